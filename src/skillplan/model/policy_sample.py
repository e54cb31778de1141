"""The expected cost of a policy from roll-outs, where its states are too many for equations."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist, fmean, stdev

from skillplan.model.skill_model import SkillModel, Transition
from skillplan.task.skill import Skill
from skillplan.task.state import State

ROLL_OUTS = 2_000
_TWO_SIDED_95 = NormalDist().inv_cdf(0.975)
# What takes so many times the step limit does not arrive.
_LIMITS = 20


@dataclass(frozen=True, slots=True)
class PolicySample:
    """What roll-outs of a policy say.

    Parameters
    ----------
    cost, half_width
        Mean of what a roll-out costs until the goal, and half its 95 % interval; 0 of one.
    duration_s, steps
        Means of its time and its number of skills.
    roll_outs
        How many there were; all arrived.
    problem
        Why not all did, or None; then the figures are of no use.
    infeasible
        Whether the problem is a step that cannot be executed.
    """

    cost: float
    half_width: float
    duration_s: float
    steps: float
    roll_outs: int
    problem: str | None = None
    infeasible: bool = False

    @property
    def words(self) -> str:
        """The interval in words."""
        return (
            f"expected cost by {self.roll_outs:,} roll-outs, 95 %: "
            f"{self.cost - self.half_width:.6g} to {self.cost + self.half_width:.6g}"
        )


def sample_policy(
    model: SkillModel,
    choose: Callable[[State], Skill | None],
    seed: int = 0,
    roll_outs: int = ROLL_OUTS,
    over: Callable[[], bool] = lambda: False,
) -> PolicySample | None:
    """Follow a policy from the initial state to the goal, again and again.

    The step limit does not count, as for `evaluate_policy`: under chance no number of skills
    suffices for certain.

    Parameters
    ----------
    model
        Queried on every step that the policy takes.
    choose
        The policy: the skill it takes in a state, or None where it has none.
    seed
        Governs what comes of skills.
    roll_outs
        How many, >= 1.
    over
        Polled before every roll-out; once true, they are given up.

    Returns
    -------
    PolicySample or None
        None where it was given up.
    """
    chance = random.Random(seed)
    arrows: dict[State, Transition] = {}
    costs, durations_s, steps = [], [], []
    for _ in range(roll_outs):
        if over():
            return None
        state, cost, duration_s, taken = model.initial, [0.0], 0.0, 0
        while not model.is_goal(state):
            arrow = arrows.get(state)
            if arrow is None:
                made = _arrow(model, choose, state)
                if isinstance(made, PolicySample):
                    return made
                arrow = arrows[state] = made
            if taken >= _LIMITS * model.step_limit:
                return _failed(f"the policy takes more than {taken:,} skills")
            cost.append(arrow.cost)
            duration_s += arrow.duration_s
            taken += 1
            state = _drawn(arrow, chance.random())
        costs.append(math.fsum(cost))
        durations_s.append(duration_s)
        steps.append(taken)
    half = _TWO_SIDED_95 * stdev(costs) / math.sqrt(roll_outs) if roll_outs > 1 else 0.0
    return PolicySample(fmean(costs), half, fmean(durations_s), fmean(steps), roll_outs)


def _arrow(
    model: SkillModel, choose: Callable[[State], Skill | None], state: State
) -> Transition | PolicySample:
    """Return what the policy does in a state, or what stands against it."""
    skill = choose(state)
    if skill is None:
        return _failed(f"the policy says nothing in {state}")
    verdict = model.verdict(state, skill)
    if not verdict.is_feasible:
        problem = f"{skill.name} in {state}: {verdict.stage}: {verdict.reason}"
        return _failed(problem, infeasible=verdict.is_infeasible)
    return model.transition(state, skill)


def _failed(problem: str, *, infeasible: bool = False) -> PolicySample:
    return PolicySample(math.inf, 0.0, math.inf, math.inf, 0, problem, infeasible)


def _drawn(arrow: Transition, uniform: float) -> State:
    for probability, following in arrow.outcomes:
        uniform -= probability
        if uniform < 0:
            return following
    return arrow.next_state
