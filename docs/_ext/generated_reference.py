"""Sphinx extension that generates the reference from the code at build time.

A line ``<!-- generated: NAME ARGUMENT -->`` in a page is replaced by Markdown: ``commands``,
``keys KIND`` (of task files), ``options KIND`` (of plugins), ``documents`` (JSON, from the schemas
in ``reference/documents``), ``exit-codes``, ``floors``, ``public-names``, ``errors``,
``licences`` and ``limits``.
"""

from __future__ import annotations

import importlib
import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import command_pages
import licences
import limits
import public_names
import schema_tables
import yaml

DOCS = Path(__file__).parents[1]
DOCUMENTS = DOCS / "reference" / "documents"
MARK = re.compile(r"<!-- generated: ([a-z-]+)(?: ([a-z]+))? -->")

EXIT_MEANINGS = {
    "EXIT_SOLVED": "solved, optimal or not; the claim holds; the file is valid",
    "EXIT_NO_PLAN": "no plan found; or the sequence is infeasible or incomplete, the skill not "
    "feasible, or a claim of a result fails",
    "EXIT_WRONG_INPUT": "wrong input, option or plugin; also a solver that refuses the task or is "
    "caught in a wrong claim",
    "EXIT_BACK_END": "a physics or collision back end failed, or contradicts itself; or the proof "
    "of another planner contradicts a result",
    "EXIT_INTERRUPTED": "interrupted by Ctrl-C, SIGTERM or SIGHUP; the best so far is printed",
}


def exit_codes() -> str:
    """Return the table of exit codes, one for each constant of ``skillplan.errors``."""
    from skillplan import errors

    codes = {
        name: value for name, value in vars(errors).items() if re.match(r"EXIT_[A-Z_]+$", name)
    }
    codes = {name: value for name, value in codes.items() if isinstance(value, int)}
    lines = ["| code | constant of `skillplan.errors` | means |", "|--:|---|---|"]
    for name, value in sorted(codes.items(), key=lambda item: item[1]):
        lines.append(f"| {value} | `{name}` | {EXIT_MEANINGS[name]} |")
    return "\n".join(lines)


def floors() -> str:
    """Return the packages from top to bottom, in the order of import-linter, with their content."""
    project = tomllib.loads((DOCS.parent / "pyproject.toml").read_text("utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    layers = next(one["layers"] for one in contracts if one["type"] == "layers")
    lines = ["| floor | holds |", "|---|---|"]
    for layer in layers:
        for name in layer.split("|"):
            module = importlib.import_module(name.strip(" ()"))
            words = " ".join((module.__doc__ or "").split()).replace("``", "`")
            lines.append(f"| `{module.__name__.removeprefix('skillplan.')}` | {words} |")
    return "\n".join(lines)


def task_keys(kind: str) -> str:
    """Return a table for every mapping of a kind of task file."""
    from skillplan.pipeline import registry

    schema = registry.load("domain", kind).Config.model_json_schema()
    pieces = []
    for mapping in schema_tables.mappings(schema):
        if mapping.path.startswith("expect"):
            continue
        title = f"`{mapping.path}`" if mapping.path else "The file"
        pieces.append(f"### {title}\n\n{mapping.meaning}\n\n{schema_tables.table(mapping.keys)}")
    return "\n\n".join(pieces)


def plugin_options(kind: str) -> str:
    """Return a section for every installed plugin of a kind, with its options."""
    depth = "##" if kind == "solver" else "###"  # solvers have a page of their own
    from skillplan.pipeline import registry

    pieces = []
    for info in registry.describe(kind):
        source = f"*From {info.distribution} {info.version}.*"
        pieces.append(f"{depth} `{info.name}`\n\n{info.summary}\n\n{source}")
        if info.problem:
            pieces.append(f"Not usable here: {info.problem}")
            continue
        plugin = registry.load(kind, info.name)
        options = getattr(plugin, "Options", None)
        schema = options.model_json_schema() if options is not None else {}
        keys = [mapping for mapping in schema_tables.mappings(schema) if mapping.keys]
        pieces += [schema_tables.table(mapping.keys) for mapping in keys] or ["It has no options."]
    return "\n\n".join(pieces)


def document_schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON Schema of every document, by its name such as ``skillplan.result/1``."""
    found = {}
    for path in sorted(DOCUMENTS.glob("*.yaml")):
        schema = yaml.safe_load(path.read_text("utf-8"))
        found[schema["properties"]["schema"]["const"]] = schema
    return found


def documents() -> str:
    """Build a section for every JSON document: its command, and its keys with types."""
    pieces = []
    for name, schema in document_schemas().items():
        pieces.append(f"## `{name}`\n\n{schema['description']}")
        for mapping in schema_tables.mappings(schema):
            if not mapping.keys:
                continue
            if mapping.path:
                pieces.append(f"`{mapping.path}`" + f": {mapping.meaning}" * bool(mapping.meaning))
            pieces.append(schema_tables.table(mapping.keys, defaults=False))
    return "\n\n".join(pieces)


GENERATORS: dict[str, Callable[..., str]] = {
    "commands": command_pages.page,
    "exit-codes": exit_codes,
    "floors": floors,
    "keys": task_keys,
    "options": plugin_options,
    "documents": documents,
    "public-names": public_names.page,
    "errors": public_names.errors_page,
    "licences": licences.page,
    "limits": limits.page,
}


def filled(text: str) -> str:
    """Return a page with its marks replaced."""

    def fill(mark: re.Match[str]) -> str:
        name, argument = mark.groups()
        return GENERATORS[name](*[argument] * (argument is not None))

    return MARK.sub(fill, text)


def write_json_schemas(folder: Path) -> None:
    """Write the schemas as JSON for validators, each named after its document."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, schema in document_schemas().items():
        stem = name.removeprefix("skillplan.").replace("/", "-")
        (folder / f"{stem}.schema.json").write_text(f"{json.dumps(schema, indent=2)}\n", "utf-8")


def setup(app: Any) -> dict[str, Any]:
    """Connect the generators to Sphinx."""

    def fill(_app: Any, _name: str, source: list[str]) -> None:
        source[0] = filled(source[0])

    def finish(app: Any, error: Exception | None) -> None:
        if error is None and app.builder.name == "html":
            write_json_schemas(Path(app.outdir) / "schemas")

    app.connect("source-read", fill)
    app.connect("build-finished", finish)
    return {"version": "1", "parallel_read_safe": True}
