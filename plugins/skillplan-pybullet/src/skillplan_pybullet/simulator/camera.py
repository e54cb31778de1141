"""Pictures of a simulated world, drawn by the simulator's own renderer: no display is needed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import pybullet

from skillplan.physics.performance import Image
from skillplan.task.motion import Point
from skillplan_pybullet.simulator.world import World

WIDTH, HEIGHT = 640, 480

_DISTANCE_M = 0.62
_YAW_DEG, _PITCH_DEG = 52.0, -28.0
_FIELD_OF_VIEW_DEG = 45.0
_NEAR_M, _FAR_M = 0.02, 5.0
# Of the picture's width and height, so much is filled by what has to be seen, from no nearer.
_FILLED = 0.92
_NEAREST_M = 0.3
_LIGHT = (0.4, -0.5, 1.2)
# The first culprit is red, the others are orange, so that they can be distinguished.
_ALARM = (0.90, 0.10, 0.10, 1.0)
_SECOND_ALARM = (1.0, 0.55, 0.05, 1.0)


class Camera:
    """Looks at a point of the workplace, from the side that the arm does not hide.

    Parameters
    ----------
    target
        What it looks at [m].
    distance_m
        From how far off [m].
    """

    def __init__(self, target: Point, distance_m: float = _DISTANCE_M) -> None:
        self._view = pybullet.computeViewMatrixFromYawPitchRoll(
            target, distance_m, _YAW_DEG, _PITCH_DEG, 0, 2
        )
        self._projection = pybullet.computeProjectionMatrixFOV(
            _FIELD_OF_VIEW_DEG, WIDTH / HEIGHT, _NEAR_M, _FAR_M
        )

    @classmethod
    def about(cls, points: Sequence[Point]) -> Camera:
        """Return a camera that sees all of some points, from as near as it can.

        Parameters
        ----------
        points
            At least one [m].
        """
        corners = np.asarray(points, dtype=np.float64)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        x_m, y_m, z_m = middle.tolist()
        matrix = pybullet.computeViewMatrixFromYawPitchRoll(
            (x_m, y_m, z_m), 1, _YAW_DEG, _PITCH_DEG, 0, 2
        )
        seen = (corners - middle) @ np.asarray(matrix).reshape(4, 4)[:3, :3]
        half = math.tan(math.radians(_FIELD_OF_VIEW_DEG) / 2) * _FILLED
        # A point at the middle's depth plus its own must lie within the pyramid of view.
        wide_m = np.abs(seen[:, 0]) / (half * WIDTH / HEIGHT) + seen[:, 2]
        high_m = np.abs(seen[:, 1]) / half + seen[:, 2]
        return cls((x_m, y_m, z_m), max(_NEAREST_M, float(max(wide_m.max(), high_m.max()))))

    def take(self, world: World) -> Image:
        """Return a picture of a world as it is now."""
        _, _, pixels, _, _ = pybullet.getCameraImage(
            WIDTH,
            HEIGHT,
            self._view,
            self._projection,
            lightDirection=_LIGHT,
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=world.client,
        )
        colours = np.asarray(pixels, dtype=np.uint8).reshape(HEIGHT, WIDTH, 4)[:, :, :3]
        return Image(WIDTH, HEIGHT, np.ascontiguousarray(colours).tobytes())


def alarm(world: World, names: Iterable[str]) -> None:
    """Paint bodies in the colours of alarm."""
    colour = _ALARM
    for name in names:
        if name in world.bodies:
            pybullet.changeVisualShape(
                world.numbers[name], -1, rgbaColor=colour, physicsClientId=world.client
            )
            colour = _SECOND_ALARM
