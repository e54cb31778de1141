"""From a path to a problem: the file's content, validated, and the tasks grounded from it.

All faults of a file are reported at once. What a kind of task looks like is the business of
its domain, which is passed in: this floor knows none.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from pydantic import BaseModel, ValidationError

from skillplan.errors import Issue, PluginError, TaskError
from skillplan.task.reachability import unreachable_facts
from skillplan.task.schema_errors import schema_issues, shown
from skillplan.task.task import Task
from skillplan.task.yaml import Document, parse, read_text

# What a reader of the task may want to change without making it another task.
_NOT_HASHED = ("description", "expect")


class TaskDomain(Protocol):
    """What loading needs of a domain; see :class:`skillplan.domains.domain.Domain`."""

    Config: Any

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return the faults that a schema cannot see."""

    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the tasks of a faultless content."""

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the path of the file's entry that a fact comes from."""


@dataclass(frozen=True)
class Problem:
    """A loaded task file.

    Parameters
    ----------
    name, kind
        As the file says.
    source
        The file as the user named it.
    sha256
        Hash of the content, in hexadecimal.
    config
        The validated content.
    tasks
        One, or a chain of several that are solved in turn.
    """

    name: str
    kind: str
    source: str
    sha256: str
    config: BaseModel
    tasks: tuple[Task, ...]

    @property
    def task(self) -> Task:
        """The only task.

        Raises
        ------
        TaskError
            If the file describes a chain of several.
        """
        if len(self.tasks) != 1:
            message = f"describes {len(self.tasks)} tasks in a chain; this command takes one."
            raise TaskError(self.source, [Issue(message)])
        return self.tasks[0]


def load_task(
    path: str | os.PathLike[str],
    find_domain: Callable[[str], TaskDomain],
    known_kinds: Iterable[str] = (),
) -> Problem:
    """Load, validate and ground a task file.

    Parameters
    ----------
    path
        A YAML file.
    find_domain
        Returns the domain of a kind; raises `PluginError` for an unknown one.
    known_kinds
        What `find_domain` knows, to name in a message.

    Raises
    ------
    TaskError
        With every fault of the file: its place, what is wrong and what to write instead.
    """
    source = os.fspath(path)
    document = parse(read_text(Path(source), source), source)
    kind, domain = _domain(document, find_domain, known_kinds)
    config = _validated(document, domain)
    issues = list(domain.issues(config))
    if issues:
        raise document.error(issues)
    sha256 = _content_hash(config)
    tasks = domain.ground(config, sha256)
    for task in tasks:
        lost = unreachable_facts(task)
        issues += [
            Issue(f"the goal {fact} is out of reach: {reason}", domain.locate(fact))
            for fact, reason in lost.items()
        ]
    if issues:
        raise document.error(issues)
    name = getattr(config, "name", None) or Path(source).stem
    return Problem(name, kind, source, sha256, config, tuple(tasks))


def _domain(
    document: Document, find_domain: Callable[[str], TaskDomain], known_kinds: Iterable[str]
) -> tuple[str, TaskDomain]:
    kinds = ", ".join(sorted(known_kinds))
    if not isinstance(document.data, dict):
        message = f"must be a mapping with a key 'kind', not {shown(document.data)}."
        raise document.error([Issue(message)])
    if "kind" not in document.data:
        raise document.error([Issue(f"key 'kind' is missing. Known kinds: {kinds}.", ("kind",))])
    kind = document.data["kind"]
    if not isinstance(kind, str):
        raise document.error([Issue(f"must be one of {kinds}, not {shown(kind)}.", ("kind",))])
    try:
        return kind, find_domain(kind)
    except PluginError as error:
        raise document.error([Issue(str(error), ("kind",))]) from None


def _validated(document: Document, domain: TaskDomain) -> BaseModel:
    try:
        config: BaseModel = domain.Config.model_validate(document.data)
    except ValidationError as error:
        issues = [
            document.locate(issue, key=key) for issue, key in schema_issues(error, domain.Config)
        ]
        raise TaskError(document.source, issues) from None
    return config


def _content_hash(config: BaseModel) -> str:
    content = config.model_dump(mode="json", exclude=set(_NOT_HASHED))
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
