"""Pictures of a simulated world, drawn by MuJoCo's renderer: no display is needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import mujoco
import numpy as np

from skillplan.physics.performance import HEIGHT, WIDTH, Image, View
from skillplan.task.motion import Point
from skillplan.task.scene import Scene
from skillplan_mujoco.simulator.drawing_context import DrawingContext
from skillplan_mujoco.simulator.world import World
from skillplan_simulation import simulator
from skillplan_simulation.pictures.annotations import annotated
from skillplan_simulation.pictures.seen_cell import PLACE_M, SeenCell

# How high marks of places are [m].
_PLACE_HEIGHT_M = 0.0005
_MOST_SHAPES = 4000


class Camera:
    """Looks at a workplace; see `skillplan_simulation.simulator.Camera`.

    Parameters
    ----------
    scene
        What bodies and tools there are.
    view
        From where.
    context
        Where to draw.
    labels
        Whether bodies, feeders and docks have name tags.
    """

    def __init__(
        self, scene: Scene, view: View, context: DrawingContext, *, labels: bool = False
    ) -> None:
        self._view, self._seen, self._context = view, SeenCell(scene, labels=labels), context
        self._docks = {tool.name: tool.holder for tool in scene.robots[0].tools}
        self._eye = mujoco.MjvCamera()
        self._eye.lookat, self._eye.distance = np.array(view.target), view.distance_m
        self._eye.azimuth = view.angle.azimuth_deg + 90.0
        self._eye.elevation = -view.angle.elevation_deg
        self._shown = mujoco.MjvOption()
        self._shown.sitegroup[:] = 0
        self._renderer: Any = None
        self._drawn: Any = None
        self._model: Any = None

    def shot(
        self,
        world: simulator.World,
        arm: simulator.Arm,
        caption: str = "",
        culprits: Sequence[str] = (),
    ) -> Callable[[], Image]:
        """Draw a picture of a world as it is now, and return what writes on it.

        Raises
        ------
        ValueError
            If this machine has nothing to draw with, in words.
        """
        seen = cast("World", world)
        self._set_up(seen)
        mujoco.mjv_updateScene(
            seen.model,
            seen.data,
            self._shown,
            mujoco.MjvPerturb(),
            self._eye,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._drawn,
        )
        self._paint(seen, culprits)
        self._mark_places(culprits)
        frame = mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
        mujoco.mjr_render(frame, self._drawn, self._renderer)
        pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, frame, self._renderer)
        notes = self._seen.notes(world, caption, culprits, _middles(seen))
        return lambda: annotated(
            WIDTH, HEIGHT, np.ascontiguousarray(pixels[::-1]).tobytes(), self._view, notes
        )

    def _set_up(self, world: World) -> None:
        self._context.take_up()
        if self._model is world.model:
            return
        self._model = world.model
        self._renderer = mujoco.MjrContext(world.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self._drawn = mujoco.MjvScene(world.model, _MOST_SHAPES)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_REFLECTION.value] = 0
        # In software shadows take as long as all the rest.
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW.value] = not self._context.is_software

    def _paint(self, world: World, culprits: Sequence[str]) -> None:
        """Give every shape its colour, have tools lie in their docks, hide what is not there."""
        kind = mujoco.mjtObj.mjOBJ_GEOM.value
        for shape in self._drawn.geoms[: self._drawn.ngeom]:
            if shape.objtype != kind:
                continue
            name = world.cell.labels[shape.objid]
            lies = name in self._docks and name not in world.numbers
            if lies:
                _lay(shape, world, int(world.model.geom_bodyid[shape.objid]), self._docks[name])
            if lies or world.is_seen(shape.objid):
                shape.rgba = self._seen.colour(name, culprits)
            else:
                shape.rgba = (0.0, 0.0, 0.0, 0.0)

    def _mark_places(self, culprits: Sequence[str]) -> None:
        """Draw marks on the table where feeders and docks are."""
        kind = mujoco.mjtGeom.mjGEOM_CYLINDER.value
        size = np.array((PLACE_M, _PLACE_HEIGHT_M, 0.0))
        for _, (x_m, y_m, _z), colour in self._seen.places(culprits):
            shape = self._drawn.geoms[self._drawn.ngeom]
            where = np.array((x_m, y_m, _PLACE_HEIGHT_M))
            rgba = np.array(colour, np.float32)
            mujoco.mjv_initGeom(shape, kind, size, where, np.eye(3).ravel(), rgba)
            self._drawn.ngeom += 1


def _lay(shape: Any, world: World, body: int, dock: Point) -> None:
    """Draw a shape as if its body were upright in a dock."""
    turned = np.array(world.data.xmat[body]).reshape(3, 3).T
    shape.pos = np.array(dock) + turned @ (np.array(shape.pos) - world.data.xpos[body])
    shape.mat = turned @ np.array(shape.mat)


def _middles(world: World) -> list[tuple[str, Point]]:
    """Return names of bodies, and where they are."""
    found: list[tuple[str, Point]] = []
    for name in world.bodies:
        x, y, z = world.centre(name).tolist()
        found.append((name, (x, y, z)))
    return found
