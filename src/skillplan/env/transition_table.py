"""Known transitions of the models of an environment, as arrays that grow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import MaskKind, Observation, RewardFunction, list_allowed_actions
from skillplan.model.skill_model import SkillModel
from skillplan.task.state import State

GOES_ON, COMPLETE, INFEASIBLE, OUT_OF_TIME = range(4)

_FIRST_SIZE = 256
_Array = TypeVar("_Array", bound=NDArray[np.generic])


class TransitionTable:
    """The known states and outcomes of actions.

    States and outcomes are numbered in the order of their discovery. A model is queried once for
    every pair of state and action, when it is first needed. Arrays by state have a row for every
    state of every model, arrays by outcome one for every outcome; row 0 of the latter stands for
    unknown outcomes. Arrays are replaced when they grow.

    Parameters
    ----------
    models
        Models with equal actions, at least one.
    mask
        Kind of the action mask.

    Attributes
    ----------
    model_of, limits
        Number of the model, and its step limit, by state.
    features, masks
        Features and allowed actions by state, shapes (states, width) and (states, actions), once
        observed.
    outcomes
        First outcome by state and action; 0 if unknown.
    following, costs, rewards, late_rewards, ends
        By outcome: next state; cost, 0 if not executed; reward, and reward at the step limit; end
        of the episode.
    chances, cumulated
        By outcome: number of outcomes if it is the first one; cumulated probability.
    """

    def __init__(
        self,
        models: Sequence[SkillModel],
        observations: Sequence[Observation],
        reward_functions: Sequence[RewardFunction],
        mask: MaskKind,
    ) -> None:
        self.models = tuple(models)
        self._observations = tuple(observations)
        self._reward_functions = tuple(reward_functions)
        self._mask = mask
        self._states: list[State] = []
        self._numbers: list[dict[State, int]] = [{} for _ in models]
        width, actions = observations[0].width, len(models[0].task.skills)
        self.model_of = np.zeros(_FIRST_SIZE, dtype=np.int64)
        self.limits = np.zeros(_FIRST_SIZE, dtype=np.int64)
        self.features = np.zeros((_FIRST_SIZE, width), dtype=np.float32)
        self.masks = np.zeros((_FIRST_SIZE, actions), dtype=np.bool_)
        self.outcomes = np.zeros((_FIRST_SIZE, actions), dtype=np.int64)
        self._observed = np.zeros(_FIRST_SIZE, dtype=np.bool_)
        self._n_outcomes = 1
        self.following = np.zeros(_FIRST_SIZE, dtype=np.int64)
        self.costs = np.zeros(_FIRST_SIZE, dtype=np.float64)
        self.rewards = np.zeros(_FIRST_SIZE, dtype=np.float64)
        self.late_rewards = np.zeros(_FIRST_SIZE, dtype=np.float64)
        self.ends = np.zeros(_FIRST_SIZE, dtype=np.int8)
        self.chances = np.ones(_FIRST_SIZE, dtype=np.int64)
        self.cumulated = np.ones(_FIRST_SIZE, dtype=np.float64)
        self.has_chances = False

    def __len__(self) -> int:
        return len(self._states)

    def state(self, number: int) -> State:
        """Return a state by its number."""
        return self._states[number]

    def number(self, model: int, state: State) -> int:
        """Return the number of a state of a model; unknown states get a new one."""
        numbers = self._numbers[model]
        number = numbers.get(state)
        if number is None:
            number = len(self._states)
            if number == len(self.limits):
                self._grow_states()
            self.model_of[number] = model
            self.limits[number] = self.models[model].step_limit
            self._states.append(state)
            numbers[state] = number
        return number

    def first_outcomes(
        self, states: NDArray[np.int64], actions: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the first outcome of actions in states, shape (n,), with queries for unknown ones.

        Parameters
        ----------
        states, actions
            Numbers, shape (n,).

        Raises
        ------
        BackEndError
            If a back end fails.
        SearchStopped
            If the learner is overdue.
        """
        outcomes: NDArray[np.int64] = self.outcomes[states, actions]
        if np.count_nonzero(outcomes) < len(outcomes):
            for place in np.flatnonzero(outcomes == 0).tolist():
                outcomes[place] = self._first_outcome(int(states[place]), int(actions[place]))
        return outcomes

    def draw(self, outcomes: NDArray[np.int64], generators: Sequence[np.random.Generator]) -> None:
        """Replace first outcomes by drawn ones, if there are several.

        Parameters
        ----------
        outcomes
            First outcomes, shape (n,); changed in place.
        generators
            One generator per entry; used only if there are several outcomes.
        """
        places = np.flatnonzero(self.chances[outcomes] > 1)
        drawn = np.array([generators[place].random() for place in places.tolist()])
        rows = outcomes[places]
        # The last outcome takes the remainder, because probabilities may add up to a bit less.
        last = rows + self.chances[rows] - 1
        beyond = (drawn >= self.cumulated[rows]) & (rows < last)
        while np.count_nonzero(beyond):
            rows += beyond
            beyond = (drawn >= self.cumulated[rows]) & (rows < last)
        outcomes[places] = rows

    def observe(self, states: NDArray[np.int64]) -> None:
        """Fill in the features and masks of states.

        Parameters
        ----------
        states
            Numbers, shape (n,).

        Raises
        ------
        BackEndError
            If a back end fails; only the mask ``feasible`` queries them.
        SearchStopped
            If the learner is overdue.
        """
        known = self._observed[states]
        if np.count_nonzero(known) == len(known):
            return
        for number in dict.fromkeys(states[~known].tolist()):
            index = int(self.model_of[number])
            model, state = self.models[index], self._states[number]
            feasible = partial(self._feasible, number)
            # Actions first: they may discover states, and the arrays then grow.
            allowed = list(list_allowed_actions(model, state, self._mask, feasible))
            self.masks[number, allowed] = True
            self.features[number] = self._observations[index].encode(state)
            self._observed[number] = True

    def _feasible(self, number: int, action: int) -> bool:
        # Queries first: they may make the arrays grow.
        first = self._first_outcome(number, action)
        return bool(self.ends[first] != INFEASIBLE)

    def _first_outcome(self, number: int, action: int) -> int:
        """Return the first outcome of an action in a state; the model is queried if needed."""
        known = int(self.outcomes[number, action])
        if known:
            return known
        index = int(self.model_of[number])
        model, reward_function, state = (
            self.models[index],
            self._reward_functions[index],
            self._states[number],
        )
        skill = model.task.skills[action]
        first = self._n_outcomes
        if not model.verdict(state, skill).is_feasible:
            self._add_outcome(
                number, 0.0, reward_function.infeasible, reward_function.infeasible, INFEASIBLE, 1.0
            )
        else:
            cost, total = model.cost(state, skill), 0.0
            for outcome in skill.outcomes_in(state):
                following = outcome.apply(state)
                goal = model.is_goal(following)
                reward, late = (
                    reward_function.of_step(
                        state, skill.name, cost, goal=goal, out_of_time=out_of_time
                    )
                    for out_of_time in (False, not goal)
                )
                total += outcome.probability
                end = COMPLETE if goal else GOES_ON
                self._add_outcome(self.number(index, following), cost, reward, late, end, total)
            self.chances[first] = self._n_outcomes - first
            self.has_chances = self.has_chances or self._n_outcomes - first > 1
        self.outcomes[number, action] = first
        return first

    def _add_outcome(
        self,
        following: int,
        cost: float,
        reward: float,
        late_reward: float,
        end: int,
        cumulated: float,
    ) -> None:
        row = self._n_outcomes
        if row == len(self.ends):
            self._grow_outcomes()
        self.following[row] = following
        self.costs[row] = cost
        self.rewards[row] = reward
        self.late_rewards[row] = late_reward
        self.ends[row] = end
        self.chances[row] = 1
        self.cumulated[row] = cumulated
        self._n_outcomes += 1

    def _grow_states(self) -> None:
        self.model_of = _doubled(self.model_of)
        self.limits = _doubled(self.limits)
        self.features = _doubled(self.features)
        self.masks = _doubled(self.masks)
        self.outcomes = _doubled(self.outcomes)
        self._observed = _doubled(self._observed)

    def _grow_outcomes(self) -> None:
        self.following = _doubled(self.following)
        self.costs = _doubled(self.costs)
        self.rewards = _doubled(self.rewards)
        self.late_rewards = _doubled(self.late_rewards)
        self.ends = _doubled(self.ends)
        self.chances = _doubled(self.chances)
        self.cumulated = _doubled(self.cumulated)


def _doubled(array: _Array) -> _Array:
    larger = np.zeros((2 * len(array), *array.shape[1:]), dtype=array.dtype)
    larger[: len(array)] = array
    return larger  # type: ignore[return-value]
