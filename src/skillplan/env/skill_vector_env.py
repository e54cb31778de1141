"""A vectorised Gymnasium environment: many episodes of a task, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from skillplan.env.observation import MaskKind, Observation, RewardFunction, check_name, read_start
from skillplan.env.rendering import (
    FRAMES_PER_S,
    Frame,
    Window,
    check_render_mode,
    list_render_modes,
    paint_frame,
)
from skillplan.env.transition_table import OUT_OF_TIME, TransitionTable
from skillplan.errors import OptionError
from skillplan.model.skill_model import SkillModel
from skillplan.task.task import Task


@dataclass(frozen=True)
class PlaceRecord:
    """State of one sub-environment."""

    model: int
    bits: int
    steps: int
    generator: np.random.Generator

    def document(self) -> dict[str, Any]:
        """Return JSON values; long integers are hexadecimal."""
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
            Value from `document`.

        Raises
        ------
        ValueError
            If it is no such document, or belongs to other models.
        """
        try:
            model, steps = int(document["model"]), int(document["steps"])
            bits = int(document["facts"], 16)
            numbers = document["generator"]
            generator = np.random.Generator(np.random.PCG64())
            generator.bit_generator.state = {
                "bit_generator": "PCG64",
                "state": {"state": int(numbers["state"], 16), "inc": int(numbers["increment"], 16)},
                "has_uint32": int(numbers["half_left"]),
                "uinteger": int(numbers["half"]),
            }
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise ValueError(f"This is no state of a place: {error!r}.") from None
        if not 0 <= model < len(models) or not 0 <= steps < models[model].step_limit:
            raise ValueError("This is the state of a place of other tasks.")
        models[model].task.facts.state(bits)
        return cls(model, bits, steps, generator)


