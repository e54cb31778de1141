"""Dwell times: the time that the hand stays at a target to act, by what it does there.

Travels, and strokes down and up, are no part of them. Where they are given on several levels, the
part or screw comes first, then its tool, then the task.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Protocol

from pydantic import Field

from skillplan.domains.domain import Strict

Duration = Annotated[float, Field(ge=0, le=86_400)]
_FETCH_S = 1.0
_NEXT = "left out: that of its tool, or the task's"
_LAST = "left out: the task's"


def is_absent(value: Any) -> bool:
    """Return True if a key is left out: such files keep the hash that they had before the key."""
    return value is None


def _is_usual(value: float) -> bool:
    return value == _FETCH_S


class DurationsConfig(Strict):
    """Dwell times of the task, which count where a part, a screw and its tool give none."""

    pick: Duration = Field(3.0, description="close the jaws on a part, or draw it by suction [s]")
    place: Duration = Field(3.0, description="let go of a part where it belongs [s]")
    load: Duration = Field(5.0, description="attach a tool [s]")
    offload: Duration = Field(
        5.0, description="put a tool back, also as the first half of a swap [s]"
    )
    fetch: Duration = Field(
        _FETCH_S, exclude_if=_is_usual, description="take a screw from its feeder [s]"
    )
    fasten: Duration = Field(8.0, description="drive a screw [s]")


class PartDurations(Strict):
    """Dwell times of one part."""

    pick: Duration | None = Field(None, description=f"close the jaws on it [s]; {_NEXT}")
    place: Duration | None = Field(None, description=f"let go of it at its goal [s]; {_NEXT}")


class ScrewDurations(Strict):
    """Dwell times of one screw."""

    fetch: Duration | None = Field(None, description=f"take it from its feeder [s]; {_NEXT}")
    fasten: Duration | None = Field(None, description=f"drive it [s]; {_NEXT}")


class ToolDurations(Strict):
    """Dwell times with one tool."""

    pick: Duration | None = Field(None, description=f"close it on a part [s]; {_LAST}")
    place: Duration | None = Field(None, description=f"let go of a part [s]; {_LAST}")
    load: Duration | None = Field(None, description=f"attach it [s]; {_LAST}")
    offload: Duration | None = Field(None, description=f"put it back [s]; {_LAST}")
    fetch: Duration | None = Field(None, description=f"take a screw from a feeder [s]; {_LAST}")
    fasten: Duration | None = Field(None, description=f"drive a screw [s]; {_LAST}")


class _Dwells(Protocol):
    """A part, a screw or a tool, each of which may have dwell times."""

    @property
    def durations_s(self) -> Strict | None: ...


def dwell_s(kind: str, task: DurationsConfig, *owners: _Dwells) -> float:
    """Return a dwell time [s].

    Parameters
    ----------
    kind
        Key of `DurationsConfig`.
    task
        The task's dwell times.
    owners
        A part or screw, and its tool: the first that gives the dwell counts.
    """
    given = (getattr(owner.durations_s, kind, None) for owner in owners)
    taken_s: float = next((value for value in given if value is not None), getattr(task, kind))
    return taken_s


def given_kinds(owner: _Dwells) -> Iterator[str]:
    """Yield the keys of the dwell times that a part, a screw or a tool gives."""
    for kind in DurationsConfig.model_fields:
        if getattr(owner.durations_s, kind, None) is not None:
            yield kind
