"""What `check` has against a task, before it is written."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import ValidationError

from skillplan.domains.assembly import AssemblyDomain
from skillplan.errors import Issue
from skillplan.files.schema_errors import schema_issues


def refused(document: Mapping[str, Any], files: Mapping[str, str]) -> dict[str, str]:
    """Return by the names of parts and screws why `check` refuses a task; nothing if it does not.

    What is about no part goes by an empty name.

    Parameters
    ----------
    document
        What stands in the task file.
    files
        Contents of its meshes by their path within the folder.
    """
    found: dict[str, str] = {}
    with TemporaryDirectory(prefix="skillplan-cad-") as folder:
        for name, content in files.items():
            path = Path(folder, name)
            path.parent.mkdir(exist_ok=True)
            path.write_text(content, "utf-8")
        for issue in _issues(document, folder):
            of_part = len(issue.path) > 1 and issue.path[0] in ("parts", "screws")
            about = str(issue.path[1]) if of_part else ""
            found.setdefault(about, issue.message)
    return found


def _issues(document: Mapping[str, Any], folder: str) -> list[Issue]:
    domain = AssemblyDomain()
    try:
        config = domain.Config.model_validate(document, context={"folder": Path(folder)})
    except ValidationError as error:
        return list(schema_issues(error, domain.Config))
    return list(domain.issues(config))
