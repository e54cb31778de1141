"""Numbers, evidence and directions in words, and texts with control characters escaped."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

IN_PLACE = "of them in place from the start: the arm does not bring these"
"""Parts of a product in a task that no skill brings."""


def format_percent(fraction: float | None) -> str:
    """Return a fraction in per cent with two decimals, or a dash."""
    return "-" if fraction is None else f"{100 * fraction:.2f} %"


def format_number(value: float | None, decimals: int) -> str:
    """Return a number, or a dash."""
    return "-" if value is None else f"{value:.{decimals}f}"


def format_yes_no(value: bool) -> str:
    """Return a truth value as a word."""
    return "yes" if value else "no"


def count(amount: int, noun: str) -> str:
    """Return an amount with its noun in the singular or plural."""
    return f"{amount:,} {noun}" if amount == 1 else f"{amount:,} {noun}s"


# Starts of words, between spaces and slashes, that contain three letters in a row.
_WORD_START = re.compile(r"(?:^|(?<=[/ ]))(?=[^/ ]*[^\W\d_]{3})")


def describe_covered(covered: tuple[int, int]) -> str:
    """Return how many parts of a product a task has."""
    parts, total = covered
    if parts == total:
        return f"all {total} parts of the product"
    return f"{parts} of {total} parts of the product; {total - parts} left out"


def shorten_names(names: Sequence[str], fits: Callable[[str], bool]) -> list[str]:
    """Return the longest endings of names that fit, without the words that all begin with.

    An ending begins with a word of letters, after a space or ``/``, and differs from all others.
    If none fits, it is the shortest that differs. Equal names stay equal.
    """
    different = set(names)
    low, high = min(different, default=""), max(different, default="")
    shared = next((n for n, (a, b) in enumerate(zip(low, high, strict=False)) if a != b), 0)
    first = max(low.rfind(" ", 0, shared), low.rfind("/", 0, shared)) + 1
    starts = {
        name: [first, *(m.start() for m in _WORD_START.finditer(name) if m.start() > first)]
        for name in different
    }
    counts = Counter(name[start:] for name in different for start in starts[name])
    short = {}
    for name in different:
        endings = [name[start:] for start in starts[name] if counts[name[start:]] == 1]
        short[name] = next((ending for ending in endings if fits(ending)), (endings or [name])[-1])
    return [short[name] for name in names]


# Control, format (bidirectional, zero-width), lone surrogates, line and paragraph separators.
_CATEGORIES = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))
# Invisible letters and marks, and code points reserved for more (DerivedCoreProperties,
# Default_Ignorable_Code_Point), except the selectors of emoji and of Han variants.
_INVISIBLE = frozenset((0x34F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x3164, 0xFFA0, 0x2065))
_UNUSUAL = re.compile(r"[^\n\t\x20-\x7e]")


def escape(text: str) -> str:
    r"""Return a text with control and invisible characters written out, as ``\x1b``.

    Line breaks and tabs stay. Texts of documents, file names, exceptions and verdicts pass through
    this function before they reach a terminal or a page.
    """
    return _UNUSUAL.sub(lambda match: _write_out(match.group()), text)


@cache
def _write_out(character: str) -> str:
    code = ord(character)
    tag = 0xE0000 <= code <= 0xE00FF or 0xE01F0 <= code <= 0xE0FFF
    reserved = 0xFFF0 <= code <= 0xFFF8
    invisible = tag or reserved or code in _INVISIBLE
    if not invisible and unicodedata.category(character) not in _CATEGORIES:
        return character
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def format_evidence(evidence: Mapping[str, Any]) -> str:
    """Return evidence as ``key value`` pairs, with nested evidence in brackets."""
    return ", ".join(f"{key} {_format_value(value)}" for key, value in evidence.items())


def list_evidence(evidence: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return evidence as names and texts, one for each measured quantity."""
    return [
        (
            key,
            (format_evidence(value) or "none")
            if isinstance(value, Mapping)
            else _format_value(value),
        )
        for key, value in evidence.items()
    ]


def _format_value(value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        # Adding 0.0 turns minus zero into zero.
        return f"{value + 0.0:.4g}"
    if isinstance(value, Mapping):
        return f"({format_evidence(value)})" if value else "none"
    if isinstance(value, list | tuple):
        return " ".join(_format_value(item) for item in value) or "none"
    return str(value)


def name_direction(direction: Sequence[float]) -> str:
    """Return ``+x`` and the like, or the three numbers of any other direction."""
    for axis, value in zip("xyz", direction, strict=True):
        if abs(abs(value) - 1) < 1e-6:
            return f"{'+' if value > 0 else '-'}{axis}"
    return " ".join(f"{value:.3g}" for value in direction)
