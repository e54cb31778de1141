"""Where jobs are done: an executor by name, with an address and options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.errors import OptionError

DEFAULT_EXECUTOR = "local"


@dataclass(frozen=True)
class ExecutorChoice:
    """An executor that was chosen; nothing is imported, started or connected to.

    Parameters
    ----------
    name
        Of the plugin.
    address
        What it connects to; empty for none.
    options
        Its options, as given.
    """

    name: str = DEFAULT_EXECUTOR
    address: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, text: str, options: Mapping[str, Mapping[str, Any]]) -> ExecutorChoice:
        """Return the choice of ``NAME`` or ``NAME:ADDRESS``.

        Parameters
        ----------
        text
            Such as ``local`` or ``ray:10.0.0.1:6379``.
        options
            Plugin name to options; those of others are left alone.

        Raises
        ------
        OptionError
            If an address is announced and none given.
        """
        name, colon, address = text.partition(":")
        if colon and not address:
            raise OptionError(f"--executor {text}: no address follows the colon; leave both away.")
        return cls(name, address, dict(options.get(name, {})))

    @property
    def is_default(self) -> bool:
        """Whether jobs are done in processes of this machine, as without a choice."""
        return self == ExecutorChoice()
