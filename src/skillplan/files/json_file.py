"""JSON as plain data under limits, and documents that are checked when they are read."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from skillplan.errors import OptionError
from skillplan.files.regular_file import read_bytes
from skillplan.files.schema_errors import list_schema_issues

MAX_DEPTH = 64
_MOST_DIGITS = 300

_STRING = re.compile(rb'"(?:[^"\\]++|\\.)*+"?', re.DOTALL)
# All brackets become square; other characters are dropped.
_BRACKETS = bytes.maketrans(b"{}", b"[]")
_OTHERS = bytes(set(range(256)) - set(b"[]{}"))


def parse_json(content: bytes | str) -> Any:
    """Return the value of a JSON text.

    Raises
    ------
    ValueError
        If it is not JSON, nested deeper than `MAX_DEPTH`, repeats a key in an object, or has a
        number that is not finite.
    """
    raw = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
    if _is_too_deep(raw):
        raise ValueError(f"it is nested deeper than {MAX_DEPTH} levels")
    return _DECODER.decode(content if isinstance(content, str) else raw.decode("utf-8-sig"))


def _is_too_deep(raw: bytes) -> bool:
    """Return whether brackets are nested beyond the limit; checked before the parser recurses."""
    if raw.count(b"[") + raw.count(b"{") <= MAX_DEPTH:
        return False
    brackets = _STRING.sub(b"", raw).translate(_BRACKETS, _OTHERS)
    # Each round removes the innermost pairs. If brackets do not match, the parser reports it
    # better, unless it would recurse too deep.
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


_MOST_BYTES = 64 * 1024 * 1024
_Content = TypeVar("_Content", bound=BaseModel)


def format_document(schema: str, content: BaseModel | Mapping[str, Any]) -> str:
    """Return the text of a document, which starts with the name of its schema.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    values = content.model_dump(mode="json") if isinstance(content, BaseModel) else dict(content)
    return json.dumps({"schema": schema, **values}, indent=2, allow_nan=False)


def read_document(
    path: Path, schema: str, remedy: str, *, within: Path | None = None
) -> dict[str, Any]:
    """Return the content of a document that `format_document` wrote, without its schema name.

    Parameters
    ----------
    schema
        Name of the schema with its version, such as ``skillplan.run/1``.
    remedy
        Advice for damaged files; no full stop.
    within
        Folder that must contain the file, with no link on the way; None for any.

    Raises
    ------
    OptionError
        If it cannot be read, is no such document, or has another version.
    """
    try:
        document = parse_json(read_bytes(path, _MOST_BYTES, within=within))
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}. {remedy}.") from None
    except ValueError as error:
        raise OptionError(f"{path}: is damaged: {error}. {remedy}.") from None
    name = document.pop("schema", None) if isinstance(document, dict) else None
    if isinstance(name, str) and name != schema:
        kind = schema.partition("/")[0]
        if name.partition("/")[0] == kind:
            raise OptionError(
                f"{path}: is of another version, {name}; this skillplan reads {schema}. Use the "
                "version that wrote it."
            )
    if name != schema:
        raise OptionError(f"{path}: is no document {schema}. {remedy}.")
    assert isinstance(document, dict)
    return document


def read_checked(
    path: Path, schema: str, model: type[_Content], remedy: str, *, within: Path | None = None
) -> _Content:
    """Return a document as a validated model.

    Raises
    ------
    OptionError
        As for `read_document`, or if the content does not match.
    """
    document = read_document(path, schema, remedy, within=within)
    return validate_document(document, path, model, remedy)


def validate_document(
    document: Mapping[str, Any], path: Path, model: type[_Content], remedy: str
) -> _Content:
    """Return the content of a document as a validated model.

    Raises
    ------
    OptionError
        If the content does not match.
    """
    try:
        return model.model_validate_json(json.dumps(document))
    except ValidationError as error:
        fault = str(list_schema_issues(error, model)[0]).rstrip(".")
        raise OptionError(f"{path}: is damaged: {fault}. {remedy}.") from None


def find_json_fault(value: Mapping[str, Any]) -> str | None:
    """Return the reason why a mapping is not JSON, or None; NaN and infinity are not."""
    try:
        json.dumps(dict(value), allow_nan=False)
    except (TypeError, ValueError) as error:
        return str(error)
    return None
