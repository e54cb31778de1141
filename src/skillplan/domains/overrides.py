"""Values given beside a task file, which is read as if it held them."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any

from skillplan.errors import OptionError, TaskError
from skillplan.files.yaml import Document, parse

# As deep as a task file may be nested.
_MOST_STEPS = 32


def overridden(document: Document, changes: Mapping[str, str]) -> Document:
    """Return the document with some values changed.

    Parameters
    ----------
    document
        A task file's content: a mapping.
    changes
        YAML value by key path, such as ``base.goal_choice`` or ``trajectory.vertices_m.0``.
        Mappings that are missing on the path are made.

    Raises
    ------
    OptionError
        If a path leads through something that is neither mapping nor list, or a value is not
        YAML.
    """
    if not changes or not isinstance(document.data, dict):
        return document
    data = deepcopy(document.data)
    values = dict(document.values)
    given: list[tuple[str | int, ...]] = []
    for key, text in changes.items():
        path = _put(data, key, _value(key, text))
        given.append(path)
        # What stands in the file there is not what counts.
        for known in list(values):
            if known[: len(path)] == path:
                del values[known]
    return replace(document, data=data, values=values, given=tuple(given))


def _value(key: str, text: str) -> Any:
    if not text.strip():
        raise OptionError(f"--set {key[:40]}= has no value. Write null for none.")
    try:
        document = parse(text, f"--set {key}")
    except TaskError as error:
        raise OptionError(str(error)) from None
    if document.issues:
        raise OptionError(str(document.error([])))
    return document.data


def _put(data: Any, key: str, value: Any) -> tuple[str | int, ...]:
    """Set a value in nested data and return its path."""
    steps = key.split(".")
    if len(steps) > _MOST_STEPS:
        raise OptionError(f"--set {key[:40]}...: more than {_MOST_STEPS} keys deep.")
    here, path = data, list[str | int]()
    for number, step in enumerate(steps, start=1):
        last = number == len(steps)
        if isinstance(here, list):
            index = _index(step, len(here))
            if index is None:
                holder = f"--set {_short(key)}: {_short('.'.join(steps[: number - 1]))}"
                if not here:
                    raise OptionError(f"{holder} is an empty list. Give all of it.")
                raise OptionError(
                    f"{holder} is a list of {len(here)}; "
                    f"give an index from 0 to {len(here) - 1} instead of {_short(step)!r}."
                )
            path.append(index)
            if last:
                here[index] = value
            here = here[index]
        elif isinstance(here, dict):
            path.append(step)
            if last:
                here[step] = value
            elif here.get(step) is None:
                here[step] = {}
            here = here[step]
        else:
            holder = f"--set {_short(key)}: {_short('.'.join(steps[: number - 1]))}"
            raise OptionError(f"{holder} is a single value and has no keys.")
    return tuple(path)


def _index(step: str, length: int) -> int | None:
    """Return the index that a step names; None where it is none of a list of this length."""
    # No list is as long as a number of ten digits, and int() refuses very long ones.
    if not (step.isascii() and step.isdigit() and len(step) < 10):
        return None
    return int(step) if int(step) < length else None


def _short(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
