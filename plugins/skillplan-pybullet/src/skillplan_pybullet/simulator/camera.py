"""Pictures of a simulated world, drawn by the simulator's own renderer: no display is needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import pybullet

from skillplan.physics.performance import Image
from skillplan.physics.view import FIELD_OF_VIEW_DEG, View
from skillplan_pinocchio.simulation import simulator
from skillplan_pinocchio.simulation.colours import ALARMS, PALE
from skillplan_pinocchio.simulation.simulator import ROBOT, TABLE
from skillplan_pybullet.simulator.world import World

# Half of what the view is made for: this renderer takes its time for every point.
WIDTH, HEIGHT = 640, 360

_NEAR_M, _FAR_M = 0.02, 5.0
_LIGHT = (0.4, -0.5, 1.2)


class Camera:
    """Looks at a workplace; see `skillplan_pinocchio.simulation.simulator.Camera`.

    Parameters
    ----------
    view
        From where.
    """

    def __init__(self, view: View) -> None:
        angle = view.angle
        self._view = pybullet.computeViewMatrixFromYawPitchRoll(
            view.target, view.distance_m, angle.azimuth_deg, -angle.elevation_deg, 0, 2
        )
        self._projection = pybullet.computeProjectionMatrixFOV(
            FIELD_OF_VIEW_DEG, WIDTH / HEIGHT, _NEAR_M, _FAR_M
        )

    def take(
        self, world: simulator.World, caption: str = "", culprits: Sequence[str] = ()
    ) -> Image:
        """Return a picture of a world as it is now; the simulator cannot write, or draw arrows."""
        drawn = cast("World", world)
        if culprits:
            _alarm(drawn, culprits)
        _, _, pixels, _, _ = pybullet.getCameraImage(
            WIDTH,
            HEIGHT,
            self._view,
            self._projection,
            lightDirection=_LIGHT,
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=drawn.client,
        )
        colours = np.asarray(pixels, dtype=np.uint8).reshape(HEIGHT, WIDTH, 4)[:, :, :3]
        return Image(WIDTH, HEIGHT, np.ascontiguousarray(colours).tobytes())


def _alarm(world: World, names: Sequence[str]) -> None:
    """Paint bodies, links of the hand among them, in the colours of alarm, and all else pale."""
    links = {name: link for link, name in world.link_names.items()}
    for name, number in world.numbers.items():
        if name not in (TABLE, ROBOT, *names):
            _paint(world, number, -1, PALE)
    for place, name in enumerate(names):
        colour = ALARMS[min(place, len(ALARMS) - 1)]
        if name in links:
            _paint(world, world.numbers[ROBOT], links[name], colour)
        elif name in world.numbers:
            _paint(world, world.numbers[name], -1, colour)


def _paint(world: World, number: int, link: int, colour: tuple[float, ...]) -> None:
    pybullet.changeVisualShape(number, link, rgbaColor=colour, physicsClientId=world.client)
