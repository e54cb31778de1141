"""What elements of a URDF say: names, numbers and poses."""

from __future__ import annotations

import math
import re

from skillplan.robots.arm_description import Triple
from skillplan.robots.rigid import Rigid
from skillplan.xml_tree import Element

MOST_NUMBER = 1_000_000.0
"""Greatest magnitude of a number that has no limit of its own."""

MOST_LENGTH_M = 100.0
"""Greatest coordinate and extent [m]."""

# ASCII, and in linear time.
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


class UrdfError(Exception):
    """A URDF describes no arm that can be used.

    Parameters
    ----------
    message
        What is wrong and what to do instead, in a clause.
    key
        The key of the task file that is at fault: ``model``, ``tip`` or ``home_rad``.
    line
        Of the URDF, where there is one.
    """

    def __init__(self, message: str, key: str = "model", line: int | None = None) -> None:
        self.key = key
        self.line = line
        super().__init__(message if line is None else f"line {line}: {message}")


def named(root: Element, tag: str) -> dict[str, Element]:
    """Return the elements of a kind by their names.

    Raises
    ------
    UrdfError
        If one has no name, or two have one.
    """
    found: dict[str, Element] = {}
    for element in root.all(tag):
        name = element.attributes.get("name")
        if not name:
            raise UrdfError(f"a <{tag}> has no name", line=element.line)
        if name in found:
            raise UrdfError(f"two {tag}s are called {name!r}", line=element.line)
        found[name] = element
    return found


def number(
    element: Element, key: str, default: float | None = None, most: float = MOST_NUMBER
) -> float:
    """Return a number that an element gives.

    Parameters
    ----------
    element, key
        Element, and name of its attribute.
    default
        Value if the attribute is missing; None if it must not be.
    most
        Greatest magnitude, > 0.

    Raises
    ------
    UrdfError
        If the attribute is missing and there is no default, or is no number up to `most`.
    """
    text = element.attributes.get(key)
    if text is None and default is not None:
        return default
    return _bounded(element, key, text, most)


def numbers(element: Element, key: str, default: Triple, most: float = MOST_NUMBER) -> Triple:
    """Return three numbers that an element gives.

    Raises
    ------
    UrdfError
        If it gives others than three numbers up to `most`.
    """
    text = element.attributes.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        raise UrdfError(f"{key}={text[:40]!r} are not three numbers", line=element.line)
    x, y, z = (_bounded(element, key, word, most) for word in words)
    return (x, y, z)


def pose_of(element: Element) -> Rigid:
    """Return what the <origin> of an element says; nowhere else where it has none."""
    origin = element.first("origin")
    if origin is None:
        return Rigid()
    zero = (0.0, 0.0, 0.0)
    return Rigid.of(numbers(origin, "xyz", zero, MOST_LENGTH_M), numbers(origin, "rpy", zero))


def _bounded(element: Element, key: str, text: str | None, most: float) -> float:
    # `float` also reads digits of other scripts and underscores, as no other reader of URDF does.
    digits = "" if text is None else text.strip(" \t\r\n")
    value = float(digits) if _DECIMAL.fullmatch(digits) else math.nan
    if not math.isfinite(value):
        given = "nothing" if text is None else repr(text[:40])
        words = f"<{element.tag}> needs a number as {key!r}, and has {given}"
        raise UrdfError(words, line=element.line)
    if abs(value) > most:
        words = f"<{element.tag}> has {value:g} as {key!r}, where {most:,g} is the most"
        raise UrdfError(words, line=element.line)
    return value
