"""What a checker found out about a result: claim by claim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from skillplan.records import schemas


class Outcome(StrEnum):
    """What became of checking a claim."""

    HOLDS = "holds"
    FAILS = "fails"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of a result, checked.

    Parameters
    ----------
    claim
        What is claimed, as ``cost``; of a chain after the name of the task.
    outcome
        Whether it holds.
    detail
        The figures, or why it fails or was not checked.
    method
        How it was checked.
    """

    claim: str
    outcome: Outcome
    detail: str
    method: str

    def document(self) -> dict[str, str]:
        """Return the claim as JSON values."""
        return {
            "claim": self.claim,
            "outcome": self.outcome.value,
            "detail": self.detail,
            "method": self.method,
        }


@dataclass(frozen=True)
class Certificate:
    """The claims of one result.

    Parameters
    ----------
    file
        The result, as the user named it.
    name, kind, sha256
        Its task.
    claims
        All of them, in the order of checking.
    """

    file: str
    name: str
    kind: str
    sha256: str
    claims: Sequence[Claim]

    @property
    def valid(self) -> bool:
        """Whether no claim fails; some may not have been checked."""
        return all(claim.outcome is not Outcome.FAILS for claim in self.claims)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.verification/1``."""
        return {
            "schema": schemas.VERIFICATION,
            "file": self.file,
            "task": {"name": self.name, "kind": self.kind, "sha256": self.sha256},
            "claims": [claim.document() for claim in self.claims],
            "valid": self.valid,
        }
