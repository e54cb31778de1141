"""JSON as plain data, under limits.

What the standard library lets pass is refused: values nested without end, a key that stands
twice, numbers that are not finite.
"""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from typing import Any

MAX_DEPTH = 64
_MOST_DIGITS = 300

_STRING = re.compile(rb'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)
# All brackets as one kind; everything else is dropped.
_BRACKETS = bytes.maketrans(b"{}", b"[]")
_OTHERS = bytes(set(range(256)) - set(b"[]{}"))


def parse_json(content: bytes | str) -> Any:
    """Return the value that a JSON text describes.

    Parameters
    ----------
    content
        The text; bytes are UTF-8.

    Raises
    ------
    ValueError
        If it is not JSON, is nested deeper than `MAX_DEPTH`, has a key twice in one object or a
        number that is not finite.
    """
    raw = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
    if _is_too_deep(raw):
        raise ValueError(f"it is nested deeper than {MAX_DEPTH} levels")
    return _DECODER.decode(content if isinstance(content, str) else raw.decode("utf-8-sig"))


def _is_too_deep(raw: bytes) -> bool:
    """Whether brackets are nested beyond the limit; looked at before anything recurses."""
    if raw.count(b"[") + raw.count(b"{") <= MAX_DEPTH:
        return False
    brackets = _STRING.sub(b"", raw).translate(_BRACKETS, _OTHERS)
    # Each round takes away the innermost level. What does not pair is no JSON, which the parser
    # says better, unless it opens so often that the parser would recurse.
    for _ in range(MAX_DEPTH):
        before, brackets = brackets, brackets.replace(b"[]", b"")
        if len(before) == len(brackets):
            break
    return b"[]" in brackets or brackets.count(b"[") > MAX_DEPTH


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) < len(pairs):
        twice = next(key for key, times in Counter(key for key, _ in pairs).items() if times > 1)
        raise ValueError(f"the key {twice[:40]!r} stands twice")
    return content


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text[:40]} is too large")
    return value


def _representable(text: str) -> int:
    """Return an integer that can be converted to a float, as comparisons do."""
    if len(text) > _MOST_DIGITS:
        raise ValueError(f"the number {text[:40]} is too large")
    return int(text)


def _refuse_constant(text: str) -> Any:
    raise ValueError(f"a number must be finite, not {text}")


_DECODER = json.JSONDecoder(
    object_pairs_hook=_object,
    parse_float=_finite,
    parse_int=_representable,
    parse_constant=_refuse_constant,
)
