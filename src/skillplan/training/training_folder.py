"""The folder of training runs as it is written: begun, or taken up again; one writer a time.

The manifest is the last file that describes what is trained: where it is, the others are, too.
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
from skillplan.files.atomic_file import (
    is_unfinished,
    remove_unfinished,
    write_as_one,
    write_whole,
)
from skillplan.files.folder import HeldFolder
from skillplan.files.json_file import json_text
from skillplan.files.regular_file import read_bytes
from skillplan.files.yaml import MAX_BYTES
from skillplan.plugins.installed import registered
from skillplan.records import schemas
from skillplan.records.task_difference import differences, resolved_config, what_changed
from skillplan.records.training.run_folder import (
    MANIFEST,
    METRICS,
    RESULT,
    TASK_CONFIG,
    RunFolder,
    RunManifest,
    TaskReference,
    copy_name,
    group_path,
    metrics_lines,
    run_path,
)
from skillplan.solvers.learning.learner import STRIDE_STEPS
from skillplan.training.run_files import writing
from skillplan.training.training_plan import TrainingPlan
from skillplan.workers.processes import output_of

SCHEDULE = "schedule_steps"


def gone_on_with(was: RunManifest, wanted: RunManifest) -> RunManifest:
    """Return a manifest of the training that is wanted, with the schedules that are there.

    Where nothing is said of schedules, a training that is extended keeps those that it has: they
    spanned its steps, and stay at their ends. So it is the training that these schedules and all
    its steps would have been from the start.

    Parameters
    ----------
    was
        The training that is there.
    wanted
        The same with as many steps, or more.
    """
    if wanted.options.get(SCHEDULE, 0) is not None:
        return wanted
    known = was.options.get(SCHEDULE)
    if known is None and wanted.steps > was.steps:
        known = was.steps
    return wanted.model_copy(update={"options": {**wanted.options, SCHEDULE: known}})


def with_steps(manifest: RunManifest, steps: int) -> RunManifest:
    """Return a manifest of the same training with more steps [-], and schedules as they are."""
    options = {**manifest.options, "steps": steps}
    if SCHEDULE in options and options[SCHEDULE] is None:
        options[SCHEDULE] = manifest.steps
    return manifest.model_copy(update={"steps": steps, "options": options})


def refuse_longer(folder: Path, manifest: RunManifest, steps: int, *, said: bool) -> None:
    """Refuse what would not be the same as if all steps had been asked for from the start.

    Parameters
    ----------
    folder
        Of the training, for the message.
    manifest
        Of the training as it is.
    steps
        How many environment steps it is to have instead, more than now.
    said
        Whether somebody said how many; otherwise they are derived from the task.

    Raises
    ------
    OptionError
        If nobody asked for more, the learner has no schedules of their own length, or the training
        ends between two notes of its figures.
    """
    was = manifest.steps
    if not said:
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


def extension_words(manifest: RunManifest) -> str:
    """Return what a training is that has been extended to the steps of a manifest."""
    schedule = manifest.options.get(SCHEDULE)
    return (
        f"extended to {manifest.steps:,} steps; schedules stay at their ends, as if begun with "
        f"-O {manifest.solver}.{SCHEDULE}={schedule} --steps {manifest.steps}"
    )


# What a training may differ in from the one that is gone on with, in words. What it takes to
# keep checkpoints, and in how many processes, changes nothing that is learned.
_WORDS: Mapping[str, str] = {
    "solver": "the solver",
    "options": "the solver's options",
    "physics": "the physics engine",
    "collision": "the collision detectors",
    "back_end_options": "the options of back ends",
    "screening": "whether geometry is asked first",
    "family": "the family",
    "warm_start": "what the runs begin with",
    "versions": "the versions",
}
_MOST_NAMED = 4


class TrainingFolder(HeldFolder):
    """A folder that is being written by one training; a context manager.

    Parameters
    ----------
    path
        The folder, made if need be.
    plan
        What is trained.
    problem
        The task file it came from.
    part, changes
        Of a chain the task meant, and what was changed of the file.
    resume
        Whether a training that was begun there is gone on with.
    command
        The words of the command line, to be kept.

    Attributes
    ----------
    path
        The folder.
    manifest
        What is trained there.
    plan
        The same, to be done: of a training that is gone on with, with the schedules and groups
        that it has.
    extended
        What the training has become by more steps, in words; empty where it has as many as before.

    Raises
    ------
    OptionError
        If the folder cannot be used, holds something else, or another training: what differs is
        named.
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
        wanted = _manifest(plan, problem, part, changes or {}, command)
        self.extended = ""
        with self._opening("training"):
            self.manifest = self._opened(wanted, problem, resume, plan.steps_said)
        # Checkpoints are of the groups that the training was begun with.
        self.plan = replace(plan, options=self.manifest.options, groups=self.manifest.groups)

    def finish(self, result: Mapping[str, Any]) -> None:
        """Write the result, and what all runs have noted in one file.

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
                metrics = run_path(self.path, run) / METRICS
                for line in metrics_lines(metrics, within=self.path):
                    lines.append(f'{{"run":{run},{line[1:]}\n')
        text = json.dumps(dict(result), indent=2, allow_nan=False)
        with writing(self.path, RESULT):
            contents = {METRICS: "".join(lines), RESULT: text}
            write_as_one(self.path, contents, within=self.path)

    def _opened(
        self, wanted: RunManifest, problem: Problem, resume: bool, steps_said: bool
    ) -> RunManifest:
        there = {one.name for one in self.path.iterdir()}
        copy = copy_name(problem.source)
        # A program that was ended before it wrote the manifest has done nothing yet.
        begun = {name for name in there if is_unfinished(name)} | {copy, TASK_CONFIG}
        if there and not resume:
            raise OptionError(
                f"--out {self.path}: is not empty. Name a new folder, or go on with --resume."
            )
        if MANIFEST in there:
            stored = RunFolder(self.path)
            wanted = gone_on_with(stored.manifest, wanted)
            longer = stored.manifest.steps < wanted.steps
            kept = with_steps(stored.manifest, wanted.steps) if longer else stored.manifest
            self._compare(stored, kept, wanted, problem)
            if longer:
                refuse_longer(self.path, stored.manifest, wanted.steps, said=steps_said)
                write_whole(self.path / MANIFEST, json_text(schemas.RUN, kept), within=self.path)
                self.extended = extension_words(kept)
            runs = [run_path(self.path, run) for run in range(len(stored.manifest.seeds))]
            groups = [group_path(self.path, group) for group in range(len(stored.manifest.groups))]
            for folder in (self.path, *runs, *groups):
                remove_unfinished(folder, within=self.path)
            return kept
        if there - begun:
            raise OptionError(f"--out {self.path}: holds no {MANIFEST}, so nothing to resume.")
        content = read_bytes(problem.source, max(MAX_BYTES, problem.domain.max_bytes))
        write_whole(self.path / copy, content, within=self.path)
        config = json_text(schemas.RESOLVED_TASK, resolved_config(problem))
        write_whole(self.path / TASK_CONFIG, config, within=self.path)
        write_whole(self.path / MANIFEST, json_text(schemas.RUN, wanted), within=self.path)
        remove_unfinished(self.path, within=self.path)
        return wanted

    def _compare(
        self, stored: RunFolder, was: RunManifest, wanted: RunManifest, problem: Problem
    ) -> None:
        if (was.task.sha256, was.task.part) != (wanted.task.sha256, wanted.task.part):
            changed = what_changed(stored.config, resolved_config(problem))
            if was.task.sha256 == wanted.task.sha256:
                changed = f"the part: {was.task.part} there, {wanted.task.part} now"
            self._refuse("the task", changed)
        if was.seeds != wanted.seeds:
            there, now = (f"{len(one.seeds)} from seed {one.seed}" for one in (was, wanted))
            self._refuse("the runs", f"{there} there, {now} now")
        for key, words in _WORDS.items():
            one, other = (manifest.model_dump(mode="json")[key] for manifest in (was, wanted))
            if one != other:
                found = differences(one, other)
                changed = "; ".join(str(difference) for difference in found[:_MOST_NAMED])
                self._refuse(words, changed.replace("the file: ", ""))

    def _refuse(self, words: str, changed: str) -> None:
        raise OptionError(
            f"--resume: the training in {self.path} is another one, in {words}: {changed}. Give "
            "the same values, or name a new folder."
        )


def _manifest(
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
        versions=_versions(plan.solver),
        git_commit=_git_commit(),
        machine={
            "system": platform.platform(),
            "processor": platform.processor() or platform.machine(),
            "cores": os.cpu_count(),
        },
    )


def _versions(solver: str) -> dict[str, str]:
    """Return the versions of what figures rest on, those the solver's distribution needs, too."""
    found = {"python": sys.version.split()[0], "skillplan": skillplan.__version__}
    names = ["numpy"]
    for entry in registered("solver").select(name=solver):
        if entry.dist is not None:
            names += [entry.dist.name]
            for needed in requires(entry.dist.name) or ():
                if "extra ==" not in needed:
                    names += re.findall(r"^[\w.-]+", needed)
    for name in dict.fromkeys(names):
        try:
            found.setdefault(name, version(name))
        except PackageNotFoundError:
            continue  # needed elsewhere, under another Python for example
    return found


def _git_commit() -> str | None:
    """Return the commit of the source that runs, or None where it is no checkout."""
    source = Path(skillplan.__file__)
    git = ["git", "-C", str(source.parent)]
    if output_of([*git, "ls-files", "--error-unmatch", source.name]) is None:
        return None
    return (output_of([*git, "rev-parse", "HEAD"]) or "").strip() or None
