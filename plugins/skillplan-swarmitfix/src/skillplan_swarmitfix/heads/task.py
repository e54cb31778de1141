"""Placing the heads between two vertices: a task for every segment.

Veeramani and Muthuswamy 2022, section 4.1.2, have it solved by Monte Carlo. A state is the head
that was placed last, an action the next one. No stretch between consecutive heads lies bare for
longer than the limit; fewest heads, and fewest turns of the head, cost least.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

from skillplan.task.cost import CaseCost, ConstantCost
from skillplan.task.scene import Scene
from skillplan.task.skill import Case, Outcome, Skill
from skillplan.task.state import Condition, Facts, State
from skillplan.task.task import Metric, Place, Task
from skillplan_swarmitfix.bench.bench import Timings
from skillplan_swarmitfix.heads.grid import HeadGrid
from skillplan_swarmitfix.heads.heads import Head, HeadRules
from skillplan_swarmitfix.trajectory.path_elements import Point2
from skillplan_swarmitfix.trajectory.workpiece import Segment

Holdable = Callable[[Point2], bool]

SUPPORTS = Metric("supports", "supports", 2)
"""Heads between the vertices, and the weight of turns."""

_FIRST = "head(first)"
_SUPPORTED = "supported"
_FINISH = "finish"


def head_task(
    segment: Segment,
    first: Head,
    last: Head,
    rules: HeadRules,
    *,
    name: str,
    sha256: str = "",
    place_s: float | None = None,
    holdable: Holdable | None = None,
) -> Task:
    """Return the task of placing the heads of a segment between those at its vertices.

    Skill ``support(K:O)`` places the next head on grid point K, in heading O; ``finish`` places
    the one at the last vertex. A support costs 1, and turning the head against the one before
    the re-orientation cost. Heads from which the end cannot be reached are left out, so
    that every state leads to the goal in fewer skills than there are grid points.

    The time of a placement does not depend on the spacing: a time that favoured even spacing
    among equally many heads would not be one.

    Parameters
    ----------
    segment
        Segment to support.
    first, last
        The heads at its start and its end.
    rules
        Rules for placing heads.
    name
        The task's.
    sha256
        Hash of the task file, in hexadecimal.
    place_s
        Time of moving the head from one support to the next [s], >= 0; by default that of
        retracting, approaching and supporting on the real machine.
    holdable
        Returns whether a base can hold a head at a point; None if that is not required.

    Raises
    ------
    ValueError
        If the segment cannot be supported; the message is that of `segment_fault`.
    """
    grid = _grid(segment, first, last, rules, holdable)
    if grid.fault is not None:
        raise ValueError(grid.fault)
    if place_s is None:
        timings = Timings()
        place_s = timings.retract_s + timings.approach_s + timings.support_s
    nodes = sorted(grid.arrows)
    names = {node: _fact(grid, node) for node in nodes}
    facts = Facts((*names.values(), _SUPPORTED), exclusive=((*names.values(), _SUPPORTED),))
    states = {node: facts.of(fact) for node, fact in names.items()}
    before: dict[int, list[int]] = {node: [] for node in (*nodes[1:], grid.last)}
    for node in nodes:
        for other in grid.arrows[node]:
            before[other].append(node)
    done = facts.of(_SUPPORTED)
    return Task(
        name=name,
        kind="swarmitfix",
        facts=facts,
        skills=tuple(
            _place(grid, node, states.get(node, done), {n: states[n] for n in earlier}, place_s)
            for node, earlier in before.items()
        ),
        initial=states[0],
        goal=Condition(done, facts.none),
        metric=SUPPORTS,
        step_limit=grid.cells,
        scene=Scene((), ()),
        sha256=sha256,
        starts=tuple(states[node] for node in nodes[1:]),
        stage="heads",
        places={fact: _spot(grid, node) for node, fact in names.items()},
    )


def heads_of(
    segment: Segment, first: Head, last: Head, rules: HeadRules, plan: Sequence[str]
) -> tuple[Head, ...]:
    """Return the heads between the vertices that a plan of `head_task` places.

    Parameters
    ----------
    segment
        The segment that the heads support.
    first, last
        The heads at its ends.
    rules
        Rules for placing heads.
    plan
        Names of skills, in order.

    Raises
    ------
    ValueError
        If the plan names a skill that no head of this segment has.
    """
    grid = _grid(segment, first, last, rules)
    nodes = {_skill(grid, node): node for node in range(1, grid.last)}
    heads = []
    for skill in plan:
        if skill == _FINISH:
            continue
        if skill not in nodes:
            raise ValueError(f"Segment {segment.index + 1} has no head for {skill!r}.")
        heads.append(grid.head(nodes[skill]))
    return tuple(heads)


def fewest(
    segment: Segment, first: Head, last: Head, rules: HeadRules, holdable: Holdable | None = None
) -> tuple[str, ...]:
    """Return the cheapest plan of `head_task` by dynamic programming; of equals the most even.

    The most even placement has the least sum of squares of the unsupported stretches.

    Raises
    ------
    ValueError
        If the segment cannot be supported; the message is that of `segment_fault`.
    """
    grid = _grid(segment, first, last, rules, holdable)
    if grid.fault is not None:
        raise ValueError(grid.fault)
    return tuple(_skill(grid, node) for node in grid.cheapest())


def segment_fault(segment: Segment, first: Head, last: Head, rules: HeadRules) -> str | None:
    """Return in words why a segment cannot be supported under the rules; None if it can."""
    return _grid(segment, first, last, rules).fault


def has_holdable_heads(
    segment: Segment, first: Head, last: Head, rules: HeadRules, holdable: Holdable
) -> bool:
    """Return whether a segment can be supported by heads that a base can hold."""
    return bool(_grid(segment, first, last, rules, holdable).arrows)


@lru_cache(maxsize=256)
def _grid(
    segment: Segment, first: Head, last: Head, rules: HeadRules, holdable: Holdable | None = None
) -> HeadGrid:
    """Return the heads to choose from, which a chain needs again and again."""
    return HeadGrid(segment, first, last, rules, holdable)


def _skill(grid: HeadGrid, node: int) -> str:
    return _FINISH if node == grid.last else "support({}:{})".format(*grid.key(node))


def _fact(grid: HeadGrid, node: int) -> str:
    return _FIRST if node == 0 else "head({}:{})".format(*grid.key(node))


def _spot(grid: HeadGrid, node: int) -> Place:
    distance_m = grid.distance_m(node)
    return Place(f"{distance_m:.3f} m", (*grid.segment.point_at(distance_m), 0.0))


def _place(
    grid: HeadGrid, node: int, there: State, earlier: Mapping[int, State], place_s: float
) -> Skill:
    """Return the skill of placing a head after any of some others."""
    facts = there.facts
    elsewhere = facts.state(facts.all_bits & ~sum(state.bits for state in earlier.values()))
    return Skill(
        name=_skill(grid, node),
        kind=_FINISH if node == grid.last else "support",
        agents=("head",),
        precondition=Condition(facts.none, elsewhere),
        outcomes=(),
        cost=CaseCost({state.bits: grid.cost(n, node) for n, state in earlier.items()}),
        duration_s=ConstantCost(place_s),
        parameters={
            "distance_m": f"{grid.distance_m(node):.4f}",
            "yaw_deg": f"{math.degrees(grid.yaw_rad(node)):.2f}",
        },
        cases=tuple(
            Case(state, (Outcome(1.0, there, state),), facts.none) for state in earlier.values()
        ),
    )
