"""The folder of training runs as it is read: settings, metrics and what was learned.

Whatever is wrong with a file is one error that names it and says what to do. How a folder comes
about, and survives whatever ends the program, is the business of `skillplan.training`.
Somebody else may have made it: `files.regular_file` follows no link in it and opens regular files
only, and what the manifest says is bounded.
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
from skillplan.files.regular_file import is_folder, is_regular, open_regular, read_bytes
from skillplan.records import schemas
from skillplan.records.stored.result_folder import MANIFEST as MANIFEST
from skillplan.records.stored.result_folder import RESULT as RESULT
from skillplan.records.training.network_policy_file import StoredNetwork, read_network
from skillplan.solvers.learning.learner import End, Episode

METRICS = "metrics.jsonl"
_ENDS = get_args(End)
# More than a run of a hundred million steps notes.
_MOST_BYTES = 4 * 1024**3


@dataclass(frozen=True, slots=True)
class FiguresRecord:
    """What a learner thinks worth a curve.

    Parameters
    ----------
    step
        Environment steps done, >= 1.
    figures
        Finite numbers by name, such as ``loss``.
    """

    step: int
    figures: Mapping[str, float]


@dataclass(frozen=True)
class RunMetrics:
    """All that a run noted, in order.

    Parameters
    ----------
    episodes
        Those that ended.
    figures
        What the learner thought worth a curve.
    """

    episodes: tuple[Episode, ...] = ()
    figures: tuple[FiguresRecord, ...] = ()


def metrics_line(record: Episode | FiguresRecord) -> str:
    """Return a line of JSON, without its end.

    Figures that are not finite are left out; an episode's must be finite.

    Raises
    ------
    ValueError
        If an episode's cost or reward is not finite.
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
    """Return what a run noted; a piece of a line at the end of the file is left out.

    Parameters
    ----------
    path
        The file; none is that of a run which has noted nothing.
    run
        The run's number.
    within
        A folder that the file must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OptionError
        If the file cannot be read, or another line is damaged: it is named.
    """
    try:
        lines = metrics_lines(path, within=within)
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}.") from None
    return metrics_of(lines, path, run)


def metrics_of(lines: Iterable[str], path: Path, run: int) -> RunMetrics:
    """Return what lines say; parameters and errors are those of `read_metrics`."""
    episodes: list[Episode] = []
    figures: list[FiguresRecord] = []
    for record in _records(lines, path, run):
        if isinstance(record, Episode):
            episodes.append(record)
        else:
            figures.append(record)
    return RunMetrics(tuple(episodes), tuple(figures))


def metrics_lines(path: Path, *, within: Path | None = None) -> list[str]:
    """Return the whole lines of a file, unread; none where there is no file.

    Parameters
    ----------
    path, within
        As for `read_metrics`.

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


def _records(lines: Iterable[str], path: Path, run: int) -> Iterator[Episode | FiguresRecord]:
    before = 0
    for number, line in enumerate(lines, start=1):
        try:
            record = _record(line, run)
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


def _record(line: str, run: int) -> Episode | FiguresRecord:
    content = parse_json(line)
    if not isinstance(content, dict):
        raise ValueError("it is no mapping")
    kind, step = content.pop("kind", None), content.pop("step", None)
    if type(step) is not int:
        raise ValueError("it has no step")
    if kind == "figures":
        return FiguresRecord(step, {name: _finite(value) for name, value in content.items()})
    if kind != "episode":
        raise ValueError("it is neither an episode nor figures")
    actions = tuple(content["actions"])
    if not all(type(action) is int and action >= 0 for action in actions):
        raise ValueError("its actions are no numbers of skills")
    if content["end"] not in _ENDS or content["length"] != len(actions):
        raise ValueError("its end or its length is wrong")
    if type(content["greedy"]) is not bool:
        raise ValueError("it does not say whether it was greedy")
    if type(content.get("planned", False)) is not bool:
        raise ValueError("it does not say whether it was planned")
    return Episode(
        run,
        step,
        content["end"],
        actions,
        _finite(content["cost"]),
        _finite(content["reward"]),
        content["greedy"],
        content.get("planned", False),
    )


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError("a figure is no finite number")
    return float(value)


TASK_CONFIG = "task.json"
PROGRESS, CHECKPOINT = "progress.json", "checkpoint.safetensors"
MOST_RUNS = 1_000
"""As many as --runs takes; what else a manifest lists is not longer either."""
MOST_PATH = 4_096
"""No path of a file is longer."""
_REMEDY = "Bring the file back from a copy, or train again in another folder"


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


Word = Annotated[str, Field(max_length=MOST_PATH)]
Amount = Annotated[int, Field(ge=1, le=1_000_000_000)]
Seed = Annotated[int, Field(ge=0, le=2**64)]


class TaskReference(_Part):
    """The task that is learned, and where its file was."""

    name: Word
    kind: Word
    sha256: Word = Field(description="hash of the file's content")
    source: Word = Field(description="the file as the user named it")
    path: Word = Field(description="the same from the root")
    part: Word | None = Field(description="of a file that describes a chain, the task meant")
    changes: dict[Word, str] = Field(
        max_length=MOST_RUNS, description="what --set changed, by key path"
    )


class Family(_Part):
    """Layouts drawn from the task file's family, one for every episode."""

    count: int = Field(ge=1, le=10_000, description="layouts")
    seed: Seed


