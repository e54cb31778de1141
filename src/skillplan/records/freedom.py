"""In which directions a part of a product can be moved away, and what stands in the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from skillplan.records import schemas
from skillplan.records.stored.product_relation import Obstacle, ProductRelation
from skillplan.task.pose import Point
from skillplan.task.state import State
from skillplan.task.task import Task

_MM_PER_M = 1000.0


@dataclass(frozen=True, slots=True)
class Way:
    """A straight move without end.

    Parameters
    ----------
    direction
        Unit vector in the world of the task.
    in_file
        The same in the file of the product.
    obstacles
        What is in its way, the nearest first; empty where it is free.
    """

    direction: Point
    in_file: Point
    obstacles: tuple[Obstacle, ...]


@dataclass(frozen=True)
class Freedom:
    """The ways of one part among the parts that are in place.

    Parameters
    ----------
    task
        Of the product.
    part
        Its name in the task.
    present
        The other parts in place, in the order of the file.
    tolerance_m
        Radius of the disc that has to be blocked before a pair is.
    ways
        In the order of the file.
    files
        What was drawn of it, such as ``picture``, and where.
    """

    task: Task
    part: str
    present: tuple[str, ...]
    tolerance_m: float
    ways: tuple[Way, ...]
    files: Mapping[str, str] = field(default_factory=dict, hash=False)

    def drawn(self, files: Mapping[str, str]) -> Freedom:
        """Return it with what was drawn of it."""
        return replace(self, files=files)

    @property
    def free(self) -> bool:
        """Whether at least one way is."""
        return any(not way.obstacles for way in self.ways)

    @property
    def blockers(self) -> tuple[str, ...]:
        """The parts that are in its way in some direction, each once."""
        found = (one.part for way in self.ways for one in way.obstacles)
        return tuple(dict.fromkeys(found))

    def document(self) -> dict[str, Any]:
        """Return it as JSON; lengths are millimetres, directions and points the task's."""
        return {
            "schema": schemas.FREEDOM,
            "task": {"name": self.task.name, "sha256": self.task.sha256},
            "part": self.part,
            "free": self.free,
            "present": list(self.present),
            "tolerance_mm": _mm(self.tolerance_m),
            "directions": [
                {
                    "direction": list(way.direction),
                    "in_file": list(way.in_file),
                    "free": not way.obstacles,
                    "blocked_by": [
                        {
                            "part": one.part,
                            "distance_mm": _mm(one.distance_m),
                            "width_mm": _mm(one.width_m),
                            "point_mm": [_mm(value) for value in one.point_m],
                            "sensitive": one.sensitive,
                        }
                        for one in way.obstacles
                    ],
                }
                for way in self.ways
            ],
            "files": dict(self.files),
        }


def freedom(
    task: Task, relation: ProductRelation, part: str, state: State | None = None
) -> Freedom:
    """Return in which directions a part is free.

    Parameters
    ----------
    task
        That `relation` was read beside.
    relation
        Of the product.
    part
        Its name in the task.
    state
        Whose parts are in place; None for the whole product.

    Raises
    ------
    OptionError
        If there is no such part.
    """
    name = relation.part(part)
    others = (one for one in relation.parts if one != name)
    present = tuple(one for one in others if state is None or in_place(task, one, state))
    ways = tuple(
        Way(
            direction,
            in_file,
            tuple(one for one in relation.obstacles.get((name, number), ()) if one.part in present),
        )
        for number, (direction, in_file) in enumerate(relation.directions)
    )
    return Freedom(task, name, present, relation.tolerance_m, ways)


def in_place(task: Task, part: str, state: State) -> bool:
    """Whether all that the goal says of a part holds in a state."""
    wanted = [fact for fact in task.goal.requires if fact.endswith(f"({part})")]
    return bool(wanted) and all(fact in state for fact in wanted)


def _mm(length_m: float) -> float:
    return round(length_m * _MM_PER_M, 6) + 0.0
