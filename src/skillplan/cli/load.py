"""Loading of the inputs that options name: task files, results, back ends and caches.

Imports are inside functions, so that the help of a command is instant.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skillplan.cli.options.shared import BackEnds, Caching, PartReading, Reading, ResultReading
from skillplan.cli.options.values import parse_options, split_names
from skillplan.cli.writing import tell
from skillplan.errors import OptionError, name_hint

if TYPE_CHECKING:
    from skillplan.checks.verdict_cache import DiskVerdictCache
    from skillplan.domains.load import Problem
    from skillplan.pipeline.restoration import LoadedResult
    from skillplan.pipeline.setup import Setup
    from skillplan.records.certificate import Certificate
    from skillplan.task.back_end import BackEnd
    from skillplan.task.task import Task

# Time limit of the verification before a page or picture [s]; `verify` has a limit of its own.
_VERIFICATION_S = 10.0


def load_file(
    path: str, reading: Reading, back_ends: BackEnds | None = None, *, warn: bool = True
) -> Problem:
    """Load a task file.

    Parameters
    ----------
    path
        The file.
    reading
        Changes of the file.
    back_ends
        Back ends that are checked with the file if the command line names them.
    warn
        True if to print the warnings of the file on stderr.

    Raises
    ------
    TaskError
        With all faults of the file.
    OptionError
        If an entry of ``--set`` has another form.
    """
    from skillplan.pipeline import setup

    if isinstance(reading, ResultReading):
        reading.refuse_task_file(path, "a task file")
    named = None if back_ends is None else name_back_ends(back_ends)
    problem = setup.load_problem(path, named, reading.settings())
    if warn:
        print_warnings(problem)
    return problem


def print_warnings(problem: Problem) -> None:
    """Print the warnings about a task file on stderr."""
    for warning in problem.warnings:
        tell(f"skillplan: warning: {warning}")


def load_part(
    path: str,
    reading: PartReading,
    back_ends: BackEnds,
    *,
    screening: bool = False,
    executor: str = "local",
    with_chart: bool = True,
) -> tuple[Task, Setup, list[BackEnd]]:
    """Load a task file; return the task that is meant, its setup, and its back ends.

    Parameters
    ----------
    path
        The file.
    reading
        Changes of the file, and the task that is meant.
    back_ends, screening, executor, with_chart
        As in `make_setup`.

    Raises
    ------
    TaskError
        With all faults of the file.
    OptionError
        If the file holds several tasks and none is named, or a back end refuses the task.
    PluginError, BackEndError
        If a back end is unknown or broken, or fails to start.
    """
    problem = load_file(path, reading, back_ends)
    task = problem.part(reading.part)
    setup = make_setup(
        back_ends, task, screening=screening, executor=executor, with_chart=with_chart
    )
    return task, setup, setup.back_ends(task, problem.spare_back_ends)


def name_back_ends(back_ends: BackEnds) -> dict[str, list[str]]:
    """Return the names of the back ends that the command line chooses, by kind."""
    from skillplan.pipeline.setup import resolve_engine

    given = {"physics": back_ends.physics, "collision": back_ends.collision}
    named = {kind: split_names(names) for kind, names in given.items() if names is not None}
    if "physics" in named:
        named["physics"] = [resolve_engine(name) for name in named["physics"]]
    return named


def make_setup(
    back_ends: BackEnds,
    task: Task,
    solvers: Collection[str] = (),
    *,
    screening: bool = False,
    executor: str = "local",
    with_chart: bool = True,
) -> Setup:
    """Return the setup for a task.

    Parameters
    ----------
    back_ends
        Back ends and options of the command line.
    task
        The task, whose file may choose back ends, too.
    solvers
        Names of the solvers that take part. Options of a single one need not name it.
    screening
        True if geometry is checked before anything is executed.
    executor
        Executor of the jobs, as ``NAME`` or ``NAME:ADDRESS``.
    with_chart
        True if a chart of the file is checked although no option names it.

    Raises
    ------
    OptionError
        If an option has a wrong form or names a plugin that takes no part.
    PluginError
        If the executor is unknown or broken.
    """
    from skillplan.pipeline.setup import Setup
    from skillplan.workers.executor import ExecutorChoice

    if back_ends.physics is not None and not back_ends.physics.strip():
        raise OptionError("--physics names no engine.")
    detectors = tuple(split_names(back_ends.collision or ""))
    if back_ends.collision is not None and not detectors:
        raise OptionError("--collision names no detector.")
    parsed = parse_options(back_ends.options, next(iter(solvers)) if len(solvers) == 1 else None)
    place = ExecutorChoice.read(executor, parsed)
    parsed.pop(place.name, None)
    setup = Setup(back_ends.physics, detectors, parsed, screening, place, with_chart)
    if setup.make_executor is not None:
        # Refuses an executor that is unknown or has wrong options.
        setup.make_executor(1)
    taking_part = [
        *solvers,
        setup.physics_choice(task).name,
        *(choice.name for choice in setup.collision_choices(task)),
    ]
    for plugin in parsed:
        if plugin not in taking_part:
            hint = name_hint(plugin, taking_part)
            raise OptionError(f"No plugin {plugin!r} takes part in this run. {hint}")
    return setup


def open_cache(caching: Caching) -> DiskVerdictCache | None:
    """Return the cache of verdicts on disk, or None if it is not to be used."""
    from skillplan.pipeline.solving import open_warm_cache

    return None if caching.no_cache else open_warm_cache()


def load_result(
    path: str,
    reading: PartReading,
    back_ends: BackEnds,
    *,
    solver: str | None = None,
    task_file: str | None = None,
    changed_task: bool = False,
    executor: str = "local",
) -> LoadedResult:
    """Load a result with its task, by its origin and the command line.

    Parameters
    ----------
    path
        A result.json of search-optimal, or its folder.
    reading, back_ends
        Options that override the origin of the result. ``--set`` makes another task of it.
    solver
        Solver of the options without a plugin's name; None for none.
    task_file
        The task file; None for the file of `reading`, or that the result names.
    changed_task
        True if the task may differ from the task that was solved.
    executor
        Executor of the jobs, as ``NAME`` or ``NAME:ADDRESS``.

    Raises
    ------
    OptionError
        If the result cannot be used, or an option is wrong.
    """
    from skillplan.pipeline import restoration
    from skillplan.pipeline.restoration import Override
    from skillplan.workers.executor import ExecutorChoice

    options = parse_options(back_ends.options, solver)
    place = ExecutorChoice.read(executor, options)
    options.pop(place.name, None)
    if task_file is None and isinstance(reading, ResultReading):
        task_file = reading.task_file
    override = Override(
        task_file,
        reading.part,
        reading.settings(),
        back_ends.physics,
        tuple(split_names(back_ends.collision or "")),
        options,
    )
    changed = changed_task or bool(reading.changes)
    loaded = restoration.load_result(path, override, changed_task=changed)
    if loaded.times_note:
        tell(f"skillplan: warning: {path}: does not count {loaded.times_note}.")
    chosen = replace(
        back_ends,
        physics=back_ends.physics or loaded.origin.physics,
        collision=back_ends.collision or ",".join(loaded.origin.collision) or None,
    )
    # Refuses options of plugins that take no part.
    solvers = () if solver is None else (solver,)
    make_setup(chosen, loaded.problem.tasks[-1], solvers, executor=executor)
    return replace(loaded, setup=replace(loaded.setup, executor=place))


def verify_before_showing(
    path: str, task_file: str | None, time_limit_s: float | None
) -> Certificate:
    """Verify a result before its claims are shown, with verdicts kept on disk.

    Parameters
    ----------
    path
        A result.json of search-optimal, or its folder.
    task_file
        The task file; None for the file that the result names.
    time_limit_s
        Time limit of the command [s]; None for none. The verification takes 10 s at most.

    Raises
    ------
    OptionError
        If a claim fails.
    """
    from skillplan.cli.waiting import stoppable
    from skillplan.pipeline.certification import certify
    from skillplan.pipeline.solving import open_warm_cache

    limit_s = min(_VERIFICATION_S, time_limit_s or _VERIFICATION_S)
    with stoppable(limit_s, label="verifying") as stop:
        certificate = certify(path, task_file, stop=stop, cache=open_warm_cache())
    if certificate.refuted:
        claim = certificate.refuted[0]
        raise OptionError(
            f"{path}: is not shown, as it is refuted: {claim.claim}: {claim.detail}. "
            f"`skillplan verify {path}` checks all claims."
        )
    return certificate


def load_cad_command(name: str, command: str) -> Callable[..., Any]:
    """Return a function of skillplan-cad.

    Parameters
    ----------
    name
        Its entry point.
    command
        The command that calls it, for messages.

    Raises
    ------
    PluginError
        If the plugin is absent or broken.
    """
    from skillplan.errors import PluginError
    from skillplan.plugins.blame import ends_program
    from skillplan.plugins.installed import importers

    registered = [importer for importer in importers() if importer.name == name]
    if not registered:
        raise PluginError(
            f"{command} is a command of the plugin skillplan-cad, which is not installed: "
            "pip install 'skillplan[cad]', or in a checkout "
            "pip install -c constraints.txt -e plugins/skillplan-cad."
        )
    if len(registered) > 1:
        owners = " and ".join(
            sorted({entry.dist.name for entry in registered if entry.dist is not None})
        )
        raise PluginError(f"{command} is provided by {owners}. Uninstall one of them.")
    try:
        loaded: Callable[..., Any] = registered[0].load()
    except BaseException as error:
        if ends_program(error):
            raise
        raise PluginError(
            f"{command} cannot be imported ({registered[0].value}): {type(error).__name__}: "
            f"{error}. Install skillplan-cad anew."
        ) from error
    return loaded
