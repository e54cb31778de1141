"""``skillplan train`` at work: begins or resumes a training, and shows its progress."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.cli.interruption import Deadline, counting, handle_signals
from skillplan.cli.output import emit
from skillplan.cli.writing import tell
from skillplan.domains.load import Problem
from skillplan.errors import exit_code
from skillplan.records import schemas
from skillplan.records.evaluation import Optimum
from skillplan.records.training.result import TrainingResult
from skillplan.solvers.solution import deviation
from skillplan.solvers.stop import Stop
from skillplan.training.family_training import FamilyFolder, FamilyPlan, train_family
from skillplan.training.groups import GroupReport
from skillplan.training.trainer import Trainer, find_next_folder
from skillplan.training.training_folder import TrainingFolder
from skillplan.training.training_plan import TrainingPlan
from skillplan.views.tables.training import tabulate_family, tabulate_training
from skillplan.views.text.wording import escape


@dataclass(frozen=True, slots=True)
class TrainingSession:
    """A training as the command line requests it.

    Parameters
    ----------
    problem, plan
        The task file, and the training on it.
    part, changes
        The task of a chain, and the entries of ``--set``.
    jobs
        Number of processes, >= 1.
    proof_time_limit_s
        Time limit for proving the optimum [s], > 0.
    deadline
        End of the whole command.
    style
        Output format.
    """

    problem: Problem
    plan: TrainingPlan
    part: str | None
    changes: Mapping[str, str]
    jobs: int
    proof_time_limit_s: float
    deadline: Deadline
    style: str

    def begin(self, out: str | None) -> int:
        """Train in a new folder, by default the next free one; return the exit code.

        Raises
        ------
        OptionError
            If the folder cannot be used.
        """
        command = sys.argv[1:]
        if out is None:
            out = str(find_next_folder(self.plan.task.name, self.plan.solver))
            command = [*command, "--out", out]
            tell(f"writing to {out}")
        with self._open(out, command, resume=False) as folder:
            tell(_describe_derived(self.plan))
            return self._train(folder, command)

    def resume(self, out: str) -> int:
        """Continue the training in a folder; return the exit code.

        Raises
        ------
        OptionError
            If the folder holds another training, or none.
        """
        command = sys.argv[1:]
        with self._open(out, command, resume=True) as folder:
            if folder.extended:
                tell(folder.extended)
            return self._train(folder, command)

    def _open(self, out: str, command: Sequence[str], *, resume: bool) -> TrainingFolder:
        return TrainingFolder(
            out,
            self.plan,
            self.problem,
            part=self.part,
            changes=self.changes,
            resume=resume,
            command=command,
        )

    def _train(self, folder: TrainingFolder, command: Sequence[str]) -> int:
        trainer = Trainer(folder.plan, folder, jobs=self.jobs, time_limit_s=self.proof_time_limit_s)
        with (
            TrainingDisplay(folder.plan) as display,
            handle_signals(trainer.interrupt),
            self.deadline.calling(trainer.end_in_time),
        ):
            trainer.on_report, trainer.on_optimum = display.report, display.proved
            result = trainer.train()
        code = _get_exit_code(trainer, result)
        emit(self.style, result.document(), tabulate_training(result), failed=code != 0)
        if result.interrupted:
            self._show_resume_command(command, trainer.timed_out)
        return code

    def _show_resume_command(self, command: Sequence[str], timed_out: bool) -> None:
        again = shlex.join(["skillplan", *(word for word in command if word != "--resume")])
        limit_s = self.deadline.time_limit_s
        ended = f"ended by --time-limit {limit_s:g}" if timed_out else "interrupted"
        tell(f"{ended}; go on with: {again} --resume")


def _get_exit_code(trainer: Trainer, result: TrainingResult) -> int:
    all_failed = len(result.failed) == len(result.outcomes)
    return exit_code(
        interrupted=trainer.interrupted and not trainer.timed_out,
        back_end_failed=all_failed and trainer.back_end_failed,
        solved=bool(result.completed),
    )


def train_family_policy(
    plan: FamilyPlan, out: str | None, time_limit_s: float | None, style: str
) -> int:
    """Train one policy on random boards, print its test results, and return the exit code.

    Parameters
    ----------
    out
        New folder; None for the next free one.
    time_limit_s
        Time limit of the training [s], > 0.

    Raises
    ------
    OptionError
        If the learner does not fit, or the folder cannot be written.
    PluginError
        If the solver is unknown or broken.
    """
    stop = Stop(time_limit_s=time_limit_s)
    steps = plan.learner(stop).steps
    if out is None:
        out = str(find_next_folder(str(plan.family).replace(":", "-"), plan.solver))
        tell(f"writing to {out}")
    with (
        FamilyFolder(out) as folder,
        counting("learning in rounds", steps) as count,
        handle_signals(stop.interrupt),
    ):
        learned = train_family(plan, folder, stop, count.one_more)
    complete = learned.trial is not None and learned.trial.completed == learned.trial.boards
    document = {"schema": schemas.RELATIONAL_POLICY, **learned.model_dump(mode="json")}
    emit(style, document, [tabulate_family(learned, out)], failed=not complete)
    return exit_code(interrupted=stop.interrupted, solved=complete)


class TrainingDisplay:
    """Progress of a training on stderr, if that is a terminal: time left, success, gap, speed."""

    def __init__(self, plan: TrainingPlan) -> None:
        self._sizes = [len(group) for group in plan.groups]
        self._reports: dict[int, GroupReport] = {}
        self._first: dict[int, int] = {}
        self._begun_s = time.monotonic()
        self._optimum: float | None = None
        self._bar: Any = None
        self._live: Any = None
        if sys.stderr.isatty():
            self._show(f"{plan.solver}, {len(plan.seeds)} runs", plan.steps * len(plan.seeds))

    def _show(self, label: str, total: int) -> None:
        # Imported here because only a terminal needs it.
        from rich.console import Console, Group
        from rich.live import Live
        from rich.progress import (
            BarColumn,
            Progress,
            TaskProgressColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.text import Text

        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            TaskProgressColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        self._line = self._bar.add_task(escape(label), total=total)
        # The figures are below the bar because a narrow terminal cannot show both in one line.
        self._live = Live(
            get_renderable=lambda: Group(self._bar, Text(self.figures())),
            console=Console(stderr=True),
            transient=True,
        )

    def __enter__(self) -> TrainingDisplay:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def proved(self, optimum: Optimum) -> None:
        """Note the proved optimum."""
        self._optimum = optimum.cost

    def report(self, report: GroupReport) -> None:
        """Note the state of a group, and show it."""
        if report.group not in self._reports:
            self._first[report.group] = report.steps
        self._reports[report.group] = report
        if self._bar is not None:
            sizes = self._sizes
            done = sum(known.steps * sizes[known.group] for known in self._reports.values())
            self._bar.update(self._line, completed=done)

    def figures(self) -> str:
        """Return a line about all groups together."""
        # Another thread calls this while reports come in.
        reports = list(self._reports.values())
        successes, recent = (sum(report.recent[i] for report in reports) for i in (0, 1))
        parts = [f"{sum(report.episodes for report in reports):,} episodes"]
        if recent:
            parts.append(f"{100 * successes / recent:.0f} % success")
        costs = [report.best_cost for report in reports if report.best_cost is not None]
        if costs:
            parts.append(f"best {min(costs):.5f}")
            gap = deviation(min(costs), self._optimum)
            parts += [] if gap is None else [f"gap {100 * gap:.2f} %"]
        here = sum(
            (report.steps - self._first[report.group]) * self._sizes[report.group]
            for report in reports
        )
        passed_s = time.monotonic() - self._begun_s
        if here and passed_s > 0:
            parts.append(f"{here / passed_s:,.0f} steps/s")
        executions = sum(report.executions for report in reports)
        return "  ".join([*parts, *([f"{executions:,} checks"] if executions else [])])


def _describe_derived(plan: TrainingPlan) -> str:
    """Return a line with the options that the task determines."""
    values = ", ".join(f"{name} {_format(value)}" for name, value in plan.derived.items())
    return f"derived from the task: {values}"


def _format(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:,.6g}" if isinstance(value, int | float) else str(value)
