"""Result files, read to start from them or to verify them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.files.json_file import read_document, validate_document
from skillplan.files.regular_file import is_folder
from skillplan.records import schemas
from skillplan.records.result import Origin, Status
from skillplan.records.stored.result_folder import check_finished, find_result_path
from skillplan.solvers.solution import Plan

_REMEDY = "Give a result.json of search-optimal, or the folder that --out named"
# Maximum length of a path.
_MOST_PATH = 4_096
# Number of characters of a hash that distinguish two files.
_SHOWN_HASH = 12


class _Stored(BaseModel):
    model_config = ConfigDict(frozen=True, strict=True, extra="ignore", allow_inf_nan=False)


class StoredTask(_Stored):
    """The task of a result."""

    name: str
    kind: str
    sha256: str


class StoredStep(_Stored):
    """A step of a stored plan; costs in the task's metric, durations in s."""

    index: int
    skill: str
    action: int
    cost: float
    duration_s: float
    way: str | None = None
    wait_s: float = 0.0


class StoredOrigin(_Stored):
    """The task file of a result and how it was read."""

    file: str = Field(max_length=_MOST_PATH)
    part: str | None = None
    changes: dict[str, str] = Field(default_factory=dict, alias="set")
    physics: str | None = None
    collision: list[str] = Field(default_factory=list)
    options: dict[str, dict[str, Any]] = Field(default_factory=dict)
    screening: bool = False

    def origin(self) -> Origin:
        """Return the origin of the result."""
        return Origin(
            self.file,
            self.part,
            self.changes,
            self.physics,
            tuple(self.collision),
            self.options,
            self.screening,
        )


class StoredStats(_Stored):
    """Effort of a search, which cannot be verified."""

    states: int = Field(default=0, ge=0)
    expanded: int | None = Field(default=None, ge=0)
    checks: int = Field(default=0, ge=0)
    cache_hits: int = Field(default=0, ge=0)
    trajectories: int = Field(default=0, ge=0)
    wall_s: float = Field(default=0.0, ge=0)


class StoredClaims(_Stored):
    """The claims of a result, or of one part of a chain."""

    solver: str
    status: Status
    cost: float | None
    cost_unit: str
    lower_bound: float | None
    bound_method: str = ""
    gap: float | None
    makespan: int | None
    makespan_s: float | None
    skills: list[str]
    actions: list[int]
    steps: list[StoredStep]
    seed: int = 0
    reason: str = ""
    stats: StoredStats = StoredStats()
    trace: dict[str, Any] = Field(default_factory=dict)
    policy: bool | None = None


class StoredPart(StoredClaims):
    """A task of a chain."""

    name: str
    stage: str
    optimum: float | None = None
    reused_policy: bool = False


class StoredResult(StoredClaims):
    """A document ``skillplan.result/1``.

    Parameters
    ----------
    task, origin
        The task and its file; no origin if it is not from a file.
    physics, collision
        Names of the back ends that were queried, the latter separated by commas.
    timed_by
        Names of the back ends that planned the trajectories; may be empty.
    dwells_from
        Key paths of the dwell times; None in versions before these were in the task file.
    replans
        Number of times that the upper levels of a chain were planned again.
    sequences, stages
        Tasks of the last stage of a chain, and of the stages before; None for a single task.
    """

    task: StoredTask
    origin: StoredOrigin | None = None
    physics: str
    collision: str
    timed_by: str = ""
    dwells_from: list[str] | None = None
    replans: int = 0
    sequences: list[StoredPart] | None = None
    stages: list[StoredPart] = Field(default_factory=list)

    @property
    def is_chain(self) -> bool:
        """True if the result is for a chain of tasks."""
        return self.sequences is not None


def read_result(path: str) -> StoredResult:
    """Return the content of a result.

    Raises
    ------
    OptionError
        If it cannot be read, is not a result, has another version, lacks a key, or its search has
        not finished.
    """
    return read_with_document(path)[0]


def read_with_document(path: str) -> tuple[StoredResult, dict[str, Any]]:
    """Return the content of a result, and the whole document without its schema.

    Raises
    ------
    OptionError
        As in `read_result`.
    """
    check_finished(path)
    named, file = Path(path), find_result_path(path)
    within = named if is_folder(named) else None
    document = read_document(file, schemas.RESULT, _REMEDY, within=within)
    return validate_document(document, file, StoredResult, _REMEDY), document


def describe_other_task(
    stored: StoredResult, problem: Problem, *, quoted: bool = True
) -> str | None:
    """Return the difference between the task of a result and a loaded one; None if it is the same.

    Parameters
    ----------
    stored
        The result.
    problem
        The loaded task file.
    quoted
        True to quote the content of the file.
    """
    if stored.task.sha256 == problem.sha256:
        return None
    was, now = stored.task.sha256[:_SHOWN_HASH], problem.sha256[:_SHOWN_HASH]
    if (stored.task.kind, stored.task.name) == (problem.kind, problem.name):
        return f"{problem.source} has changed since: its content is {now}, was {was}"
    if not quoted:
        return f"the result is of {stored.task.name!r} ({stored.task.kind}), {problem.source} not"
    return (
        f"the result is of {stored.task.name!r} ({stored.task.kind}, {was}), {problem.source} is "
        f"{problem.name!r} ({problem.kind}, {now})"
    )


def read_start_plan(path: str, problem: Problem, part: str | None) -> Plan:
    """Return the plan of a stored result, for a search of the same or a changed task.

    A search replays the plan on the present task before it uses it.

    Parameters
    ----------
    path
        The result.
    problem
        The problem to solve.
    part
        Name of one task of a chain.

    Raises
    ------
    OptionError
        If the result is for a chain, holds no plan, or names a skill that the task lacks.
    """
    if problem.is_chain and part is None:
        raise OptionError(
            f"--start serves a single task, and {problem.source} describes a chain. Name one of "
            "its tasks by --part."
        )
    stored = read_result(path)
    difference = describe_other_task(stored, problem)
    task = problem.part(part)
    name, known = task.name, {skill.name for skill in task.skills}
    unknown = [skill for skill in stored.skills if skill not in known]
    if difference is not None and (unknown or stored.task.kind != problem.kind):
        lacks = f", which has no skill {unknown[0]!r}" if unknown else ""
        raise OptionError(f"--start {path}: is of another task: {difference}{lacks}.")
    if stored.is_chain or (problem.is_chain and stored.task.name != name):
        whole = "the whole chain" if stored.is_chain else repr(stored.task.name)
        raise OptionError(f"--start {path}: is of {whole}, not of {name!r}.")
    if stored.cost is None:
        raise OptionError(f"--start {path}: holds no plan, its status is {stored.status}.")
    return Plan(tuple(stored.skills))
