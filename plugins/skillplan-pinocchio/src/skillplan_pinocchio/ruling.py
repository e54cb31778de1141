"""What a course comes to in one state, and the facts that the answer rests on.

Obstacles are looked at in the order of the motion; what was looked at before the one that
decides was absent, and that, too, is part of the answer.
"""

from __future__ import annotations

from skillplan.task.state import State
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.course import Choice, Course, Hit
from skillplan_pinocchio.support import Ground


class Ruling:
    """Looks at facts of a state, and remembers which.

    Parameters
    ----------
    state
        Where the skill starts.
    present, absent
        Facts that the answer rests on from the beginning, as bits.
    """

    def __init__(self, state: State, present: int, absent: int) -> None:
        self.state = state
        self.present = present
        self.absent = absent

    def verdict(self, course: Course) -> Verdict:
        """Return the answer for a course."""
        for event in course.events:
            hit = self._hit(event)
            if hit is not None:
                return Verdict.infeasible(hit.reason, *self._rests, hit.evidence)
        for ground in course.grounds:
            verdict = self._unborne(ground)
            if verdict is not None:
                return verdict
        return Verdict.feasible(*self._rests)

    @property
    def _rests(self) -> tuple[State, State]:
        facts = self.state.facts
        return facts.state(self.present), facts.state(self.absent)

    def _hit(self, event: Hit | Choice) -> Hit | None:
        """Return the collision that happens, or None."""
        if isinstance(event, Hit):
            return event if self._holds(event.fact) else None
        blocking: Hit | None = None
        for way in event.ways:
            hit = next((hit for hit in way if self._holds(hit.fact)), None)
            if hit is None:
                return None
            blocking = blocking or hit
        return blocking

    def _unborne(self, ground: Ground) -> Verdict | None:
        """Return the verdict that nothing bears a body, or None."""
        there = [self._holds(contact.fact) for contact in ground.contacts]
        if ground.bears(there):
            return None
        contacts = zip(ground.contacts, there, strict=True)
        names = sorted({contact.body for contact, holds in contacts if holds})
        reason = (
            f"{ground.body} would tip off {', '.join(names)}"
            if names
            else f"{ground.body} has nothing beneath it"
        )
        possible = sorted({contact.body for contact in ground.contacts})
        evidence = {"body": ground.body, "bodies": names, "possible_supports": possible}
        return Verdict.infeasible(reason, *self._rests, evidence)

    def _holds(self, fact: str | None) -> bool:
        """Whether a fact holds, which is noted; None always does."""
        if fact is None:
            return True
        bit = self.state.facts.bit(fact)
        if self.state.bits & bit:
            self.present |= bit
            return True
        self.absent |= bit
        return False
