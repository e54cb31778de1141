"""One task as a Gymnasium environment that says why: the verdict on every step, in words."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import (
    MaskKind,
    Observation,
    RewardFunction,
    allowed_actions,
    checked_name,
)
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State

Features = NDArray[np.float32]


class SkillEnv(gymnasium.Env[Features, np.int64]):
    """A task as seen by a learner: Moller et al., section 4.2.

    An action is a skill's number. A skill that is not applicable, not feasible, or on which back
    ends cannot decide ends the episode where it is with the reward of the infeasible; reaching
    the goal ends it; reaching the step limit truncates it.

    The info of a step holds

    ``skill``, ``verdict``, ``stage``, ``reason``, ``facts``
        What was tried; whether that is ``feasible``, ``infeasible`` or ``unknown``; the check
        that decided, why, and the facts on which that rests, those that do not hold with ``not``.
    ``cost``
        Of the skill in the task's metric; 0 of one that could not be executed.
    ``state``
        The facts that hold now. Also in the info of a reset.
    ``action_mask``
        Int8, shape (actions,): 1 for what is allowed now, as ``action_space.sample(mask)`` takes
        it. Also in the info of a reset.

    Parameters
    ----------
    model
        The model of the task.
    observation
        ``paper``, ``markov`` or ``layout``: see `Observation`.
    mask
        ``none``, ``applicable`` or ``feasible``: see `allowed_actions`.
    objective
        ``reward`` or ``cost``: see `RewardFunction`.
    render_mode
        None, or ``ansi`` for one line of text.

    Attributes
    ----------
    features
        What every feature of an observation means.
    model
        As given.

    Raises
    ------
    OptionError
        If a name is unknown.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi"], "render_fps": 1}  # type: ignore[misc]

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
        self.render_mode = render_mode
        self._observation = Observation.of(model.task, observation)
        self._mask: MaskKind = checked_name("mask", mask, MaskKind)
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
        """Begin an episode.

        Parameters
        ----------
        seed
            Governs which outcomes chance gives; None goes on with the random numbers there are.
        options
            There are none.

        Returns
        -------
        observation, info
            Float32, shape (width,); and see the class.
        """
        super().reset(seed=seed)
        self._state, self._steps, self._cost = self.model.initial, 0, 0.0
        self._last, self._over = "", False
        return self._observation.encode(self._state), self._info()

    def step(self, action: np.int64 | int) -> tuple[Features, float, bool, bool, dict[str, Any]]:
        """Take an action.

        Returns
        -------
        observation
            Float32, shape (width,).
        reward
            Its reward.
        terminated
            Whether the task is completed, or the skill could not be executed.
        truncated
            Whether the step limit was reached.
        info
            See the class.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset, and once the episode is over.
        gymnasium.error.InvalidAction
            If there is no such action.
        BackEndError
            If a back end fails.
        SearchStopped
            If the learner should have stopped long ago.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("There is no running episode: call reset.")
        if not self.action_space.contains(action):
            last = len(self.model.task.skills) - 1
            raise gymnasium.error.InvalidAction(f"Actions are 0 to {last}, not {action!r}.")
        before, skill = self._state, self.model.task.skills[int(action)]
        verdict = self.model.verdict(before, skill)
        said = {
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
            info = {**self._info(), **said}
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
        reward = self._reward_function.of_step(
            before, skill.name, cost, goal=goal, out_of_time=late
        )
        info = {**self._info(), **said, "cost": cost}
        return self._observation.encode(self._state), float(reward), goal, late, info

    def render(self) -> str | None:
        """Return one line of where things stand; None without a render mode."""
        if self.render_mode is None:
            return None
        cost = self.model.task.cost_text(self._cost)
        return f"step {self._steps}, {cost}{self._last}; {self._state}"

    def close(self) -> None:
        """End the processes that back ends were queried in."""
        self.model.feasibility.close()

    def _info(self) -> dict[str, Any]:
        mask = np.zeros(len(self.model.task.skills), dtype=np.int8)
        mask[list(allowed_actions(self.model, self._state, self._mask, self._feasible))] = 1
        return {"state": list(self._state), "action_mask": mask, "cost": 0.0}

    def _feasible(self, action: int) -> bool:
        return self.model.verdict(self._state, self.model.task.skills[action]).is_feasible

    def _outcome(self, skill: Skill, state: State) -> Outcome:
        """Return the outcome of a skill; it is drawn only where there are several."""
        outcomes = skill.outcomes_in(state)
        if len(outcomes) == 1:
            return outcomes[0]
        drawn, below = self.np_random.random(), 0.0
        for outcome in outcomes[:-1]:
            below += outcome.probability
            if drawn < below:
                return outcome
        return outcomes[-1]
