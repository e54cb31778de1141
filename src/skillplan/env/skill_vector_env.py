"""Many places at which one task is done, stepped together: a vectorised Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from skillplan.env.observation import MaskKind, Observation, RewardFunction, checked_name
from skillplan.env.transition_table import OUT_OF_TIME, TransitionTable
from skillplan.errors import OptionError
from skillplan.model.skill_model import SkillModel
from skillplan.task.task import Task


@dataclass(frozen=True)
class PlaceRecord:
    """All that a place goes on from.

    Parameters
    ----------
    model
        Number of the model that is done there.
    bits
        The state's.
    steps
        Steps done in the episode.
    generator
        The place's random numbers.
    """

    model: int
    bits: int
    steps: int
    generator: np.random.Generator

    def document(self) -> dict[str, Any]:
        """Return it as JSON values; whole numbers of any length are in hexadecimal."""
        numbers: Any = self.generator.bit_generator.state
        return {
            "model": self.model,
            "facts": hex(self.bits),
            "steps": self.steps,
            "generator": {
                "state": hex(numbers["state"]["state"]),
                "increment": hex(numbers["state"]["inc"]),
                "half_left": int(numbers["has_uint32"]),
                "half": int(numbers["uinteger"]),
            },
        }

    @classmethod
    def read(cls, document: Mapping[str, Any], models: Sequence[SkillModel]) -> PlaceRecord:
        """Return the record of a document.

        Parameters
        ----------
        document
            What `document` returned.
        models
            Those of the environment.

        Raises
        ------
        ValueError
            If it is none, or of other models.
        """
        try:
            model, steps = int(document["model"]), int(document["steps"])
            bits = int(document["facts"], 16)
            numbers = document["generator"]
            generator = np.random.Generator(np.random.PCG64())
            generator.bit_generator.state = {
                "bit_generator": "PCG64",
                "state": {
                    "state": int(numbers["state"], 16),
                    "inc": int(numbers["increment"], 16),
                },
                "has_uint32": int(numbers["half_left"]),
                "uinteger": int(numbers["half"]),
            }
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"This is no state of a place: {error!r}.") from None
        if not 0 <= model < len(models) or not 0 <= steps < models[model].step_limit:
            raise ValueError("This is the state of a place of other tasks.")
        models[model].task.facts.state(bits)
        return cls(model, bits, steps, generator)


def family_observations(tasks: Sequence[Task], kind: str) -> list[Observation]:
    """Return the observation of every task.

    Parameters
    ----------
    tasks
        At least one.
    kind
        See `Observation`.

    Raises
    ------
    OptionError
        If there is no such kind, or if facts, skills or features are not of the same names in
        the same order.
    """
    observations = [Observation.of(task, kind) for task in tasks]
    for task, observed in zip(tasks[1:], observations[1:], strict=True):
        pairs = {
            "facts": (tasks[0].facts.names, task.facts.names),
            "skills": tuple([skill.name for skill in one.skills] for one in (tasks[0], task)),
            "observations": (observations[0].features, observed.features),
        }
        for what, (names, other_names) in pairs.items():
            if list(names) != list(other_names):
                raise OptionError(
                    f"Tasks {tasks[0].name!r} and {task.name!r} cannot be learned together: their "
                    f"{what} differ."
                )
    return observations


Features = NDArray[np.float32]
Infos = dict[str, Any]


class SkillVectorEnv(gymnasium.vector.VectorEnv[Features, NDArray[np.int64], NDArray[Any]]):
    """One or several models of equal shape, done at many places at once.

    An action is a skill's number. A skill that is not applicable, not feasible, or on which back
    ends cannot decide ends the episode where it is with the reward of the infeasible; reaching
    the goal ends it; reaching the step limit truncates it. Rewards are those of
    `skillplan.env.observation`; nothing shapes them.

    An episode that ends is followed by the next one in the same step: what is returned is the
    next one's first observation, and what the last one came to is in the infos. They are arrays
    of one row a place, by name:

    ``action_mask``
        Bool, shape (n, actions): what is allowed next. A row may allow nothing; any action
        then ends the episode.
    ``cost``
        Float64, shape (n,): cost of the skill just executed in the task's metric; 0 of one that
        could not be.
    ``end``
        Int8, shape (n,): 0 where the episode goes on, 1 complete, 2 infeasible, 3 out of time.
    ``final_obs``, ``final_mask``
        What was observed and allowed after the step, before another episode began.

    A place's future depends on its seed and the actions taken there alone: neither on its
    neighbours nor on how many there are.

    Parameters
    ----------
    models
        One model; or several, such as the boards of a family, of which every episode draws one.
        They have facts and skills of the same names in the same order.
    num_envs
        How many places, >= 1.
    observation
        ``paper``, ``markov`` or ``layout``: see `Observation`.
    mask
        What is allowed: ``none`` limits nothing; ``applicable`` the skills whose preconditions
        hold, for which no back end is queried; ``feasible`` those that back ends allow, too, which
        check all of them.
    objective
        ``reward`` or ``cost``: see `RewardFunction`.

    Attributes
    ----------
    features
        What every feature of an observation means.
    models
        As given, in a tuple.

    Raises
    ------
    OptionError
        If a name is unknown or the models do not fit each other.
    ValueError
        If there is no model or no place.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": [],
    }

    def __init__(
        self,
        models: SkillModel | Sequence[SkillModel],
        num_envs: int,
        *,
        observation: str = "markov",
        mask: str = "applicable",
        objective: str = "reward",
    ) -> None:
        self.models = (models,) if isinstance(models, SkillModel) else tuple(models)
        if not self.models or num_envs < 1:
            raise ValueError("An environment has at least one model and one place.")
        allowed: MaskKind = checked_name("mask", mask, MaskKind)
        tasks = [model.task for model in self.models]
        observations = family_observations(tasks, observation)
        self.num_envs = num_envs
        self.features = observations[0].features
        self.single_observation_space = observations[0].space
        self.single_action_space = gymnasium.spaces.Discrete(len(tasks[0].skills))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        reward_functions = [RewardFunction.of(task, objective) for task in tasks]
        self._table = TransitionTable(self.models, observations, reward_functions, allowed)
        self._starts = [self._table.number(i, one.initial) for i, one in enumerate(self.models)]
        self._generators: list[np.random.Generator] = []
        self._at = np.full(num_envs, -1, dtype=np.int64)
        self._steps = np.zeros(num_envs, dtype=np.int64)

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Features, Infos]:
        """Begin an episode at every place.

        Parameters
        ----------
        seed
            One for every place; or one of all, of which place i gets the i-th after it. None
            goes on with the generators there are, or seeds them by chance.
        options
            There are none.

        Returns
        -------
        observations, infos
            As of `step`; costs and ends are 0.

        Raises
        ------
        ValueError
            If there is not one seed for every place.
        """
        seeds: Sequence[int | None]
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seeds = [int(seed) + place for place in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else [int(one) for one in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"There are {self.num_envs} places, but {len(seeds)} seeds.")
        if seed is not None or not self._generators:
            self._generators = [seeding.np_random(one)[0] for one in seeds]
        self._begin(np.ones(self.num_envs, dtype=np.bool_))
        return self._first_look()

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Features, NDArray[Any], NDArray[Any], NDArray[Any], Infos]:
        """Take an action at every place.

        Parameters
        ----------
        actions
            Numbers of skills, shape (n,).

        Returns
        -------
        observations
            Float32, shape (n, width); of the next episode where one ended.
        rewards
            Float64, shape (n,).
        terminations, truncations
            Bool, shape (n,): whether the task was completed or a skill could not be executed;
            whether the step limit was reached.
        infos
            See the class.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        gymnasium.error.InvalidAction
            If there is not one action for every place, or one does not exist.
        BackEndError
            If a back end fails.
        SearchStopped
            If the learner should have stopped long ago.
        """
        table = self._table
        chosen = self._checked(actions)
        outcomes = table.first_outcomes(self._at, chosen)
        if table.has_chances:
            table.draw(outcomes, self._generators)
        following = table.following[outcomes]
        table.observe(following)
        self._steps += 1
        ends = table.ends[outcomes]
        rewards = table.rewards[outcomes]
        late = (self._steps >= table.limits[self._at]) & (ends == 0)
        if np.count_nonzero(late):
            rewards[late] = table.late_rewards[outcomes[late]]
            ends[late] = OUT_OF_TIME
        self._at = following
        over = ends > 0
        final_obs, final_mask = table.features[following], table.masks[following]
        if np.count_nonzero(over):
            self._at = following.copy()
            self._begin(over)
        infos: Infos = {
            "action_mask": table.masks[self._at],
            "cost": table.costs[outcomes],
            "end": ends,
            "final_obs": final_obs,
            "final_mask": final_mask,
        }
        return table.features[self._at], rewards, over & ~late, late, infos

    def state(self) -> dict[str, Any]:
        """Return where every place is, as JSON values: what `restore` goes on from.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        self._check_begun()
        table = self._table
        return {
            "places": [
                PlaceRecord(
                    model=int(table.model_of[at]),
                    bits=table.state(at).bits,
                    steps=int(steps),
                    generator=generator,
                ).document()
                for at, steps, generator in zip(
                    self._at.tolist(), self._steps.tolist(), self._generators, strict=True
                )
            ]
        }

    def restore(self, state: Mapping[str, Any]) -> tuple[Features, Infos]:
        """Put every place where it was, and its random numbers, so that it goes on bit for bit.

        Parameters
        ----------
        state
            What `state` returned, of an environment of the same models and as many places.

        Returns
        -------
        observations, infos
            As of `step`; costs and ends are 0.

        Raises
        ------
        ValueError
            If it is no such state; nothing has changed then.
        """
        places = state.get("places")
        if not isinstance(places, list) or len(places) != self.num_envs:
            raise ValueError(f"This is no state of an environment of {self.num_envs} places.")
        records = [PlaceRecord.read(document, self.models) for document in places]
        numbers = [
            self._table.number(
                record.model, self.models[record.model].task.facts.state(record.bits)
            )
            for record in records
        ]
        self._at = np.array(numbers, dtype=np.int64)
        self._steps = np.array([one.steps for one in records], dtype=np.int64)
        self._generators = [one.generator for one in records]
        return self._first_look()

    def close_extras(self, **kwargs: Any) -> None:
        """End the processes that back ends were queried in."""
        for model in self.models:
            model.feasibility.close()

    def _begin(self, places: NDArray[np.bool_]) -> None:
        """Begin an episode at the places marked."""
        count = len(self.models)
        if count == 1:
            self._at[places] = self._starts[0]
        else:
            for place in np.flatnonzero(places).tolist():
                self._at[place] = self._starts[int(self._generators[place].integers(count))]
        self._steps[places] = 0
        self._table.observe(self._at)

    def _first_look(self) -> tuple[Features, Infos]:
        table = self._table
        table.observe(self._at)
        observed, allowed = table.features[self._at], table.masks[self._at]
        return observed, {
            "action_mask": allowed,
            "cost": np.zeros(self.num_envs),
            "end": np.zeros(self.num_envs, dtype=np.int8),
            "final_obs": observed.copy(),
            "final_mask": allowed.copy(),
        }

    def _checked(self, actions: NDArray[np.int64]) -> NDArray[np.int64]:
        self._check_begun()
        chosen = np.asarray(actions)
        if chosen.shape != (self.num_envs,) or chosen.dtype.kind not in "iu":
            raise gymnasium.error.InvalidAction(
                f"There are {self.num_envs} places; each takes the number of an action."
            )
        count = len(self.models[0].task.skills)
        if np.count_nonzero((chosen < 0) | (chosen >= count)):
            raise gymnasium.error.InvalidAction(f"Actions are 0 to {count - 1}, not {chosen}.")
        return chosen

    def _check_begun(self) -> None:
        if not self._generators:
            raise gymnasium.error.ResetNeeded("The environment must be reset before it is used.")
