"""Messages about conflicts: the shortest cycle, and the change that would free most components."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from skillplan.chart.partial_order import cycle, find_orderable
from skillplan.chart.precedence_query import Relation
from skillplan.task.scene import Body, Box, Pose
from skillplan.task.state import AND
from skillplan.task.task import Task

# Lower and upper end along x, y and z [m].
_Extent = list[tuple[float, float]]

# Greatest gap between faces that touch [m]; coordinates in files are rounded.
_TOUCH_M = 5e-4


@dataclass(frozen=True, slots=True)
class Cause:
    """The cause of a relation, which the user could change.

    Parameters
    ----------
    what
        ``start`` or ``goal`` of a component, or ``line`` of the chart.
    """

    what: str
    name: str

    def __str__(self) -> str:
        if self.what == "line":
            return f"without the chart's line {self.name}"
        return f"with another {self.what} for {self.name}"


@dataclass(frozen=True, slots=True)
class _Clause:
    """A clause: ``cpu``, ``lies``, ``on``, ``mainboard``, ``at the start``."""

    subject: str
    verb: str = ""
    joint: str = ""
    object: str = ""
    tail: str = ""

    def __str__(self) -> str:
        return _words(self.subject, self.verb, self.joint, self.object, self.tail)

    def after(self, before: _Clause) -> str:
        """Return the clause as a continuation of another one."""
        if self.subject != before.subject or not self.verb:
            return str(self)
        verb = "" if self.verb == before.verb else self.verb
        said_again = self.object == before.object and verb
        return _words(verb, self.joint, "it" if said_again else self.object, self.tail)


def _words(*parts: str) -> str:
    return " ".join(filter(None, parts))


def explain_conflict(task: Task, relations: Sequence[Relation]) -> tuple[str, ...]:
    """Return the reason why a relation allows no order, in at most three lines, or none.

    The first line gives the shortest cycle and its causes. The second names the single start or
    goal whose change would free most components. The third gives the cycle that would remain.

    Parameters
    ----------
    relations
        Relations between components, each with its evidence.
    """
    shortest = _cycle(relations)
    if not shortest:
        return ()
    reasons = _Reasons(task)
    lines = [_cycle_line(shortest, relations, reasons)]
    components = list(task.operations)
    free = find_orderable(components, _pairs(relations))
    best: tuple[int, list[Relation], Cause] | None = None
    for cause in _candidates(relations, reasons):
        left = [relation for relation in relations if cause not in reasons.causes(relation)]
        count = len(find_orderable(components, _pairs(left)))
        if count > len(free) and (best is None or count > best[0]):
            best = count, left, cause
    if best is None:
        return (*lines, "no other single start or goal would free any component")
    count, left, cause = best
    every = f"{count} of {len(components)}"
    if count == len(components):
        every = "both" if count == 2 else f"all {count}"
    lines.append(f"{cause}, {every} components would have an order")
    rest = _cycle(left)
    if rest:
        lines.append(f"then there is still {_cycle_line(rest, left, reasons)}")
    return tuple(lines)


def _pairs(relations: Iterable[Relation]) -> list[tuple[str, str]]:
    return [(relation.before, relation.after) for relation in relations]


def _cycle(relations: Iterable[Relation]) -> tuple[str, ...]:
    return cycle(_pairs(relations))


def _cycle_line(cycle: Sequence[str], relations: Sequence[Relation], reasons: _Reasons) -> str:
    by_pair = {(relation.before, relation.after): relation for relation in relations}
    clauses = [reasons.clause(by_pair[pair]) for pair in pairwise(cycle)]
    # Clauses about one component stay together, its start first.
    clauses.sort(key=lambda clause: not clause.tail.endswith("start"))
    texts = [str(clauses[0]), *(clause.after(before) for before, clause in pairwise(clauses))]
    words = texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
    return f"{' before '.join(cycle)}: {words}"


def _candidates(relations: Sequence[Relation], reasons: _Reasons) -> list[Cause]:
    """Return the causes: starts before goals, obstacles first."""
    rank: dict[Cause, tuple[bool, int]] = {}
    for relation in relations:
        for position, cause in enumerate(reasons.causes(relation)):
            key = (cause.what == "goal", position)
            rank[cause] = min(rank.get(cause, key), key)
    return sorted(rank, key=rank.__getitem__)


class _Reasons:
    """Finds the causes of relations in their evidence."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self._bodies = {body.name: body for body in task.scene.bodies}

    def causes(self, relation: Relation) -> tuple[Cause, ...]:
        """Return the causes of a relation, obstacles first."""
        if self._is_line(relation):
            return (Cause("line", f"{relation.before} before {relation.after}"),)
        component, other = self._sides(relation)
        own = Cause(self._phase(relation, component), component)
        if self._starts(relation, other):
            return Cause("start", other), own
        if other == relation.before:
            # The component belongs on the other one, or needs it otherwise.
            return own, Cause("goal", other)
        return Cause("goal", other), own

    def clause(self, relation: Relation) -> _Clause:
        """Return the clause that explains a relation."""
        if self._is_line(relation):
            return _Clause("the chart", "puts", relation.before, f"before {relation.after}")
        component, other = self._sides(relation)
        skill = str(relation.evidence.get("skill", component))
        if other == relation.before and self._starts(relation, other):
            if self._rests(other, component, "start"):
                return _Clause(other, "lies", "on", component, "at the start")
            return _Clause(other, "is in the way", "of", skill, "at its start")
        if other == relation.before:
            if self._rests(component, other, "goal"):
                return _Clause(component, "belongs", "on", other)
            return _Clause(relation.reason)
        if self._starts(relation, other):
            return _Clause(relation.reason)
        if self._rests(other, component, "goal") and self._phase(relation, component) == "goal":
            return _Clause(other, "belongs", "on", component)
        return _Clause(other, "is in the way", "of", skill, "at its goal")

    def _is_line(self, relation: Relation) -> bool:
        """Return whether the relation comes from a hand-made chart."""
        return {"before", "after"} <= set(relation.evidence)

    def _sides(self, relation: Relation) -> tuple[str, str]:
        """Return the component whose skill fails, and the other one."""
        if relation.component == relation.before:
            return relation.before, relation.after
        return relation.after, relation.before

    def _phase(self, relation: Relation, component: str) -> str:
        """Return whether the skill moves the component from its start or to its goal."""
        name = relation.evidence.get("skill")
        skill = next((skill for skill in self.task.skills if skill.name == name), None)
        goal = self.task.operations.get(component)
        brings = skill is None or (goal is not None and goal in skill.prediction.add)
        return "goal" if brings else "start"

    def _starts(self, relation: Relation, other: str) -> bool:
        """Return whether the evidence concerns the start of a component."""
        facts = {str(fact).removeprefix("not ") for fact in relation.evidence.get("facts", ())}
        return any(fact in facts and fact.endswith(f"({other})") for fact in self.task.initial)

    def _rests(self, upper: str, lower: str, phase: str) -> bool:
        """Return whether a body stands on another at their starts or goals."""
        above, below = self._bodies.get(upper), self._bodies.get(lower)
        if above is None or below is None:
            return False
        feet, tops = self._boxes(above, phase), self._boxes(below, phase)
        return any(_stands_on(foot, top) for foot in feet for top in tops)

    def _boxes(self, body: Body, phase: str) -> list[_Extent]:
        goal = self.task.operations.get(body.name)
        for placement in body.placements:
            starts = placement.fact in self.task.initial
            if starts if phase == "start" else placement.fact.partition(AND)[0] == goal:
                return [_extent(box, placement.pose) for box in body.boxes]
        return []


def _extent(box: Box, pose: Pose) -> _Extent:
    """Return the extents of a body's box along each axis [m], rotated as it stands."""
    cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    (x, y, z), (width, depth, height) = box.centre, box.size
    centre = (cos * x - sin * y, sin * x + cos * y, z)
    size = (abs(cos) * width + abs(sin) * depth, abs(sin) * width + abs(cos) * depth, height)
    middles = [origin + offset for origin, offset in zip(pose.position, centre, strict=True)]
    return [(at - extent / 2, at + extent / 2) for at, extent in zip(middles, size, strict=True)]


def _stands_on(foot: _Extent, top: _Extent) -> bool:
    """Return whether a box stands at least partly on another."""
    touches = abs(foot[2][0] - top[2][1]) <= _TOUCH_M
    return touches and all(
        max(foot[axis][0], top[axis][0]) < min(foot[axis][1], top[axis][1]) for axis in (0, 1)
    )