def make_family_observations(tasks: Sequence[Task], kind: str) -> list[Observation]:
    """Return the observation of every task.

    Parameters
    ----------
    kind
        See `Observation`.

    Raises
    ------
    OptionError
        If the kind is unknown, or if facts, skills or features differ in names or order.
    """
    observations = [Observation.of(task, kind) for task in tasks]
    for task, observed in zip(tasks[1:], observations[1:], strict=True):
        pairs = {
            "facts": (tasks[0].facts.names, task.facts.names),
            "skills": tuple([skill.name for skill in member.skills] for member in (tasks[0], task)),
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
    """Many parallel episodes of one model, or of several models with equal shape.

    An action is the number of a skill. If the skill is not applicable, infeasible or undecided, the
    episode ends in the same state with the penalty of infeasible skills. Reaching the goal ends the
    episode; reaching the step limit truncates it. Rewards come from `skillplan.env.observation`,
    without shaping.

    When an episode ends, the next one starts in the same step: the returned observation is its
    first one, and the infos describe the end of the last one. They are arrays with one row per
    sub-environment, by name:

    ``action_mask``
        Int8, shape (n, actions): 1 for actions that are allowed next. If a row allows none, any
        action ends the episode.
    ``cost``
        Float64, shape (n,): cost of the executed skill in the task's metric; 0 if it was not
        executed.
    ``end``
        Int8, shape (n,): 0 if the episode goes on, 1 complete, 2 infeasible, 3 out of time.
    ``final_obs``, ``final_mask``
        Observation and mask after the step, before the next episode; of every row.
    ``_final_obs``
        Bool, shape (n,): True if an episode ended.
    ``final_info``, ``_final_info``
        Only if an episode ended, as of Gymnasium's `SyncVectorEnv`: ``action_mask``, ``cost`` and
        ``end`` after the step, valid in the rows that ``_final_info`` marks.

    The episodes of a sub-environment depend only on its seed and actions, not on the others.

    Parameters
    ----------
    models
        One model; or several, such as the boards of a family, of which every episode draws one.
        Their facts and skills must agree in names and order.
    num_envs
        Number of sub-environments, >= 1.
    observation
        ``paper``, ``markov`` or ``layout``: see `Observation`.
    mask
        Allowed actions: ``none`` allows all; ``applicable`` skills whose preconditions hold,
        without back ends; ``feasible`` skills that back ends allow, too.
    objective
        ``reward`` or ``cost``: see `RewardFunction`.
    render_mode
        None; ``ansi`` or ``rgb_array`` for a line of text or an image of every sub-environment; or
        ``human`` for a window with all of them.

    Attributes
    ----------
    features
        Names of the features of an observation.

    Raises
    ------
    OptionError
        If a name is unknown, or the models do not match.
    ValueError
        If the models are empty, or `num_envs` is below 1.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": ["ansi", "human", "rgb_array"],
        "render_fps": FRAMES_PER_S,
    }

    def __init__(
        self,
        models: SkillModel | Sequence[SkillModel],
        num_envs: int,
        *,
        observation: str = "markov",
        mask: str = "applicable",
        objective: str = "reward",
        render_mode: str | None = None,
    ) -> None:
        self.models = (models,) if isinstance(models, SkillModel) else tuple(models)
        if not self.models or num_envs < 1:
            raise ValueError("An environment has at least one model and one place.")
        allowed: MaskKind = check_name("mask", mask, MaskKind)
        tasks = [model.task for model in self.models]
        observations = make_family_observations(tasks, observation)
        self.num_envs = num_envs
        self.render_mode = check_render_mode(render_mode)
        self.metadata = {**self.metadata, "render_modes": list_render_modes()}
        self._window = Window()
        self.features = observations[0].features
        self.single_observation_space = observations[0].space
        self.single_action_space = gymnasium.spaces.Discrete(len(tasks[0].skills))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        reward_functions = [RewardFunction.of(task, objective) for task in tasks]
        self._table = TransitionTable(self.models, observations, reward_functions, allowed)
        self._starts = [self._table.number(i, model.initial) for i, model in enumerate(self.models)]
        self._generators: list[np.random.Generator] = []
        self._at = np.full(num_envs, -1, dtype=np.int64)
        self._steps = np.zeros(num_envs, dtype=np.int64)
        # Actions and ends of the last step, for captions.
        self._last: tuple[NDArray[np.int64], NDArray[np.int8]] | None = None

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Features, Infos]:
        """Start an episode in every sub-environment.

        Parameters
        ----------
        seed
            One seed per sub-environment; or one for all, to which its index is added. None goes on
            with the present generators.
        options
            ``{"start": ...}`` for first episodes from another state: see `read_start`. Episodes
            that follow in the same sub-environment begin in the task's own initial state.

        Returns
        -------
        observations, infos
            As for `step`; costs and ends are 0.

        Raises
        ------
        OptionError
            If an option or its value is wrong.
        ValueError
            If the number of seeds differs.
        gymnasium.error.ClosedEnvironmentError
            If the environment was closed.
        """
        self._check_open()
        starts = self._starts
        if options:
            states = [read_start(model, options) for model in self.models]
            starts = [self._table.number(i, state) for i, state in enumerate(states)]
        seeds: Sequence[int | None]
        if isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
            seeds = [int(seed) + place for place in range(self.num_envs)]
        else:
            seeds = [None] * self.num_envs if seed is None else [int(entry) for entry in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"There are {self.num_envs} places, but {len(seeds)} seeds.")
        if seed is not None or not self._generators:
            self._generators = [seeding.np_random(entry)[0] for entry in seeds]
        self._begin(np.ones(self.num_envs, dtype=np.bool_), starts)
        self._last = None
        return self._first_look()

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Features, NDArray[Any], NDArray[Any], NDArray[Any], Infos]:
        """Take an action in every sub-environment.

        Parameters
        ----------
        actions
            Action numbers, shape (n,).

        Returns
        -------
        observations
            Float32, shape (n, width); of the next episode if one ended.
        rewards
            Rewards, float64, shape (n,).
        terminations, truncations
            Bool, shape (n,): completed or infeasible; and step limit reached.
        infos
            Infos of the class.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset.
        gymnasium.error.ClosedEnvironmentError
            If the environment was closed.
        gymnasium.error.InvalidAction
            If the number of actions differs, or an action does not exist.
        BackEndError
            If a back end fails.
        SearchStopped
            If the learner is overdue.
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
        final_obs, final_mask = table.features[following], table.masks[following].view(np.int8)
        if np.count_nonzero(over):
            self._at = following.copy()
            self._begin(over, self._starts)
        self._last = chosen, ends
        if self.render_mode == "human":
            self.render()
        infos: Infos = {
            "action_mask": self.action_masks(),
            "cost": table.costs[outcomes],
            "end": ends,
            "final_obs": final_obs,
            "final_mask": final_mask,
            "_final_obs": over,
        }
        if np.count_nonzero(over):
            final = {"action_mask": final_mask, "cost": infos["cost"], "end": ends}
            infos["final_info"] = {**final, **{f"_{name}": over for name in final}}
            infos["_final_info"] = over
        return table.features[self._at], rewards, over & ~late, late, infos

    def action_masks(self) -> NDArray[np.int8]:
        """Return ``action_mask`` of the present states, shape (n, actions).

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset.
        """
        self._check_begun()
        return self._table.masks[self._at].view(np.int8)

    def render(self) -> tuple[str | Frame, ...] | None:
        """Return a line of text or an image of every sub-environment.

        An image has shape (480, 640, 3). Returns None without a render mode, and with ``human``,
        for which it renews the window.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset.
        gymnasium.error.DependencyNotInstalled
            If the mode is ``human`` and pygame is not installed.
        OptionError
            If the mode is ``human`` and no window can be opened.
        """
        if self.render_mode is None:
            return None
        self._check_begun()
        states = [self._table.state(number) for number in self._at.tolist()]
        captions = [self._caption(place) for place in range(self.num_envs)]
        if self.render_mode == "ansi":
            return tuple(
                f"{caption}; {state}" for caption, state in zip(captions, states, strict=True)
            )
        tasks = [self.models[index].task for index in self._table.model_of[self._at].tolist()]
        frames = tuple(map(paint_frame, tasks, states, captions))
        if self.render_mode == "rgb_array":
            return frames
        self._window.show(frames, tasks[0].name)
        return None

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return the results of ``action_masks`` or ``render``, one per sub-environment.

        As `SyncVectorEnv.call`, which wrappers of other libraries use.

        Raises
        ------
        AttributeError
            If it is another method.
        """
        if name not in ("action_masks", "render"):
            raise AttributeError(
                f"Sub-environments have no method {name!r}; they have action_masks and render."
            )
        results = getattr(self, name)(*args, **kwargs)
        return (None,) * self.num_envs if results is None else tuple(results)

    def _caption(self, place: int) -> str:
        """Return the number of the step and the last skill, or how the last episode ended."""
        caption = f"step {self._steps[place]}"
        if self._last is None:
            return caption
        actions, ends = self._last
        skill = self.models[0].task.skills[int(actions[place])].name
        reason = ("", ", which completed it", ", which was infeasible", ", out of time")
        end = int(ends[place])
        return f"{caption}; {skill}" if not end else f"{caption}; before: {skill}{reason[end]}"

    def state(self) -> dict[str, Any]:
        """Return the state of all sub-environments as JSON values, for `restore`.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset.
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
        """Restore the states and random generators of all sub-environments, bit for bit.

        Parameters
        ----------
        state
            Value from `state`, of an environment with equal models and size.

        Returns
        -------
        observations, infos
            As for `step`; costs and ends are 0.

        Raises
        ------
        ValueError
            If it is no such state; then nothing changes.
        gymnasium.error.ClosedEnvironmentError
            If the environment was closed.
        """
        self._check_open()
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
        self._steps = np.array([record.steps for record in records], dtype=np.int64)
        self._generators = [record.generator for record in records]
        self._last = None
        return self._first_look()

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window, and end the worker processes of back ends."""
        self._window.close()
        for model in self.models:
            model.feasibility.close()

    def _begin(self, places: NDArray[np.bool_], starts: Sequence[int]) -> None:
        """Start an episode in the marked sub-environments, from the start of each model."""
        count = len(self.models)
        if count == 1:
            self._at[places] = starts[0]
        else:
            for place in np.flatnonzero(places).tolist():
                self._at[place] = starts[int(self._generators[place].integers(count))]
        self._steps[places] = 0
        self._table.observe(self._at)

    def _first_look(self) -> tuple[Features, Infos]:
        if self.render_mode == "human":
            self.render()
        table = self._table
        table.observe(self._at)
        observed, allowed = table.features[self._at], self.action_masks()
        return observed, {
            "action_mask": allowed,
            "cost": np.zeros(self.num_envs),
            "end": np.zeros(self.num_envs, dtype=np.int8),
            "final_obs": observed.copy(),
            "final_mask": allowed.copy(),
            "_final_obs": np.zeros(self.num_envs, dtype=np.bool_),
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

    def _check_open(self) -> None:
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError(
                "The environment was closed: make a new one."
            )

    def _check_begun(self) -> None:
        self._check_open()
        if not self._generators:
            raise gymnasium.error.ResetNeeded("The environment must be reset before it is used.")
