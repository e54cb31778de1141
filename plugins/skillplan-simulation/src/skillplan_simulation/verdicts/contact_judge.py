"""Who rules on the contacts of an execution: the same for a single skill and for a whole plan."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Protocol, runtime_checkable

from skillplan.task.verdict import Verdict
from skillplan_simulation.record import Record
from skillplan_simulation.verdicts.pair_verdict import PairLimits, pair_verdict

Judge = Callable[[Record], Verdict]


@runtime_checkable
class ContactJudge(Protocol):
    """A detector that rules on contacts by the record of an execution."""

    def contact_verdict(self, record: Record) -> Verdict:
        """Return the verdict on the contacts of an execution that ran to its end."""


def judges_among(back_ends: Sequence[object], parts: Collection[str]) -> tuple[Judge, ...]:
    """Return the judges among some back ends; where there is none, the limits of `PairLimits`.

    Parameters
    ----------
    back_ends
        Those that are queried beside an engine.
    parts
        Names of the task's bodies.
    """
    found = [one.contact_verdict for one in back_ends if isinstance(one, ContactJudge)]
    return tuple(found) or (partial(pair_verdict, limits=PairLimits(), parts=frozenset(parts)),)


def collision_in(record: Record, judges: Sequence[Judge]) -> Verdict | None:
    """Return the verdict of the first judge that finds a collision in an execution, or None."""
    verdicts = (judge(record) for judge in judges)
    return next((verdict for verdict in verdicts if verdict.is_infeasible), None)
