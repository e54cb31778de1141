"""Colours, name tags and captions of a cell: the same whoever draws it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from skillplan.task.motion import Point
from skillplan.task.scene import Scene
from skillplan_simulation.colours import (
    ALARMS,
    ARM_COLOUR,
    DOCK_COLOUR,
    FEEDER_COLOUR,
    HAND_COLOUR,
    PALE,
    PALETTE,
    TABLE_COLOUR,
    Colour,
    colour_number,
)
from skillplan_simulation.pictures.annotations import Notes
from skillplan_simulation.simulator import FINGERS, HAND, ROBOT, TABLE, World

# How places end where parts and tools are taken.
_FEEDER, _DOCK = ".start)", "holder)"
# What is so near to its feeder has its own name there [m].
_NEAR_M = 0.04
# The radius of a mark of a place on the table [m].
PLACE_M = 0.022

Named = tuple[str, Point]


class SeenCell:
    """Says what things are called in pictures, and what colour they have.

    Parameters
    ----------
    scene
        What bodies and tools there are.
    labels
        Whether bodies, feeders and docks have name tags.
    """

    def __init__(self, scene: Scene, *, labels: bool) -> None:
        self.scene, self.labels = scene, labels
        names = [body.name for body in scene.bodies]
        names += [tool.name for robot in scene.robots for tool in robot.tools]
        self._colours = {name: PALETTE[colour_number(scene, name) % len(PALETTE)] for name in names}

    def colour(self, name: str, culprits: Sequence[str]) -> Colour:
        """Return the colour of a body, of the table, or of arm, hand or finger."""
        if name in culprits:
            return ALARMS[min(list(culprits).index(name), len(ALARMS) - 1)]
        if name == TABLE:
            return TABLE_COLOUR
        if culprits:
            return PALE
        if name == ROBOT:
            return ARM_COLOUR
        return HAND_COLOUR if name in (HAND, *FINGERS) else self._colours[name]

    def places(self, culprits: Sequence[str] = ()) -> list[tuple[str, Point, Colour]]:
        """Return names, places and colours of feeders and docks."""
        found = []
        for robot in self.scene.robots:
            for fact, place in robot.places.items():
                if fact.endswith((_FEEDER, _DOCK)):
                    name = fact.removeprefix("at(").removesuffix(")")
                    colour = DOCK_COLOUR if fact.endswith(_DOCK) else FEEDER_COLOUR
                    found.append((name, place, PALE if culprits else colour))
        return found

    def notes(
        self, world: World, caption: str, culprits: Sequence[str], middles: Iterable[Named]
    ) -> Notes:
        """Return what is to be written onto a picture.

        Parameters
        ----------
        world
            What touches in it.
        caption
            What is under way.
        culprits
            Bodies that are to be blamed.
        middles
            Bodies, and where they are.
        """
        words = f"{' and '.join(culprits)}: {caption}" if culprits else caption
        return Notes(words, tuple(self._tags(list(middles))), _contact(world, culprits))

    def _tags(self, middles: Sequence[Named]) -> Iterable[Named]:
        if not self.labels:
            return
        yield from middles
        named: dict[tuple[str, Point], list[str]] = {}
        for fact, (x, y, _), _ in self.places():
            if all(math.dist((x, y), at[:2]) > _NEAR_M for _, at in middles):
                name, _, kind = fact.rpartition(".")
                what = "dock" if kind == _DOCK.strip(")") else "feeder"
                named.setdefault((what, (x, y, 0.0)), []).append(name)
        yield from ((f"{what} of {', '.join(names)}", at) for (what, at), names in named.items())


def _contact(world: World, culprits: Sequence[str]) -> Point | None:
    """Return where two culprits press on each other the hardest [m]."""
    found = [one for one in world.touches() if {one.first, one.second} == set(culprits)]
    if not found:
        return None
    x, y, z = max(found, key=lambda one: one.normal_n).place.tolist()
    return x, y, z
