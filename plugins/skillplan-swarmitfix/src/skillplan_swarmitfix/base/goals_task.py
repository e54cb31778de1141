"""The goals of the base as a task of their own: one position out of every goal set.

A state holds the position of the base and the served sets. The task exists so that any solver
can choose; the chain takes the plan of `goal_choice` unless another solver is chosen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from skillplan.task.cost import CaseCost
from skillplan.task.scene import Scene
from skillplan.task.skill import Case, Outcome, Skill
from skillplan.task.state import Condition, Facts, State
from skillplan.task.task import Place, Task
from skillplan_swarmitfix.base.goal_choice import LeastSwings
from skillplan_swarmitfix.base.goals import GoalSet
from skillplan_swarmitfix.base.locomotion import STEPS
from skillplan_swarmitfix.bench.bench import Bench


def serve(number: int, position: str) -> str:
    """Return the skill of going to a position to serve a goal set, as ``serve(3:C17)``.

    Parameters
    ----------
    number
        Number of the goal set, from 1.
    position
        Name of the position.
    """
    return f"serve({number}:{position})"


def goal_of(skill: str) -> str:
    """Return the position in the name of a skill, as C17 of ``serve(3:C17)``."""
    return skill.rpartition(":")[2].removesuffix(")")


def goals_task(
    bench: Bench,
    home: int,
    sets: Sequence[GoalSet],
    swing_s: Mapping[int, float],
    goals: Sequence[int] | None,
    *,
    name: str,
    sha256: str = "",
    infeasible: str = "",
) -> Task:
    """Return the task of choosing a goal out of every set.

    A goal costs the fewest swings that lead to it from where the base stands, and takes the least
    time of that many swings. It occupies the pins on which the base docks at its end.

    Parameters
    ----------
    bench
        The lattice.
    home
        Position at the start.
    sets
        At least one, in the order in which they are served; none if a support cannot be served.
    swing_s
        Time of a swing [s] by its angle [deg].
    goals
        Positions, one of each set, that make the preset plan; None for no preset.
    name
        The task's.
    sha256
        Hash of the task file, in hexadecimal.
    infeasible
        Why a support cannot be served; the task then has no skill and no plan. Empty if all can.

    Raises
    ------
    ValueError
        If there is no set although all supports can be served, or the preset is not one position of
        each.
    """
    if not sets and not infeasible:
        raise ValueError(f"Task {name!r} needs at least one goal set.")
    if goals is not None and not (
        len(goals) == len(sets)
        and all(goal in goal_set.positions for goal, goal_set in zip(goals, sets, strict=True))
    ):
        raise ValueError(f"Task {name!r}: the preset is not one position of every goal set.")
    positions = sorted({home, *(position for goal_set in sets for position in goal_set.positions)})
    stands = {position: f"base({bench.name(position)})" for position in positions}
    served = [f"served({number})" for number in range(1, max(1, len(sets)) + 1)]
    facts = Facts((*stands.values(), *served), exclusive=(tuple(stands.values()),))
    states = {position: facts.of(fact) for position, fact in stands.items()}
    least_swings = LeastSwings(bench, swing_s)
    skills = []
    before: Sequence[int] = (home,)
    for number, reachable in enumerate(sets, start=1):
        done = facts.of(served[number - 1])
        ready = Condition(facts.of(*served[number - 2 : number - 1]), done)
        for position in reachable.positions:
            steps, times_us = least_swings.to(position)
            skills.append(
                Skill(
                    name=serve(number, bench.name(position)),
                    kind="serve",
                    agents=("base",),
                    precondition=ready,
                    outcomes=(),
                    cost=CaseCost({states[p].bits: float(steps[p]) for p in before}),
                    duration_s=CaseCost({states[p].bits: times_us[p] / 1e6 for p in before}),
                    parameters={"goal_set": str(number), "position": bench.name(position)},
                    cases=_cases(bench, states, before, position, done),
                )
            )
        before = reachable.positions
    return Task(
        name=name,
        kind="swarmitfix",
        facts=facts,
        skills=tuple(skills),
        initial=states[home],
        goal=Condition(facts.of(served[-1]), facts.none),
        metric=STEPS,
        step_limit=len(served),
        scene=Scene((), ()),
        sha256=sha256,
        stage="goals",
        infeasible=infeasible,
        preset=None
        if goals is None
        else tuple(serve(n, bench.name(goal)) for n, goal in enumerate(goals, start=1)),
        places={
            fact: Place(
                bench.name(p), (float(bench.centroids_m[p, 0]), float(bench.centroids_m[p, 1]), 0.0)
            )
            for p, fact in stands.items()
        },
    )


def _cases(
    bench: Bench, states: Mapping[int, State], before: Sequence[int], position: int, done: State
) -> tuple[Case, ...]:
    """Build the cases of going to a position, one per possible position of the base."""
    there = states[position]
    none = there.facts.none
    pins = frozenset(bench.pin_name(pin) for pin in bench.legs[position].tolist())
    return tuple(
        Case(here, (Outcome(1.0, there | done, here - there),), none, pins)
        for here in (states[start] for start in before)
    )
