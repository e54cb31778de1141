"""Verdicts of back ends on skills in states, and the facts they rest on.

A verdict may be reused in every state in which these facts are the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from skillplan.task.state import State


class VerdictStatus(StrEnum):
    """Status of a verdict."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Verdict:
    """A verdict: feasible, infeasible or unknown, with a reason and the facts it rests on.

    Parameters
    ----------
    reason
        One sentence; empty if feasible.
    stage
        Name of the check that decided, such as ``precondition`` or ``aabb``.
    present, absent
        Facts that must hold, and must not hold, for the verdict to apply. None if the back end does
        not know; then the verdict rests on all facts and applies in the same state only.
    evidence
        Measurements such as bodies, forces [N] and poses; JSON values only.
    """

    status: VerdictStatus
    reason: str = ""
    stage: str = ""
    present: State | None = None
    absent: State | None = None
    evidence: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if self.status is not VerdictStatus.FEASIBLE and not self.reason:
            raise ValueError(f"A verdict {self.status!s} needs a reason.")
        if (self.present is None) != (self.absent is None):
            raise ValueError("A verdict names both present and absent facts, or neither.")
        present, absent = self.present, self.absent
        if present is not None and absent is not None and present.bits & absent.bits:
            both = present & absent
            raise ValueError(f"A verdict rests on facts both present and absent: {both}.")

    @classmethod
    def feasible(
        cls,
        present: State | None = None,
        absent: State | None = None,
        evidence: Mapping[str, Any] | None = None,
    ) -> Verdict:
        """Return the verdict that the skill can be executed."""
        return cls(VerdictStatus.FEASIBLE, present=present, absent=absent, evidence=evidence or {})

    @classmethod
    def infeasible(
        cls,
        reason: str,
        present: State | None = None,
        absent: State | None = None,
        evidence: Mapping[str, Any] | None = None,
    ) -> Verdict:
        """Return the verdict that the skill cannot be executed."""
        return cls(
            VerdictStatus.INFEASIBLE,
            reason,
            present=present,
            absent=absent,
            evidence=evidence or {},
        )

    @classmethod
    def unknown(cls, reason: str, evidence: Mapping[str, Any] | None = None) -> Verdict:
        """Return the verdict that the back end could not decide."""
        return cls(VerdictStatus.UNKNOWN, reason, evidence=evidence or {})

    @property
    def is_feasible(self) -> bool:
        """True if the skill can be executed."""
        return self.status is VerdictStatus.FEASIBLE

    @property
    def is_infeasible(self) -> bool:
        """True if the skill cannot be executed."""
        return self.status is VerdictStatus.INFEASIBLE

    def grounded(self, state: State, stage: str) -> Verdict:
        """Return this verdict with a stage, resting on all facts of `state` if it names none."""
        if self.present is not None:
            return replace(self, stage=stage)
        return replace(self, stage=stage, present=state, absent=state.complement())

    def applies_in(self, state: State) -> bool:
        """Return whether all facts that the verdict rests on are the same in `state`."""
        if self.present is None or self.absent is None:
            return False
        bits = state.bits
        return bits & self.present.bits == self.present.bits and not bits & self.absent.bits

    @property
    def facts(self) -> list[str]:
        """The facts that it rests on; absent ones as ``not NAME``."""
        return [*(self.present or ()), *(f"not {name}" for name in self.absent or ())]
