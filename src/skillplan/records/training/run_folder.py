"""Reader for a folder of training runs: settings, metrics and learned policies.

Any fault in a file is one error that names the file and the remedy. `skillplan.training` writes the
folder. The folder may come from another person, so `files.regular_file` follows no links and opens
only regular files, and the sizes in the manifest are limited.

Metrics are lines of JSON: one per episode, and figures now and then. They contain no time of day,
so that an interrupted and resumed run writes the same bytes as any other.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BaseModel, ConfigDict, Field, model_validator

from skillplan.errors import OptionError
from skillplan.files.json_file import parse_json, read_checked, read_document
from skillplan.files.regular_file import is_regular, open_regular, read_bytes
from skillplan.records import schemas
from skillplan.records.stored.result_folder import MANIFEST as MANIFEST
from skillplan.records.stored.result_folder import RESULT as RESULT
from skillplan.records.training.network_policy_file import StoredNetwork, read_network
from skillplan.solvers.learning.learner import End, Episode

METRICS = "metrics.jsonl"
_ENDS = get_args(End)
# Larger than the metrics of a hundred million steps.
_MOST_BYTES = 4 * 1024**3


@dataclass(frozen=True, slots=True)
class FiguresRecord:
    """Figures of a learner at one step.

    Parameters
    ----------
    figures
        Finite numbers by name, such as ``loss``.
    """

    step: int
    figures: Mapping[str, float]


@dataclass(frozen=True)
class RunMetrics:
    """Recorded episodes and figures of a run, in order."""

    episodes: tuple[Episode, ...] = ()
    figures: tuple[FiguresRecord, ...] = ()


def format_metrics_line(record: Episode | FiguresRecord) -> str:
    """Return a record as a line of JSON, without its line break.

    Figures that are not finite are left out. The numbers of an episode must be finite.

    Raises
    ------
    ValueError
        If the cost or reward of an episode is not finite.
    """
    if isinstance(record, FiguresRecord):
        finite = {name: float(x) for name, x in record.figures.items() if math.isfinite(x)}
        content: dict[str, Any] = {"kind": "figures", "step": record.step, **finite}
    else:
        content = {
            "kind": "episode",
            "step": record.step,
            "end": record.end,
            "cost": float(record.cost),
            "reward": float(record.reward),
            "length": len(record.actions),
            "actions": [int(action) for action in record.actions],
            "greedy": bool(record.greedy),
        }
        if record.planned:
            content["planned"] = True
    return json.dumps(content, allow_nan=False, separators=(",", ":"))


def read_metrics(path: Path, run: int, *, within: Path | None = None) -> RunMetrics:
    """Read the metrics of a run; an incomplete last line is ignored.

    Parameters
    ----------
    path
        The file. A missing file is an empty one.
    within
        Folder that the file must be in, with no link on the way. Default: any folder.

    Raises
    ------
    OptionError
        If the file cannot be read, or another line is damaged; the message names it.
    """
    try:
        lines = read_metrics_lines(path, within=within)
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}.") from None
    return parse_metrics(lines, path, run)


def parse_metrics(lines: Iterable[str], path: Path, run: int) -> RunMetrics:
    """Parse lines; parameters and errors as for `read_metrics`."""
    episodes: list[Episode] = []
    figures: list[FiguresRecord] = []
    for record in _parse_lines(lines, path, run):
        if isinstance(record, Episode):
            episodes.append(record)
        else:
            figures.append(record)
    return RunMetrics(tuple(episodes), tuple(figures))


def read_metrics_lines(path: Path, *, within: Path | None = None) -> list[str]:
    """Return the complete lines of a file; an empty list without a file.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    try:
        content = read_bytes(path, _MOST_BYTES, within=within)
    except FileNotFoundError:
        return []
    whole = content[: content.rfind(b"\n") + 1]
    return whole.decode("utf-8", "replace").splitlines()


