"""``skillplan cache``: show, verify, fill and clear the verdicts kept on disk."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from skillplan.cli.load import load_part, open_cache
from skillplan.cli.options import shared
from skillplan.cli.options.values import count_option, option
from skillplan.cli.writing import tell

HELP = """Show, verify, fill and clear the verdicts kept on disk.

Verdicts of expensive back ends, such as physics, are kept between runs: each in a file of its
own, in the folder SKILLPLAN_CACHE_DIR or else the user's cache. What could change an answer is
part of where it is kept, so that nothing stale is ever used.
"""


def show(
    back_ends: shared.BackEnds,
    reading: shared.PartReading,
    task: shared.MaybeTaskFile = None,
    style: shared.Style = "table",
) -> int:
    """Show the kept verdicts by back end and task; with TASK only the verdicts for its use."""
    import time

    from skillplan.checks.single_check import introduce_back_ends
    from skillplan.checks.verdict_files import VerdictFolder
    from skillplan.cli.output import emit
    from skillplan.errors import OptionError
    from skillplan.pipeline.solving import open_warm_cache
    from skillplan.records.cache import CacheSurvey
    from skillplan.views.tables.installation import tabulate_survey

    root = open_warm_cache().folder
    folder = VerdictFolder(root)
    if task is None:
        if back_ends != shared.BackEnds() or reading != shared.PartReading():
            raise OptionError("Back ends, --set and --part choose what a TASK would use: name it.")
        kept, others = folder.survey()
        survey = CacheSurvey(root, kept, time.time(), len(others))
    else:
        loaded, _, constructed = load_part(task, reading, back_ends)
        kept_for = folder.kept_for(introduce_back_ends(constructed))
        every = [verdict for own in kept_for for verdict in own]
        survey = CacheSurvey(root, every, time.time(), task=loaded)
    emit(style, survey.document(), [tabulate_survey(survey)])
    return 0


def verify(
    task: shared.TaskFile,
    back_ends: shared.BackEnds,
    reading: shared.PartReading,
    workers: shared.Workers,
    sample: Annotated[
        int,
        count_option("--sample", minimum=1, maximum=1_000_000, text="Number of verdicts to check."),
    ] = 10,
    elsewhere: Annotated[
        bool,
        typer.Option(
            "--elsewhere",
            help="Check the verdicts in other reachable states to which they claim to apply.",
        ),
    ] = False,
    seed: shared.Seed = 0,
    style: shared.Style = "table",
) -> int:
    """Check a random sample of the verdicts that TASK would use again, with fresh back ends.

    Compares status, reason, facts and evidence bit for bit. Different verdicts are removed, and the
    exit code is 3. With --elsewhere a verdict that does not hold in another state proves that the
    back end names too few facts, and the missing fact is shown.
    """
    from skillplan.checks.audit import (
        choose_other_states,
        draw_kept,
        explain_first_difference,
        recheck_kept,
        sample_reachable_states,
    )
    from skillplan.checks.verdict_files import VerdictFolder
    from skillplan.cli.interruption import counting
    from skillplan.cli.output import emit
    from skillplan.errors import exit_code
    from skillplan.pipeline.solving import make_feasibility, open_warm_cache
    from skillplan.records.cache import CacheTest
    from skillplan.views.tables.installation import tabulate_cache_test

    loaded, setup, constructed = load_part(task, reading, back_ends, executor=workers.executor)
    feasibility = make_feasibility(loaded, setup, back_ends=constructed)
    folder = VerdictFolder(open_warm_cache().folder)
    kept = folder.kept_for(feasibility.back_ends)
    drawn = draw_kept(kept, sample, seed)
    chosen, states = drawn, None
    with counting("verifying", len(drawn)) as count:
        if elsewhere:
            known = make_feasibility(loaded, setup, open_warm_cache(), back_ends=constructed)
            checked = sample_reachable_states(known, seed, stopped=lambda: count.interrupted)
            chosen, states = choose_other_states(loaded, drawn, checked, seed)
        trials = recheck_kept(
            feasibility,
            chosen,
            elsewhere=states,
            jobs=workers.jobs,
            stopped=lambda: count.interrupted,
            on_trial=count.one_more,
        )
    dropped = sum(folder.drop(trial.kept) for trial in trials if not trial.same)
    if elsewhere and not all(trial.same for trial in trials):
        raise explain_first_difference(feasibility.back_ends, trials)
    every = sum(map(len, kept))
    test = CacheTest(
        loaded,
        every,
        trials,
        seed,
        len(trials) < len(chosen),
        dropped,
        elsewhere,
        len(drawn) - len(chosen),
    )
    emit(style, test.document(), [tabulate_cache_test(test)], failed=bool(test.different))
    different = bool(test.different)
    # A back end that answers otherwise than it did counts more than an early end of the search
    # for one: it is known then, and the interruption did not hide it.
    return exit_code(back_end_failed=different, interrupted=test.interrupted and not different)


def fill(
    task: shared.TaskFile,
    back_ends: shared.BackEnds,
    reading: shared.PartReading,
    checking: shared.Checking,
    style: shared.Style = "table",
) -> int:
    """Check every skill in every reachable state of TASK, so that runs start warm.

    Shows the number of executions, and the number without reuse of verdicts in other states.
    Ctrl-C keeps the verdicts so far.
    """
    import time
    from contextlib import closing

    from skillplan.cli.interruption import handle_signals
    from skillplan.cli.output import emit
    from skillplan.cli.waiting import show_checks
    from skillplan.errors import exit_code
    from skillplan.model.enumeration import enumerate_feasibility
    from skillplan.pipeline.solving import make_feasibility
    from skillplan.records.cache import CacheFilling
    from skillplan.views.tables.installation import tabulate_filling

    loaded, setup, constructed = load_part(task, reading, back_ends, executor=checking.executor)
    cache = open_cache(checking)
    requests: list[bool] = []
    begin_s = time.perf_counter()
    with (
        show_checks("filling") as on_check,
        handle_signals(lambda: requests.append(True)),
        closing(
            make_feasibility(
                loaded, setup, cache, jobs=checking.jobs, on_check=on_check, back_ends=constructed
            )
        ) as checks,
    ):
        counts = enumerate_feasibility(checks, lambda: bool(requests))
    names = [back_end.name for back_end in checks.back_ends]
    kept = any(back_end.expensive for back_end in checks.back_ends)
    folder = cache.folder if cache is not None and kept else None
    filling = CacheFilling(loaded, names, counts, time.perf_counter() - begin_s, folder)
    emit(style, filling.document(), [tabulate_filling(filling)], failed=not counts.complete)
    return exit_code(interrupted=not counts.complete)


def clear(
    task: shared.MaybeTaskFile = None,
    yes: Annotated[bool, option("--yes", shared.OUTPUT, "Do not ask for confirmation.")] = False,
    style: shared.Style = "table",
) -> int:
    """Remove all kept verdicts, or only the verdicts for the task named TASK.

    Asks for confirmation on a terminal. Other files in the folder stay.
    """
    from skillplan.checks.verdict_files import VerdictFolder
    from skillplan.cli.output import emit
    from skillplan.errors import OptionError
    from skillplan.pipeline.setup import load_problem
    from skillplan.pipeline.solving import open_warm_cache
    from skillplan.records.cache import make_clearing_document
    from skillplan.views.tables.installation import tabulate_clearing

    problem = None if task is None else load_problem(task)
    root = open_warm_cache().folder
    what = "everything" if problem is None else f"what was kept for {problem.name}"
    if not yes and sys.stdin.isatty():
        # Not Typer's own prompt: part of it goes to stdout, where JSON stands alone.
        tell(f"Remove {what} in {root}? [y/N]: ", end="")
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise typer.Abort
    try:
        names = None if problem is None else {verdict.name for verdict in problem.tasks}
        removed = VerdictFolder(root).clear(names)
    except OSError as error:
        raise OptionError(f"{root} cannot be cleared: {error.strerror}.") from None
    name = None if problem is None else problem.name
    emit(
        style, make_clearing_document(root, name, removed), [tabulate_clearing(root, name, removed)]
    )
    return 0


COMMANDS = {"show": show, "verify": verify, "fill": fill, "clear": clear}
