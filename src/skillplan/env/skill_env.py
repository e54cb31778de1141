"""A task as a Gymnasium environment that explains every step by a verdict."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import (
    MaskKind,
    Observation,
    RewardFunction,
    check_name,
    list_allowed_actions,
    read_start,
)
from skillplan.env.rendering import (
    FRAMES_PER_S,
    Frame,
    Window,
    check_render_mode,
    list_render_modes,
    paint_frame,
)
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State

Features = NDArray[np.float32]


class SkillEnv(gymnasium.Env[Features, np.int64]):
    """The environment of a task (Moller et al., section 4.2).

    An action is the number of a skill. If the skill is not applicable, infeasible or undecided, the
    episode ends in the same state with the penalty of infeasible skills. Reaching the goal ends the
    episode; reaching the step limit truncates it.

    The info of a step holds

    ``skill``, ``verdict``, ``stage``, ``reason``, ``facts``
        Name of the skill; ``feasible``, ``infeasible`` or ``unknown``; the check that decided; its
        reason; and the facts of the verdict, absent ones with ``not``.
    ``cost``
        Cost of the skill in the task's metric; 0 if it was not executed.
    ``state``
        Facts that hold now. Also in the info of a reset.
    ``action_mask``
        Int8, shape (actions,): 1 for allowed actions, as ``action_space.sample(mask)`` takes it.
        Also in the info of a reset.

    Parameters
    ----------
    observation
        ``paper``, ``markov`` or ``layout``: see `Observation`.
    mask
        ``none``, ``applicable`` or ``feasible``: see `list_allowed_actions`.
    objective
        ``reward`` or ``cost``: see `RewardFunction`.
    render_mode
        None, ``ansi`` for one line of text, ``rgb_array`` for an image, shape (480, 640, 3), or
        ``human`` for a window, which every reset and step renews.

    Attributes
    ----------
    features
        Names of the features of an observation.

    Raises
    ------
    OptionError
        If a name is unknown.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["ansi", "human", "rgb_array"],
        "render_fps": FRAMES_PER_S,
    }

    def __init__(
        self,
        model: SkillModel,
        *,
        observation: str = "markov",
        mask: str = "applicable",
        objective: str = "reward",
        render_mode: str | None = None,
    ) -> None:
        self.model = model
        self.render_mode = check_render_mode(render_mode)
        self.metadata = {**self.metadata, "render_modes": list_render_modes()}
        self._window = Window()
        self._observation = Observation.of(model.task, observation)
        self._mask: MaskKind = check_name("mask", mask, MaskKind)
        self._reward_function = RewardFunction.of(model.task, objective)
        self.features = self._observation.features
        self.observation_space = self._observation.space
        self.action_space = gymnasium.spaces.Discrete(len(model.task.skills))
        self._state = model.initial
        self._steps = 0
        self._cost = 0.0
        self._last = ""
        self._over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Features, dict[str, Any]]:
        """Start an episode.

        Parameters
        ----------
        seed
            Seed of the outcomes; None goes on with the present generator.
        options
            ``{"start": ...}`` for an episode from another state: see `read_start`.

        Returns
        -------
        observation, info
            Observation, float32, shape (width,); info of the class.

        Raises
        ------
        OptionError
            If an option or its value is wrong.
        """
        start = read_start(self.model, options)
        super().reset(seed=seed)
        self._state, self._steps, self._cost = start, 0, 0.0
        self._last, self._over = "", False
        self._show()
        return self._observation.encode(self._state), self._info()

    def step(self, action: np.int64 | int) -> tuple[Features, float, bool, bool, dict[str, Any]]:
        """Take an action.

        Returns
        -------
        observation
            Observation, float32, shape (width,).
        reward
            Reward of the step.
        terminated
            True if the task is completed, or the skill could not be executed.
        truncated
            True if the step limit was reached.
        info
            Info of the class.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset, or the episode is over.
        gymnasium.error.InvalidAction
            If the action does not exist.
        BackEndError
            If a back end fails.
        SearchStopped
            If the learner is overdue.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no running episode: call reset.")
        if not self.action_space.contains(action):
            last = len(self.model.task.skills) - 1
            raise gymnasium.error.InvalidAction(f"Actions are 0 to {last}, not {action!r}.")
        before, skill = self._state, self.model.task.skills[int(action)]
        verdict = self.model.verdict(before, skill)
        explanation = {
            "skill": skill.name,
            "verdict": str(verdict.status),
            "stage": verdict.stage,
            "reason": verdict.reason,
            "facts": verdict.facts,
        }
        self._last = f"; {skill.name}: {verdict.reason or verdict.status}"
        self._steps += 1
        if not verdict.is_feasible:
            self._over = True
            self._show()
            info = {**self._info(), **explanation}
            return (
                self._observation.encode(before),
                self._reward_function.infeasible,
                True,
                False,
                info,
            )
        cost = self.model.cost(before, skill)
        self._cost += cost
        self._state = self._outcome(skill, before).apply(before)
        goal = self.model.is_goal(self._state)
        late = not goal and self._steps >= self.model.step_limit
        self._over = goal or late
        self._show()
        reward = self._reward_function.of_step(
            before, skill.name, cost, goal=goal, out_of_time=late
        )
        info = {**self._info(), **explanation, "cost": cost}
        return self._observation.encode(self._state), float(reward), goal, late, info

    def render(self) -> str | Frame | None:
        """Return a line of text or an image of the present state.

        Returns None without a render mode, and with ``human``, for which it renews the window.

        Raises
        ------
        gymnasium.error.DependencyNotInstalled
            If the mode is ``human`` and pygame is not installed.
        OptionError
            If the mode is ``human`` and no window can be opened.
        """
        cost = self.model.task.cost_text(self._cost)
        caption = f"step {self._steps}, {cost}{self._last}"
        if self.render_mode == "ansi":
            return f"{caption}; {self._state}"
        if self.render_mode == "rgb_array":
            return paint_frame(self.model.task, self._state, caption)
        if self.render_mode == "human":
            frame = paint_frame(self.model.task, self._state, caption)
            self._window.show([frame], self.model.task.name)
        return None

    def action_masks(self) -> NDArray[np.int8]:
        """Return ``action_mask`` of the present state, as MaskablePPO of sb3-contrib calls it."""
        mask = np.zeros(len(self.model.task.skills), dtype=np.int8)
        mask[list(list_allowed_actions(self.model, self._state, self._mask, self._feasible))] = 1
        return mask

    def close(self) -> None:
        """Close the window, and end the worker processes of back ends."""
        self._window.close()
        self.model.feasibility.close()

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()

    def _info(self) -> dict[str, Any]:
        return {"state": list(self._state), "action_mask": self.action_masks(), "cost": 0.0}

    def _feasible(self, action: int) -> bool:
        return self.model.verdict(self._state, self.model.task.skills[action]).is_feasible

    def _outcome(self, skill: Skill, state: State) -> Outcome:
        """Return an outcome of a skill, drawn if there are several."""
        outcomes = skill.outcomes_in(state)
        if len(outcomes) == 1:
            return outcomes[0]
        drawn, below = self.np_random.random(), 0.0
        for outcome in outcomes[:-1]:
            below += outcome.probability
            if drawn < below:
                return outcome
        return outcomes[-1]
