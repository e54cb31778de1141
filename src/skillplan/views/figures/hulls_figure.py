"""The hulls that a collision detector compares, in 3-D."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence, Set
from operator import itemgetter

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray
from PIL import Image as PillowImage

from skillplan.collision.hulls import Hull, HullRole, HullScene
from skillplan.physics.performance import Image
from skillplan.task.motion import Point
from skillplan.views.figures import figure_style as style
from skillplan.views.figures.figure_file import render_figure

_WIDE_IN, _TALL_IN, _LEGEND_IN = 7.6, 5.8, 0.7
_ELEVATION_DEG, _AZIMUTH_DEG = 26.0, -62.0
_LOOKS = {
    HullRole.MOVING: (style.BLUE, 0.16, "swept by hand, load and arm"),
    HullRole.STANDING: (style.GREY, 0.45, "stands there"),
    HullRole.MET: (style.RED, 0.75, "named by the verdict"),
}
# Loss of brightness of faces that look away from the light.
_SHADE = 0.45
_LIGHT = np.array([0.3, -0.5, 0.8])
_MARGIN_M = 0.02
# Bodies within this distance of the motion are shown, too [m].
_BESIDE_M = 0.1
_MOST_TICKS = 6
# A name stands above the corners within this distance of the highest [m].
_TOP_M = 0.005
# Order in front of all hulls, which matplotlib numbers by their depth.
_IN_FRONT = 10_000
# Width of a letter and distance of lines, as shares of the font size.
_LETTER, _LINE = 0.6, 1.15


@style.in_house_style
def draw_hulls(scene: HullScene, heading: style.Heading) -> Figure:
    """Draw the hulls of a swept motion and of bodies near it.

    Names are shown for the bodies that an infeasible verdict blames, or else for all bodies that
    do not move.

    Parameters
    ----------
    scene
        Scene with at least one hull.

    Raises
    ------
    ValueError
        If the scene is empty.
    """
    if not scene.hulls:
        raise ValueError("No hull to draw.")
    head_in = heading.height_in(_WIDE_IN - 0.4)
    height_in = head_in + _TALL_IN + _LEGEND_IN
    figure = style.create_sheet(_WIDE_IN, height_in, heading)
    place = (0.02, _LEGEND_IN / height_in, 0.96, _TALL_IN / height_in)
    axes = figure.add_axes(place, projection="3d")
    assert isinstance(axes, Axes3D)
    shown = _select_shown(scene.hulls)
    for hull in shown:
        _draw(axes, hull)
    if scene.touches:
        x, y, z = zip(*scene.touches, strict=True)
        axes.plot(
            x,
            y,
            z,
            "*",
            color=style.INK,
            markerfacecolor="#ffffff",
            markersize=13,
            gid="touches",
            zorder=_IN_FRONT,
        )
    _lay_out(axes, shown)
    _write_names(axes, shown, scene.subjects)
    used = [role for role in HullRole if any(hull.role is role for hull in shown)]
    figure.legend(
        [Patch(facecolor=_LOOKS[role][0], alpha=max(0.4, _LOOKS[role][1])) for role in used],
        [_LOOKS[role][2] for role in used],
        loc="lower left",
        bbox_to_anchor=(0.03, 0.05 / height_in),
        ncols=len(used),
        borderaxespad=0.0,
    )
    return figure


def render_image(figure: Figure, dpi: int = 150) -> Image:
    """Return a figure as an image of a resolution [dots per inch]."""
    with PillowImage.open(io.BytesIO(render_figure(figure, ".png", dpi))) as opened:
        picture = opened.convert("RGB")
    return Image(*picture.size, picture.tobytes())


def _draw(axes: Axes3D, hull: Hull) -> None:
    colour, opacity, _ = _LOOKS[hull.role]
    corners = np.array(hull.vertices)
    faces = corners[np.array(hull.triangles, dtype=int).reshape(-1, 3)]
    shades = 1.0 - _SHADE * (1.0 - _compute_facing(faces, corners.mean(axis=0))) / 2
    colours = [(*(shade * np.array(to_rgb(colour))), opacity) for shade in shades]
    collection = Poly3DCollection(faces, facecolors=colours, edgecolors="none", linewidths=0)
    collection.set_gid(f"{hull.role} {hull.name}")
    axes.add_collection3d(collection)


def _compute_facing(faces: NDArray[np.float64], middle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cosine between each face's outward normal and the light, shape (faces,)."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    outward = np.sign(np.einsum("ij,ij->i", normals, faces.mean(axis=1) - middle))
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-15)
    light = _LIGHT / np.linalg.norm(_LIGHT)
    return np.asarray(outward * (normals @ light) / lengths)


def _list_named(hulls: Sequence[Hull], subjects: Set[str]) -> Iterator[tuple[str, Point]]:
    """Yield the name of each named body and its place above the highest corner."""
    bodies: dict[str, list[Point]] = {}
    for hull in hulls:
        if hull.name in subjects or (not subjects and hull.role is not HullRole.MOVING):
            bodies.setdefault(hull.name, []).extend(hull.vertices)
    for name, corners in bodies.items():
        places = np.array(corners)
        top = places[places[:, 2] > places[:, 2].max() - _TOP_M].mean(axis=0)
        yield name, (float(top[0]), float(top[1]), float(places[:, 2].max()))


def _write_names(axes: Axes3D, hulls: Sequence[Hull], subjects: Set[str]) -> None:
    """Write the names of bodies above them, in front of everything, without overlaps."""
    points = 72 / axes.get_figure().dpi
    written: list[tuple[float, float, float]] = []
    for body, above in _list_named(hulls, subjects):
        x, y, _ = proj3d.proj_transform(*above, axes.get_proj())
        across, up = (points * float(at) for at in axes.transData.transform((x, y)))
        half, lifted = _LETTER * style.SMALL_PT * len(body) / 2, up
        for other, height, wide in sorted(written, key=itemgetter(1)):
            if abs(across - other) < half + wide and abs(lifted - height) < _LINE * style.SMALL_PT:
                lifted = height + _LINE * style.SMALL_PT
        written.append((across, lifted, half))
        axes.annotate(
            body,
            (x, y),
            (0.0, lifted - up),
            textcoords="offset points",
            size=style.SMALL_PT,
            ha="center",
            va="bottom",
            zorder=_IN_FRONT,
            annotation_clip=False,
            path_effects=[withStroke(linewidth=2.5, foreground="#ffffff")],
        )


def _select_shown(hulls: Sequence[Hull]) -> list[Hull]:
    """Return moving and met hulls, hulls near them, and hulls inside the box of all these."""
    moving = [hull for hull in hulls if hull.role is not HullRole.STANDING]
    low, high = _find_box(moving or hulls)
    near = {
        hull.name
        for hull in hulls
        if all(
            low[i] - _BESIDE_M < x < high[i] + _BESIDE_M for i, x in enumerate(_find_middle(hull))
        )
    }
    low, high = _find_box([hull for hull in hulls if hull.name in near] or hulls)
    corners = {hull.name: np.array(hull.vertices) for hull in hulls}
    near |= {name for name, at in corners.items() if (low <= at).all() and (at <= high).all()}
    return [hull for hull in hulls if hull.name in near]


def _lay_out(axes: Axes3D, hulls: Sequence[Hull]) -> None:
    """Show hulls to scale."""
    low, high = _find_box(hulls)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low)
    axes.view_init(_ELEVATION_DEG, _AZIMUTH_DEG)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.tick_params(labelsize=style.SMALL_PT - 1)
    for axis, extent_m in zip((axes.xaxis, axes.yaxis, axes.zaxis), high - low, strict=True):
        axis.set_major_locator(MaxNLocator(max(1, round(_MOST_TICKS * extent_m / max(high - low)))))


def _find_middle(hull: Hull) -> NDArray[np.float64]:
    return np.asarray(np.mean(hull.vertices, axis=0))


def _find_box(hulls: Sequence[Hull]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper corner of the box around hulls, with a margin [m]."""
    corners = np.concatenate([np.array(hull.vertices) for hull in hulls])
    return corners.min(axis=0) - _MARGIN_M, corners.max(axis=0) + _MARGIN_M