def _parse_lines(lines: Iterable[str], path: Path, run: int) -> Iterator[Episode | FiguresRecord]:
    before = 0
    for number, line in enumerate(lines, start=1):
        try:
            record = _parse_line(line, run)
            if record.step < max(before, 1):
                raise ValueError("its step is before that of the line above")
        except (ValueError, TypeError, KeyError) as error:
            reason = str(error) if isinstance(error, ValueError) else type(error).__name__
            raise OptionError(
                f"{path}:{number}: is damaged: {reason}. Bring the file back from a copy, or "
                "train again."
            ) from None
        before = record.step
        yield record


def _parse_line(line: str, run: int) -> Episode | FiguresRecord:
    content = parse_json(line)
    if not isinstance(content, dict):
        raise ValueError("it is not a mapping")
    kind, step = content.pop("kind", None), content.pop("step", None)
    if type(step) is not int:
        raise ValueError("it has no step")
    if kind == "figures":
        return FiguresRecord(step, {name: _check_finite(value) for name, value in content.items()})
    if kind != "episode":
        raise ValueError("it is neither an episode nor figures")
    actions = tuple(content["actions"])
    if not all(type(action) is int and action >= 0 for action in actions):
        raise ValueError("its actions are not numbers of skills")
    if content["end"] not in _ENDS or content["length"] != len(actions):
        raise ValueError("its end or its length is wrong")
    if type(content["greedy"]) is not bool:
        raise ValueError("its greedy is not a bool")
    if type(content.get("planned", False)) is not bool:
        raise ValueError("its planned is not a bool")
    return Episode(
        run,
        step,
        content["end"],
        actions,
        _check_finite(content["cost"]),
        _check_finite(content["reward"]),
        content["greedy"],
        content.get("planned", False),
    )


def _check_finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError("a figure is not a finite number")
    return float(value)


TASK_CONFIG = "task.json"
PROGRESS, CHECKPOINT = "progress.json", "checkpoint.safetensors"
MOST_RUNS = 1_000
"""Limit of --runs, and of all lists in a manifest."""
MOST_PATH = 4_096
"""Largest length of a path."""
_REMEDY = "Bring the file back from a copy, or train again in another folder"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


Word = Annotated[str, Field(max_length=MOST_PATH)]
Amount = Annotated[int, Field(ge=1, le=1_000_000_000)]
Seed = Annotated[int, Field(ge=0, le=2**64)]


class TaskReference(_Part):
    """The learned task, and the path of its file."""

    name: Word
    kind: Word
    sha256: Word = Field(description="hash of the file's content")
    source: Word = Field(description="path as the user gave it")
    path: Word = Field(description="absolute path")
    part: Word | None = Field(description="task of a chain")
    changes: dict[Word, str] = Field(
        max_length=MOST_RUNS, description="changes of --set, by key path"
    )


class Family(_Part):
    """Layouts drawn from the family of the task file, one per episode."""

    count: int = Field(ge=1, le=10_000, description="layouts")
    seed: Seed


class WarmStartRecord(_Part):
    """Networks of an earlier training that the runs started from."""

    run_dir: Word = Field(description="folder of the earlier training as the user named it")
    task: Word = Field(description="task of the earlier training")
    runs: tuple[int, ...] = Field(
        min_length=1, max_length=MOST_RUNS, description="earlier run that each run starts from"
    )
    skills: Amount
    skills_known: Amount = Field(description="skills whose name the earlier task has, too")
    features: Amount
    features_known: Amount = Field(description="features whose name the earlier task has, too")
    sha256: Word = Field(description="hash of the adapted networks")

    @property
    def text(self) -> str:
        """Description for tables."""
        return (
            f"from networks of {self.run_dir} ({self.task}): {self.skills_known} of {self.skills} "
            f"skills and {self.features_known} of {self.features} features known"
        )


