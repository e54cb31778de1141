"""Messages about schema faults, for authors of task files."""

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
    "float_parsing": "a number",
    "int_parsing": "a whole number",
    "bool_parsing": "true or false",
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
# Faults whose message includes the description of the key, with unit and order.
_EXPLAINED = {"list_type", "dict_type", "too_short", "too_long", *_BOUNDS}
# Enough for a reader; finding the nearest key takes time for each.
_MOST = 1000

ONE, SEVERAL, WORD = "<one>", "<several>", "<word>"
"""Tags of alternative forms of a value, for pydantic; messages omit them."""
_TAGS = frozenset({ONE, SEVERAL, WORD})


class Located(ValueError):
    """Raised in a validator to name the faulty key of the model."""

    def __init__(self, message: str, *path: str | int) -> None:
        self.path = path
        super().__init__(message)


def list_schema_issues(error: ValidationError, model: type[BaseModel]) -> list[Issue]:
    """Return an issue for each fault, a thousand at most."""
    issues = []
    for fault in error.errors(include_url=False)[:_MOST]:
        path = remove_tags(fault["loc"])
        kind = fault["type"]
        if kind == "extra_forbidden":
            hint = name_hint(str(path[-1]), list_fields_at(model, path[:-1]))
            issues.append(Issue(f"unknown key {shown(path[-1])}. {hint}", path, at_key=True))
        elif kind == "missing":
            meaning = _meaning(model, path)
            message = f"key {path[-1]!r} is missing{f': {meaning}' if meaning else ''}."
            issues.append(Issue(message, path, at_key=True))
        elif _concerns_key(fault):
            issues.append(Issue(f"key {_words(fault)}", path[:-1], at_key=True))
        else:
            cause = fault.get("ctx", {}).get("error")
            if isinstance(cause, Located):
                path = (*path, *cause.path)
            words, meaning = _words(fault), _meaning(model, path)
            if kind in _EXPLAINED and meaning:
                words = f"{words.removesuffix('.')} ({meaning})."
            issues.append(Issue(words, path))
    return issues


def remove_tags(location: Iterable[str | int]) -> tuple[str | int, ...]:
    """Return the path of a fault, without tags of alternative forms."""
    return tuple(step for step in location if step not in _TAGS)


def _concerns_key(fault: Mapping[str, Any]) -> bool:
    """Return whether the fault concerns the key of a mapping: the last step is '[key]'."""
    *path, last = fault["loc"] or ("",)
    return last == "[key]" and bool(path) and path[-1] == fault["input"]


def _words(fault: Mapping[str, Any]) -> str:
    kind, value, context = fault["type"], fault["input"], fault.get("ctx", {})
    if kind in _KINDS:
        return f"must be {_KINDS[kind]}, not {shown(value)}."
    if kind in _BOUNDS:
        sign, bound = _BOUNDS[kind]
        most = context[bound]
        most = f"{most:.10g}" if isinstance(most, float) else most
        return f"must be {sign}{most}, not {shown(value)}."
    if kind in ("too_short", "too_long"):
        bound = context.get("min_length") if kind == "too_short" else context.get("max_length")
        word = "at least" if kind == "too_short" else "at most"
        entries = "entry" if bound == 1 else "entries"
        return f"must have {word} {bound} {entries}, not {len(value)}."
    if kind == "string_too_long":
        return f"must have at most {context['max_length']} characters, not {len(value)}."
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
    """Return a value for a message: short, and as YAML."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "a list"
    if isinstance(value, str) and len(value) > 48:
        return repr(value[:45] + "...")
    text = repr(value)
    return text if len(text) <= 48 else text[:45] + "..."


def continue_sentence(sentence: str) -> str:
    """Return a sentence for the middle of a line, with a small first letter.

    Leading names, such as G41 or X, are kept.
    """
    word = sentence.partition(" ")[0]
    is_name = word != "A" and not (len(word) > 1 and word[1:].islower())
    return sentence if is_name else sentence[0].lower() + sentence[1:]


def _meaning(model: type[BaseModel], path: Sequence[str | int]) -> str:
    """Return the description of the key at a path, or of the list with this entry.

    The description ends at a semicolon; the rest is about the default.
    """
    while path and isinstance(path[-1], int):
        path = path[:-1]
    if not path:
        return ""
    fields = _model_at(model, path[:-1])
    info = None if fields is None else fields.model_fields.get(str(path[-1]))
    description = (info.description if info is not None else None) or ""
    return description.partition(";")[0]


def list_fields_at(model: type[BaseModel], path: Iterable[str | int]) -> list[str]:
    """Return the keys that `model` allows at a path."""
    resolved = _model_at(model, path)
    if resolved is None:
        return []
    return [info.alias or name for name, info in resolved.model_fields.items()]


def _model_at(model: type[BaseModel], path: Iterable[str | int]) -> type[BaseModel] | None:
    here: Any = model
    for step in path:
        here = _child(here, step)
    return _model_in(here)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in typing.get_args(annotation):
        model_in = _model_in(argument)
        if model_in is not None:
            return model_in
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
            child = _child(argument, step)
            if child is not None:
                return child
    return None
