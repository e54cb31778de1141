"""The folder of a training as it is written: begun, or resumed; by one program at a time.

The manifest is written last of the files that describe a training: if it exists, they do.
"""

from __future__ import annotations

import json
import os
import platform
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import skillplan
from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.files.atomic_file import is_unfinished, remove_unfinished, write_as_one, write_whole
from skillplan.files.folder import HeldFolder
from skillplan.files.json_file import format_document
from skillplan.files.regular_file import read_bytes
from skillplan.files.yaml import MAX_BYTES
from skillplan.pipeline import registry
from skillplan.plugins.installed import registered
from skillplan.records import schemas
from skillplan.records.task_difference import describe_changes, differences, resolve_config
from skillplan.records.training.run_folder import (
    MANIFEST,
    METRICS,
    RESULT,
    TASK_CONFIG,
    RunFolder,
    RunManifest,
    TaskReference,
    get_copy_name,
    get_group_path,
    get_run_path,
    read_metrics_lines,
)
from skillplan.solvers.learning.learner import STRIDE_STEPS, LearnerOptions
from skillplan.training.run_files import writing
from skillplan.training.training_plan import TrainingPlan
from skillplan.workers.processes import read_output

SCHEDULE = "schedule_steps"


def keep_schedules(existing: RunManifest, requested: RunManifest) -> RunManifest:
    """Return the requested manifest with the schedules of the training that exists.

    An extended training keeps its schedules unless the request names one. They spanned the original
    steps and stay at their final values. The result equals a training that had these schedules and
    all steps from the start.

    Parameters
    ----------
    existing
        Manifest of the training that exists.
    requested
        The same with as many steps, or more.
    """
    if requested.options.get(SCHEDULE, 0) is not None:
        return requested
    known = existing.options.get(SCHEDULE)
    if known is None and requested.steps > existing.steps:
        known = existing.steps
    return requested.model_copy(update={"options": {**requested.options, SCHEDULE: known}})


def adopt_options(existing: RunManifest, requested: RunManifest) -> tuple[RunManifest, RunManifest]:
    """Return both manifests with all options of a training that an earlier version began.

    Options that the request leaves at their defaults get the values of the existing training.

    Parameters
    ----------
    existing, requested
        Manifest of the training that exists, and of the request.
    """
    fields: type[LearnerOptions] = registry.load("solver", requested.solver).Options
    stored = fields.upgrade(existing.options)
    if stored == existing.options or existing.solver != requested.solver:
        return existing, requested
    options = dict(requested.options)
    for name, field in fields.model_fields.items():
        if name in stored and options.get(name) == field.default:
            options[name] = stored[name]
    return (
        existing.model_copy(update={"options": stored}),
        requested.model_copy(update={"options": options}),
    )


def set_steps(manifest: RunManifest, steps: int) -> RunManifest:
    """Return the manifest of the same training with more steps and the same schedules."""
    options = {**manifest.options, "steps": steps}
    if SCHEDULE in options and options[SCHEDULE] is None:
        options[SCHEDULE] = manifest.steps
    derived = manifest.derived_options
    if derived is not None:
        derived = tuple(name for name in derived if name != "steps")
    return manifest.model_copy(
        update={"steps": steps, "options": options, "derived_options": derived}
    )


