"""The expected cost of a policy, exactly, on tasks whose skills may have several outcomes."""

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
# Up to so many states a dense linear system is solved; beyond, values are swept until they rest.
_MOST_EQUATIONS = 2_000
_MOST_SWEEPS = 20_000
# Values that a sweep changes by less, as a fraction of the largest, have come to rest.
_AT_REST = 1e-14
_ABOVE_ROUNDING = 1e3
# With such a rate the changes to come add up to a thousand times the last one.
_SLOWEST = 0.999


@dataclass(frozen=True, slots=True)
class PolicyValue:
    """What a policy is worth from the initial state.

    Parameters
    ----------
    cost, duration_s, steps
        Expected sums until the goal; None where `problem` is given.
    problem
        Why the policy does not reach the goal with certainty, or None.
    infeasible
        Whether the problem is a step that cannot be executed.
    """

    cost: float | None
    duration_s: float | None = None
    steps: float | None = None
    problem: str | None = None
    infeasible: bool = False


class Convergence:
    """Decides whether the values of sweeps have converged.

    A small change alone is no sign of it: if a chain hardly ever ends, every sweep changes little,
    and there are many to come.

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
        """Record the change of a sweep; whether the changes to come are negligible.

        Parameters
        ----------
        change
            Largest change of a value, >= 0.
        largest
            Largest value.
        """
        scale = max(1.0, largest)
        # Below, rounding decides how fast changes shrink.
        if change > _ABOVE_ROUNDING * self._tolerance * scale and math.isfinite(self._previous):
            self._rate = change / self._previous
        self._previous = change
        return change == 0 or (change <= self._tolerance * scale and self._rate <= _SLOWEST)


def roll_out(model: SkillModel, choose: Callable[[State], Skill | None]) -> list[Skill]:
    """Return the skills that a policy takes while every outcome is the nominal one.

    Ends at the goal, at the step limit, where the policy knows nothing, or with a skill that is
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
    """Solve the linear equations of the Markov chain that a policy makes of the model.

    Parameters
    ----------
    model
        A model, queried on every step that the policy takes.
    choose
        The policy: the skill it takes in a state, or None where it has none.

    Raises
    ------
    ModelTooLarge
        If the policy reaches more than `MAX_STATES` states.
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
    """Return a state from which no outcome leads to the goal, or None."""
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
    # Here and not above: a deterministic task must not pay for importing numpy.
    import numpy as np

    index = {state: i for i, state in enumerate(chain)}
    gains = np.zeros((len(chain), 3))
    owners, successors, shares = [], [], []
    for state, step in chain.items():
        if step is None:
            continue
        # Tries that leave the state as it is are divided out: with failures that are almost
        # certain, the equations would lose all digits.
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
    """Return the values of a chain that ends for certain, by sweeps from 0.

    Parameters
    ----------
    gains
        What every state adds to each of k sums, shape (n, k).
    owners, successors, shares
        State, next state and probability of every outcome.

    Raises
    ------
    ModelTooLarge
        If the values have not come to rest, as the chain hardly ever ends.
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
