"""Options that several commands share: single ones, and groups that commands take as a whole.

They hold data; `skillplan.cli.load` loads the files and plugins that they name.
"""

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
    option,
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
RESULT_HELP = "a result.json of search-optimal, or its folder"
ResultFile = Annotated[
    str, typer.Argument(metavar="RESULT", help=f"{RESULT_HELP.capitalize()}.", show_default=False)
]
MaybeTaskFile = Annotated[
    str | None, typer.Argument(metavar="TASK", autocompletion=task_files, help="A task file.")
]
Style = Annotated[
    Literal["table", "json", "csv", "md"],
    option(
        "--format FORMAT",
        OUTPUT,
        "Output format: table, json, csv or md. json contains everything in one document.",
        parser=one_of(FORMATS),
    ),
]
OutFolder = Annotated[
    str,
    option("--out DIR", OUTPUT, "New or empty folder for the output files.", show_default=False),
]
Seed = Annotated[
    int,
    option("--seed N", SOLVER, "Seed of all random numbers.", parser=whole_number(0, _MOST_SEED)),
]
Jobs = Annotated[
    int,
    count_option(
        "--jobs",
        minimum=1,
        maximum=256,
        text="Number of worker processes. Results do not depend on it",
        rich_help_panel=BACK_ENDS,
    ),
]
ExecutorName = Annotated[
    str,
    option(
        "--executor NAME[:ADDRESS]",
        BACK_ENDS,
        "Where workers run: local, or ray[:ADDRESS] for a Ray cluster (needs skillplan-ray).",
        autocompletion=plugin_names("executor"),
    ),
]
Audit = Annotated[
    int | None,
    count_option(
        "--audit",
        minimum=0,
        maximum=100_000,
        text="Number of reused verdicts to recompute after the search; default: 4, none of "
        "expensive back ends",
        rich_help_panel=BACK_ENDS,
        show_default=False,
    ),
]
NoScreening = Annotated[
    bool,
    option(
        "--no-screening",
        BACK_ENDS,
        "Let a physics engine check everything. By default geometry is checked first (by "
        "swept, if it is installed), and only a sample of the skills that it refuses is "
        "executed.",
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
    """Changes of a task file."""

    changes: Annotated[
        list[str],
        option(
            "--set KEY=VALUE",
            TASK,
            "Override KEY of the task file, such as base.goal_choice or parts.pcb.mass_kg. "
            "May be repeated.",
        ),
    ] = field(default_factory=list)

    def settings(self) -> dict[str, str]:
        """Return key path to value.

        Raises
        ------
        OptionError
            If an entry has another form.
        """
        changes = {}
        for entry in self.changes:
            key, equals, value = entry.partition("=")
            if not equals or not all(key.split(".")):
                raise OptionError(f"--set {entry!r} must have the form KEY=VALUE, as base.home=C1.")
            changes[key] = value
        return changes


@dataclass(frozen=True, slots=True)
class PartReading(Reading):
    """Changes of a task file, and the task that is meant.

    Parameters
    ----------
    part
        Name of one task of a chain; None for the only task.
    """

    part: Annotated[
        str | None, option("--part NAME", TASK, "Name of one task of a chain, such as base-1.")
    ] = None


def task_option(text: str, panel: str = TASK) -> Any:
    """Return the option ``--task``, the task file of a result or run; `text` is its help."""
    return option("--task FILE", panel, text, autocompletion=task_files)


@dataclass(frozen=True, slots=True)
class ResultReading(PartReading):
    """Changes of a task file, and the file itself for a result that names another place.

    Parameters
    ----------
    task_file
        The task file of the result; None for the file that it names.
    """

    task_file: Annotated[
        str | None, task_option("Task file of RESULT if it has moved. Default: as RESULT names it.")
    ] = None

    def refuse_task_file(self, path: str, kind: str) -> None:
        """Raise an `OptionError` if a task file is named for an input of another kind."""
        if self.task_file is not None:
            raise OptionError(f"--task names the task file of a result, but {path} is {kind}.")


@dataclass(frozen=True, slots=True)
class BackEnds:
    """The back ends of the command line, and options of plugins.

    Parameters
    ----------
    physics
        Name of an engine; None for the choice of the file.
    collision
        Names of detectors, separated by commas; None for the choice of the file.
    options
        Entries ``[PLUGIN.]KEY=VALUE``.
    """

    physics: Annotated[
        str | None,
        option(
            "--physics NAME",
            BACK_ENDS,
            "Physics engine, or auto: pybullet if it is installed, or else mujoco. Default: "
            "the task file's choice, or else kinematic.",
            autocompletion=engine_names,
        ),
    ] = None
    collision: Annotated[
        str | None,
        option(
            "--collision NAMES",
            BACK_ENDS,
            "Collision detectors, separated by commas. Default: the task file's choice, or "
            "else swept if it is installed, or else aabb. A chart of the task file is checked "
            "in addition; precedence alone checks the chart and no geometry.",
            autocompletion=plugin_lists("collision"),
        ),
    ] = None
    options: Annotated[
        list[str],
        option(
            "-O KEY=VALUE",
            BACK_ENDS,
            "Option of the solver, or of any plugin as PLUGIN.KEY=VALUE; 'skillplan plugins "
            "KIND NAME' lists them. May be repeated.",
            autocompletion=plugin_options,
        ),
    ] = field(default_factory=list)


@dataclass(frozen=True)
class Caching:
    """Use of the verdicts kept on disk."""

    no_cache: Annotated[
        bool, option("--no-cache", BACK_ENDS, "Neither read nor write verdicts kept on disk.")
    ] = False


@dataclass(frozen=True)
class Workers:
    """Number of worker processes, and their executor."""

    jobs: Jobs = 1
    executor: ExecutorName = "local"


@dataclass(frozen=True)
class Checking(Workers, Caching):
    """Use of kept verdicts, and worker processes."""


LIMITS = "Limits"


def time_limit_option(text: str) -> Any:
    """Return the option ``--time-limit``; `text` is its help."""
    return option("--time-limit S", LIMITS, text, parser=positive_seconds)


def memory_limit_option(text: str) -> Any:
    """Return the option ``--memory-limit``; its help is `text` and the form of a size."""
    return option(
        "--memory-limit SIZE",
        LIMITS,
        f"{text}, such as 2GiB or 512MiB; 64MiB at least.",
        parser=memory_size,
    )


@dataclass(frozen=True, slots=True)
class CommandLimits:
    """Limits of a whole command.

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
            "End the whole command after S seconds, or 20 % and 2 s later at most. Optional work "
            "is left out before."
        ),
    ] = None
    memory_limit_bytes: Annotated[
        int | None,
        memory_limit_option("End the whole command before it and its processes hold more memory"),
    ] = None

    def begin(self, *, graceful: bool) -> Deadline:
        """Return the deadline of the command, which is ended if it goes on after that.

        Parameters
        ----------
        graceful
            True if the command stops at its deadline with a result; it is ended later then.
        """
        from skillplan.cli.interruption import Deadline

        return Deadline(self.time_limit_s, self.memory_limit_bytes, graceful=graceful)


TimeLimit = Annotated[
    float | None,
    time_limit_option("Stop after S seconds with the best plan, its bound and its gap."),
]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a search.

    Parameters
    ----------
    time_limit_s
        Time limit [s].
    stall_s
        Time without a better plan or bound [s].
    memory_limit_bytes
        Memory limit [B].
    """

    time_limit_s: TimeLimit = None
    stall_s: Annotated[
        float | None,
        option(
            "--stall S",
            LIMITS,
            "Stop once there is a plan and neither cost nor bound has improved for S seconds.",
            parser=positive_seconds,
        ),
    ] = None
    memory_limit_bytes: Annotated[
        int | None,
        memory_limit_option(
            "Stop with the best plan, its bound and its gap before the search and its processes "
            "hold more memory"
        ),
    ] = None

    @property
    def of_stop(self) -> dict[str, Any]:
        """The keywords of a `Stop` with these limits."""
        return {
            "time_limit_s": self.time_limit_s,
            "stall_s": self.stall_s,
            "memory_limit_bytes": self.memory_limit_bytes,
        }

    def stoppable(self, label: str, gap: float = 0.0) -> AbstractContextManager[Stop]:
        """Return a context manager of a stop with these limits.

        Parameters
        ----------
        label
            Label of the progress on a terminal.
        gap
            Relative gap at which the search ends, from 0 to 1.
        """
        from skillplan.cli.waiting import stoppable

        return stoppable(
            self.time_limit_s,
            gap,
            label,
            stall_s=self.stall_s,
            memory_limit_bytes=self.memory_limit_bytes,
        )
