"""Options that several commands share, in groups that commands take whole."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated

import typer

from skillplan.cli.options.completion import engine_names, plugin_lists, plugin_options
from skillplan.cli.options.panels import BACK_ENDS, TASK
from skillplan.cli.options.single import ExecutorName, Jobs
from skillplan.cli.options.values import parse_options, split_names
from skillplan.cli.writing import tell
from skillplan.errors import OptionError

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.checks.verdict_cache import DiskVerdictCache
    from skillplan.domains.load import Problem
    from skillplan.pipeline.setup import Setup
    from skillplan.task.back_end import BackEnd
    from skillplan.task.task import Task


@dataclass(frozen=True, slots=True)
class Reading:
    """How a task file is read.

    Parameters
    ----------
    changes
        Entries ``KEY=VALUE``.
    """

    changes: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Read the task file as if KEY, such as base.goal_choice or parts.pcb.mass_kg, "
            "had this value. May be repeated.",
            rich_help_panel=TASK,
        ),
    ] = field(default_factory=list)

    def settings(self) -> dict[str, str]:
        """Return key path to value.

        Raises
        ------
        OptionError
            If an entry has another form.
        """
        found = {}
        for entry in self.changes:
            key, equals, value = entry.partition("=")
            if not equals or not all(key.split(".")):
                raise OptionError(f"--set {entry!r} must have the form KEY=VALUE, as base.home=C1.")
            found[key] = value
        return found

    def problem(
        self, path: str, back_ends: BackEnds | None = None, *, warn: bool = True
    ) -> Problem:
        """Return what a task file describes.

        Parameters
        ----------
        path
            Of the file.
        back_ends
            Those that are checked with the file, where the command line may choose them.
        warn
            Whether to print on stderr what in the file is valid, but hardly meant.

        Raises
        ------
        TaskError
            With every fault of the file.
        OptionError
            If an entry of ``--set`` has another form.
        """
        from skillplan.pipeline import setup

        named = None if back_ends is None else back_ends.named()
        problem = setup.load_problem(path, named, self.settings())
        if warn:
            warn_of(problem)
        return problem


@dataclass(frozen=True, slots=True)
class PartReading(Reading):
    """How a task file is read, and which task of a chain is meant.

    Parameters
    ----------
    changes
        Entries ``KEY=VALUE``.
    part
        The task's name; None for the only one.
    """

    part: Annotated[
        str | None,
        typer.Option(
            "--part",
            metavar="NAME",
            help="The task meant, of a file that describes a chain of several, such as base-1.",
            rich_help_panel=TASK,
        ),
    ] = None

    def task(self, path: str, back_ends: BackEnds | None = None) -> Task:
        """Return the task meant, of what a task file describes.

        Parameters
        ----------
        path
            Of the file.
        back_ends
            Those that are checked with the file, where the command line may choose them.

        Raises
        ------
        TaskError
            With every fault of the file.
        OptionError
            If it holds several tasks and none is named, or none of that name.
        """
        return self.problem(path, back_ends).part(self.part)

    def set_up(
        self,
        path: str,
        back_ends: BackEnds,
        *,
        screening: bool = False,
        executor: str = "local",
        with_chart: bool = True,
    ) -> tuple[Task, Setup, list[BackEnd]]:
        """Return the task meant, how it is checked, and the back ends, constructed once.

        Parameters
        ----------
        path
            Of the file.
        back_ends
            Those that the command line chooses.
        screening
            Whether geometry is asked before anything is executed.
        executor
            Where jobs are done, as ``NAME`` or ``NAME:ADDRESS``.
        with_chart
            Whether a chart of the file is checked although no option names it.

        Raises
        ------
        TaskError, OptionError
            As `task`, or if a back end refuses the task.
        PluginError, BackEndError
            If a back end is unknown or broken, or fails to start.
        """
        problem = self.problem(path, back_ends)
        task = problem.part(self.part)
        setup = back_ends.setup(task, screening=screening, executor=executor, with_chart=with_chart)
        return task, setup, setup.back_ends(task, problem.spare_back_ends)


@dataclass(frozen=True, slots=True)
class BackEnds:
    """The back ends that the command line chooses, and options of plugins.

    Parameters
    ----------
    physics
        An engine's name; None for the file's choice.
    collision
        Detectors' names with commas; None for the file's choice.
    options
        Entries ``[PLUGIN.]KEY=VALUE``.
    """

    physics: Annotated[
        str | None,
        typer.Option(
            "--physics",
            metavar="NAME",
            autocompletion=engine_names,
            help="Physics engine, or auto: pybullet where it is installed, else mujoco; default: "
            "the task file's choice, or else kinematic.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = None
    collision: Annotated[
        str | None,
        typer.Option(
            "--collision",
            metavar="NAMES",
            autocompletion=plugin_lists("collision"),
            help="Collision detectors, separated by commas; default: the task file's choice, or "
            "else swept if it is installed, or else aabb. A chart of the task file is checked in "
            "addition; precedence alone checks the chart and no geometry.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = None
    options: Annotated[
        list[str],
        typer.Option(
            "-O",
            metavar="KEY=VALUE",
            autocompletion=plugin_options,
            help="Option of the solver, or as PLUGIN.KEY=VALUE of any plugin; 'skillplan plugins "
            "KIND NAME' lists them. May be repeated.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = field(default_factory=list)

    def named(self) -> dict[str, list[str]]:
        """Return the names that the command line chooses, by kind."""
        from skillplan.pipeline.setup import engine_named

        given = {"physics": self.physics, "collision": self.collision}
        found = {kind: split_names(names) for kind, names in given.items() if names is not None}
        if "physics" in found:
            found["physics"] = [engine_named(name) for name in found["physics"]]
        return found

    def setup(
        self,
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
        task
            What the file's own choices are taken from.
        solvers
            Those that take part; of a single one options need not name it.
        screening
            Whether geometry is asked before anything is executed.
        executor
            Where jobs are done, as ``NAME`` or ``NAME:ADDRESS``.
        with_chart
            Whether a chart of the file is checked although no option names it.

        Raises
        ------
        OptionError
            If an option has a wrong form or names a plugin that takes no part.
        PluginError
            If the executor is unknown or broken.
        """
        from skillplan.errors import name_hint
        from skillplan.pipeline.setup import Setup
        from skillplan.workers.executor import ExecutorChoice

        if self.physics is not None and not self.physics.strip():
            raise OptionError("--physics names no engine.")
        detectors = tuple(split_names(self.collision or ""))
        if self.collision is not None and not detectors:
            raise OptionError("--collision names no detector.")
        parsed = parse_options(self.options, next(iter(solvers)) if len(solvers) == 1 else None)
        chosen = ExecutorChoice.read(executor, parsed)
        parsed.pop(chosen.name, None)
        setup = Setup(self.physics, detectors, parsed, screening, chosen, with_chart)
        if setup.make_executor is not None:
            setup.make_executor(1)  # one that is unknown or has wrong options is refused here
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


