"""What elements of a URDF say: names, numbers and poses."""

from __future__ import annotations

import math

from skillplan.robots.arm_description import Triple
from skillplan.robots.rigid import Rigid
from skillplan.xml_tree import Element


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


def number(element: Element, key: str, default: float | None = None) -> float:
    """Return a number that an element gives.

    Raises
    ------
    UrdfError
        If it gives none and there is no default, or one that is not finite.
    """
    text = element.attributes.get(key)
    if text is None and default is not None:
        return default
    return _finite(element, key, text)


def numbers(element: Element, key: str, default: Triple) -> Triple:
    """Return three numbers that an element gives.

    Raises
    ------
    UrdfError
        If it gives others than three finite ones.
    """
    text = element.attributes.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        raise UrdfError(f"{key}={text[:40]!r} are not three numbers", line=element.line)
    x, y, z = (_finite(element, key, word) for word in words)
    return (x, y, z)


def pose_of(element: Element) -> Rigid:
    """Return what the <origin> of an element says; nowhere else where it has none."""
    origin = element.first("origin")
    if origin is None:
        return Rigid()
    zero = (0.0, 0.0, 0.0)
    return Rigid.of(numbers(origin, "xyz", zero), numbers(origin, "rpy", zero))


def _finite(element: Element, key: str, text: str | None) -> float:
    try:
        value = float(text if text is not None else "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        given = "nothing" if text is None else repr(text[:40])
        words = f"<{element.tag}> needs a number as {key!r}, and has {given}"
        raise UrdfError(words, line=element.line)
    return value
