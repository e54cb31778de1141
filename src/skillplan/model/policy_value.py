"""Expected cost of a policy: exactly by linear equations, or estimated by roll-outs."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import NormalDist, fmean, stdev
from typing import TYPE_CHECKING

from skillplan.errors import ModelTooLarge
from skillplan.model.skill_model import SkillModel, Transition
from skillplan.task.skill import Skill
from skillplan.task.state import State

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


MAX_STATES = 200_000
# Largest dense linear system; larger ones are solved by sweeps.
_MOST_EQUATIONS = 2_000
_MOST_SWEEPS = 20_000
# Largest change of converged values in a sweep, as a fraction of the largest value.
_AT_REST = 1e-14
_ABOVE_ROUNDING = 1e3
# At this rate, the remaining changes add up to a thousand times the last one.
_SLOWEST = 0.999


@dataclass(frozen=True, slots=True)
class PolicyValue:
    """Value of a policy in the initial state.

    Parameters
    ----------
    cost, duration_s, steps
        Expected sums until the goal; None if there is a `problem`.
    problem
        Reason why the policy does not reach the goal with certainty, or None.
    infeasible
        True if the problem is a step that cannot be executed.
    """

    cost: float | None
    duration_s: float | None = None
    steps: float | None = None
    problem: str | None = None
    infeasible: bool = False


class Convergence:
    """Detects convergence of sweeps.

    A small change is not sufficient: if a chain hardly ever ends, every sweep changes little, and
    many are to come.

    Parameters
    ----------
    tolerance
        Largest change of a value, as a fraction of the largest value, > 0.
    """

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._previous = math.inf
        self._rate = 0.0

    def reached(self, change: float, largest: float) -> bool:
        """Record the change of a sweep, and return whether the remaining changes are negligible.

        Parameters
        ----------
        change
            Largest change of a value, >= 0.
        """
        scale = max(1.0, largest)
        # Smaller changes are rounding errors.
        if change > _ABOVE_ROUNDING * self._tolerance * scale and math.isfinite(self._previous):
            self._rate = change / self._previous
        self._previous = change
        return change == 0 or (change <= self._tolerance * scale and self._rate <= _SLOWEST)


def roll_out(model: SkillModel, choose: Callable[[State], Skill | None]) -> list[Skill]:
    """Return the skills of a policy if every outcome is the nominal one.

    They end at the goal, at the step limit, at a state without an action, or with a skill that is
    not applicable.
    """
    state = model.initial
    skills: list[Skill] = []
    while not model.is_goal(state) and len(skills) < model.step_limit:
        skill = choose(state)
        if skill is None:
            break
        skills.append(skill)
        if not skill.applicable(state):
            break
        state = skill.prediction_in(state).apply(state)
    return skills


def evaluate_policy(model: SkillModel, choose: Callable[[State], Skill | None]) -> PolicyValue:
    """Return the value of a policy, by the linear equations of its Markov chain.

    Parameters
    ----------
    model
        The model, queried about every step of the policy.
    choose
        Policy: returns the skill in a state, or None if it has none.
    """
    chain: dict[State, Transition | None] = {}
    todo = [model.initial]
    while todo:
        state = todo.pop()
        if state in chain:
            continue
        if len(chain) >= MAX_STATES:
            raise ModelTooLarge(f"The policy reaches more than {MAX_STATES:,} states.")
        if model.is_goal(state):
            chain[state] = None
            continue
        skill = choose(state)
        if skill is None:
            return PolicyValue(None, problem=f"the policy says nothing in {state}")
        verdict = model.verdict(state, skill)
        if not verdict.is_feasible:
            problem = f"{skill.name} in {state}: {verdict.stage}: {verdict.reason}"
            return PolicyValue(None, problem=problem, infeasible=verdict.is_infeasible)
        step = chain[state] = model.transition(state, skill)
        todo += [next_state for _, next_state in step.outcomes]
    stuck = _cannot_finish(chain)
    if stuck is not None:
        return PolicyValue(None, problem=f"the policy never reaches the goal from {stuck}")
    return _solve(model, chain)


def _cannot_finish(chain: Mapping[State, Transition | None]) -> State | None:
    """Return a state from which the goal is unreachable, or None."""
    before: dict[State, list[State]] = {}
    for state, step in chain.items():
        for _, next_state in step.outcomes if step is not None else ():
            before.setdefault(next_state, []).append(state)
    todo = [state for state, step in chain.items() if step is None]
    finishing = set(todo)
    while todo:
        for state in before.get(todo.pop(), ()):
            if state not in finishing:
                finishing.add(state)
                todo.append(state)
    return next((state for state in chain if state not in finishing), None)


def _solve(model: SkillModel, chain: Mapping[State, Transition | None]) -> PolicyValue:
    # Imported here, because deterministic tasks do not need numpy.
    import numpy as np

    index = {state: i for i, state in enumerate(chain)}
    gains = np.zeros((len(chain), 3))
    owners, successors, shares = [], [], []
    for state, step in chain.items():
        if step is None:
            continue
        # Outcomes that leave the state unchanged are divided out: if failures are almost certain,
        # the equations would lose all digits.
        leaving = math.fsum(share for share, following in step.outcomes if following != state)
        gains[index[state]] = (step.cost / leaving, step.duration_s / leaving, 1.0 / leaving)
        for share, following in step.outcomes:
            if following != state:
                owners.append(index[state])
                successors.append(index[following])
                shares.append(share / leaving)
    first = index[model.initial]
    if len(chain) <= _MOST_EQUATIONS:
        matrix = np.eye(len(chain))
        np.subtract.at(matrix, (owners, successors), shares)
        cost, duration_s, steps = np.linalg.solve(matrix, gains)[first]
    else:
        cost, duration_s, steps = _swept(gains, owners, successors, shares)[first]
    return PolicyValue(float(cost), float(duration_s), float(steps))


def _swept(
    gains: NDArray[np.float64], owners: list[int], successors: list[int], shares: list[float]
) -> NDArray[np.float64]:
    """Return the values of an absorbing chain, by sweeps from 0.

    Parameters
    ----------
    gains
        Gains of every state in each of k sums, shape (n, k).
    owners, successors, shares
        State, next state and probability of every outcome.

    Raises
    ------
    ModelTooLarge
        If the values do not converge, because the chain hardly ever ends.
    """
    import numpy as np

    rows, following, share = np.array(owners), np.array(successors), np.array(shares)
    values = np.zeros_like(gains)
    convergence = Convergence(_AT_REST)
    for _ in range(_MOST_SWEEPS):
        after = gains + np.stack(
            [
                np.bincount(rows, share * values[following, column], minlength=len(gains))
                for column in range(gains.shape[1])
            ],
            axis=1,
        )
        change = float(np.abs(after - values).max())
        values = after
        if convergence.reached(change, float(values.max())):
            return values
    raise ModelTooLarge(f"The policy takes too long to evaluate in {len(gains):,} states.")


ROLL_OUTS = 2_000
_TWO_SIDED_95 = NormalDist().inv_cdf(0.975)
# Roll-outs of more than this multiple of the step limit count as endless.
_LIMITS = 20


@dataclass(frozen=True, slots=True)
class PolicySample:
    """Estimate of a policy from roll-outs.

    Parameters
    ----------
    cost, half_width
        Mean cost of a roll-out until the goal, and half of its 95 % interval; 0 for one roll-out.
    duration_s, steps
        Means of its time and its number of skills.
    roll_outs
        Number of roll-outs; all reached the goal.
    problem
        Why not all did, or None; then the figures are of no use.
    infeasible
        True if the problem is a step that cannot be executed.
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
    """Estimate the expected cost of a policy by roll-outs to the goal.

    The step limit is ignored, as in `evaluate_policy`: under chance no number of skills is
    certainly enough.

    Parameters
    ----------
    model
        The model, queried about every step of the policy.
    choose
        Policy: returns the skill in a state, or None if it has none.
    roll_outs
        Number of roll-outs, >= 1.
    over
        Returns True to stop; called before every roll-out.

    Returns
    -------
    PolicySample or None
        None if it was stopped.
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
                next_arrow = _arrow(model, choose, state)
                if isinstance(next_arrow, PolicySample):
                    return next_arrow
                arrow = arrows[state] = next_arrow
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
    """Return the action of the policy in a state, or the problem with it."""
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
