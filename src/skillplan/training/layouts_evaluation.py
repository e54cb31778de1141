"""Learned policies on layouts of a family that they have not seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.pipeline.run import make_model
from skillplan.pipeline.setup import Setup
from skillplan.records.training.layouts_result import LayoutOutcome
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task
from skillplan.training.policy_roll_out import prove_optimum
from skillplan.training.runs_evaluation import RunsEvaluation


def unseen_layouts(evaluation: RunsEvaluation, problem: Problem, count: int) -> tuple[Task, ...]:
    """Return layouts of a file's family that no run of a folder has learned on.

    They are drawn like those that were learned on, and come after them.

    Parameters
    ----------
    evaluation
        Of the runs.
    problem
        The task file.
    count
        How many, >= 1.

    Raises
    ------
    OptionError
        If the file describes no family.
    """
    family = evaluation.folder.manifest.family
    seed, seen = (0, 0) if family is None else (family.seed, family.count)
    return problem.variants(seed, seen + count)[seen:]


def layout_outcomes(
    evaluation: RunsEvaluation,
    layouts: tuple[Task, ...],
    setup: Setup,
    make_stop: Callable[[], Stop],
    *,
    jobs: int = 1,
) -> Iterator[LayoutOutcome]:
    """Yield what the policies do on every layout, and what exact search does, both from scratch.

    Parameters
    ----------
    evaluation
        Of the runs.
    layouts
        As `unseen_layouts` gives them.
    setup
        Back ends.
    make_stop
        Returns when to give up proving the optimum of a layout.
    jobs
        In how many processes expensive back ends check.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    for task in layouts:
        optimum = prove_optimum(task, setup, VerdictCache(), make_stop(), jobs=jobs)
        answers, times_s = [], []
        for policy in evaluation.policies():
            # Each policy starts as exact search does: with a model that has checked nothing yet.
            begin_s = time.perf_counter()
            model = make_model(task, setup, VerdictCache(), jobs=jobs)
            with closing(model.feasibility):
                answers.append(evaluation.greedy(model, policy))
            times_s.append(time.perf_counter() - begin_s)
        yield LayoutOutcome(task.name, optimum, tuple(answers), tuple(times_s))
