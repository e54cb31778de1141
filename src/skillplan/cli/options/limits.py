"""When a command ends by itself: options of time and memory, and what they come to."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from skillplan.cli.options.values import memory_size, positive_seconds

if TYPE_CHECKING:  # --help pays for no imports
    from skillplan.cli.deadline import Deadline
    from skillplan.solvers.stop import Stop

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
        from skillplan.cli.deadline import Deadline

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
