"""What was measured, for people: in one line, or as a list."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def evidence_text(evidence: Mapping[str, Any]) -> str:
    """Return evidence as ``key value`` pairs; what belongs to one thing stands in brackets."""
    return ", ".join(f"{key} {_plain(value)}" for key, value in evidence.items())


def evidence_items(evidence: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return evidence as names and texts, one for each thing that was measured."""
    return [
        (key, (evidence_text(value) or "none") if isinstance(value, Mapping) else _plain(value))
        for key, value in evidence.items()
    ]


def _plain(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        # Minus zero says nothing.
        return f"{value + 0.0:.4g}"
    if isinstance(value, Mapping):
        return f"({evidence_text(value)})" if value else "none"
    if isinstance(value, list | tuple):
        return " ".join(_plain(item) for item in value) or "none"
    return str(value)
