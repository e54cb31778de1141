"""``skillplan compare --engines`` and ``--detectors``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from time import monotonic

from skillplan.checks.feasibility import Feasibility
from skillplan.cli.interruption import counting
from skillplan.cli.load import load_file, make_setup
from skillplan.cli.options.shared import BackEnds, Reading
from skillplan.cli.options.values import split_names
from skillplan.cli.output import emit
from skillplan.cli.showing import PICTURE, draw
from skillplan.errors import OptionError, exit_code
from skillplan.files.output_path import check_output_folder
from skillplan.physics.performance import Performer
from skillplan.pipeline.performing import find_contact_detectors
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_feasibility
from skillplan.records.execution.comparisons import make_agreement_document, make_detectors_document
from skillplan.task.task import Task
from skillplan.trials.detector_trials import try_detectors
from skillplan.trials.engine_agreement import EngineAgreement, compare_engines
from skillplan.views.tables.trials import tabulate_agreement, tabulate_detectors

# Queries per process and batch.
_AT_ONCE = 8


def compare_physics(
    path: str,
    engines: str,
    back_ends: BackEnds,
    reading: Reading,
    *,
    jobs: int,
    executor: str,
    pictures: str | None,
    time_limit_s: float | None,
    style: str,
) -> int:
    """Compare engines on a task, print where they differ, and return the exit code.

    Parameters
    ----------
    engines
        Names of the engines, separated by commas.
    back_ends
        Further back ends of every engine. Default: detectors that read its contacts.
    jobs, executor
        Number of processes, and their executor.
    pictures
        Folder for pictures of contradictions, if any.
    time_limit_s
        Time limit of the comparison [s]; it keeps the results so far.

    Raises
    ------
    OptionError
        If there are not two engines, an engine refuses the task, or the task has no bodies.
    """
    names = split_names(engines)
    if len(names) < 2:
        raise OptionError("--engines needs two engines at least, such as pybullet,mujoco.")
    folder = None if pictures is None else check_output_folder("--pictures", pictures)
    task = load_file(path, reading, replace(back_ends, physics=engines)).tasks[-1]
    if not task.scene.bodies:
        raise OptionError(f"{task.name!r} has no bodies: there is nothing to simulate.")
    begin_s = monotonic()
    with ExitStack() as open_ones, counting("questions", None) as count:

        def stopped() -> bool:
            late = time_limit_s is not None and monotonic() - begin_s > time_limit_s
            return count.interrupted or late

        checks: dict[str, Feasibility] = {}
        for name in names:
            setup = _make_engine_setup(name, names, back_ends, task, executor)
            checks[name] = open_ones.enter_context(
                closing(make_feasibility(task, setup, jobs=jobs))
            )
        agreement = compare_engines(
            task,
            checks,
            at_once=1 if jobs == 1 else _AT_ONCE * jobs,
            note=count.one_more,
            stopped=stopped,
        )
    drawn = [] if folder is None else _draw_contradictions(agreement, checks, folder)
    emit(style, make_agreement_document(agreement, drawn), tabulate_agreement(agreement, drawn))
    return exit_code(interrupted=count.interrupted)


def _make_engine_setup(
    engine: str, engines: Sequence[str], back_ends: BackEnds, task: Task, executor: str
) -> Setup:
    """Return the setup of one engine, without the options of the others."""
    others = tuple(f"{name}." for name in engines if name != engine)
    options = [entry for entry in back_ends.options if not entry.startswith(others)]
    collision = back_ends.collision
    if collision is None:
        chosen = [choice.name for choice in task.collision]
        collision = ",".join(find_contact_detectors(engine, chosen)) or None
    own = replace(back_ends, physics=engine, collision=collision, options=options)
    return make_setup(own, task, executor=executor, with_chart=False)


def _draw_contradictions(
    agreement: EngineAgreement, checks: dict[str, Feasibility], folder: Path
) -> list[dict[str, str]]:
    """Draw every contradiction by every engine that draws; return the files by engine."""
    folder.mkdir(exist_ok=True)
    pictures = []
    for number, contradiction in enumerate(agreement.contradictions, start=1):
        files = {}
        for name, feasibility in checks.items():
            drawer = next((b for b in feasibility.back_ends if isinstance(b, Performer)), None)
            if drawer is None:
                continue
            taken = feasibility.taken(contradiction.skill, contradiction.state)
            path = folder / f"{number:03d}-{name}.png"
            files[name] = draw(drawer, taken, contradiction.state, {PICTURE: path})["picture"]
        pictures.append(files)
    return pictures


def compare_detectors(
    path: str,
    back_ends: BackEnds,
    reading: Reading,
    *,
    staged: int,
    time_limit_s: float | None,
    style: str,
) -> int:
    """Compare detectors on a task, print the errors of each, and return the exit code.

    Parameters
    ----------
    back_ends
        Contains the names of the detectors.
    staged
        Largest number of injected collisions, >= 0.
    time_limit_s
        Time limit of the comparison [s]; it keeps the results so far.

    Raises
    ------
    OptionError
        If no detector is named, or the task has no bodies.
    """
    if not split_names(back_ends.collision or ""):
        raise OptionError("--detectors names no detector.")
    task = load_file(path, reading, back_ends).tasks[-1]
    setup = make_setup(back_ends, task, with_chart=False)
    if not task.scene.bodies:
        raise OptionError(f"{task.name!r} has no bodies: there is nothing to collide.")
    begin_s = time.monotonic()
    with counting("trials", None) as count:

        def stopped() -> bool:
            late = time_limit_s is not None and time.monotonic() - begin_s > time_limit_s
            return count.interrupted or late

        trials = try_detectors(task, setup.back_ends, staged, note=count.one_more, stopped=stopped)
    document = make_detectors_document(trials, time.monotonic() - begin_s)
    emit(style, document, tabulate_detectors(trials))
    return exit_code(interrupted=count.interrupted)
