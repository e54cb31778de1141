"""Installed plugins and their options."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from skillplan.records.plugin_info import PluginInfo
from skillplan.views.text.table import Column, Table

_BOUNDS = {
    "minimum": ">= ",
    "exclusiveMinimum": "> ",
    "maximum": "<= ",
    "exclusiveMaximum": "< ",
}


def plugin_tables(infos: Sequence[PluginInfo], options: type[BaseModel] | None) -> list[Table]:
    """Return the plugins and, where there is one only, its options."""
    headings = ("kind", "name", "distribution", "version", "what it does")
    rows = [
        (
            info.kind,
            info.name,
            info.distribution,
            info.version,
            f"BROKEN: {info.problem}" if info.problem else info.summary,
        )
        for info in infos
    ]
    tables = [Table("installed plugins", [Column(heading) for heading in headings], rows)]
    if options is not None:
        tables.append(_option_table(infos[0].name, options))
    return tables


def _option_table(name: str, options: type[BaseModel]) -> Table:
    properties = options.model_json_schema().get("properties", {})
    rows = [
        (
            key,
            _type(field),
            _default(field),
            _range(field),
            str(field.get("description", "")),
        )
        for key, field in properties.items()
    ]
    headings = ("option", "type", "default", "range", "what it is [unit]")
    title = f"options of {name}" if rows else f"{name} has no options"
    return Table(title, [Column(heading) for heading in headings], rows)


def _default(field: Mapping[str, Any]) -> str:
    """Return the default of an option, as a file and ``-O`` have it."""
    default = field.get("default", "required")
    return default if isinstance(default, str) else json.dumps(default)


def _type(field: Mapping[str, Any]) -> str:
    """Return the type of an option; of an optional one that of its value."""
    kinds = [kind.get("type") for kind in field.get("anyOf", ())]
    return str(field.get("type") or " or ".join(str(k) for k in kinds if k != "null") or "any")


def _range(field: Mapping[str, Any]) -> str:
    """Return the bounds of an option, or its words."""
    kinds = (field, *field.get("anyOf", ()))
    for kind in kinds:
        if "enum" in kind or "const" in kind:
            return " or ".join(str(word) for word in kind.get("enum", [kind.get("const")]))
    for kind in kinds:
        bounds = [f"{sign}{kind[bound]}" for bound, sign in _BOUNDS.items() if bound in kind]
        if bounds:
            return ", ".join(bounds)
    return "-"
