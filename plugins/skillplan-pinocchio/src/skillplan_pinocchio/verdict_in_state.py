"""The verdict on a swept motion in one state, and the facts that it rests on.

Obstacles are checked in the order of the motion; what was checked before the one that decides was
absent, and that, too, is part of what the verdict rests on.
"""

from __future__ import annotations

from collections.abc import Callable

from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.gravity import Overload
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.skill_travels import SkillTravels
from skillplan_pinocchio.support import Supports
from skillplan_pinocchio.swept_motion import Collision, ElbowChoice, SweptMotion


class VerdictInState:
    """Looks at facts of a state, and remembers which.

    Parameters
    ----------
    state
        Where the skill starts.
    present, absent
        Facts that the verdict rests on from the beginning, as bits.
    stand
        The fact that says where the arm stands, and how: joint angles [rad], or None where it
        cannot stand there.
    """

    def __init__(
        self,
        state: State,
        present: int,
        absent: int,
        stand: Callable[[], tuple[str, Vector | None]],
    ) -> None:
        self.state = state
        self.present = present
        self.absent = absent
        self.stand = stand
        self._elbows: dict[int, int] = {}

    def on(self, motion: SweptMotion) -> Verdict:
        """Return the verdict on a swept motion."""
        for event in motion.events:
            collision = self._collision(event)
            if collision is not None:
                return Verdict.infeasible(collision.reason, *self._rests, collision.evidence)
        for supports in motion.supports:
            verdict = self._unsupported(supports)
            if verdict is not None:
                return verdict
        return self._travelled(motion.travels)

    def _travelled(self, travels: SkillTravels | None) -> Verdict:
        """Return the verdict on travels, the last and dearest of all that is looked at."""
        if travels is None:
            return Verdict.feasible(*self._rests)
        found = travels.found(*self.stand(), self._elbows, self._holds)
        last = found[-1].travel if found else None
        if isinstance(last, Unfound):
            hit = last.hit
            evidence = {
                "moving": hit.mover,
                "bodies": [hit.body],
                "during": "the travel",
                "position_m": list(hit.position),
                "fraction": hit.place,
                "checks": last.checks,
            }
            status = VerdictStatus.INFEASIBLE if last.is_proof else VerdictStatus.UNKNOWN
            present, absent = self._rests
            return Verdict(status, last.reason, "", present, absent, evidence)
        if isinstance(last, Overload):
            during = "the travel"
            reason = f"{last.reason} on {during}; no other way was looked for"
            present, absent = self._rests
            evidence = dict(last.evidence(during))
            return Verdict(VerdictStatus.UNKNOWN, reason, "", present, absent, evidence)
        planned = [one.evidence for one in found if one.evidence is not None]
        return Verdict.feasible(*self._rests, {"travels": planned} if planned else None)

    @property
    def _rests(self) -> tuple[State, State]:
        facts = self.state.facts
        return facts.state(self.present), facts.state(self.absent)

    def _collision(self, event: Collision | ElbowChoice) -> Collision | None:
        """Return the collision that happens, or None."""
        if isinstance(event, Collision):
            return event if self._holds(event.fact) else None
        blocking: Collision | None = None
        for number, path in enumerate(event.paths):
            collision = next((collision for collision in path if self._holds(collision.fact)), None)
            if collision is None:
                self._elbows[event.motion] = number
                return None
            blocking = blocking or collision
        return blocking

    def _unsupported(self, supports: Supports) -> Verdict | None:
        """Return the verdict that a body is not supported, or None."""
        there = [self._holds(contact.fact) for contact in supports.contacts]
        if supports.hold(there):
            return None
        contacts = zip(supports.contacts, there, strict=True)
        names = sorted({contact.body for contact, holds in contacts if holds})
        reason = (
            f"{supports.body} would tip off {', '.join(names)}"
            if names
            else f"{supports.body} has nothing beneath it"
        )
        possible = sorted({contact.body for contact in supports.contacts})
        evidence = {"body": supports.body, "bodies": names, "possible_supports": possible}
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
