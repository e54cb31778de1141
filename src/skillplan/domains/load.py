"""Task files: reading, validation and grounding.

All faults of a file are reported at once. The caller provides the domains.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from skillplan.domains.domain import Domain
from skillplan.errors import Issue, OptionError, PluginError, TaskError, name_hint
from skillplan.files.schema_errors import list_schema_issues, remove_tags, shown
from skillplan.files.yaml import YAML_SUFFIXES, Document, parse, read_text
from skillplan.plugins.blame import blame
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task, find_unreachable_facts

# Greatest depth of a key path, as for task files.
_MOST_STEPS = 32


def apply_changes(document: Document, changes: Mapping[str, str]) -> Document:
    """Return the document with changed values.

    Parameters
    ----------
    document
        Content of a task file: a mapping.
    changes
        YAML values by key path, such as ``base.goal_choice`` or ``trajectory.vertices_m.0``.
        Missing
        mappings on the path are created.

    Raises
    ------
    OptionError
        If a path leads through a scalar, or a value is not YAML.
    """
    if not changes or not isinstance(document.data, dict):
        return document
    data = deepcopy(document.data)
    values = dict(document.values)
    given: list[tuple[str | int, ...]] = []
    for key, text in changes.items():
        path = _put(data, key, _parse_value(key, text))
        given.append(path)
        # Positions in the file no longer apply to changed values.
        for known in list(values):
            if known[: len(path)] == path:
                del values[known]
    return replace(document, data=data, values=values, given=tuple(given))


def _parse_value(key: str, text: str) -> Any:
    if not text.strip():
        raise OptionError(f"--set {key[:40]}= has no value. Write null for none.")
    try:
        document = parse(text, f"--set {key}")
    except TaskError as error:
        raise OptionError(str(error)) from None
    if document.issues:
        raise OptionError(str(document.error([])))
    return document.data


def _put(data: Any, key: str, value: Any) -> tuple[str | int, ...]:
    """Set a value in nested data and return its path."""
    steps = key.split(".")
    if len(steps) > _MOST_STEPS:
        raise OptionError(f"--set {key[:40]}...: more than {_MOST_STEPS} keys deep.")
    here, path = data, list[str | int]()
    for number, step in enumerate(steps, start=1):
        last = number == len(steps)
        if isinstance(here, list):
            index = _parse_index(step, len(here))
            if index is None:
                holder = f"--set {_shorten(key)}: {_shorten('.'.join(steps[: number - 1]))}"
                if not here:
                    raise OptionError(f"{holder} is an empty list. Give all of it.")
                raise OptionError(
                    f"{holder} is a list of {len(here)}; "
                    f"give an index from 0 to {len(here) - 1} instead of {_shorten(step)!r}."
                )
            path.append(index)
            if last:
                here[index] = value
            here = here[index]
        elif isinstance(here, dict):
            path.append(step)
            if last:
                here[step] = value
            elif here.get(step) is None:
                here[step] = {}
            here = here[step]
        else:
            holder = f"--set {_shorten(key)}: {_shorten('.'.join(steps[: number - 1]))}"
            raise OptionError(f"{holder} is a single value and has no keys.")
    return tuple(path)


def _parse_index(step: str, length: int) -> int | None:
    """Return the index of a step in a list of a given length, or None."""
    # No list has ten digits of entries, and int() refuses very long numbers.
    if not (step.isascii() and step.isdigit() and len(step) < 10):
        return None
    return int(step) if int(step) < length else None


def _shorten(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."


# Keys that a user may change without creating another task.
_NOT_HASHED = ("description", "expect", "family")


@dataclass(frozen=True)
class Problem:
    """A loaded task file.

    Parameters
    ----------
    spare_back_ends
        Back ends constructed during loading to check that they accept the tasks. A user of one
        takes
        it out of the list, because a back end serves one solver only.
    """

    name: str
    kind: str
    source: str
    sha256: str
    config: BaseModel
    tasks: tuple[Task, ...]
    domain: Domain
    document: Document = field(repr=False)
    spare_back_ends: list[BackEnd] = field(default_factory=list, compare=False, repr=False)

    def __repr__(self) -> str:
        tasks = "\n  ".join(map(repr, self.tasks))
        return f"<Problem {self.name!r} of {self.source}:\n  {tasks}>"

    @property
    def task(self) -> Task:
        """The only task.

        Raises
        ------
        TaskError
            If the file describes a chain.
        """
        return self.part(None, by="`Problem.part(NAME)`")

    @property
    def is_chain(self) -> bool:
        """True if the tasks are stages of a chain."""
        return len(self.tasks) > 1 or bool(self.tasks[0].stage)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Suspicious entries of the file: ``file:line:column: key: message``."""
        return self.told(self.domain.warnings(self.config))

    @property
    def hints(self) -> tuple[str, ...]:
        """Entries that may cause trouble later, in the same form."""
        return self.told(self.domain.hints(self.config))

    def told(self, issues: Iterable[Issue]) -> tuple[str, ...]:
        """Return issues as `warnings` formats them, with their positions."""
        located = [self.document.locate(issue) for issue in issues]
        return tuple(TaskError(self.source, located).lines())

    def part(self, name: str | None, *, by: str = "--part, in Python by `part`") -> Task:
        """Return a task by name; None for the only one.

        Parameters
        ----------
        by
            Option or argument that gives the name, for the message.

        Raises
        ------
        TaskError
            If the file describes a chain and no name is given.
        OptionError
            If no task has the name.
        """
        names = [task.name for task in self.tasks]
        if name is None and len(names) == 1:
            return self.tasks[0]
        if name is None:
            message = f"describes {len(names)} tasks in a chain; name one by {by}: "
            shown = names if len(names) <= 8 else [*names[:4], "...", *names[-3:]]
            raise TaskError(self.source, [Issue(f"{message}{', '.join(shown)}.")])
        if name not in names:
            raise OptionError(f"No task {name!r} in {self.source}. {name_hint(name, names)}")
        return self.tasks[names.index(name)]

    def follow(self, plans: Mapping[str, Sequence[str]], refinement: int = 0) -> tuple[Task, ...]:
        """Return the tasks of a chain after some of them have been solved."""
        return tuple(self.domain.follow(self.config, self.sha256, plans, refinement))

    def variants(self, seed: int, count: int) -> tuple[Task, ...]:
        """Return tasks of the same family: the same facts and skills in other layouts.

        They have the name of the file's task with a number from 0, and their own hashes.

        Parameters
        ----------
        seed
            Random seed, >= 0.
        count
            Number of tasks, >= 1. Longer lists begin with the shorter ones, so training and test
            layouts
            can be separated.

        Raises
        ------
        OptionError
            If a number is out of range, the file describes no family, or too few of its layouts are
            faultless.
        TaskError
            If the file describes a chain of tasks.
        """
        if seed < 0 or count < 1:
            raise OptionError(f"A family takes seed >= 0 and count >= 1, not {seed} and {count}.")
        drawn = self.domain.variants(self.config, seed, count)
        name = self.task.name
        tasks = []
        for index, config in enumerate(drawn):
            sha256 = _hash_content(config)
            (task,) = self.domain.ground(config, sha256)
            tasks.append(task.replace(name=f"{name}/{index}", sha256=sha256))
        return tuple(tasks)

    def ground_with(self, changes: Mapping[str, str]) -> Task | None:
        """Return the task with some values changed, without checking it; None for no valid values.

        Parameters
        ----------
        changes
            YAML values by key path, as for `load_task`.
        """
        whole = self.document.written_from or self.document
        document = self.domain.expand(apply_changes(whole, changes))
        if document.issues:
            return None
        config, faults = _validate(document, self.domain, {"folder": Path(self.source).parent})
        if config is None or faults:
            return None
        return self.domain.ground(config, "")[0]

    def account(self, plans: Mapping[str, Sequence[str]], refinement: int = 0) -> Any:
        """Return the domain's results beyond the plans."""
        return self.domain.account(self.config, plans, refinement)


