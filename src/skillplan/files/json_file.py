"""Documents of JSON that the program keeps for itself: checked when they are read again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from skillplan.errors import OptionError
from skillplan.files.regular_file import read_bytes
from skillplan.files.schema_errors import schema_issues
from skillplan.files.strict_json import parse_json

_MOST_BYTES = 64 * 1024 * 1024
_Content = TypeVar("_Content", bound=BaseModel)


def json_text(schema: str, content: BaseModel | Mapping[str, Any]) -> str:
    """Return a document that begins with the name of its schema.

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
    """Return a document that `json_text` wrote, without the name of its schema.

    Parameters
    ----------
    path
        The file.
    schema
        Its name with a version, such as ``skillplan.run/1``.
    remedy
        What to do where the file is not as it was written; no full stop.
    within
        A folder that the file must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OptionError
        If it cannot be read, is no such document, or one of another version.
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
    """Return a document as a model has it.

    Parameters
    ----------
    path, schema, remedy, within
        As for `read_document`.
    model
        What the content must fit.

    Raises
    ------
    OptionError
        As for `read_document`, or if the content does not fit.
    """
    document = read_document(path, schema, remedy, within=within)
    return fitted(document, path, model, remedy)


def fitted(document: Mapping[str, Any], path: Path, model: type[_Content], remedy: str) -> _Content:
    """Return a document that has been read as a model has it.

    Parameters
    ----------
    document
        As `read_document` gave it.
    path, model, remedy
        As for `read_checked`.

    Raises
    ------
    OptionError
        If the content does not fit.
    """
    try:
        return model.model_validate_json(json.dumps(document))
    except ValidationError as error:
        fault = str(schema_issues(error, model)[0]).rstrip(".")
        raise OptionError(f"{path}: is damaged: {fault}. {remedy}.") from None
