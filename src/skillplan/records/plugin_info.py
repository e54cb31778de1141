"""One installed plugin, as it is listed."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PluginInfo:
    """One line of ``skillplan plugins``.

    Parameters
    ----------
    kind, name
        What it is and what it is called.
    distribution, version
        Who provides it.
    summary
        First line of its docstring; empty where it is broken.
    problem
        Why it cannot be used, or None.
    """

    kind: str
    name: str
    distribution: str
    version: str
    summary: str
    problem: str | None = None
