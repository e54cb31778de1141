"""An exploded view as PNG, of bodies that are no task yet."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.task.pose import Point, Pose
from skillplan.task.scene import Body
from skillplan.views.pictures.added_parts import AddedPart, role_of
from skillplan.views.pictures.exploded_picture import exploded_drawing
from skillplan.views.pictures.raster_canvas import raster
from skillplan.views.video_file import picture_bytes

_SCALE = 1.6


def exploded_png(name: str, added: Sequence[tuple[Body, Pose, Point]]) -> bytes:
    """Return the picture; equal bodies make equal bytes.

    Parameters
    ----------
    name
        Of the product.
    added
        Bodies in the order in which they are added, at least one; where each belongs, and the unit
        vector in which it comes.
    """
    parts = [
        AddedPart(body, goal, along, role_of(number))
        for number, (body, goal, along) in enumerate(added)
    ]
    return picture_bytes(raster(exploded_drawing(name, parts), scale=_SCALE))
