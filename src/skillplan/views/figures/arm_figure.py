"""An arm at home: its shapes, and the axes of its tip."""

from __future__ import annotations

import math

import numpy as np

from skillplan.domains.assembly.arm_summary import ArmSummary
from skillplan.physics.performance import Image
from skillplan.views.figures.picture import Picture
from skillplan.views.figures.solids import Camera, SolidPainter

_WIDTH_PX, _HEIGHT_PX, _MARGIN_PX, _HEAD_PX = 760.0, 620.0, 30.0, 46.0
_AZIMUTH_DEG = -58.0
_COLOURS = ("#7d8a97", "#e07b39")
# Length of the axes of the tip, as a share of the size of the arm.
_AXIS = 0.12


def draw_arm(summary: ArmSummary) -> Image:
    """Return the picture of an arm at home, without shapes its chain of origins."""
    solids, chain = summary.solids(), np.array(summary.chain_m())
    points = np.concatenate([chain, *(corners for _, corners, _ in solids)])
    frame = summary.tip_frame()
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
    title = f"{summary.arm.name} at home"
    picture = Picture(_WIDTH_PX, _HEIGHT_PX, title)
    picture.image(painter.image())
    joints = [camera.pixel(point) for point in chain]
    if not solids:
        picture.line(joints, "muted", 3.0)
    for end, name in zip(ends, "xyz", strict=True):
        picture.line((camera.pixel(frame[:3, 3]), camera.pixel(end)), "ink", 1.6)
        picture.label(camera.pixel(end), name, bold=True)
    picture.label((_MARGIN_PX, _MARGIN_PX), title, size_px=15.0, anchor="start", bold=True)
    words = f"tip {summary.tip}, reach {summary.reach_m:.2f} m"
    picture.label((_MARGIN_PX, _MARGIN_PX + 20.0), words, anchor="start")
    pixels = picture.pixels(1.6)
    return Image(pixels.shape[1], pixels.shape[0], pixels[:, :, :3].tobytes())
