"""The domain ``sop``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skillplan.domains.domain import Domain
from skillplan.domains.sop.problem import SopConfig, build_task, find_issues
from skillplan.domains.sop.tsplib_file import read_tsplib
from skillplan.errors import Issue
from skillplan.files.yaml import Document
from skillplan.task.task import Task


class SopDomain(Domain):
    """Nodes to be visited one after another, some before others, at least cost."""

    kind = "sop"
    Config = SopConfig
    suffixes = (".sop",)
    max_bytes = 16 * 1_048_576

    def read(self, text: str, source: str) -> Document:
        """Return the content of a TSPLIB file, with a header or a bare matrix."""
        return read_tsplib(text, source)

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return faults of the matrix's shape and of its order."""
        return find_issues(config)

    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the one task of a matrix."""
        return [build_task(config, sha256)]

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the matrix, the source of all facts."""
        return ("costs",)
