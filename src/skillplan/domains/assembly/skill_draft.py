"""A skill of an assembly in terms of its places and facts, before it is grounded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from skillplan.task.motion import Visit


@dataclass(frozen=True, kw_only=True)
class SkillDraft:
    """What a skill needs, does and visits.

    Parameters
    ----------
    kind, subject
        The name's two parts, as in ``pick(pcb)``.
    requires, forbids
        Facts that have to hold, and that must not.
    add, delete
        Facts that it brings about, and that it ends.
    ends_at
        The place where the arm stands then.
    routes
        What the arm visits, by the fact that selects the route; None for a single one. The path
        along them is what the skill costs.
    ways
        Where there are several visits to choose from, all of them, each with the way in words; the
        preferred one first, which is that of the only route.
    parameters
        What it is about, for people and engines.
    carries
        The part in the hand, or None.
    failure
        Probability that nothing comes of it but that the arm stands at `failed_at`, below 1.
    failed_at
        A place.
    """

    kind: str
    subject: str
    requires: Sequence[str]
    add: Sequence[str]
    delete: Sequence[str]
    ends_at: str
    routes: Mapping[str | None, Sequence[Visit]]
    parameters: Mapping[str, str]
    forbids: Sequence[str] = ()
    ways: Sequence[tuple[str, Visit]] = ()
    carries: str | None = None
    failure: float = 0.0
    failed_at: str = ""

    @property
    def name(self) -> str:
        """The skill's name."""
        return f"{self.kind}({self.subject})"
