"""The licences of the requirements of skillplan and its plugins, out of the installed metadata."""

from __future__ import annotations

import re
import tomllib
from collections import defaultdict
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
MISSING = "not installed where this page was made"
# What a licence may be called in a `License` field that holds its whole text.
_NAME_CHARACTERS = 60


def projects() -> dict[str, dict[str, Any]]:
    """Return the project tables of the core and of the plugins, by name."""
    paths = [ROOT / "pyproject.toml", *sorted(ROOT.glob("plugins/*/pyproject.toml"))]
    tables = [tomllib.loads(path.read_text("utf-8"))["project"] for path in paths]
    return {table["name"]: table for table in tables}


def direct() -> dict[str, set[str]]:
    """Return the direct requirements of the core and the plugins, each with its users.

    What an extra needs is needed by ``skillplan[test]``, for example.
    """
    found: dict[str, set[str]] = defaultdict(set)
    own = projects()
    for name, table in own.items():
        for text in table["dependencies"]:
            found[canonical(Requirement(text).name)].add(name)
        for extra, texts in table.get("optional-dependencies", {}).items():
            for text in texts:
                found[canonical(Requirement(text).name)].add(f"{name}[{extra}]")
    return {name: by for name, by in found.items() if name not in own}


def all_needed() -> dict[str, set[str]]:
    """Return `direct` with all indirect requirements, each with its users."""
    found = defaultdict(set, direct())
    to_visit = sorted(found)
    while to_visit:
        name = to_visit.pop()
        for text in _requires(name):
            requirement = Requirement(text)
            marker = requirement.marker
            if marker is None or marker.evaluate({"extra": ""}):
                needed = canonical(requirement.name)
                if needed not in found:
                    to_visit.append(needed)
                found[needed].add(name)
    return dict(found)


def licence(name: str) -> str:
    """Return the licence in a distribution's metadata; empty if it is missing."""
    about = metadata.metadata(name)
    expression = about.get("License-Expression")
    if expression:
        return str(expression)
    classifiers = [
        one.rpartition("::")[2].strip()
        for one in about.get_all("Classifier", [])
        if one.startswith("License ::") and not one.endswith("OSI Approved")
    ]
    if classifiers:
        return ", ".join(classifiers)
    first = (about.get("License") or "").strip().partition("\n")[0]
    return first[:_NAME_CHARACTERS]


def page() -> str:
    """Return the table: name, version, licence, needed by."""
    lines = ["| distribution | version | licence | needed by |", "|---|---|---|---|"]
    for name, by in sorted(all_needed().items()):
        try:
            about = metadata.metadata(name)
        except metadata.PackageNotFoundError:
            lines.append(f"| {name} | - | {MISSING} | {', '.join(sorted(by))} |")
            continue
        words = re.sub(r"([|<*])", r"\\\1", licence(name) or "not stated; see its files")
        lines.append(
            f"| {about['Name']} | {about['Version']} | {words} | {', '.join(sorted(by))} |"
        )
    return "\n".join(lines)


def canonical(name: str) -> str:
    """Return a distribution's name as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _requires(name: str) -> list[str]:
    try:
        return metadata.requires(name) or []
    except metadata.PackageNotFoundError:
        return []
