"""``skillplan cache``: show, verify, fill and clear the verdicts kept on disk."""

from __future__ import annotations

import sys

import click

from skillplan.cli.command_group import CommandGroup
from skillplan.cli.options import (
    TaskPath,
    asked,
    back_end_options,
    format_option,
    jobs_option,
    make_setup,
    no_cache_option,
    part_option,
    seed_option,
    set_option,
    settings,
    task_argument,
)


@click.group("cache", cls=CommandGroup)
def command() -> None:
    """Show, verify, fill and clear the verdicts kept on disk.

    Verdicts of dear back ends, such as physics, are kept between runs: each in a file of its
    own, in the folder SKILLPLAN_CACHE_DIR or else the user's cache. What could change an answer
    is part of where it is kept, so that nothing stale is ever used.
    """


@command.command("show", short_help="Show what is kept, by back end and task.")
@click.argument("task", type=TaskPath(), required=False)
@back_end_options
@set_option
@part_option
@format_option
def show(
    task: str | None,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    style: str,
) -> int:
    """Show what is kept by back end and task; of TASK only what it would use now."""
    import time

    from skillplan.checks.verdict_folder import VerdictFolder
    from skillplan.cli.output import emit
    from skillplan.errors import OptionError
    from skillplan.pipeline.run import make_feasibility, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.cache import CacheSurvey
    from skillplan.views.tables.cache import survey_table

    root = warm_cache().folder
    folder = VerdictFolder(root)
    if task is None:
        if physics or collision or options or changes or part:
            raise OptionError("Back ends, --set and --part choose what a TASK would use: name it.")
        kept, others = folder.survey()
        survey = CacheSurvey(root, kept, time.time(), len(others))
    else:
        loaded = load_problem(task, asked(physics, collision), settings(changes)).part(part)
        setup = make_setup(physics, collision, options)(loaded)
        feasibility = make_feasibility(loaded, setup)
        found = folder.kept_for(feasibility.back_ends)
        every = [one for own in found for one in own]
        survey = CacheSurvey(root, every, time.time(), task=loaded)
    emit(style, survey.document(), [survey_table(survey)])
    return 0


@command.command("verify", short_help="Ask anew for a sample and compare bit for bit.")
@task_argument
@back_end_options
@set_option
@part_option
@click.option(
    "--sample",
    type=click.IntRange(1, 1_000_000),
    default=10,
    show_default=True,
    metavar="N",
    help="How many verdicts are asked anew.",
)
@seed_option
@jobs_option
@format_option
def verify(
    task: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    sample: int,
    seed: int,
    jobs: int,
    style: str,
) -> int:
    """Ask fresh back ends for a random sample of the verdicts that TASK would use.

    Compares status, reason, facts and evidence bit for bit. What differs is dropped, and the
    exit code is 3.
    """
    from skillplan.checks.verdict_folder import VerdictFolder
    from skillplan.checks.verification import draw, put_to_the_test
    from skillplan.cli.counting import counting
    from skillplan.cli.output import emit
    from skillplan.errors import EXIT_BACK_END, EXIT_INTERRUPTED, EXIT_SOLVED
    from skillplan.pipeline.run import make_feasibility, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.cache import CacheTest
    from skillplan.views.tables.cache import cache_test_table

    loaded = load_problem(task, asked(physics, collision), settings(changes)).part(part)
    setup = make_setup(physics, collision, options)(loaded)
    feasibility = make_feasibility(loaded, setup)
    folder = VerdictFolder(warm_cache().folder)
    kept = folder.kept_for(feasibility.back_ends)
    drawn = draw(kept, sample, seed)
    with counting("verifying", len(drawn)) as count:
        trials = put_to_the_test(
            feasibility,
            drawn,
            jobs=jobs,
            stopped=lambda: count.interrupted,
            on_trial=count.one_more,
        )
    dropped = sum(folder.drop(trial.kept) for trial in trials if not trial.same)
    every = sum(map(len, kept))
    test = CacheTest(loaded, every, trials, seed, len(trials) < len(drawn), dropped)
    emit(style, test.document(), [cache_test_table(test)], failed=bool(test.different))
    if test.different:
        return EXIT_BACK_END
    return EXIT_INTERRUPTED if test.interrupted else EXIT_SOLVED


@command.command("fill", short_help="Ask about everything, so that runs start warm.")
@task_argument
@back_end_options
@set_option
@part_option
@jobs_option
@no_cache_option
@format_option
def fill(
    task: str,
    physics: str | None,
    collision: str | None,
    options: tuple[str, ...],
    changes: tuple[str, ...],
    part: str | None,
    jobs: int,
    no_cache: bool,
    style: str,
) -> int:
    """Ask about every skill in every state of TASK that can be reached, so that runs start warm.

    Says how many executions that took, and how many it would have been with verdicts kept by
    state and skill. Ctrl-C keeps what was decided.
    """
    import time
    from contextlib import closing

    from skillplan.cli.interruption import heeding
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import showing_checks
    from skillplan.errors import EXIT_INTERRUPTED, EXIT_SOLVED
    from skillplan.model.enumeration import enumerate_feasibility
    from skillplan.pipeline.run import make_feasibility, warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.cache import CacheFilling
    from skillplan.views.tables.cache import filling_table

    loaded = load_problem(task, asked(physics, collision), settings(changes)).part(part)
    setup = make_setup(physics, collision, options)(loaded)
    cache = None if no_cache else warm_cache()
    requests: list[bool] = []
    begin_s = time.perf_counter()
    with (
        showing_checks("filling") as on_check,
        heeding(lambda: requests.append(True)),
        closing(make_feasibility(loaded, setup, cache, jobs=jobs, on_check=on_check)) as asking,
    ):
        counts = enumerate_feasibility(asking, lambda: bool(requests))
    names = [back_end.name for back_end in asking.back_ends]
    kept = any(back_end.dear for back_end in asking.back_ends)
    folder = cache.folder if cache is not None and kept else None
    filling = CacheFilling(loaded, names, counts, time.perf_counter() - begin_s, folder)
    emit(style, filling.document(), [filling_table(filling)], failed=not counts.complete)
    return EXIT_SOLVED if counts.complete else EXIT_INTERRUPTED


@command.command("clear", short_help="Remove all, or what was kept for one task.")
@click.argument("task", type=TaskPath(), required=False)
@click.option("--yes", is_flag=True, help="Do not ask.")
@format_option
def clear(task: str | None, yes: bool, style: str) -> int:
    """Remove all that is kept, or all verdicts that were made for TASK, by its name.

    Asks first where there is a terminal. Files that are not the cache's own stay.
    """
    from skillplan.checks.verdict_folder import VerdictFolder
    from skillplan.cli.output import emit
    from skillplan.errors import OptionError
    from skillplan.pipeline.run import warm_cache
    from skillplan.pipeline.setup import load_problem
    from skillplan.records.cache import clearing_document
    from skillplan.views.tables.cache import clearing_table

    problem = None if task is None else load_problem(task)
    root = warm_cache().folder
    what = "everything" if problem is None else f"what was kept for {problem.name}"
    if not yes and sys.stdin.isatty():
        click.confirm(f"Remove {what} in {root}?", abort=True, err=True)
    try:
        names = None if problem is None else {one.name for one in problem.tasks}
        removed = VerdictFolder(root).clear(names)
    except OSError as error:
        raise OptionError(f"{root} cannot be cleared: {error.strerror}.") from None
    name = None if problem is None else problem.name
    emit(style, clearing_document(root, name, removed), [clearing_table(root, name, removed)])
    return 0
