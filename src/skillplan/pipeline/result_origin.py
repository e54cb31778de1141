"""Where the task of a stored result is, and how it is loaded again."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from skillplan.domains.load import Problem
from skillplan.errors import OptionError, TaskError
from skillplan.files.regular_file import is_regular
from skillplan.pipeline.received_task import is_near, unquoted
from skillplan.pipeline.setup import BOXES, CHART, SCREEN, Setup, load_problem
from skillplan.records.origin import Origin
from skillplan.records.stored.result_file import StoredResult, other_task
from skillplan.records.stored.result_folder import result_path
from skillplan.task.task import Task


def origin_problem(
    path: str, stored: StoredResult, origin: Origin, *, named: bool
) -> tuple[Problem, str | None]:
    """Load the task of a result; return it, and in words how it is another than was solved.

    Parameters
    ----------
    path
        Of the result.
    stored
        What it says.
    origin
        How its task is loaded.
    named
        Whether the user named the task file; of others nothing is told that they hold, unless
        they lie near.

    Raises
    ------
    OptionError
        If the file is far off, another task, and not named by the user.
    TaskError
        If the task file is wrong.
    """
    queried, former = named_back_ends(origin), stored.dwells_from is None
    with nullcontext() if named else unquoted(path, origin.file):
        problem = load_problem(origin.file, queried, origin.changes, former=former)
    told = named or is_near(origin.file, result_path(path).parent)
    difference = other_task(stored, problem, quoted=told)
    if difference is not None and former:
        was_solved = _with_former_defaults(stored, origin, problem)
        if was_solved is not None:
            return was_solved, None
    if difference is None or told:
        return problem, difference
    before = {} if stored.origin is None else stored.origin.changes
    if before != origin.changes:
        # The user changes something; what counts is whether the file is the one that was solved.
        with unquoted(path, origin.file):
            was = load_problem(origin.file, queried, before, former=former)
        if other_task(stored, was) is None:
            return problem, difference
    raise OptionError(f"{path}: is of another task: {difference}. Name its own by --task.")


def _with_former_defaults(stored: StoredResult, origin: Origin, problem: Problem) -> Problem | None:
    """Return a file's task with the defaults of earlier versions; None if that is another task.

    Equal hashes show that it is the task that was solved, so nothing else is taken for it.
    """
    changes = {**problem.domain.former_defaults, **origin.changes}
    if changes == origin.changes:
        return None
    try:
        former = load_problem(origin.file, named_back_ends(origin), changes, former=True)
    except TaskError:
        # The file gives a key that excludes the default, which did not count then.
        return None
    return former if other_task(stored, former) is None else None


def found_origin(path: str, stored: StoredResult, task_file: str | None) -> Origin:
    """Return how to load a result's task; by the names of its back ends where no more is known.

    Parameters
    ----------
    path
        Of the result, beside which the task file is looked for.
    stored
        What it says.
    task_file
        The task file, if it is not to be looked for.

    Raises
    ------
    OptionError
        If the task file is not said, or not found.
    """
    if stored.origin is not None:
        origin = stored.origin.origin()
    elif task_file is None:
        raise OptionError(f"{path}: does not say which file its task is from. Name it by --task.")
    else:
        part = None if stored.is_chain else stored.task.name
        collision = tuple(filter(None, stored.collision.split(",")))
        origin = Origin(task_file, part, {}, stored.physics, collision)
    if task_file is not None:
        return replace(origin, file=task_file)
    folder = result_path(path).parent
    for candidate in (Path(origin.file), folder / origin.file, folder / Path(origin.file).name):
        if is_regular(candidate):
            return replace(origin, file=str(candidate))
    raise OptionError(
        f"{path}: its task {origin.file} is neither here nor beside it. Name it by --task."
    )


def restored_setup(origin: Origin, collision: str, task: Task) -> Setup:
    """Return the setup under which a stored result was made.

    A result whose origin names no detectors was made under the defaults of its version, which may
    not be those of this one. Its `collision` key says which they were: older versions checked a
    chart alone by default, or no chart if the task file chose a detector.

    Parameters
    ----------
    origin
        How its task was read.
    collision
        Names of the detectors that it claims, with commas.
    task
        The task, or one of the chain.
    """
    setup = Setup(origin.physics, origin.collision, origin.options, origin.screening)
    candidates = [setup, replace(setup, with_chart=False)]
    if not origin.collision and not task.collision:
        names = tuple(filter(None, collision.split(",")))
        if task.chart:
            candidates.append(replace(setup, collision=(CHART,)))
        if set(names) <= {CHART, SCREEN, BOXES} and CHART not in names[:1]:
            candidates.append(replace(setup, collision=names, with_chart=False))
    for candidate in candidates:
        if candidate.detector_names(task) == collision:
            return candidate
    return setup


def named_back_ends(origin: Origin) -> Mapping[str, list[str]]:
    """Return the names of the back ends that an origin chooses, by kind."""
    named = {"physics": [] if origin.physics is None else [origin.physics]}
    named["collision"] = list(origin.collision)
    return {kind: names for kind, names in named.items() if names}
