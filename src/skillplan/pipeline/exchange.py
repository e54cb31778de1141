"""Plans handed to other tools by exporters, and read back from their files."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from skillplan.domains.load import Problem
from skillplan.errors import OptionError, PluginError
from skillplan.exporters.exporter import Exporter, Handover, TrainedPolicy
from skillplan.exporters.pddl.exporter import ActionNames
from skillplan.exporters.plan_files import read_plan
from skillplan.model.replay import Replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.setup import CHART, DEFAULT_PHYSICS, Setup
from skillplan.plugins.blame import blame
from skillplan.records.stored.result_file import read_start_plan
from skillplan.solvers.solution import Plan
from skillplan.task.skill import Skill
from skillplan.task.task import Task

if TYPE_CHECKING:
    from skillplan.records.training.network_policy_file import StoredNetwork

_Said = TypeVar("_Said")


def make_exporter(name: str, options: Mapping[str, Any]) -> Exporter:
    """Return an exporter by name.

    Raises
    ------
    PluginError
        If it is unknown or broken.
    OptionError
        If an option is wrong.
    """
    plugin = registry.load("exporter", name)
    validated = registry.make_options("exporter", name, plugin, options)
    exporter: Exporter = _call(plugin, lambda: plugin(validated))
    return exporter


def make_handover(
    model: SkillModel,
    setup: Setup,
    plan: Replay | None,
    policies: Mapping[int, TrainedPolicy] = MappingProxyType({}),
) -> Handover:
    """Return the input of an exporter.

    Parameters
    ----------
    model
        Model of the task.
    setup
        Back ends that the model queries.
    plan
        A plan replayed on the model; None for the task alone.
    policies
        Policies of a training by the number of their run.
    """
    return Handover(model, plan, is_charted(model, setup), policies)


def describe_policy(stored: StoredNetwork) -> TrainedPolicy:
    """Return a stored policy as exporters take it."""
    content = stored.content
    return TrainedPolicy(
        stored.network.weights,
        stored.network.biases,
        tuple(content.features),
        tuple(content.actions),
        content.observation,
        content.mask,
        content.solver,
        content.task.name,
        content.step,
        content.cost,
        stored.own_rule.words,
    )


def is_charted(model: SkillModel, setup: Setup) -> bool:
    """Return whether the chart of the task file is the only check except reach."""
    detectors = [choice.name for choice in setup.collision_choices(model.task)]
    return detectors == [CHART] and setup.physics_choice(model.task).name == DEFAULT_PHYSICS


def export_files(exporter: Exporter, handover: Handover) -> Mapping[str, str | bytes]:
    """Return the files that an exporter makes of a task or a plan, by name.

    Raises
    ------
    OptionError
        If the exporter refuses, or needs a plan or a policy and has none.
    PluginError
        If it fails.
    """
    plugin = type(exporter)
    if exporter.needs_policies and not handover.policies:
        raise OptionError(
            f"{exporter.name} exports a policy: give a folder of train that has one in the place "
            "of TASK."
        )
    if exporter.needs_plan and handover.plan is None:
        raise OptionError(
            f"{exporter.name} hands over a plan: give a RESULT in the place of TASK, or --sequence."
        )
    refusal = _call(plugin, lambda: exporter.refuses(handover))
    if refusal:
        raise OptionError(f"{handover.task.name} cannot be exported to {exporter.name}: {refusal}.")
    files = _call(plugin, lambda: dict(exporter.files(handover)))
    if not files or (exporter.suffix and len(files) > 1):
        raise PluginError(f"The exporter {exporter.name!r} made {len(files)} files.")
    for name in files:
        if PurePath(name).name != name:
            raise PluginError(f"The exporter {exporter.name!r} made {name!r}: no name of a file.")
    return files


def list_notes(exporter: Exporter, handover: Handover) -> tuple[str, ...]:
    """Return the notes of an exporter on its files.

    Raises
    ------
    PluginError
        If it fails.
    """
    return _call(type(exporter), lambda: tuple(exporter.notes(handover)))


def _call(plugin: type[Any], call: Callable[[], _Said]) -> _Said:
    try:
        return call()
    except BaseException as error:
        name = getattr(plugin, "name", plugin.__name__)
        blame(error, plugin, lambda raised: f"The exporter {name!r} failed: {raised}.", PluginError)


def read_start(text: str, problem: Problem, part: str | None) -> Plan:
    """Return the plan that a search starts from.

    Parameters
    ----------
    text
        A result, or a plan as in `read_given_plan`.
    problem, part
        The task to solve.

    Raises
    ------
    OptionError
        As in `read_start_plan` and `read_given_plan`.
    """
    if text.strip().startswith("@") or ("," in text and not os.path.exists(text)):
        return Plan(tuple(skill.name for skill in read_given_plan(text, problem.part(part))))
    return read_start_plan(text, problem, part)


def read_given_plan(text: str, task: Task) -> tuple[Skill, ...]:
    """Return the skills of a plan.

    Parameters
    ----------
    text
        Action numbers or names of skills, separated by commas; or ``@`` and a file.
    task
        The task of the plan.

    Raises
    ------
    OptionError
        If it is empty or has an unknown name, or the file holds no plan.
    """
    if not text.strip().startswith("@"):
        return task.parse_sequence(text)
    names = cache(lambda: ActionNames(task))
    return read_plan(text.strip()[1:], task, lambda action: names().skill_of(action))