class FileChecks:
    """Additional checks of a file; these do nothing."""

    def content_issues(self, content: Mapping[str, Any]) -> Iterable[Issue]:
        """Return faults of a content before validation."""
        return ()

    def task_issues(self, task: Task, domain: Domain) -> Iterable[Issue]:
        """Return faults of a grounded task."""
        return ()


def load_task(
    path: str | os.PathLike[str],
    domains: Mapping[str, Domain],
    checks: FileChecks = FileChecks(),
    changes: Mapping[str, str] | None = None,
) -> Problem:
    """Load, validate and ground a task file.

    Parameters
    ----------
    path
        A YAML file, or one with a suffix that a domain reads.
    domains
        Domains by kind. Only the domain of the file is looked up; the look-up may import it, and
        may
        raise `PluginError`, or `KeyError` for an unknown kind.
    changes
        YAML values by key path that replace values of the file.

    Raises
    ------
    TaskError
        With every fault of the file: position, problem and remedy.
    OptionError
        If a change does not fit the file.
    """
    source = os.fspath(path)
    document = apply_changes(_read(source, domains), changes or {})
    kind, domain = _find_domain(document, domains)
    try:
        return _ground(source, domain.expand(document), kind, domain, checks)
    except BaseException as error:
        failed = f"{source}: the kind {kind!r} failed"
        blame(error, type(domain), lambda words: f"{failed}: {words}", PluginError)