def check_extension(folder: Path, manifest: RunManifest, steps: int, *, requested: bool) -> None:
    """Refuse an extension that would differ from a training with all steps from the start.

    Parameters
    ----------
    manifest
        The training before its extension.
    steps
        Environment steps after it, more than before.
    requested
        True if the user gave this number; otherwise it is derived from the task.

    Raises
    ------
    OptionError
        If no extension is requested, the learner has no option for the length of its schedules, or
        the training ends between two strides.
    """
    was = manifest.steps
    if not requested:
        raise OptionError(
            f"--resume: the training in {folder} is of {was} steps. Give --steps {was} to go on "
            f"with it, or more to extend it; without --steps it would be {steps}."
        )
    if SCHEDULE not in manifest.options:
        raise OptionError(
            f"--resume --steps {steps}: {manifest.solver} has no option {SCHEDULE}, so that its "
            f"training in {folder} cannot be extended. Train anew in another folder."
        )
    if was % STRIDE_STEPS:
        ends = -(-was // STRIDE_STEPS) * STRIDE_STEPS
        raise OptionError(
            f"--resume --steps {steps}: the training in {folder} has {was} steps, and only whole "
            f"hundreds can be extended. Train anew in another folder, with --steps {ends} for "
            f"example, or at once with -O {manifest.solver}.{SCHEDULE}={was} --steps {steps}."
        )


def describe_extension(manifest: RunManifest) -> str:
    """Describe a training that has been extended."""
    schedule = manifest.options.get(SCHEDULE)
    return (
        f"extended to {manifest.steps:,} steps; schedules stay at their ends, as if begun with "
        f"-O {manifest.solver}.{SCHEDULE}={schedule} --steps {manifest.steps}"
    )


# Settings that must not change when a training is resumed, with their names in messages.
# Checkpoints and the number of processes may change: they do not affect the results.
_WORDS: Mapping[str, str] = {
    "solver": "the solver",
    "options": "the solver's options",
    "physics": "the physics engine",
    "collision": "the collision detectors",
    "back_end_options": "the options of back ends",
    "screening": "whether geometry is checked first",
    "family": "the family",
    "warm_start": "the networks that the runs start from",
    "versions": "the versions",
}
_MOST_NAMED = 4
# Versions of skillplan whose trainings this version continues bit for bit.
_CONTINUED_VERSIONS = {"0.2.0"}


class TrainingFolder(HeldFolder):
    """A folder that one training writes; a context manager.

    Parameters
    ----------
    path
        The folder, created if necessary.
    part, changes
        The task of a chain, and the entries of ``--set``.
    resume
        True to continue the training in the folder.
    command
        The words of the command line, stored in the manifest.

    Attributes
    ----------
    manifest
        The settings of the training.
    plan
        The training to do; a resumed one has the schedules and groups of its manifest.
    extended
        Description of an extension by more steps; empty without one.

    Raises
    ------
    OptionError
        If the folder cannot be used, or holds something else or another training; the message names
        the difference.
    """

    def __init__(
        self,
        path: str,
        plan: TrainingPlan,
        problem: Problem,
        *,
        part: str | None = None,
        changes: Mapping[str, str] | None = None,
        resume: bool = False,
        command: Sequence[str] = (),
    ) -> None:
        super().__init__(path)
        manifest = _make_manifest(plan, problem, part, changes or {}, command)
        self.extended = ""
        with self._opening("training"):
            self.manifest = self._open_manifest(manifest, problem, resume, plan.steps_said)
        # Checkpoints belong to the groups that the training began with.
        self.plan = replace(plan, options=self.manifest.options, groups=self.manifest.groups)

    def finish(self, result: Mapping[str, Any]) -> None:
        """Write the result, and the metrics of all runs in one file.

        Parameters
        ----------
        result
            The document ``skillplan.training/1``.

        Raises
        ------
        OptionError
            If a file cannot be written.
        """
        lines = []
        with writing(self.path, METRICS):
            for run in range(len(self.manifest.seeds)):
                metrics = get_run_path(self.path, run) / METRICS
                for line in read_metrics_lines(metrics, within=self.path):
                    lines.append(f'{{"run":{run},{line[1:]}\n')
        text = json.dumps(dict(result), indent=2, allow_nan=False)
        with writing(self.path, RESULT):
            contents = {METRICS: "".join(lines), RESULT: text}
            write_as_one(self.path, contents, within=self.path)

    def _open_manifest(
        self, requested: RunManifest, problem: Problem, resume: bool, steps_said: bool
    ) -> RunManifest:
        there = {path.name for path in self.path.iterdir()}
        copy = get_copy_name(problem.source)
        # A program that ended before it wrote the manifest has done nothing else yet.
        unfinished = {name for name in there if is_unfinished(name)} | {copy, TASK_CONFIG}
        if there and not resume:
            raise OptionError(
                f"--out {self.path}: is not empty. Name a new folder, or go on with --resume."
            )
        if MANIFEST in there:
            stored = RunFolder(self.path)
            existing, requested = adopt_options(stored.manifest, requested)
            requested = keep_schedules(existing, requested)
            longer = existing.steps < requested.steps
            kept = set_steps(existing, requested.steps) if longer else existing
            self._compare(stored, kept, requested, problem)
            if longer:
                check_extension(self.path, existing, requested.steps, requested=steps_said)
                write_whole(
                    self.path / MANIFEST, format_document(schemas.RUN, kept), within=self.path
                )
                self.extended = describe_extension(kept)
            runs = [get_run_path(self.path, run) for run in range(len(stored.manifest.seeds))]
            groups = [
                get_group_path(self.path, group) for group in range(len(stored.manifest.groups))
            ]
            for folder in (self.path, *runs, *groups):
                remove_unfinished(folder, within=self.path)
            return kept
        if there - unfinished:
            raise OptionError(f"--out {self.path}: holds no {MANIFEST}, so nothing to resume.")
        content = read_bytes(problem.source, max(MAX_BYTES, problem.domain.max_bytes))
        write_whole(self.path / copy, content, within=self.path)
        config = format_document(schemas.RESOLVED_TASK, resolve_config(problem))
        write_whole(self.path / TASK_CONFIG, config, within=self.path)
        write_whole(self.path / MANIFEST, format_document(schemas.RUN, requested), within=self.path)
        remove_unfinished(self.path, within=self.path)
        return requested

    def _compare(
        self, stored: RunFolder, existing: RunManifest, requested: RunManifest, problem: Problem
    ) -> None:
        task, other = existing.task, requested.task
        if (task.sha256, task.part) != (other.sha256, other.part):
            changed = describe_changes(stored.config, resolve_config(problem))
            if task.sha256 == other.sha256:
                changed = f"the part: {task.part} there, {other.part} now"
            self._refuse("the task", changed)
        if existing.seeds != requested.seeds:
            there, now = (
                f"{len(manifest.seeds)} from seed {manifest.seed}"
                for manifest in (existing, requested)
            )
            self._refuse("the runs", f"{there} there, {now} now")
        for key, words in _WORDS.items():
            before, after = (
                manifest.model_dump(mode="json")[key] for manifest in (existing, requested)
            )
            if key == "versions":
                before = _raise_versions(before, after)
            if before != after:
                changes = differences(before, after)[:_MOST_NAMED]
                changed = "; ".join(str(difference) for difference in changes)
                self._refuse(words, changed.replace("the file: ", ""))

    def _refuse(self, words: str, changed: str) -> None:
        raise OptionError(
            f"--resume: the training in {self.path} differs in {words}: {changed}. Give "
            "the same values, or name a new folder."
        )


def _make_manifest(
    plan: TrainingPlan,
    problem: Problem,
    part: str | None,
    changes: Mapping[str, str],
    command: Sequence[str],
) -> RunManifest:
    task, setup = plan.task, plan.setup
    return RunManifest(
        task=TaskReference(
            name=task.name,
            kind=task.kind,
            sha256=task.sha256,
            source=problem.source,
            path=str(Path(problem.source).resolve()),
            part=part,
            changes=dict(changes),
        ),
        solver=plan.solver,
        options=dict(plan.options),
        derived_options=tuple(name for name in plan.derived if name in plan.options),
        steps=plan.steps,
        seed=plan.seeds[0],
        seeds=plan.seeds,
        physics=setup.physics_choice(task).name,
        collision=tuple(choice.name for choice in setup.named_collision_choices(task)),
        back_end_options={name: dict(kv) for name, kv in setup.options.items()},
        screening=setup.screening,
        family=plan.family,
        warm_start=None if plan.start is None else plan.start.record,
        checkpoint_steps=plan.checkpoint_steps,
        groups=plan.groups,
        command=tuple(command),
        versions=_collect_versions(plan.solver),
        git_commit=_find_git_commit(),
        machine={
            "system": platform.platform(),
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
        },
    )


def _raise_versions(stored: Mapping[str, str], current: Mapping[str, str]) -> dict[str, str]:
    """Replace versions of skillplan's distributions from which a training continues."""
    return {
        name: current[name]
        if name.startswith("skillplan") and name in current and number in _CONTINUED_VERSIONS
        else number
        for name, number in stored.items()
    }


def _collect_versions(solver: str) -> dict[str, str]:
    """Return the versions of skillplan, the solver's package and its requirements."""
    versions = {"python": sys.version.split()[0], "skillplan": skillplan.__version__}
    names = ["numpy"]
    for entry in registered("solver").select(name=solver):
        if entry.dist is not None:
            names += [entry.dist.name]
            for needed in requires(entry.dist.name) or ():
                if "extra ==" not in needed:
                    names += re.findall(r"^[\w.-]+", needed)
    for name in dict.fromkeys(names):
        try:
            versions.setdefault(name, version(name))
        except PackageNotFoundError:
            continue  # required on other platforms only
    return versions


def _find_git_commit() -> str | None:
    """Return the commit of the running source; None if it is not a checkout."""
    source = Path(skillplan.__file__)
    git = ["git", "-C", str(source.parent)]
    if read_output([*git, "ls-files", "--error-unmatch", source.name]) is None:
        return None
    return (read_output([*git, "rev-parse", "HEAD"]) or "").strip() or None
