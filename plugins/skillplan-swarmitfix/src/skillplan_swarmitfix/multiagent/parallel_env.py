"""A task of several agents as a parallel environment of PettingZoo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from skillplan.env.rendering import (
    FRAMES_PER_S,
    Frame,
    Window,
    check_render_mode,
    list_render_modes,
    paint_frame,
)
from skillplan.model.skill_model import SkillModel
from skillplan_swarmitfix.multiagent.multi_agent import Move, MultiAgentProblem

try:
    from pettingzoo import ParallelEnv
except ModuleNotFoundError as error:
    if (error.name or "").partition(".")[0] != "pettingzoo":
        raise
    raise ModuleNotFoundError(
        "FleetParallelEnv needs PettingZoo: pip install pettingzoo", name=error.name
    ) from None

Features = NDArray[np.float32]
Infos = dict[str, dict[str, Any]]
WAIT = 0
"""The action of an agent that stays where it is."""


class FleetParallelEnv(ParallelEnv):  # type: ignore[misc]
    """Agents that move at the same time, until all of them are at their goals.

    Action 0 waits; action k is the agent's k-th skill. Every agent gets the reward -1 in every
    step, so that the return of a completed episode is minus its number of parallel steps. An
    episode is truncated when its moves or its steps reach the step limit of the task.

    Agents are served in the order of `agents`. A move is executed unless it is impossible at the
    beginning of the step, clashes with a move that an earlier agent makes in it, because both sweep
    a pin, or is infeasible for the back ends. An agent whose move is not executed waits, without a
    penalty. Moves of one step can therefore run at once or in any order, and `plan` is a plan of
    the task.

    An observation holds the agent's own place, its goal, and the places of the others, in the order
    of `agents` from the next one on: one bit per place, float32, shape (places * (n + 1),).

    The info of an agent holds

    ``action_mask``
        Int8, shape (actions,): 1 for waiting and for moves that are possible now, if no other agent
        moves. Also in the info of a reset.
    ``skill``
        Name of the skill that the agent tried; empty if it waited.
    ``executed``, ``reason``
        True if it was executed; else the reason.
    ``cost``
        Cost of the move in the task's metric; 0 if it was not executed.

    Parameters
    ----------
    model
        Model of a task of several agents, such as ``configs/swarmitfix_fleet.yaml``.
    render_mode
        None, ``ansi``, ``rgb_array`` or ``human``, as in `SkillEnv`.

    Attributes
    ----------
    plan
        Executed skills of the present episode, in an order that the task allows.
    schedule
        Executed skills of every step.

    Raises
    ------
    NotMultiAgent
        If the task does not consist of agents that move between places of their own.
    OptionError
        If the render mode is unknown, or no display is available for ``human``.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "skillplan_fleet_v0",
        "render_modes": ["ansi", "human", "rgb_array"],
        "render_fps": FRAMES_PER_S,
        "is_parallelizable": True,
    }

    def __init__(self, model: SkillModel, *, render_mode: str | None = None) -> None:
        self.model = model
        self.render_mode = check_render_mode(render_mode)
        self.metadata = {**self.metadata, "render_modes": list_render_modes()}
        self._window = Window()
        self._problem = MultiAgentProblem.from_model(model)
        self.possible_agents = list(self._problem.agents)
        self.agents: list[str] = []
        skills: dict[str, list[str]] = {agent: [] for agent in self.possible_agents}
        for skill in model.task.skills:
            skills[skill.agents[0]].append(skill.name)
        self.skills: Mapping[str, tuple[str, ...]] = {
            agent: tuple(names) for agent, names in skills.items()
        }
        # Move of every agent by place and action.
        self._moves: list[list[dict[int, Move]]] = [
            [{names.index(move.skill) + 1: move for move in here} for here in moves]
            for names, moves in zip(skills.values(), self._problem.moves, strict=True)
        ]
        sizes = [len(places) for places in self._problem.places]
        self.action_spaces = {agent: Discrete(len(skills[agent]) + 1) for agent in skills}
        self.observation_spaces = {
            agent: Box(0.0, 1.0, (sum(sizes) + size,), np.float32)
            for agent, size in zip(skills, sizes, strict=True)
        }
        self.state_space = Box(0.0, 1.0, (sum(sizes),), np.float32)
        self._places = list(self._problem.starts)
        self._state = model.initial
        self.schedule: list[tuple[str, ...]] = []

    @property
    def plan(self) -> tuple[str, ...]:
        """Executed skills of the present episode, in an order that the task allows."""
        return tuple(skill for step in self.schedule for skill in step)

    def observation_space(self, agent: str) -> Box:
        """Return the space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete:
        """Return the space of an agent's actions."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Features], Infos]:
        """Put every agent at its start.

        Parameters
        ----------
        seed, options
            Without effect, because neither starts nor moves are left to chance.

        Returns
        -------
        observations, infos
            By agent, as in the class.
        """
        self.agents = list(self.possible_agents)
        self._places = list(self._problem.starts)
        self._state, self.schedule = self.model.initial, []
        if self.render_mode == "human":
            self.render()
        return self._observe(), self._infos()

    def step(
        self, actions: Mapping[str, int]
    ) -> tuple[dict[str, Features], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Move all agents at the same time.

        Parameters
        ----------
        actions
            Action of every agent.

        Returns
        -------
        observations, rewards, terminations, truncations, infos
            By agent. All agents end together: terminated at their goals, truncated at the step
            limit.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the environment was not reset, or the episode is over.
        gymnasium.error.InvalidAction
            If an agent has no action, or an unknown one.
        BackEndError
            If a back end fails.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded("There is no running episode: call reset.")
        chosen = [self._check_action(agent, actions) for agent in self.agents]
        before, results = self._state.bits, []
        accepted: list[Move] = []
        for index, action in enumerate(chosen):
            move = self._moves[index][self._places[index]].get(action)
            reason = self._try_move(index, move, action, before, accepted)
            if move is not None and not reason:
                accepted.append(move)
            results.append(
                {
                    "skill": self.skills[self.agents[index]][action - 1] if action else "",
                    "executed": move is not None and not reason,
                    "reason": reason,
                    "cost": 0.0 if move is None or reason else move.cost,
                }
            )
        for move in accepted:
            self._places[move.agent] = move.end
        self.schedule.append(tuple(move.skill for move in accepted))
        limit = self.model.step_limit
        complete = self.model.is_goal(self._state)
        late = not complete and (len(self.schedule) >= limit or len(self.plan) >= limit)
        observations, infos = self._observe(), self._infos()
        for agent, result in zip(self.agents, results, strict=True):
            infos[agent].update(result)
        rewards = dict.fromkeys(self.agents, -1.0)
        ended, cut = (dict.fromkeys(self.agents, flag) for flag in (complete, late))
        if complete or late:
            self.agents = []
        if self.render_mode == "human":
            self.render()
        return observations, rewards, ended, cut, infos

    def state(self) -> Features:
        """Return the places of all agents, one bit per place, shape (places * n,)."""
        return np.concatenate([self._encode(index, at) for index, at in enumerate(self._places)])

    def render(self) -> str | Frame | None:
        """Return a line of text or an image of the present state, as `SkillEnv.render`."""
        step = f"step {len(self.schedule)}"
        last = ", ".join(self.schedule[-1]) or "all wait" if self.schedule else ""
        caption = f"{step}; {last}" if last else step
        if self.render_mode == "ansi":
            return f"{caption}; {self._state}"
        if self.render_mode is None:
            return None
        frame = paint_frame(self.model.task, self._state, caption)
        if self.render_mode == "rgb_array":
            return frame
        self._window.show([frame], self.model.task.name)
        return None

    def close(self) -> None:
        """Close the window, and end the worker processes of back ends."""
        self._window.close()
        self.model.feasibility.close()

    def _check_action(self, agent: str, actions: Mapping[str, int]) -> int:
        space = self.action_spaces[agent]
        action = actions.get(agent)
        if action is None or not space.contains(action):
            shown = "none" if action is None else repr(action)
            raise gymnasium.error.InvalidAction(
                f"Actions of {agent} are 0 (wait) to {int(space.n) - 1}, not {shown}."
            )
        return int(action)

    def _try_move(
        self, index: int, move: Move | None, action: int, before: int, accepted: list[Move]
    ) -> str:
        """Make a move if nothing is against it; return the reason if it is not made."""
        if action == WAIT:
            return ""
        if move is None or not move.passes(before):
            place = self._problem.places[index][self._places[index]]
            return f"not possible with the agents where they are, from {place}"
        for other in accepted:
            if move.clashes(other):
                return f"clashes with {other.skill}"
        if len(self.plan) + len(accepted) >= self.model.step_limit:
            return f"the plan has {self.model.step_limit} moves, the limit of the task"
        skill = self.model.task.skill(move.skill)
        verdict = self.model.verdict(self._state, skill)
        if not verdict.is_feasible:
            return verdict.reason or str(verdict.status)
        self._state = skill.prediction_in(self._state).apply(self._state)
        return ""

    def _encode(self, index: int, place: int) -> Features:
        bits = np.zeros(len(self._problem.places[index]), dtype=np.float32)
        bits[place] = 1.0
        return bits

    def _observe(self) -> dict[str, Features]:
        own = [self._encode(index, at) for index, at in enumerate(self._places)]
        return {
            agent: np.concatenate(
                [own[i], self._encode(i, self._problem.goals[i]), *own[i + 1 :], *own[:i]]
            )
            for i, agent in enumerate(self.possible_agents)
        }

    def _infos(self) -> Infos:
        bits, infos = self._state.bits, {}
        for index, agent in enumerate(self.possible_agents):
            mask = np.zeros(int(self.action_spaces[agent].n), dtype=np.int8)
            here = self._moves[index][self._places[index]]
            mask[[WAIT, *(action for action, move in here.items() if move.passes(bits))]] = 1
            infos[agent] = {"action_mask": mask}
        return infos
