"""Documents held against what they should say, leaf by leaf."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from skillplan.errors import format_path

# Figures may differ by rounding; times in s come from engines, which round otherwise.
_ROUNDING = 1e-9
_SAME_TIME_S = 1e-6
_MOST_SHOWN = 80
_Path = tuple[str | int, ...]


def differences(claimed: Any, derived: Any, path: _Path = ()) -> Iterator[str]:
    """Yield in words every leaf that a document has otherwise than it should, with its path.

    Parameters
    ----------
    claimed
        What it says, as JSON values.
    derived
        What it should say.
    path
        Where in the document both stand.
    """
    if isinstance(claimed, Mapping) and isinstance(derived, Mapping):
        for key, value in derived.items():
            if key in claimed:
                yield from differences(claimed[key], value, (*path, key))
            else:
                yield f"{format_path((*path, key))} is missing"
        for key in claimed:
            if key not in derived:
                yield f"{format_path((*path, key))} does not belong there"
    elif isinstance(claimed, list) and isinstance(derived, list | tuple):
        for index, (one, other) in enumerate(zip(claimed, derived, strict=False)):
            yield from differences(one, other, (*path, index))
        if len(claimed) != len(derived):
            yield f"{format_path(path)} has {len(claimed)} entries, not {len(derived)}"
    elif not _same(claimed, derived, path):
        yield f"{format_path(path)} is {_shown(derived)}, claimed {_shown(claimed)}"


def leaves(value: Any) -> int:
    """Return how many values a document holds that hold no others."""
    if isinstance(value, Mapping):
        return sum(map(leaves, value.values()))
    if isinstance(value, list | tuple):
        return sum(map(leaves, value))
    return 1


def _same(claimed: Any, derived: Any, path: _Path) -> bool:
    numbers = all(
        isinstance(one, int | float) and not isinstance(one, bool) for one in (claimed, derived)
    )
    if numbers:
        timed = bool(path) and str(path[-1]).endswith("_s")
        allowed = _ROUNDING * max(1.0, abs(derived))
        return bool(abs(claimed - derived) <= (max(_SAME_TIME_S, allowed) if timed else allowed))
    return type(claimed) is type(derived) and bool(claimed == derived)


def _shown(value: Any) -> str:
    text = f"{value:.10g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."
