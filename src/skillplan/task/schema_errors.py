"""What a schema found wrong, in words for the author of a task file."""

from __future__ import annotations

import typing
from collections.abc import Iterable, Mapping, Sequence
from types import UnionType
from typing import Any

from pydantic import BaseModel, ValidationError

from skillplan.errors import Issue, name_hint

_KINDS = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": ("> ", "gt"),
    "greater_than_equal": (">= ", "ge"),
    "less_than": ("< ", "lt"),
    "less_than_equal": ("<= ", "le"),
}


class Located(ValueError):
    """Raised inside a validator to say which key of the model is at fault."""

    def __init__(self, message: str, *path: str | int) -> None:
        self.path = path
        super().__init__(message)


def schema_issues(error: ValidationError, model: type[BaseModel]) -> list[tuple[Issue, bool]]:
    """Return an issue for each fault, and whether it concerns the key rather than the value."""
    found = []
    for fault in error.errors(include_url=False):
        path = tuple(fault["loc"])
        kind = fault["type"]
        if kind == "extra_forbidden":
            hint = name_hint(str(path[-1]), fields_at(model, path[:-1]))
            found.append((Issue(f"unknown key {path[-1]!r}. {hint}", path), True))
        elif kind == "missing":
            found.append((Issue(f"key {path[-1]!r} is missing.", path), True))
        else:
            cause = fault.get("ctx", {}).get("error")
            if isinstance(cause, Located):
                path = (*path, *cause.path)
            found.append((Issue(_words(fault), path), path[-1:] == ("[key]",)))
    return [(_without_key_marker(issue), key) for issue, key in found]


def _without_key_marker(issue: Issue) -> Issue:
    if issue.path[-1:] == ("[key]",):
        return Issue(f"key {issue.path[-2]!r}: {issue.message}", issue.path[:-1])
    return issue


def _words(fault: Mapping[str, Any]) -> str:
    kind, value, context = fault["type"], fault["input"], fault.get("ctx", {})
    if kind in _KINDS:
        return f"must be {_KINDS[kind]}, not {shown(value)}."
    if kind in _BOUNDS:
        sign, bound = _BOUNDS[kind]
        return f"must be {sign}{context[bound]}, not {shown(value)}."
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length") if kind == "too_short" else context.get("max_length")
        word = "at least" if kind == "too_short" else "at most"
        return f"must have {word} {bound} entries, not {context.get('actual_length')}."
    if kind == "literal_error":
        return f"must be {context['expected']}, not {shown(value)}."
    if kind == "string_pattern_mismatch":
        return (
            f"{shown(value)} is not a name. Use letters, digits, '_' and '-', a letter first, "
            "at most 64."
        )
    if kind == "value_error":
        return str(context["error"])
    return f"{fault['msg']}, not {shown(value)}."


def shown(value: object) -> str:
    """Return a value as a message shows it: short, and in YAML's words."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "a list"
    text = repr(value)
    return text if len(text) <= 48 else text[:45] + "..."


def fields_at(model: type[BaseModel], path: Iterable[str | int]) -> list[str]:
    """Return the keys that `model` allows at a path."""
    here: Any = model
    for step in path:
        here = _child(here, step)
    resolved = _model_in(here)
    if resolved is None:
        return []
    return [info.alias or name for name, info in resolved.model_fields.items()]


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in typing.get_args(annotation):
        found = _model_in(argument)
        if found is not None:
            return found
    return None


def _child(annotation: Any, step: str | int) -> Any:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        for name, info in annotation.model_fields.items():
            if step in (name, info.alias):
                return info.annotation
        return None
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is dict:
        return arguments[1]
    if origin is list:
        return arguments[0]
    if origin in (typing.Union, UnionType, typing.Annotated):
        for argument in arguments:
            found = _child(argument, step)
            if found is not None:
                return found
    return None