class RunManifest(_Part):
    """The settings of a training: the document ``skillplan.run/1``."""

    task: TaskReference
    solver: Word
    options: dict[str, Any] = Field(description="all options, defaults included")
    derived_options: tuple[Word, ...] | None = Field(
        None, description="options that the task determined; null before version 0.4"
    )
    steps: Amount = Field(description="environment steps per run")
    seed: Seed
    seeds: tuple[Seed, ...] = Field(min_length=1, max_length=MOST_RUNS, description="one per run")
    physics: Word
    collision: tuple[Word, ...] = Field(max_length=MOST_RUNS)
    back_end_options: dict[str, dict[str, Any]]
    screening: bool = Field(False, description="true if geometry is checked before any execution")
    family: Family | None
    warm_start: WarmStartRecord | None = None
    checkpoint_steps: Amount
    groups: tuple[Annotated[tuple[int, ...], Field(min_length=1, max_length=MOST_RUNS)], ...] = (
        Field(max_length=MOST_RUNS, description="runs that learn together")
    )
    command: tuple[str, ...]
    versions: dict[str, str]
    git_commit: str | None
    machine: dict[str, Any]

    @model_validator(mode="after")
    def _fits(self) -> RunManifest:
        if [run for group in self.groups for run in group] != list(range(len(self.seeds))):
            raise ValueError("the groups do not hold every run once")
        if self.options.get("steps") != self.steps:
            raise ValueError("the option steps is not the number of steps")
        if not all(isinstance(self.options.get(key), str) for key in _SEEN):
            raise ValueError(f"an option of {', '.join(_SEEN)} is missing")
        return self

    @property
    def observation(self) -> str:
        """Kind of the observation."""
        return str(self.options["observation"])

    @property
    def mask(self) -> str:
        """Restriction of the actions."""
        return str(self.options["mask"])

    @property
    def objective(self) -> str:
        """Source of the rewards."""
        return str(self.options["objective"])


_SEEN = ("observation", "mask", "objective")


class GroupProgress(_Part):
    """Progress of a group of runs, and its effort."""

    steps: int = Field(ge=0, le=1_000_000_000)
    failures: dict[int, Annotated[str, Field(max_length=10_000)]] = Field(
        max_length=MOST_RUNS, description="reason of failure, by run"
    )
    wall_s: float = Field(ge=0, description="duration of the learning [s]")
    elapsed_s: float = Field(ge=0, description="duration of the whole training so far [s]")
    checks: int = Field(ge=0)
    hits: int = Field(ge=0)
    executions: int = Field(ge=0)
    asked: dict[str, int] = Field(description="queries by back end")


@dataclass(frozen=True)
class StoredRun:
    """A run as stored in its files.

    Parameters
    ----------
    steps
        Environment steps at the last checkpoint.
    policy
        Its reported policy; None before the run ends or is interrupted.
    last
        Its last policy; None as above.
    failure
        Why it could not continue, or which of its files is damaged; empty if neither.
    wall_s
        Duration of its group [s]; None before the first checkpoint.
    """

    run: int
    seed: int
    steps: int = 0
    episodes: tuple[Episode, ...] = ()
    figures: tuple[FiguresRecord, ...] = ()
    policy: StoredNetwork | None = None
    last: StoredNetwork | None = None
    failure: str = ""
    wall_s: float | None = None

    @property
    def best(self) -> StoredNetwork | None:
        """The best policy; None if none completed the task."""
        return self.policy if self.policy is not None and self.policy.kept == "best" else None

    @property
    def latest_figures(self) -> Mapping[str, float]:
        """The latest figures; empty before the first."""
        return self.figures[-1].figures if self.figures else {}


def get_run_path(folder: Path, run: int) -> Path:
    """Return the folder of a run."""
    return folder / "runs" / f"{run:02d}"


def get_group_path(folder: Path, group: int) -> Path:
    """Return the folder of a group of runs."""
    return folder / "groups" / str(group)


def get_copy_name(source: str) -> str:
    """Return the name of the copy of a task file; its suffix selects the reader."""
    suffix = Path(source).suffix.lower()
    return f"task{suffix}" if suffix not in ("", ".yml", ".json", ".tmp") else "task.yaml"


