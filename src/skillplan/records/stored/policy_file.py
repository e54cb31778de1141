"""Policies as JSON files, which answer from any of their states without planning again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from skillplan.errors import OptionError
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import RefusedFile, read_bytes
from skillplan.records import schemas
from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.solvers.solution import Policy
from skillplan.task.skill import Outcome
from skillplan.task.task import Task

_MOST_BYTES = 256 * 1024 * 1024
# Maximum number of goals that a message names.
_MOST_NAMED = 8


def make_policy_document(
    sha256: str, solver: str, solved: Iterable[tuple[Task, Result]]
) -> dict[str, Any] | None:
    """Return the JSON document ``skillplan.policy/1``; None without a policy.

    Parameters
    ----------
    sha256
        Hash of the content of the task file.
    solver
        Name of the solver that learned the policies.
    solved
        Tasks with their results.
    """
    policies = [
        {
            "task": task.name,
            "fingerprint": fingerprint(task),
            "goal": list(task.goal.requires),
            "choices": {", ".join(state): skill.name for state, skill in result.policy.items()},
        }
        for task, result in solved
        if result.policy is not None
    ]
    if not policies:
        return None
    return {"schema": schemas.POLICY, "sha256": sha256, "solver": solver, "policies": policies}


def list_solved_tasks(result: Result | ChainResult, task: Task) -> list[tuple[Task, Result]]:
    """Return tasks with their results; for a chain the tasks that were searched."""
    if isinstance(result, ChainResult):
        return [(part.task, part.result) for part in result.parts if not part.reused]
    return [(task, result)]


@dataclass(frozen=True)
class StoredPolicy:
    """A policy read from a file.

    Parameters
    ----------
    solver
        Name of the solver that learned it.
    policy
        A skill for each state.
    """

    solver: str
    policy: Policy


def read_policy(path: str, task: Task, *, within: str | None = None) -> StoredPolicy:
    """Return the policy in a file that leads to the goal of a task.

    Parameters
    ----------
    path
        The file.
    task
        The task.
    within
        A folder that must contain the file, without links on the way; None for any.

    Raises
    ------
    OptionError
        If the file cannot be read, is not such a document, or holds no policy for this goal and
        these skills.
    """
    document = _read(path, within)
    goal, mine = list(task.goal.requires), fingerprint(task)
    for entry in document["policies"]:
        if entry["fingerprint"] == mine:
            try:
                choices = {
                    task.facts.of(*filter(None, names.split(", "))): task.skill(skill)
                    for names, skill in entry["choices"].items()
                }
            except OptionError as error:
                raise OptionError(f"{path}: is damaged: {error}") from None
            return StoredPolicy(document["solver"], Policy(choices))
    if any(entry["goal"] == goal for entry in document["policies"]):
        raise OptionError(
            f"{path}: was learned on a task with other skills than {task.name}. Learn again with "
            "search-optimal --out."
        )
    goals = [", ".join(entry["goal"]) for entry in document["policies"]]
    known = "; ".join(goals if len(goals) <= _MOST_NAMED else [*goals[:_MOST_NAMED], "..."])
    raise OptionError(f"{path}: holds no policy for {', '.join(goal)}, only for {known or 'none'}.")


def read_policies(path: str, *, within: str | None = None) -> dict[str, Any]:
    """Return a whole document ``skillplan.policy/1``.

    Parameters
    ----------
    path, within
        As in `read_policy`.

    Raises
    ------
    OptionError
        If the file cannot be read or is not such a document.
    """
    return _read(path, within)


def fingerprint(task: Task) -> str:
    """Return the hash of the properties that a policy depends on: facts, goal, effects of skills.

    Names of files and tasks, starts and costs do not count: a policy serves all tasks in which the
    same skills lead to the same goal.
    """

    def shown(outcome: Outcome) -> list[Any]:
        return [outcome.probability, list(outcome.add), list(outcome.delete)]

    content = [
        list(task.facts.names),
        str(task.goal),
        [
            [
                skill.name,
                str(skill.precondition),
                [shown(outcome) for outcome in skill.outcomes],
                [
                    [*case.fact, list(case.forbids), [shown(outcome) for outcome in case.outcomes]]
                    for case in skill.cases
                ],
            ]
            for skill in task.skills
        ],
    ]
    text = json.dumps(content, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _content(path: str, within: str | None) -> bytes:
    try:
        return read_bytes(path, _MOST_BYTES, within=within)
    except RefusedFile as refused:
        if refused.why == "large":
            raise OptionError(f"{path}: is larger than any policy file.") from None
        what = "is a folder" if refused.why == "folder" else f"cannot be read: {refused.strerror}"
        what = "is no regular file" if refused.why == "irregular" else what
        raise OptionError(f"{path}: {what}. Give the path of a policies.json.") from None
    except OSError as error:
        raise OptionError(f"{path!r}: cannot be read: {error.strerror}.") from None


def _read(path: str, within: str | None) -> dict[str, Any]:
    content = _content(path, within)
    try:
        document = parse_json(content)
    except ValueError as error:
        raise OptionError(f"{path}: is not JSON: {error}.") from None
    if not isinstance(document, dict) or document.get("schema") != schemas.POLICY:
        raise OptionError(
            f"{path}: is no document {schemas.POLICY}. search-optimal --out writes one."
        )
    try:
        sound = (
            isinstance(document["sha256"], str)
            and isinstance(document["solver"], str)
            and all(
                isinstance(entry["goal"], list)
                and isinstance(entry["fingerprint"], str)
                and all(isinstance(fact, str) for fact in entry["goal"])
                and all(isinstance(skill, str) for skill in entry["choices"].values())
                for entry in document["policies"]
            )
            and isinstance(document["policies"], list)
        )
    except (KeyError, TypeError, AttributeError):
        sound = False
    if not sound:
        raise OptionError(f"{path}: is damaged. Write it again with search-optimal --out.")
    return document
