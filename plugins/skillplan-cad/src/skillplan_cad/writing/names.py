"""Names that a task file takes, for parts whose names CAD chose."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

_LONGEST = 64


def task_names(names: Iterable[str], taken: Iterable[str] = ()) -> Mapping[str, str]:
    """Return for each part's name one of letters, digits, `_` and `-`, unique among all.

    Parameters
    ----------
    names
        Of parts.
    taken
        Names that no part may have.
    """
    found: dict[str, str] = {}
    seen = set(taken)
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_") or "part"
        if not plain[0].isalpha():
            plain = f"part_{plain}"
        plain = plain[:_LONGEST]
        new, number = plain, 2
        while new in seen:
            end = f"_{number}"
            new, number = f"{plain[: _LONGEST - len(end)]}{end}", number + 1
        seen.add(new)
        found[name] = new
    return found
