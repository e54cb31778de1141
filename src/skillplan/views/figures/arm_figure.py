"""An arm at home, or a tool: its shapes, and the axes of its tip."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from skillplan.domains.assembly.arm_summary import ArmSummary, Triangles, turn_outward
from skillplan.domains.assembly.tool_summary import ToolSummary
from skillplan.physics.performance import Image
from skillplan.robots.link_frames import Numbers
from skillplan.views.figures.picture import Picture
from skillplan.views.figures.solids import Camera, SolidPainter

_WIDTH_PX, _HEIGHT_PX, _MARGIN_PX, _HEAD_PX = 760.0, 620.0, 30.0, 46.0
_AZIMUTH_DEG = -58.0
_COLOURS = ("#7d8a97", "#e07b39")
# Length of the axes of the tip, as a share of the size of the arm.
_AXIS = 0.12


def draw_arm(summary: ArmSummary) -> Image:
    """Return the picture of an arm at home, without shapes its chain of origins."""
    return _draw(
        f"{summary.arm.name} at home",
        f"tip {summary.tip}, reach {summary.reach_m:.2f} m",
        summary.solids(),
        np.array(summary.chain_m()),
        summary.tip_frame(),
    )


def draw_tool(summary: ToolSummary) -> Image:
    """Return the picture of a tool that points down, with open jaws."""
    solids = []
    for at_end, piece in summary.pieces:
        hull = ConvexHull(np.array(piece))
        solids.append((int(at_end), hull.points, turn_outward(hull)))
    x_m, y_m, z_m = summary.size_m
    words = f"{x_m:.3f} x {y_m:.3f} x {z_m:.3f} m"
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    chain = np.array([[0.0, 0.0, z_m], [0.0, 0.0, 0.0]])
    return _draw(summary.model.name, words, solids, chain, down)


def _draw(
    title: str,
    words: str,
    solids: Sequence[tuple[int, Numbers, Triangles]],
    chain: Numbers,
    frame: Numbers,
) -> Image:
    points = np.concatenate([chain, *(corners for _, corners, _ in solids)])
    ends = frame[:3, 3] + _AXIS * float(np.ptp(points, axis=0).max()) * frame[:3, :3].T
    points = np.concatenate([points, ends])
    room = (
        _MARGIN_PX,
        _MARGIN_PX + _HEAD_PX,
        _WIDTH_PX - 2 * _MARGIN_PX,
        _HEIGHT_PX - 2 * _MARGIN_PX - _HEAD_PX,
    )
    camera, _ = Camera(math.radians(_AZIMUTH_DEG)).fitted(points, room, room[3])
    painter = SolidPainter(camera, _WIDTH_PX, _HEIGHT_PX)
    for number, corners, triangles in solids:
        painter.add_triangles(corners, triangles, _COLOURS[number % 2], number)
    picture = Picture(_WIDTH_PX, _HEIGHT_PX, title)
    picture.image(painter.image())
    joints = [camera.pixel(point) for point in chain]
    if not solids:
        picture.line(joints, "muted", 3.0)
    for end, name in zip(ends, "xyz", strict=True):
        picture.line((camera.pixel(frame[:3, 3]), camera.pixel(end)), "ink", 1.6)
        picture.label(camera.pixel(end), name, bold=True)
    picture.label((_MARGIN_PX, _MARGIN_PX), title, size_px=15.0, anchor="start", bold=True)
    picture.label((_MARGIN_PX, _MARGIN_PX + 20.0), words, anchor="start")
    pixels = picture.pixels(1.6)
    return Image(pixels.shape[1], pixels.shape[0], pixels[:, :, :3].tobytes())
