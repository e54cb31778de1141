"""The outcome of a verification, claim by claim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from skillplan.records import schemas
from skillplan.records.result import Origin

_MOST_SHOWN = 3


class Outcome(StrEnum):
    """The outcome of checking a claim."""

    HOLDS = "holds"
    FAILS = "fails"
    NOT_CHECKED = "not checked"


class Verdict(StrEnum):
    """The conclusion of a verification.

    ``valid``: every essential claim was checked and holds. ``refuted``: a claim fails. ``not
    confirmed``: no claim fails, but an essential one was not checked.
    """

    VALID = "valid"
    REFUTED = "refuted"
    NOT_CONFIRMED = "not confirmed"


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of a result, checked.

    Parameters
    ----------
    claim
        Name of the claim, such as ``cost``; for a chain after the name of the task.
    outcome
        Outcome of the check.
    detail
        The figures, or the reason why it fails or was not checked.
    method
        Method of the check.
    open
        True if the result may be confirmed although this claim was not checked.
    contradiction
        True if a proof of another program contradicts the result's.
    """

    claim: str
    outcome: Outcome
    detail: str
    method: str
    open: bool = True
    contradiction: bool = False

    def document(self) -> dict[str, str]:
        """Return the claim as JSON values."""
        return {
            "claim": self.claim,
            "outcome": self.outcome.value,
            "detail": self.detail,
            "method": self.method,
        }


@dataclass(frozen=True, slots=True)
class Asked:
    """A back end that was queried to check a result.

    Parameters
    ----------
    options
        All its options, as JSON values.
    """

    name: str
    version: str
    options: Mapping[str, Any]

    def document(self) -> dict[str, Any]:
        """Return the back end as JSON values."""
        return {"name": self.name, "version": self.version, "options": dict(self.options)}


@dataclass(frozen=True)
class Certificate:
    """The claims of one result.

    Parameters
    ----------
    file
        The result, as the user named it.
    name, kind, sha256
        The task of the result.
    claims
        The claims, in the order of checking.
    asked
        The back ends that were queried.
    unchecked
        Key of the result to the reason why it cannot be checked.
    warm
        True if verdicts kept on disk were used.
    not_checked
        Sentences of the back ends about unchecked properties of the task.
    origin
        The task file and the options that it was read with.
    """

    file: str
    name: str
    kind: str
    sha256: str
    claims: Sequence[Claim]
    asked: Sequence[Asked] = ()
    unchecked: Mapping[str, str] = field(default_factory=dict)
    warm: bool = False
    not_checked: tuple[str, ...] = ()
    origin: Origin | None = None

    @property
    def valid(self) -> bool:
        """True if no claim fails and every essential claim was checked."""
        return self.verdict is Verdict.VALID

    @property
    def verdict(self) -> Verdict:
        """The conclusion from all claims."""
        if self.refuted:
            return Verdict.REFUTED
        return Verdict.NOT_CONFIRMED if self.unconfirmed else Verdict.VALID

    @property
    def refuted(self) -> list[Claim]:
        """The claims that fail."""
        return [claim for claim in self.claims if claim.outcome is Outcome.FAILS]

    @property
    def unconfirmed(self) -> list[Claim]:
        """Essential claims that no method has checked."""
        held = {claim.claim for claim in self.claims if claim.outcome is Outcome.HOLDS}
        return [
            claim
            for claim in self.claims
            if claim.outcome is Outcome.NOT_CHECKED and not claim.open and claim.claim not in held
        ]

    @property
    def contradicted(self) -> bool:
        """True if a proof of another program contradicts a claim."""
        return any(claim.contradiction for claim in self.claims)

    def unconfirmed_words(self) -> str:
        """Return the first essential claims that were not checked, each with the reason."""
        claims = self.unconfirmed
        words = [f"{claim.claim} ({claim.detail})" for claim in claims[:_MOST_SHOWN]]
        more = len(claims) - len(words)
        return "; ".join([*words, *([f"{more} more claims"] if more else [])])

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.verification/1``."""
        return {
            "schema": schemas.VERIFICATION,
            "file": self.file,
            "task": {"name": self.name, "kind": self.kind, "sha256": self.sha256},
            "claims": [claim.document() for claim in self.claims],
            "origin": None if self.origin is None else self.origin.document(),
            "verdict": self.verdict.value,
            "valid": self.valid,
            "warm": self.warm,
            "asked": [back_end.document() for back_end in self.asked],
            "not_checked": [
                {"key": key, "reason": reason} for key, reason in self.unchecked.items()
            ],
            "back_ends_not_checked": list(self.not_checked),
        }
