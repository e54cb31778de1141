"""States that can be reached, drawn by random walks over verdicts that are known already."""

from __future__ import annotations

import random
from collections.abc import Callable

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import check
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict

MOST_STATES = 1_000
_MOST_WALKS = 200


def reachable_sample(
    feasibility: Feasibility,
    seed: int,
    most: int = MOST_STATES,
    stopped: Callable[[], bool] = lambda: False,
) -> list[State]:
    """Return states that skills lead to from the start, in the order of being found.

    No expensive back end is asked: a walk takes only what is kept as feasible.

    Parameters
    ----------
    feasibility
        Whose cache knows the verdicts.
    seed
        Governs the walks.
    most
        How many states, >= 1.
    stopped
        Whether to stop; polled at every step.
    """
    task, draw = feasibility.task, random.Random(seed)
    starts = [task.initial, *task.starts]
    found = dict.fromkeys(starts)
    for walk in range(_MOST_WALKS):
        state = starts[walk % len(starts)]
        for _ in range(task.step_limit):
            if stopped() or len(found) >= most:
                return list(found)[:most]
            skills = [skill for skill in task.skills if skill.applicable(state)]
            draw.shuffle(skills)
            skill = next((one for one in skills if _known_feasible(feasibility, one, state)), None)
            if skill is None or task.goal.holds(state):
                break
            outcomes = list(skill.outcomes_in(state))
            weights = [outcome.probability for outcome in outcomes]
            state = draw.choices(outcomes, weights)[0].apply(state)
            found[state] = None
    return list(found)


def _known_feasible(feasibility: Feasibility, skill: Skill, state: State) -> bool:
    variants = [one.skill for one in feasibility.ways.of(skill)] or [skill]
    return any(_granted(feasibility, variant, state) for variant in variants)


def _granted(feasibility: Feasibility, skill: Skill, state: State) -> bool:
    for back_end in feasibility.back_ends:
        verdict = _known(feasibility, back_end, skill, state)
        if verdict is None or not verdict.is_feasible:
            return False
    return True


def _known(
    feasibility: Feasibility, back_end: BackEnd, skill: Skill, state: State
) -> Verdict | None:
    verdict = feasibility.cache.find(back_end, skill, state)
    if verdict is None and not back_end.expensive:
        checked = check(back_end, skill, state)
        feasibility.cache.keep(back_end, skill, checked, state)
        verdict = checked.verdict
    return verdict
