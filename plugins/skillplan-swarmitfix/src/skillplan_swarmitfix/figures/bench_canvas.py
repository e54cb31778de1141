"""The bench to scale: pins, triangles and names, as the ground of other figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.legend_handler import HandlerPatch
from matplotlib.patches import Circle, FancyArrow, Polygon
from numpy.typing import NDArray

from skillplan.domains.domain import Account
from skillplan.views.figures.figure_request import FigureRequest
from skillplan.views.figures.figure_style import (
    FAINT,
    LEAST_PT,
    LEAST_WIDTH_IN,
    MUTED,
    PAPER,
    SMALL_PT,
    Heading,
    add_axes_in,
    create_sheet,
    fit_legend,
)
from skillplan_swarmitfix.bench.bench import Bench

_PITCH_IN = 1.25
_MOST_WIDTH_IN, _MOST_HEIGHT_IN = 15.0, 12.5
_LEFT_IN, _RIGHT_IN, _AXIS_IN, _BORDER_IN = 0.75, 0.3, 0.55, 0.18


@dataclass(frozen=True)
class BenchCanvas:
    """A figure with axes to scale, in metres."""

    bench: Bench
    figure: Figure
    axes: Axes
    inch_per_m: float
    low_m: tuple[float, float]
    size_in: tuple[float, float]

    @property
    def pitch_in(self) -> float:
        """Distance of neighbouring pins on paper [in]."""
        return self.bench.pitch_m * self.inch_per_m

    def to_inches(self, point_m: Sequence[float]) -> tuple[float, float]:
        """Return a point [m] relative to the lower left corner of the axes [in]."""
        return (
            (float(point_m[0]) - self.low_m[0]) * self.inch_per_m,
            (float(point_m[1]) - self.low_m[1]) * self.inch_per_m,
        )

    def to_metres(self, point_in: Sequence[float]) -> tuple[float, float]:
        """Return the point [m] of a place on paper [in]."""
        return (
            point_in[0] / self.inch_per_m + self.low_m[0],
            point_in[1] / self.inch_per_m + self.low_m[1],
        )

    def font_pt(self, share: float, most_pt: float = SMALL_PT) -> float | None:
        """Return a font size in proportion to the pitch [pt]; None if illegible."""
        size = min(most_pt, share * self.pitch_in)
        return size if size >= LEAST_PT else None

    def triangles(self) -> NDArray[np.float64]:
        """Return the corners of every position [m], shape (positions, 3, 2)."""
        corners: NDArray[np.float64] = self.bench.pins_m[self.bench.legs]
        return corners

    def draw_lattice(self, faces: Any = PAPER, *, pins: bool = True) -> None:
        """Draw the triangles, filled or not, and the pins with their names if there is room."""
        lattice = PolyCollection(
            self.triangles(),  # type: ignore[arg-type]
            facecolors=faces,
            edgecolors=FAINT,
            linewidths=0.8,
            zorder=1,
        )
        lattice.set_gid("positions")
        self.axes.add_collection(lattice)
        if not pins:
            return
        size_pt = self.font_pt(4.6, 5.75)
        diameter_pt = 0.18 * self.pitch_in * 72 if size_pt else 0.07 * self.pitch_in * 72
        marks = self.axes.scatter(
            self.bench.pins_m[:, 0],
            self.bench.pins_m[:, 1],
            s=diameter_pt**2,
            facecolors=PAPER if size_pt else FAINT,
            edgecolors="#9aa0a6",
            linewidths=0.7 if size_pt else 0.0,
            zorder=4,
        )
        marks.set_gid("pins")
        if size_pt:
            for pin, (x_m, y_m) in enumerate(self.bench.pins_m.tolist()):
                self.axes.text(
                    x_m,
                    y_m,
                    self.bench.pin_name(pin),
                    ha="center",
                    va="center_baseline",
                    size=size_pt,
                    color=MUTED,
                    zorder=5,
                )

    def outline(self, position: int, **style: Any) -> Polygon:
        """Draw the outline of a position a little inside its edges, and return it."""
        corners = self.triangles()[position]
        centre = corners.mean(axis=0)
        polygon = Polygon(centre + 0.95 * (corners - centre), closed=True, **style)
        self.axes.add_patch(polygon)
        return polygon

    def add_legend(self, entries: Sequence[tuple[Artist, str]]) -> None:
        """Put the legend below the axes, into the room that `open_bench_canvas` leaves."""
        labels = [label for _, label in entries]
        width_in, height_in = self.figure.get_size_inches()
        columns, _ = fit_legend(labels, width_in - 0.4)
        self.figure.legend(
            [artist for artist, _ in entries],
            labels,
            loc="lower left",
            bbox_to_anchor=(0.15 / width_in, 0.04 / height_in),
            ncols=columns,
            handlelength=1.8,
            columnspacing=1.4,
            borderaxespad=0.0,
            handler_map={
                Circle: HandlerPatch(patch_func=_make_circle),
                FancyArrow: HandlerPatch(patch_func=_make_arrow),
            },
        )


def _make_circle(*, width: float, height: float, fontsize: float, **_: Any) -> Circle:
    """Return the mark of a circle in a legend."""
    return Circle((width / 2, height / 2), 0.62 * fontsize)


def _make_arrow(*, width: float, height: float, fontsize: float, **_: Any) -> FancyArrow:
    """Return the mark of an arrow in a legend."""
    return FancyArrow(
        0.0,
        height / 2,
        width,
        0.0,
        width=0.12 * fontsize,
        head_width=0.6 * fontsize,
        head_length=0.65 * fontsize,
        length_includes_head=True,
    )


def open_bench_canvas(
    bench: Bench,
    heading: Heading,
    *,
    legend: Sequence[str] = (),
    around_m: NDArray[np.float64] | None = None,
    right_in: float = 0.0,
) -> BenchCanvas:
    """Return an empty canvas for a bench, large enough for names in its triangles if possible.

    Parameters
    ----------
    around_m
        Points off the bench that must be visible, too [m], shape (n, 2).
    right_in
        Free room on the right [in].
    """
    points_m = bench.pins_m
    if around_m is not None and len(around_m):
        points_m = np.concatenate([points_m, around_m])
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    border_m = 0.12 * bench.pitch_m
    low, high = low - border_m, high + border_m
    span_m = high - low
    inch_per_m = min(
        _PITCH_IN / bench.pitch_m, _MOST_WIDTH_IN / span_m[0], _MOST_HEIGHT_IN / span_m[1]
    )
    axes_w, axes_h = (float(side) for side in span_m * inch_per_m)
    width_in = max(LEAST_WIDTH_IN, _LEFT_IN + axes_w + _RIGHT_IN + right_in)
    _, legend_in = fit_legend(list(legend), width_in - 0.4)
    head_in = heading.height_in(width_in - 0.4)
    height_in = head_in + axes_h + _AXIS_IN + legend_in
    figure = create_sheet(width_in, height_in, heading)
    left_in = _LEFT_IN + (width_in - _LEFT_IN - axes_w - _RIGHT_IN - right_in) / 2
    axes = add_axes_in(figure, left_in, _AXIS_IN + legend_in, axes_w, axes_h)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.spines[["top", "right"]].set_visible(False)
    return BenchCanvas(
        bench, figure, axes, inch_per_m, (float(low[0]), float(low[1])), (axes_w, axes_h)
    )


def get_requested_bench(request: FigureRequest, account: Account | None = None) -> Bench:
    """Return the lattice of a request's file, from the account of a solved file if given.

    Raises
    ------
    OptionError
        If the file is of another kind.
    """
    known = request.problem.account({}) if account is None else account
    shape = known.document.get("bench")
    if shape is None:
        raise request.unfit(
            f"it shows a bench, but the file is of kind {request.problem.kind}. Figures of any "
            "kind are rewards, learning and q-values"
        )
    return Bench(shape["rows"], shape["cols"], shape["pitch_m"], shape["actions"])
