"""Differences between two task files, key by key."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from skillplan.domains.load import Problem
from skillplan.errors import format_path

# Maximum number of characters of a value.
_MOST_CHARACTERS = 60
# Keys whose changes do not make another task.
_NOT_COMPARED = ("description", "expect", "family")


class _Missing:
    """The value of a missing key."""

    def __repr__(self) -> str:
        return "nothing"


MISSING = _Missing()
"""Stands in a difference where one side lacks the key."""


@dataclass(frozen=True, slots=True)
class Difference:
    """A value that differs.

    Parameters
    ----------
    path
        The key path, such as ``parts.pcb.goal_m[0]``.
    was, now
        The JSON values; `MISSING` for a missing key.
    """

    path: str
    was: Any
    now: Any

    def __str__(self) -> str:
        return f"{self.path}: {_text(self.was)} there, {_text(self.now)} now"


def resolve_config(problem: Problem) -> dict[str, Any]:
    """Return the content of a task file with all defaults, as JSON values."""
    content: dict[str, Any] = problem.config.model_dump(mode="json")
    return content


def differences(was: Any, now: Any) -> list[Difference]:
    """Return the values in which two JSON documents differ, in the order of their keys.

    Lists of different lengths are one difference; so are values of different types.
    """
    return list(_found((), was, now))


def describe_changes(was: Mapping[str, Any], now: Mapping[str, Any], most: int = 8) -> str:
    """Return a line about the differences between two task files.

    Parameters
    ----------
    was, now
        Contents from `resolve_config`.
    most
        Maximum number of differences that are named, >= 1.
    """
    pruned = [{k: v for k, v in config.items() if k not in _NOT_COMPARED} for config in (was, now)]
    changed = differences(*pruned)
    if not changed:
        return "nothing that its file says"
    rest = f"; and {len(changed) - most} more" if len(changed) > most else ""
    return "; ".join(str(config) for config in changed[:most]) + rest


def _found(path: tuple[str | int, ...], was: Any, now: Any) -> list[Difference]:
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        keys = dict.fromkeys([*was, *now])
        pairs = [(key, was.get(key, MISSING), now.get(key, MISSING)) for key in keys]
        return [change for key, *both in pairs for change in _found((*path, key), *both)]
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        both_at = enumerate(zip(was, now, strict=True))
        return [change for index, both in both_at for change in _found((*path, index), *both)]
    if type(was) is type(now) and was == now:
        return []
    return [Difference(format_path(path) or "the file", was, now)]


def _text(value: Any) -> str:
    text = repr(value) if value is MISSING else json.dumps(value)
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 3]}..."