@dataclass(frozen=True)
class Caching:
    """Whether verdicts kept on disk are used.

    Parameters
    ----------
    no_cache
        Whether they are left alone.
    """

    no_cache: Annotated[
        bool,
        typer.Option(
            "--no-cache",
            help="Neither read nor write verdicts kept on disk.",
            rich_help_panel=BACK_ENDS,
        ),
    ] = False

    def cache(self) -> DiskVerdictCache | None:
        """Return the cache of verdicts on disk, or None where it is to be left alone."""
        from skillplan.pipeline.solving import warm_cache

        return None if self.no_cache else warm_cache()


@dataclass(frozen=True)
class Workers:
    """How many processes do jobs, and where.

    Parameters
    ----------
    jobs
        How many processes, from 1 to 256.
    executor
        Where they are, as ``NAME`` or ``NAME:ADDRESS``.
    """

    jobs: Jobs = 1
    executor: ExecutorName = "local"


@dataclass(frozen=True)
class Checking(Workers, Caching):
    """How back ends are queried.

    Parameters
    ----------
    no_cache
        Whether verdicts kept on disk are left alone.
    jobs, executor
        As for `Workers`.
    """


def warn_of(problem: Problem) -> None:
    """Print on stderr what in a task file is valid, but hardly meant."""
    for warning in problem.warnings:
        tell(f"skillplan: warning: {warning}")
