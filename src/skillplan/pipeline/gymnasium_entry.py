"""Entry points that Gymnasium calls to make ``skillplan/Task-v0`` from a task file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium

from skillplan.env.skill_env import SkillEnv
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.errors import OptionError, name_hint
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.pipeline.solving import make_model
from skillplan.task.task import Task

Options = Mapping[str, Mapping[str, Any]]


def make_env(
    task: str | os.PathLike[str] | Task | None = None,
    *,
    part: str | None = None,
    physics: str | None = None,
    collision: str | Sequence[str] = (),
    options: Options | None = None,
    observation: str = "markov",
    mask: str = "applicable",
    objective: str = "reward",
    render_mode: str | None = None,
) -> SkillEnv:
    """Return the environment of a task.

    Parameters
    ----------
    task
        A task file, or a task. Required.
    part
        Name of a task of the file; needed if the file describes a chain of several.
    physics, collision
        Names of engine and detectors, the latter as a sequence or separated by commas; by default
        as the task file chooses.
    options
        Plugin name to option values, such as ``{"aabb": {"clearance_m": 0.002}}``.
    observation, mask, objective, render_mode
        As in `SkillEnv`.

    Raises
    ------
    TaskError
        If the task file has faults, or describes a chain of several tasks and `part` is None.
    OptionError, PluginError
        If a name or an option is wrong.
    BackEndError
        If a back end fails to start.
    gymnasium.error.MissingArgument
        If `task` is None.
    """
    return SkillEnv(
        _model(task, part, physics, collision, options),
        observation=observation,
        mask=mask,
        objective=objective,
        render_mode=render_mode,
    )


def make_vector_env(
    num_envs: int,
    task: str | os.PathLike[str] | Task | None = None,
    *,
    part: str | None = None,
    physics: str | None = None,
    collision: str | Sequence[str] = (),
    options: Options | None = None,
    observation: str = "markov",
    mask: str = "applicable",
    objective: str = "reward",
    render_mode: str | None = None,
    max_episode_steps: int | None = None,
) -> SkillVectorEnv:
    """Return a vector environment, in which several episodes of a task run side by side.

    Parameters
    ----------
    num_envs
        Number of episodes, >= 1.
    task, part, physics, collision, options
        As in `make_env`, which raises the same errors.
    observation, mask, objective, render_mode
        As in `SkillVectorEnv`.
    max_episode_steps
        None: episodes end at the step limit of the task.

    Raises
    ------
    OptionError
        If `max_episode_steps` is not None.
    """
    if max_episode_steps is not None:
        raise OptionError(
            "max_episode_steps: the vector environment ends episodes at the task's step limit. Set "
            '`step_limit` in the task file, or pass vectorization_mode="sync".'
        )
    return SkillVectorEnv(
        _model(task, part, physics, collision, options),
        num_envs,
        observation=observation,
        mask=mask,
        objective=objective,
        render_mode=render_mode,
    )


def _model(
    task: str | os.PathLike[str] | Task | None,
    part: str | None,
    physics: str | None,
    collision: str | Sequence[str],
    options: Options | None,
) -> SkillModel:
    if task is None:
        raise gymnasium.error.MissingArgument(
            "An environment needs a task: pass `task`, the path of a task file or a task."
        )
    detectors = collision.split(",") if isinstance(collision, str) else collision
    detectors = tuple(dict.fromkeys(name.strip() for name in detectors if name.strip()))
    if not isinstance(task, Task):
        queried = {"physics": [physics] if physics else [], "collision": detectors}
        chosen = {kind: names for kind, names in queried.items() if names}
        task = load_problem(task, chosen).part(part, by="`part`")
    elif part is not None:
        raise OptionError("`part` names a task of a file, but `task` is a task already.")
    setup = Setup(physics, detectors, options or {})
    taking_part = [setup.physics_choice(task).name]
    taking_part += [choice.name for choice in setup.collision_choices(task)]
    for plugin in setup.options:
        if plugin not in taking_part:
            hint = name_hint(plugin, taking_part)
            raise OptionError(f"No plugin {plugin!r} takes part in this environment. {hint}")
    return make_model(task, setup)
