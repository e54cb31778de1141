"""The expected cost of a policy, exactly, on tasks whose skills may have several outcomes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
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