class WarmStartRecord(_Part):
    """Networks of an earlier training that the runs began with."""

    run_dir: Word = Field(description="folder of the earlier training as the user named it")
    task: Word = Field(description="what was learned there")
    runs: tuple[int, ...] = Field(
        min_length=1, max_length=MOST_RUNS, description="the earlier run of every run"
    )
    skills: Amount
    skills_known: Amount = Field(description="of these skills the earlier task has the name, too")
    features: Amount
    features_known: Amount = Field(description="of these features likewise")
    sha256: Word = Field(description="hash of the networks as they were taken over")

    @property
    def text(self) -> str:
        """Return it in words."""
        return (
            f"from networks of {self.run_dir} ({self.task}): {self.skills_known} of {self.skills} "
            f"skills and {self.features_known} of {self.features} features known"
        )


class RunManifest(_Part):
    """The settings of a training: the document ``skillplan.run/1``."""

    task: TaskReference
    solver: Word
    options: dict[str, Any] = Field(description="every option as it counts")
    steps: Amount = Field(description="environment steps of every run")
    seed: Seed
    seeds: tuple[Seed, ...] = Field(
        min_length=1, max_length=MOST_RUNS, description="one for every run"
    )
    physics: Word
    collision: tuple[Word, ...] = Field(max_length=MOST_RUNS)
    back_end_options: dict[str, dict[str, Any]]
    screening: bool = Field(
        False, description="whether geometry is asked before anything is executed"
    )
    family: Family | None
    warm_start: WarmStartRecord | None = None
    checkpoint_steps: Amount
    groups: tuple[Annotated[tuple[int, ...], Field(min_length=1, max_length=MOST_RUNS)], ...] = (
        Field(max_length=MOST_RUNS, description="runs that learn side by side")
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
        """What is observed of a state."""
        return str(self.options["observation"])

    @property
    def mask(self) -> str:
        """What a choice is limited to."""
        return str(self.options["mask"])

    @property
    def objective(self) -> str:
        """What the rewards are made from."""
        return str(self.options["objective"])


_SEEN = ("observation", "mask", "objective")


class GroupProgress(_Part):
    """How far runs that learn side by side have come, and what that took."""

    steps: int = Field(ge=0, le=1_000_000_000)
    failures: dict[int, Annotated[str, Field(max_length=10_000)]] = Field(
        max_length=MOST_RUNS, description="why runs cannot go on, by run"
    )
    wall_s: float = Field(ge=0, description="time spent on learning [s]")
    elapsed_s: float = Field(ge=0, description="time of the whole training until then [s]")
    checks: int = Field(ge=0)
    hits: int = Field(ge=0)
    executions: int = Field(ge=0)
    asked: dict[str, int] = Field(description="how often each back end was queried")


@dataclass(frozen=True)
class StoredRun:
    """A run as its files have it.

    Parameters
    ----------
    run, seed
        Its number, from 0, and what governs its randomness.
    steps
        Environment steps done and kept.
    episodes, figures
        What it noted, in order.
    policy
        Its reported policy; None while it has neither finished nor been interrupted.
    last
        What it had learned last; None likewise.
    failure
        Why it could not go on, or which of its files is damaged; empty where all is well.
    wall_s
        Time that it took together with those beside it [s]; None while nothing is kept.
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
        """The best policy that was seen; None where none ever completed the task."""
        return self.policy if self.policy is not None and self.policy.kept == "best" else None

    @property
    def latest_figures(self) -> Mapping[str, float]:
        """The latest figures; empty before the first."""
        return self.figures[-1].figures if self.figures else {}


def is_run_folder(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a folder of training runs rather than a task file."""
    return is_folder(path) and is_regular(Path(path) / MANIFEST)


def run_path(folder: Path, run: int) -> Path:
    """Return the folder of a run."""
    return folder / "runs" / f"{run:02d}"


def group_path(folder: Path, group: int) -> Path:
    """Return the folder of runs that learn side by side."""
    return folder / "groups" / str(group)


def copy_name(source: str) -> str:
    """Return what the copy of a task file is called: by its suffix it is read."""
    suffix = Path(source).suffix.lower()
    return f"task{suffix}" if suffix not in ("", ".yml", ".json", ".tmp") else "task.yaml"


class RunFolder:
    """A folder of training runs.

    Parameters
    ----------
    path
        The folder.

    Attributes
    ----------
    path
        The folder.
    manifest
        The settings of the training.
    config
        The task file's content as it was read, defaults included.

    Raises
    ------
    OptionError
        If it is no such folder, or its manifest or configuration is damaged or of another
        version.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            known = self.path.is_dir()
        except (OSError, ValueError) as error:
            raise OptionError(f"{path}: cannot be read: {error}.") from None
        if not known:
            raise OptionError(f"{path}: there is no such folder. Name one that train wrote.")
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
        """Where to load the task from: the user's file if it is still there, else the copy.

        Raises
        ------
        OptionError
            If neither can be read.
        """
        there = self.manifest.task.path
        return there if is_regular(there) else str(self.checked_copy())

    @property
    def task_copy(self) -> Path:
        """The copy of the task file as it was when the training began."""
        return self.path / copy_name(self.manifest.task.path)

    def checked_copy(self) -> Path:
        """Return the copy, having seen that it is a file of the folder.

        Raises
        ------
        OptionError
            If it is missing, no regular file, or a link.
        """
        try:
            os.close(open_regular(self.task_copy, os.O_RDONLY, within=self.path))
        except OSError as error:
            raise OptionError(
                f"{self.task_copy}: cannot be read: {error.strerror}. {_REMEDY}."
            ) from None
        return self.task_copy

    def progress(self, group: int) -> GroupProgress | None:
        """Return how far a group has come; None before its first checkpoint.

        Raises
        ------
        OptionError
            If the file is damaged.
        """
        path = group_path(self.path, group) / PROGRESS
        if not path.exists():
            return None
        return read_checked(path, schemas.RUN_GROUP, GroupProgress, _REMEDY, within=self.path)

    def run(self, index: int) -> StoredRun:
        """Return a run.

        Raises
        ------
        OptionError
            If there is no such run, or a file of it is damaged.
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
        folder = run_path(self.path, index)
        metrics = read_metrics(folder / METRICS, index, within=self.path)
        return replace(
            stored,
            episodes=metrics.episodes,
            figures=metrics.figures,
            policy=self._policy(folder / "policy.json"),
            last=self._policy(folder / "last.json"),
        )

    def runs(self) -> list[StoredRun]:
        """Return all runs; one whose files are damaged says so as its failure."""
        found = []
        for index, seed in enumerate(self.manifest.seeds):
            try:
                found.append(self.run(index))
            except OptionError as error:
                found.append(StoredRun(index, seed, failure=str(error)))
        return found

    def result(self) -> dict[str, Any] | None:
        """Return the result document; None while there is none.

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

    def _policy(self, path: Path) -> StoredNetwork | None:
        there = path.exists() or path.with_suffix(".safetensors").exists()
        return read_network(path, within=self.path) if there else None
