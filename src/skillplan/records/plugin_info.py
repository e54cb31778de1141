"""Installed plugins, as they are listed: the document ``skillplan.plugins/1``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from skillplan.records import schemas

if TYPE_CHECKING:
    from pydantic import BaseModel


@dataclass(frozen=True)
class PluginInfo:
    """One line of ``skillplan plugins``.

    Parameters
    ----------
    kind, name
        What it is and what it is called.
    distribution, version
        Who provides it.
    summary
        First line of its docstring; empty where it is broken.
    problem
        Why it cannot be used, or None.
    """

    kind: str
    name: str
    distribution: str
    version: str
    summary: str
    problem: str | None = None


def plugin_document(infos: Sequence[PluginInfo], options: type[BaseModel] | None) -> dict[str, Any]:
    """Return the JSON document ``skillplan.plugins/1``."""
    return {
        "schema": schemas.PLUGINS,
        "plugins": [
            {
                "kind": info.kind,
                "name": info.name,
                "distribution": info.distribution,
                "version": info.version,
                "summary": info.summary,
                "problem": info.problem,
            }
            for info in infos
        ],
        "options": None if options is None else options.model_json_schema(),
    }
