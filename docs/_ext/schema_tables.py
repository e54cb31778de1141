"""Tables of keys out of a JSON Schema, as Markdown: task files, plugin options, JSON documents."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

Schema = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a mapping.

    Parameters
    ----------
    path
        Where it stands, such as ``parts.NAME.size_m`` or ``steps[].skill``.
    type_text
        What it takes, with its range.
    default
        What counts where it is left out; "required" where it may not be.
    meaning
        What it is, with its unit.
    """

    path: str
    type_text: str
    default: str
    meaning: str


@dataclass(frozen=True, slots=True)
class Mapping:
    """A mapping of a document: its keys, and where it stands.

    Parameters
    ----------
    path
        Where it stands; empty for the document itself.
    meaning
        What it is; may be empty.
    keys
        Its keys in the order of the schema.
    """

    path: str
    meaning: str
    keys: tuple[Key, ...]


def mappings(schema: Schema) -> Iterator[Mapping]:
    """Yield the document's mapping, then each one that is nested in it, in reading order."""
    seen: set[str] = set()
    waiting: list[tuple[str, Schema]] = [("", schema)]
    while waiting:
        path, current = waiting.pop(0)
        if path in seen:
            continue
        seen.add(path)
        required = set(current.get("required", ()))
        keys, nested = [], []
        for name, own in current.get("properties", {}).items():
            below = f"{path}.{name}" if path else name
            keys.append(
                Key(
                    below,
                    type_text(own, schema),
                    _default(own, required=name in required),
                    _meaning(own, schema),
                )
            )
            nested += list(_inner(below, own, schema))
        yield Mapping(path, current.get("description", ""), tuple(keys))
        waiting = nested + waiting


def _meaning(own: Schema, root: Schema) -> str:
    """Return the description of a value, or of its reference or items."""
    for one in (own, resolved(own, root), resolved(_values(own) or {}, root)):
        if one.get("description"):
            return str(one["description"])
    return ""


def resolved(own: Schema, root: Schema) -> Schema:
    """Return the schema that a reference means, or the schema itself."""
    while "$ref" in own:
        own = root["$defs"][own["$ref"].rpartition("/")[2]]
    return own


def type_text(own: Schema, root: Schema) -> str:
    """Describe the permitted values in words."""
    own = resolved(own, root)
    if "const" in own:
        return f"`{own['const']}`"
    if "enum" in own:
        return " or ".join(f"`{value}`" for value in own["enum"])
    if "oneOf" in own:
        return " or ".join(type_text(one, root) for one in own["oneOf"])
    if "anyOf" in own:
        choices = [one for one in own["anyOf"] if resolved(one, root).get("type") != "null"]
        texts = list(dict.fromkeys(type_text(one, root) for one in choices))
        return " or ".join(texts + ["null"] * ("type" not in own and _only_output(own)))
    kind = own.get("type")
    if isinstance(kind, list):
        return " or ".join(_plain(one, own, root) for one in kind)
    return _plain(kind, own, root)


def _only_output(own: Schema) -> bool:
    # Only documents state null as a value; a key of an input is left out instead.
    return "default" not in own and any(one.get("type") == "null" for one in own["anyOf"])


def _plain(kind: str | None, own: Schema, root: Schema) -> str:
    if kind in ("integer", "number"):
        return _range("whole number" if kind == "integer" else "number", own)
    if kind == "array":
        return _list_text(own, root)
    if kind == "object":
        return "mapping by name" if _values(own) else "mapping"
    words = {"string": "text", "boolean": "true or false", "null": "null", None: "any value"}
    return words[kind]


def _list_text(own: Schema, root: Schema) -> str:
    items = own.get("items")
    if "prefixItems" in own:
        items = own["prefixItems"][0]
    inner = type_text(items, root) if isinstance(items, dict) else "any value"
    least, most = own.get("minItems"), own.get("maxItems")
    count = f"{least} x " if least is not None and least == most else ""
    return f"list of {count}({inner})" if " " in inner else f"list of {count}{inner}"


def _range(word: str, own: Schema) -> str:
    low = own.get("minimum", own.get("exclusiveMinimum"))
    high = own.get("maximum", own.get("exclusiveMaximum"))
    above = ">" if "exclusiveMinimum" in own else "≥"
    below = "<" if "exclusiveMaximum" in own else "≤"
    bounds = []
    if low is not None:
        bounds.append(f"{above} {low:,}" if abs(low) < 1e6 else f"{above} {low:g}")
    if high is not None:
        bounds.append(f"{below} {high:,}" if abs(high) < 1e6 else f"{below} {high:g}")
    return ", ".join([word, *bounds])


def _default(own: Schema, *, required: bool) -> str:
    if required:
        return "required"
    value = own.get("default")
    if value in (None, "", {}, []):
        return "-"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _values(own: Schema) -> Schema | None:
    """Return the schema of the values of a mapping whose keys are free names."""
    for values in (own.get("additionalProperties"), *own.get("patternProperties", {}).values()):
        if isinstance(values, dict) and values:
            return values
    return None


def _inner(path: str, own: Schema, root: Schema) -> Iterator[tuple[str, Schema]]:
    """Yield the mappings that a value holds, with where they stand."""
    own = resolved(own, root)
    forms = own.get("oneOf", [])
    for one in (*own.get("anyOf", ()), *forms):
        # What stands by itself or in a list is described once.
        if one.get("items") not in forms or one.get("items") is None:
            yield from _inner(path, one, root)
    if own.get("properties"):
        yield path, own
    values = _values(own)
    if values is not None:
        yield from _inner(f"{path}.NAME", values, root)
    if isinstance(own.get("items"), dict):
        yield from _inner(f"{path}[]", own["items"], root)


def table(keys: tuple[Key, ...], *, defaults: bool = True) -> str:
    """Return the Markdown table of some keys; without the column of defaults where unwanted."""
    heads = ["key", "takes", *(["default"] * defaults), "is"]
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    for key in keys:
        cells = [f"`{key.path.rpartition('.')[2]}`", key.type_text]
        cells += [key.default] * defaults + [key.meaning]
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(lines)