def _ground(
    source: str, document: Document, kind: str, domain: Domain, checks: FileChecks
) -> Problem:
    """Validate and ground a document."""
    issues = list(checks.content_issues(document.data))
    config, faults = _validate(document, domain, {"folder": Path(source).parent})
    issues += faults
    if config is not None:
        issues += domain.issues(config)
    if config is None or issues or document.issues:
        raise document.error(issues)
    sha256 = _hash_content(config)
    tasks = domain.ground(config, sha256)
    for task in tasks:
        lost = {} if task.infeasible else find_unreachable_facts(task)
        issues += [
            Issue(f"the goal {fact} is out of reach: {reason}", domain.locate(fact))
            for fact, reason in lost.items()
        ]
        issues += checks.task_issues(task, domain)
    if issues:
        # A fault of one task in a chain is often a fault of all.
        raise document.error(dict.fromkeys(issues))
    name = getattr(config, "name", None) or Path(source).stem
    return Problem(name, kind, source, sha256, config, tuple(tasks), domain, document)


def _read(source: str, domains: Mapping[str, Domain]) -> Document:
    """Return the content of a file, read by the domain of its suffix if there is one."""
    path = Path(source)
    suffix = path.suffix.lower()
    if suffix and suffix not in YAML_SUFFIXES:
        # A domain with the name of the suffix is tried first, because each look-up imports a
        # domain.
        for kind in sorted(domains, key=lambda kind: f".{kind}" != suffix):
            try:
                domain = domains[kind]
            except PluginError:
                continue  # reported if it is named
            if suffix in domain.suffixes:
                return domain.read(read_text(path, source, domain.max_bytes), source)
    return parse(read_text(path, source), source)


def _find_domain(document: Document, domains: Mapping[str, Domain]) -> tuple[str, Domain]:
    known = sorted(domains)
    kinds = ", ".join(known)
    if not isinstance(document.data, dict):
        message = f"must be a mapping with a key 'kind', not {shown(document.data)}."
        raise document.error([Issue(message)])
    if "kind" not in document.data:
        raise document.error([Issue(f"key 'kind' is missing. Known kinds: {kinds}.", ("kind",))])
    kind = document.data["kind"]
    if not isinstance(kind, str):
        message = f"must be the name of a kind of task, not {shown(kind)}. Known: {kinds}."
        raise document.error([Issue(message, ("kind",))])
    try:
        return kind, domains[kind]
    except PluginError as error:
        raise document.error([Issue(str(error), ("kind",))]) from error
    except KeyError:
        if kind in known:
            raise
        hint = name_hint(kind, known)
        raise document.error([Issue(f"unknown kind {shown(kind)}. {hint}", ("kind",))]) from None


def _validate(
    document: Document, domain: Domain, context: Mapping[str, Any]
) -> tuple[BaseModel | None, list[Issue]]:
    """Return the content, or None, and the faults that the document does not have yet.

    If all faults are unknown keys, the content is validated again without them to find others.
    """
    try:
        return domain.Config.model_validate(document.data, context=context), []
    except ValidationError as error:
        # Entries that could not be read are missing from the data; the document reports them.
        unread = {issue.path[:n] for issue in document.issues for n in range(len(issue.path) + 1)}
        listed = list_schema_issues(error, domain.Config)
        faults = [issue for issue in listed if issue.path not in unread]
        unknown = [
            remove_tags(fault["loc"])
            for fault in error.errors()
            if fault["type"] == "extra_forbidden"
        ]
        if len(unknown) < error.error_count():
            return None, faults
    try:
        return domain.Config.model_validate(
            _remove_paths(document.data, unknown), context=context
        ), faults
    except ValidationError as error:
        # Models are validated as a whole only if their keys are valid. A missing key may be a
        # misspelt unknown one, which is reported already.
        unread |= {tuple(path[:-1]) for path in unknown}
        listed = list_schema_issues(error, domain.Config)
        return None, faults + [issue for issue in listed if issue.path not in unread]


def _remove_paths(data: Any, paths: Iterable[tuple[str | int, ...]]) -> Any:
    """Return a copy of nested data without the entries at some paths."""
    copy = deepcopy(data)
    for path in paths:
        holder = copy
        for key in path[:-1]:
            holder = holder[key]
        del holder[path[-1]]
    return copy


def _hash_content(config: BaseModel) -> str:
    content = config.model_dump(mode="json", exclude=set(_NOT_HASHED))
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(canonical.encode()).hexdigest()