class RunFolder:
    """A folder of training runs.

    Attributes
    ----------
    manifest
        The settings of the training.
    config
        Content of the task file, defaults included.

    Raises
    ------
    OptionError
        If it is not such a folder, or its manifest or configuration is damaged or of another
        version.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            known = self.path.is_dir()
        except (OSError, ValueError) as error:
            raise OptionError(f"{path}: cannot be read: {error}.") from None
        if not known:
            raise OptionError(f"{path}: there is no such folder. Name a folder of train.")
        if not (self.path / MANIFEST).exists():
            raise OptionError(f"{path}: holds no {MANIFEST}. Name a folder that train wrote.")
        self.manifest = read_checked(
            self.path / MANIFEST, schemas.RUN, RunManifest, _REMEDY, within=self.path
        )
        self.config = read_document(
            self.path / TASK_CONFIG, schemas.RESOLVED_TASK, _REMEDY, within=self.path
        )

    @property
    def source(self) -> str:
        """Path to load the task from: the user's file if it still exists, else the copy.

        Raises
        ------
        OptionError
            If neither can be read.
        """
        there = self.manifest.task.path
        return there if is_regular(there) else str(self.checked_copy())

    @property
    def task_copy(self) -> Path:
        """The copy of the task file from the beginning of the training."""
        return self.path / get_copy_name(self.manifest.task.path)

    def checked_copy(self) -> Path:
        """Return the copy, having checked that it is a regular file of the folder.

        Raises
        ------
        OptionError
            If it is missing, not a regular file, or a link.
        """
        try:
            os.close(open_regular(self.task_copy, os.O_RDONLY, within=self.path))
        except OSError as error:
            raise OptionError(
                f"{self.task_copy}: cannot be read: {error.strerror}. {_REMEDY}."
            ) from None
        return self.task_copy

    def progress(self, group: int) -> GroupProgress | None:
        """Return the progress of a group; None before its first checkpoint.

        Raises
        ------
        OptionError
            If the file is damaged.
        """
        path = get_group_path(self.path, group) / PROGRESS
        if not path.exists():
            return None
        return read_checked(path, schemas.RUN_GROUP, GroupProgress, _REMEDY, within=self.path)

    def run(self, index: int) -> StoredRun:
        """Read a run.

        Raises
        ------
        OptionError
            If there is no such run, or one of its files is damaged.
        """
        seeds = self.manifest.seeds
        if not 0 <= index < len(seeds):
            raise OptionError(f"{self.path}: has no run {index}, only 0 to {len(seeds) - 1}.")
        group = next(g for g, runs in enumerate(self.manifest.groups) if index in runs)
        stored = StoredRun(index, seeds[index])
        progress = self.progress(group)
        if progress is not None:
            failure = progress.failures.get(index, "")
            stored = replace(stored, steps=progress.steps, failure=failure, wall_s=progress.wall_s)
        folder = get_run_path(self.path, index)
        metrics = read_metrics(folder / METRICS, index, within=self.path)
        return replace(
            stored,
            episodes=metrics.episodes,
            figures=metrics.figures,
            policy=self._read_policy(folder / "policy.json"),
            last=self._read_policy(folder / "last.json"),
        )

    def runs(self) -> list[StoredRun]:
        """Read all runs; a damaged file becomes the failure of its run."""
        runs = []
        for index, seed in enumerate(self.manifest.seeds):
            try:
                runs.append(self.run(index))
            except OptionError as error:
                runs.append(StoredRun(index, seed, failure=str(error)))
        return runs

    def result(self) -> dict[str, Any] | None:
        """Return the result document; None before it is written.

        Raises
        ------
        OptionError
            If it is damaged.
        """
        path = self.path / RESULT
        if not path.exists():
            return None
        remedy = "train --resume writes it again"
        document = read_document(path, schemas.TRAINING, remedy, within=self.path)
        return {"schema": schemas.TRAINING, **document}

    def _read_policy(self, path: Path) -> StoredNetwork | None:
        there = path.exists() or path.with_suffix(".safetensors").exists()
        return read_network(path, within=self.path) if there else None
