"""Policies that lie beside a result, held against it and against the task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from skillplan.errors import OptionError
from skillplan.judge.document_check import differences
from skillplan.model.policy_value import roll_out
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.derivation import Replayed
from skillplan.records.stored.policy_file import fingerprint
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import VerdictStatus


def policies_fault(
    document: Mapping[str, Any],
    header: Mapping[str, str],
    replayed: Mapping[str, Replayed],
    model_of: Callable[[Task], SkillModel],
    stop: Stop,
) -> str:
    """Return in words the first thing that is wrong with policies; empty where nothing is.

    A policy must be of a task of the result, take the way of its plan, and choose in every state
    a skill that can be executed there. Whether choices off that way are good, it does not claim.

    Parameters
    ----------
    document
        A document ``skillplan.policy/1``.
    header
        What must stand above the policies.
    replayed
        The tasks of the result, by name.
    model_of
        Makes a fresh model of a task.
    stop
        Polled between states.

    Raises
    ------
    BackEndError
        If a back end fails.
    TimeoutError
        If the stop is over before back ends were asked about all choices, and the rest is right.
    """
    own = {key: value for key, value in document.items() if key not in ("schema", "policies")}
    for words in differences(own, dict(header)):
        return words
    holders = [entry.get("task", "") for entry in document["policies"]]
    for name in holders:
        if holders.count(name) > 1:
            return f"holds {holders.count(name)} policies of {name!r}"
    for name, part in replayed.items():
        needed = part.stored.policy or (part.walked is not None and not part.task.deterministic)
        if needed and name not in holders:
            return f"holds no policy of {name!r}"
        if part.stored.policy is False and name in holders:
            return f"holds a policy of {name!r}, and the result names none"
    for entry in document["policies"]:
        one = replayed.get(entry.get("task", ""))
        if one is None:
            return f"holds a policy of {entry.get('task')!r}, which is no task of the result"
        expected = {
            "task": one.task.name,
            "fingerprint": fingerprint(one.task),
            "goal": list(one.task.goal.requires),
        }
        claimed = {key: value for key, value in entry.items() if key != "choices"}
        fault = next(iter(differences(claimed, expected)), "")
        fault = fault or _choices_fault(entry["choices"], one, model_of(one.task), stop)
        if fault:
            return f"{one.task.name}: {fault}"
    return ""


def _choices_fault(
    choices: Mapping[str, str], replayed: Replayed, model: SkillModel, stop: Stop
) -> str:
    task = replayed.task
    by_name = {skill.name: skill for skill in task.skills}
    cheap = not any(back_end.expensive for back_end in model.feasibility.back_ends)
    policy: dict[State, Skill] = {}
    given_up = False
    for names, name in choices.items():
        if name not in by_name:
            return f"{name!r} in [{names}] is no skill of the task"
        try:
            state = task.facts.of(*filter(None, names.split(", ")))
        except OptionError as error:
            return f"[{names}] is no state: {error}"
        skill = by_name[name]
        policy[state] = skill
        if not skill.applicable(state):
            return f"{name} is not applicable in [{names}]"
        given_up = given_up or (cheap and stop())
        if (
            cheap
            and not given_up
            and model.verdict(state, skill).status is VerdictStatus.INFEASIBLE
        ):
            return f"{name} is infeasible in [{names}]"
    taken = [skill.name for skill in roll_out(model, policy.get)]
    if replayed.stored.cost is not None and taken != replayed.stored.skills:
        at = next(
            (
                index
                for index, (one, other) in enumerate(
                    zip(taken, replayed.stored.skills, strict=False)
                )
                if one != other
            ),
            min(len(taken), len(replayed.stored.skills)),
        )
        return f"it leaves the plan at step {at + 1}"
    if given_up:
        raise TimeoutError
    return ""
