"""From the verdicts on the ways of a skill to the verdict on the skill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

WAYS = "ways"
"""The stage of a verdict that refuses all ways of a skill for different reasons of its stages."""

# Of the reasons against the ways of a skill, a message gives so many.
_MOST_REASONS = 6


@dataclass(frozen=True, slots=True)
class Looked:
    """What was said of one way of a skill.

    Parameters
    ----------
    label
        The way in words.
    verdict
        What back ends say.
    settled
        Bits of facts that follow from the skill's being applicable.
    """

    label: str
    verdict: Verdict
    settled: int = 0


class WayAccount:
    """What was said of the ways of a skill, one after the other.

    Parameters
    ----------
    skill
        With ways.
    state
        Where it begins.
    """

    def __init__(self, skill: Skill, state: State) -> None:
        self.skill = skill
        self.state = state
        self._looked: list[Looked] = []
        self._basis = 0

    def note(self, label: str, verdict: Verdict, settled: int = 0) -> VerdictStatus:
        """Note a verdict and return its status.

        Parameters
        ----------
        label, verdict, settled
            As of `Looked`.
        """
        self._looked.append(Looked(label, verdict, settled))
        return verdict.status

    def rest_on(self, bits: int) -> None:
        """Note that which way is taken also depends on some facts."""
        self._basis |= bits

    def granted(self, label: str) -> Verdict:
        """Return the verdict that the skill is feasible by a way."""
        present, absent = self._facts()
        condition = self.skill.condition(self.state)
        evidence: dict[str, object] = {"way": label}
        refused = {one.label: one.verdict.reason for one in self._against}
        if refused:
            evidence["refused"] = refused
        return Verdict.feasible(present | condition.requires, absent | condition.forbids, evidence)

    def denied(self) -> Verdict:
        """Return the verdict where no way is granted: unknown where one of them is."""
        unknown = next(
            (o for o in self._against if o.verdict.status is VerdictStatus.UNKNOWN), None
        )
        if unknown is not None:
            verdict = unknown.verdict
            reason = f"by no way it is granted, and {unknown.label}: {verdict.reason}"
            evidence = dict(verdict.evidence)
            return Verdict.unknown(reason, evidence).grounded(self.state, verdict.stage)
        present, absent = self._facts()
        stages = {one.verdict.stage for one in self._against}
        evidence = {"ways": {one.label: one.verdict.reason for one in self._against}}
        made = Verdict.infeasible(_reasons(self._against), present, absent, evidence)
        return replace(made, stage=stages.pop() if len(stages) == 1 else WAYS)

    @property
    def _against(self) -> list[Looked]:
        return [one for one in self._looked if not one.verdict.is_feasible]

    def _facts(self) -> tuple[State, State]:
        """Return the facts that hold, and that do not, on which everything that was said rests."""
        bits = self._basis
        for one in self._looked:
            present, absent = one.verdict.present, one.verdict.absent
            if present is None or absent is None:
                bits |= self.state.facts.all_bits
            else:
                bits |= (present.bits | absent.bits) & ~one.settled
        facts, here = self.state.facts, self.state.bits
        return facts.state(bits & here), facts.state(bits & ~here)


def _reasons(against: Sequence[Looked]) -> str:
    """Return why each way is refused, those with one reason together."""
    labels: dict[str, list[str]] = {}
    for one in against:
        labels.setdefault(one.verdict.reason, []).append(one.label)
    said = [f"{' and '.join(of)}: {reason}" for reason, of in labels.items()]
    more = len(said) - _MOST_REASONS
    if more > 0:
        said = [*said[:_MOST_REASONS], f"{more} more"]
    return "; ".join(said)
