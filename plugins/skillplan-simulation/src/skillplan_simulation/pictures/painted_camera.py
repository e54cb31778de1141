"""Paints a simulated cell without any graphics library: the same picture on any machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.physics.performance import HEIGHT, WIDTH, Image, View
from skillplan.task.scene import Scene
from skillplan_simulation.colours import Colour
from skillplan_simulation.pictures.annotations import Notes, Projection, annotated
from skillplan_simulation.pictures.cell_parts import CellParts, Part
from skillplan_simulation.pictures.rasteriser import ground, shade, smoothed, solid
from skillplan_simulation.pictures.seen_cell import PLACE_M, SeenCell
from skillplan_simulation.simulator import TABLE, Arm, World

# Half the side of the table [m].
_TABLE_M = 1.5
# Where light comes from: to the left of the camera, behind it, and above.
_ASIDE, _BEHIND, _ABOVE = -0.45, 0.30, 1.0


class PaintedCamera:
    """Takes pictures of worlds from one viewpoint.

    Parameters
    ----------
    scene
        What bodies and tools there are.
    view
        From where.
    labels
        Whether bodies, feeders and docks have name tags.
    """

    def __init__(self, scene: Scene, view: View, *, labels: bool = False) -> None:
        self._view, self._seen, self._parts = view, SeenCell(scene, labels=labels), CellParts(scene)
        right, up, back = (np.array(axis) for axis in view.angle.axes)
        seen = Projection(view, WIDTH, HEIGHT)
        self._focal, self._eye = seen.focal, np.array(seen.eye)
        self._axes = np.stack([right, up, -back])
        self._frame = np.hstack([self._axes, (-self._axes @ self._eye)[:, None]])
        level = np.array((back[0], back[1], 0.0))
        level = level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-6 else up
        lamp = _ASIDE * right + _BEHIND * level + _ABOVE * np.array((0.0, 0.0, 1.0))
        self._sun = lamp / np.linalg.norm(lamp)
        self._lamp = self._axes @ self._sun
        self._grounds: dict[bool, tuple[Any, Any, Any]] = {}

    def shot(
        self, world: World, arm: Arm, caption: str = "", culprits: Sequence[str] = ()
    ) -> Callable[[], Image]:
        """Return a function that paints the world as it is now, on any thread.

        Parameters
        ----------
        world, arm
            World and arm of the same simulator.
        caption
            Text below the picture.
        culprits
            Bodies in alarm colours, everything else pale; of the robot, its hand or a finger. An
            arrow points to the contact between them.
        """
        parts = self._parts.of(world, arm)
        bodies = set(world.bodies)
        middles = [
            (part.name, (float(x), float(y), float(z)))
            for part in parts
            if part.name in bodies and self._seen.labels
            for x, y, z in [part.middle]
        ]
        notes = self._seen.notes(world, caption, culprits, middles)
        blamed = tuple(culprits)
        return lambda: self._painted(parts, blamed, notes)

    def _painted(self, parts: Sequence[Part], culprits: Sequence[str], notes: Notes) -> Image:
        buffers = self._ground(culprits)
        image, _, shown = buffers
        for number, part in enumerate(parts, start=1):
            frame = self._axes @ part.frame
            frame[:, 3] += self._frame[:, 3]
            corners, normals = part.surface.corners, part.surface.normals
            colour = _bytes_of(self._seen.colour(part.name, culprits))
            solid(corners, normals, frame, colour, self._lamp, number, self._focal, buffers)
        for part in parts:
            corners = part.surface.corners
            shade(corners, part.frame, self._sun, self._frame, self._focal, image, shown)
        return annotated(WIDTH, HEIGHT, smoothed(image, shown).tobytes(), self._view, notes)

    def _ground(self, culprits: Sequence[str]) -> tuple[Any, Any, Any]:
        """Return buffers with what is behind all; it is worked out once."""
        pale = bool(culprits)
        if pale not in self._grounds:
            size = (HEIGHT, WIDTH)
            made = (
                np.zeros((*size, 3), np.uint8),
                np.zeros(size, np.float32),
                np.zeros(size, np.int16),
            )
            discs = np.zeros((0, 6))
            found = [
                (place[0], place[1], PLACE_M, *_bytes_of(colour))
                for _, place, colour in self._seen.places(culprits)
            ]
            discs = np.array(found) if found else discs
            table = _bytes_of(self._seen.colour(TABLE, culprits))
            ground(self._eye, self._axes, self._focal, _TABLE_M, table, discs, made)
            self._grounds[pale] = made
        image, near, shown = self._grounds[pale]
        return image.copy(), near.copy(), shown.copy()


def _bytes_of(colour: Colour) -> NDArray[np.float64]:
    return 255.0 * np.array(colour[:3])
