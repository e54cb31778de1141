"""Situations of trainings: one that is quick, done, cut off and gone on with."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from skillplan.domains import Problem
from skillplan.pipeline import Setup, load_problem
from skillplan.records import TrainingResult
from skillplan.training import Trainer, TrainingFolder, TrainingPlan, plan_training
from skillplan.workers import ExecutorChoice

BOARD = Path(__file__).parents[2] / "configs" / "inverter_board.yaml"
# What a clock decides, and files that hold nothing else.
_TIMED = ("progress.json", "result.json", "manifest.json")


def a_plan(problem: Problem, options: Mapping[str, Any] | None = None, **more: Any) -> TrainingPlan:
    """Return the plan of a quick training: seven runs, in two groups."""
    executor = more.pop("executor", ExecutorChoice())
    queries = {"runs": 7, "steps": 400, "checkpoint_steps": 200, **more}
    setup = Setup(options={"tabular": options or {}}, executor=executor)
    return plan_training(problem, "tabular", setup, **queries)


def train(
    folder: Path,
    options: Mapping[str, Any] | None = None,
    *,
    jobs: int = 1,
    stop_after: int | None = None,
    delay_s: float | None = None,
    resume: bool = False,
    source: Path = BOARD,
    **more: Any,
) -> TrainingResult:
    """Train on the board; stop after so many reports, at once or after a while."""
    problem = load_problem(source)
    plan = a_plan(problem, options, **more)
    with TrainingFolder(str(folder), plan, problem, resume=resume) as opened:
        trainer = Trainer(opened.plan, opened, jobs=jobs, time_limit_s=30.0)
        seen = []

        def on_report(report: object) -> None:
            seen.append(report)
            if len(seen) == stop_after and delay_s is None:
                trainer.interrupt()
            elif len(seen) == stop_after and delay_s is not None:
                threading.Timer(delay_s, trainer.interrupt).start()

        trainer.on_report = on_report
        return trainer.train()


def learned_bytes(
    folder: Path, keep: Callable[[str], bool] = lambda name: True
) -> dict[str, bytes]:
    """Return the content of all files in which no clock stands, by path."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
        and path.name not in _TIMED
        and "tfevents" not in path.name
        and keep(path.name)
    }


def counts(folder: Path) -> list[dict[str, Any]]:
    """Return what was counted in every group: progress without steps and times."""
    return [
        {
            name: value
            for name, value in json.loads(path.read_text()).items()
            if name in ("checks", "hits", "executions", "asked")
        }
        for path in sorted(folder.glob("groups/*/progress.json"))
    ]


def event_lengths(folder: Path) -> dict[str, int]:
    """Return how long the event files are: their bytes hold the time of day."""
    events = sorted(folder.rglob("events.*"))
    return {str(path.relative_to(folder)): path.stat().st_size for path in events}
