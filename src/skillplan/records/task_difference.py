"""What differs between two task files, key by key: what a policy was learned on, and another."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from skillplan.domains.load import Problem
from skillplan.errors import format_path

# A value is shown up to so many characters.
_MOST_CHARACTERS = 60
# What a reader of the task may change without making it another task is not compared.
_NOT_COMPARED = ("description", "expect", "family")


class _Missing:
    """Stands where a key is not there."""

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
        Its JSON values; `MISSING` where a side lacks the key.
    """

    path: str
    was: Any
    now: Any

    def __str__(self) -> str:
        return f"{self.path}: {_text(self.was)} there, {_text(self.now)} now"


def resolved_config(problem: Problem) -> dict[str, Any]:
    """Return the content of a task file as its schema reads it, defaults included; JSON values."""
    content: dict[str, Any] = problem.config.model_dump(mode="json")
    return content


def differences(was: Any, now: Any) -> list[Difference]:
    """Return the values in which two JSON documents differ, in the order of their keys.

    Lists of different lengths are one difference; so are values of different types.
    """
    return list(_found((), was, now))


def what_changed(was: Mapping[str, Any], now: Mapping[str, Any], most: int = 8) -> str:
    """Return the differences between two task files in a line, at most so many.

    Parameters
    ----------
    was, now
        What `resolved_config` returned.
    most
        How many are named, >= 1.
    """
    pruned = [{k: v for k, v in one.items() if k not in _NOT_COMPARED} for one in (was, now)]
    found = differences(*pruned)
    if not found:
        return "nothing that its file says"
    rest = f"; and {len(found) - most} more" if len(found) > most else ""
    return "; ".join(str(one) for one in found[:most]) + rest


def _found(path: tuple[str | int, ...], was: Any, now: Any) -> list[Difference]:
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        keys = dict.fromkeys([*was, *now])
        pairs = [(key, was.get(key, MISSING), now.get(key, MISSING)) for key in keys]
        return [one for key, *both in pairs for one in _found((*path, key), *both)]
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        both_at = enumerate(zip(was, now, strict=True))
        return [one for index, both in both_at for one in _found((*path, index), *both)]
    if type(was) is type(now) and was == now:
        return []
    return [Difference(format_path(path) or "the file", was, now)]


def _text(value: Any) -> str:
    text = repr(value) if value is MISSING else json.dumps(value)
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 3]}..."
