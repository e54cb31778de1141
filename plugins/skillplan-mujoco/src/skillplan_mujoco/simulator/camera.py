"""Pictures of a simulated world, drawn by MuJoCo's renderer: no display is needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import mujoco
import numpy as np

from skillplan.physics.performance import Image
from skillplan.physics.view import HEIGHT, WIDTH, View
from skillplan.task.scene import Scene
from skillplan_mujoco.simulator.drawing_context import drawing_context
from skillplan_mujoco.simulator.world import World
from skillplan_pinocchio.simulation import simulator
from skillplan_pinocchio.simulation.colours import (
    ALARMS,
    PALE,
    PALETTE,
    TABLE_COLOUR,
    Colour,
    colour_number,
)
from skillplan_pinocchio.simulation.simulator import FINGERS, HAND, ROBOT, TABLE

_ARM_COLOUR: Colour = (0.93, 0.93, 0.94, 1.0)
_HAND_COLOUR: Colour = (0.32, 0.33, 0.36, 1.0)
# A ring on the table where something is taken: its colour, and how wide and high it is [m].
_PLACE_COLOUR: Colour = (0.35, 0.45, 0.60, 0.55)
_PLACE_M, _PLACE_HEIGHT_M = 0.022, 0.001
# How places end where parts and tools are taken.
_DOCK = "holder)"
_TAKEN = (".start)", _DOCK)
# How long and wide the arrow at a contact is [m].
_ARROW_M, _ARROW_WIDTH_M = 0.12, 0.006
_ARROW_COLOUR: Colour = (0.10, 0.10, 0.75, 1.0)
_MOST_SHAPES = 4000


class Camera:
    """Looks at a workplace; see `skillplan_pinocchio.simulation.simulator.Camera`.

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
        self._scene, self._labels = scene, labels
        self._colours = {
            name: PALETTE[colour_number(scene, name) % len(PALETTE)]
            for name in (
                *(body.name for body in scene.bodies),
                *(tool.name for robot in scene.robots for tool in robot.tools),
            )
        }
        self._eye = mujoco.MjvCamera()
        self._eye.lookat, self._eye.distance = np.array(view.target), view.distance_m
        self._eye.azimuth = view.angle.azimuth_deg + 90.0
        self._eye.elevation = -view.angle.elevation_deg
        self._shown = mujoco.MjvOption()
        self._shown.sitegroup[:] = 0
        self._renderer: Any = None
        self._drawn: Any = None
        self._model: Any = None

    def take(
        self, world: simulator.World, caption: str = "", culprits: Sequence[str] = ()
    ) -> Image:
        """Return a picture of a world as it is now.

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
        self._mark_places(PALE if culprits else _PLACE_COLOUR)
        if self._labels:
            self._name(seen)
        self._point_at_contact(seen, culprits)
        frame = mujoco.MjrRect(0, 0, WIDTH, HEIGHT)
        mujoco.mjr_render(frame, self._drawn, self._renderer)
        words = f"{' and '.join(culprits)}: {caption}" if culprits else caption
        if words:
            corner = mujoco.mjtGridPos.mjGRID_BOTTOMLEFT.value
            font = mujoco.mjtFont.mjFONT_NORMAL.value
            mujoco.mjr_overlay(font, corner, frame, words, "", self._renderer)
        pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, frame, self._renderer)
        return Image(WIDTH, HEIGHT, np.ascontiguousarray(pixels[::-1]).tobytes())

    def _set_up(self, world: World) -> None:
        drawing_context().take_up()
        if self._model is world.model:
            return
        self._model = world.model
        self._renderer = mujoco.MjrContext(world.model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self._drawn = mujoco.MjvScene(world.model, _MOST_SHAPES)
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_REFLECTION.value] = 0
        # In software shadows take as long as all the rest.
        self._drawn.flags[mujoco.mjtRndFlag.mjRND_SHADOW.value] = 0

    def _paint(self, world: World, culprits: Sequence[str]) -> None:
        """Give every shape its colour, and hide what is not there."""
        kind = mujoco.mjtObj.mjOBJ_GEOM.value
        for shape in self._drawn.geoms[: self._drawn.ngeom]:
            if shape.objtype != kind:
                continue
            if world.is_seen(shape.objid):
                shape.rgba = self._colour(world.cell.labels[shape.objid], culprits)
            else:
                shape.rgba = (0.0, 0.0, 0.0, 0.0)

    def _colour(self, name: str, culprits: Sequence[str]) -> Colour:
        if name in culprits:
            return ALARMS[min(list(culprits).index(name), len(ALARMS) - 1)]
        if name == TABLE:
            return TABLE_COLOUR
        if culprits:
            return PALE
        if name == ROBOT:
            return _ARM_COLOUR
        return _HAND_COLOUR if name in (HAND, *FINGERS) else self._colours[name]

    def _mark_places(self, colour: Colour) -> None:
        """Draw rings where feeders and docks are."""
        for robot in self._scene.robots:
            for name, (x_m, y_m, _) in robot.places.items():
                if not name.endswith(_TAKEN):
                    continue
                where = np.array((x_m, y_m, _PLACE_HEIGHT_M))
                size = np.array((_PLACE_M, _PLACE_HEIGHT_M, 0.0))
                kind = mujoco.mjtGeom.mjGEOM_CYLINDER
                label = name.removeprefix("at(").removesuffix(")")
                self._add(
                    kind,
                    size,
                    where,
                    colour,
                    label if self._labels and name.endswith(_DOCK) else "",
                )

    def _name(self, world: World) -> None:
        for name in world.bodies:
            if all(world.is_seen(geom) for geom in world.geoms(name)):
                size, where = np.full(3, 0.001), world.centre(name)
                self._add(mujoco.mjtGeom.mjGEOM_SPHERE, size, where, (0, 0, 0, 0.01), name)

    def _point_at_contact(self, world: World, culprits: Sequence[str]) -> None:
        """Draw an arrow to where two culprits press on each other the hardest."""
        found = [one for one in world.touches() if {one.first, one.second} == set(culprits)]
        if not found:
            return
        tip = np.array(max(found, key=lambda one: one.normal_n).place)
        azimuth = np.radians(self._eye.azimuth)
        # From above, and from the left of the picture, where it hides nothing of the contact.
        away = np.array((-np.sin(azimuth), np.cos(azimuth), 1.0)) / np.sqrt(2.0)
        shape = self._add(mujoco.mjtGeom.mjGEOM_ARROW, np.zeros(3), np.zeros(3), _ARROW_COLOUR, "")
        # The simulator draws an arrow about where it is said to begin.
        half = _ARROW_M / 2 * away
        arrow = mujoco.mjtGeom.mjGEOM_ARROW.value
        mujoco.mjv_connector(shape, arrow, _ARROW_WIDTH_M, tip + half, tip - half)

    def _add(self, kind: Any, size: Any, where: Any, colour: Colour, label: str) -> Any:
        """Add a shape that is no body's."""
        shape = self._drawn.geoms[self._drawn.ngeom]
        mujoco.mjv_initGeom(
            shape, kind.value, size, where, np.eye(3).ravel(), np.array(colour, np.float32)
        )
        shape.label = label
        self._drawn.ngeom += 1
        return shape
