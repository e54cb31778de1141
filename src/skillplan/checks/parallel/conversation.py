"""What processes that check talk to: whoever says what is checked next, given the last answer."""

from __future__ import annotations

from typing import Protocol

from skillplan.checks.single_check import Checked, CheckRequest
from skillplan.errors import BackEndError


class Conversation(Protocol):
    """Checks of which each depends on what was said to the one before."""

    @property
    def wanted(self) -> bool:
        """Whether the check that it waits for still matters."""

    def go_on(self, said: Checked | None) -> CheckRequest | None:
        """Return what is to be checked next, given what was said to the last; None at the end."""

    def fail(self, error: BackEndError) -> None:
        """Note that a back end failed on this check; nothing more is queried."""


class Ahead(Conversation, Protocol):
    """Checks that are made before they are asked for."""

    @property
    def request(self) -> CheckRequest | None:
        """What is to be checked first."""

    def adopt(self) -> None:
        """Note that the check under way is asked for in earnest."""


class Guesses(Protocol):
    """What is worth checking ahead."""

    def guess(self) -> Ahead | None:
        """Return checks that are begun; None where nothing is likely enough."""

    def forget(self) -> None:
        """Take it that nobody waits any more."""
