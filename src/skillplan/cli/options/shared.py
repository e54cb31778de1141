"""Options that several commands share, in groups that commands take whole."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from skillplan.cli.options.completion import (
    engine_names,
    plugin_lists,
    plugin_names,
    plugin_options,
    task_files,
)
from skillplan.cli.options.values import (
    count_option,
    memory_size,
    one_of,
    positive_seconds,
    whole_number,
)
from skillplan.errors import OptionError

if TYPE_CHECKING:
    from skillplan.cli.interruption import Deadline
    from skillplan.solvers.stop import Stop


TASK, SOLVER, BACK_ENDS = "Task", "Solver", "Back ends"
OUTPUT = "Output"


FORMATS = ("table", "json", "csv", "md")
_MOST_SEED = 2**63 - 1

TaskFile = Annotated[
    str,
    typer.Argument(
        metavar="TASK",
        autocompletion=task_files,
        help="A task file: YAML, or TSPLIB's .sop.",
        show_default=False,
    ),
]
RESULT_HELP = "a result.json of search-optimal, or the folder that --out named"
ResultFile = Annotated[
    str,
    typer.Argument(metavar="RESULT", help=f"{RESULT_HELP.capitalize()}.", show_default=False),
]
MaybeTaskFile = Annotated[
    str | None,
    typer.Argument(metavar="TASK", autocompletion=task_files, help="A task file."),
]
Style = Annotated[
    Literal["table", "json", "csv", "md"],
    typer.Option(
        "--format",
        parser=one_of(FORMATS),
        metavar="FORMAT",
        help="How to print: table, json, csv or md; json holds everything in one document.",
        rich_help_panel=OUTPUT,
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed",
        parser=whole_number(0, _MOST_SEED),
        metavar="N",
        help="Governs all randomness.",
        rich_help_panel=SOLVER,
    ),
]
Jobs = Annotated[
    int,
    count_option(
        "--jobs",
        least=1,
        most=256,
        text="How many processes may be used at once: for checks of expensive back ends, by "
        "solvers that can, for runs, and for solvers side by side. Nothing that comes out depends "
        "on it, but times do.",
        rich_help_panel=BACK_ENDS,
    ),
]
ExecutorName = Annotated[
    str,
    typer.Option(
        "--executor",
        metavar="NAME[:ADDRESS]",
        autocompletion=plugin_names("executor"),
        help="Where those processes are: local for this machine, ray for a cluster that has been "
        "started, if skillplan-ray is installed. Nothing that comes out depends on that either.",
        rich_help_panel=BACK_ENDS,
    ),
]
Audit = Annotated[
    int | None,
    count_option(
        "--audit",
        least=0,
        most=100_000,
        text="How many verdicts that the search has reused are asked again after it, where they "
        "were reused; by default 4, and none of expensive back ends",
        rich_help_panel=BACK_ENDS,
        show_default=False,
    ),
]
NoScreening = Annotated[
    bool,
    typer.Option(
        "--no-screening",
        help="Leave all to a physics engine. Otherwise geometry is asked first (swept, if it is "
        "installed), and what it refuses is executed only for a sample.",
        rich_help_panel=BACK_ENDS,
    ),
]


def solver_option(text: str, **details: Any) -> Any:
    """Return the option that names one solver; `text` is its help."""
    return typer.Option(
        "--solver",
        metavar="NAME",
        autocompletion=plugin_names("solver"),
        help=text,
        rich_help_panel=SOLVER,
        **details,
    )


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


LIMITS = "Limits"


def time_limit_option(text: str) -> Any:
    """Return the option ``--time-limit``; `text` is its help."""
    return typer.Option(
        "--time-limit",
        parser=positive_seconds,
        metavar="S",
        help=text,
        rich_help_panel=LIMITS,
    )


def memory_limit_option(text: str) -> Any:
    """Return the option ``--memory-limit``; its help is `text` and how a size is written."""
    return typer.Option(
        "--memory-limit",
        parser=memory_size,
        metavar="SIZE",
        help=f"{text}, such as 2GiB or 512MiB; 64MiB at least.",
        rich_help_panel=LIMITS,
    )


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """When a whole command ends.

    Parameters
    ----------
    time_limit_s
        Time limit [s], > 0; None for none.
    memory_limit_bytes
        Memory of the command and its processes together [B], > 0; None for no limit.
    """

    time_limit_s: Annotated[
        float | None,
        time_limit_option(
            "End the whole command after S seconds, 20 % and 2 s later at most. What is optional "
            "is left out before."
        ),
    ] = None
    memory_limit_bytes: Annotated[
        int | None,
        memory_limit_option(
            "End the whole command before it holds more memory, with the processes it starts"
        ),
    ] = None

    def begin(self, *, graceful: bool) -> Deadline:
        """Return the deadline of the command, which is ended if it goes on after that.

        Parameters
        ----------
        graceful
            Whether the command itself stops at its deadline with a result: it is ended later then.
        """
        from skillplan.cli.interruption import Deadline

        return Deadline(self.time_limit_s, self.memory_limit_bytes, graceful=graceful)


TimeLimit = Annotated[
    float | None,
    time_limit_option("Stop after S seconds with the best plan, its bound and its gap."),
]


@dataclass(frozen=True, slots=True)
class Limits:
    """When a search ends by itself.

    Parameters
    ----------
    time_limit_s
        After how long [s].
    stall_s
        After how long without a better plan or bound [s].
    memory_limit_bytes
        How much memory it may hold [bytes].
    """

    time_limit_s: TimeLimit = None
    stall_s: Annotated[
        float | None,
        typer.Option(
            "--stall",
            parser=positive_seconds,
            metavar="S",
            help="Stop once there is a plan and neither cost nor bound has improved for S seconds.",
            rich_help_panel=LIMITS,
        ),
    ] = None
    memory_limit_bytes: Annotated[
        int | None,
        memory_limit_option(
            "Stop with the best plan, its bound and its gap before the process, and those that "
            "search beside it, hold more memory than this"
        ),
    ] = None

    @property
    def of_stop(self) -> dict[str, Any]:
        """The limits as keywords of `Stop`."""
        return {
            "time_limit_s": self.time_limit_s,
            "stall_s": self.stall_s,
            "memory_limit_bytes": self.memory_limit_bytes,
        }

    def stoppable(self, label: str, gap: float = 0.0) -> AbstractContextManager[Stop]:
        """Return what yields a stop with these limits.

        Parameters
        ----------
        label
            What a terminal shows meanwhile.
        gap
            At which relative gap the search ends, from 0 to 1.
        """
        from skillplan.cli.waiting import stoppable

        return stoppable(
            self.time_limit_s,
            gap,
            label,
            stall_s=self.stall_s,
            memory_limit_bytes=self.memory_limit_bytes,
        )
