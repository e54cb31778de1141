"""Documents about kept verdicts: content of the cache, and results of testing and filling it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.checks.audit import Trial
from skillplan.checks.verdict_files import KeptVerdict
from skillplan.model.enumeration import Enumeration
from skillplan.records import schemas
from skillplan.task.task import Task
from skillplan.task.verdict import VerdictStatus


@dataclass(frozen=True)
class CacheSurvey:
    """The content of the cache.

    Parameters
    ----------
    folder
        Folder of the cache.
    kept
        The kept verdicts.
    now_s
        The present time [s since 1970].
    others
        Number of other files in the folder, from which no verdict is read.
    task
        The task whose back ends would use the verdicts; None for all tasks.
    """

    folder: Path
    kept: Sequence[KeptVerdict]
    now_s: float
    others: int = 0
    task: Task | None = None

    def rows(self) -> list[dict[str, Any]]:
        """Return the verdicts by back end and task, as JSON values; ages in seconds."""
        groups: dict[tuple[str, str], list[KeptVerdict]] = {}
        for verdict in self.kept:
            groups.setdefault((verdict.record.back_end, verdict.record.task), []).append(verdict)
        return [
            {
                "back_end": back_end,
                "task": task,
                "verdicts": len(group),
                "feasible": _count(group, VerdictStatus.FEASIBLE),
                "infeasible": _count(group, VerdictStatus.INFEASIBLE),
                "size_bytes": sum(verdict.size_bytes for verdict in group),
                "newest_s": max(0.0, self.now_s - max(verdict.modified_s for verdict in group)),
                "oldest_s": max(0.0, self.now_s - min(verdict.modified_s for verdict in group)),
                "took_s": sum(verdict.record.took_s for verdict in group),
            }
            for (back_end, task), group in sorted(groups.items())
        ]

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.cache/1`` of ``cache show``."""
        return {
            "schema": schemas.CACHE,
            "action": "show",
            "folder": str(self.folder),
            "task": None if self.task is None else _named(self.task),
            "verdicts": len(self.kept),
            "took_s": sum(verdict.record.took_s for verdict in self.kept),
            "unusable_files": self.others,
            "rows": self.rows(),
        }


@dataclass(frozen=True)
class CacheTest:
    """The result of a test of kept verdicts.

    Parameters
    ----------
    task
        The task of the verdicts.
    kept
        Number of kept verdicts to choose from.
    trials
        The verdicts that were computed again.
    seed
        Seed of the choice.
    interrupted
        True if the test ended early.
    dropped
        Number of different verdicts that were removed.
    elsewhere
        True if the verdicts were computed in other states than before.
    nowhere_else
        Number of chosen verdicts that apply in no other known state.
    """

    task: Task
    kept: int
    trials: Sequence[Trial]
    seed: int
    interrupted: bool = False
    dropped: int = 0
    elsewhere: bool = False
    nowhere_else: int = 0

    @property
    def different(self) -> list[Trial]:
        """The trials with a different verdict."""
        return [trial for trial in self.trials if not trial.same]

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.cache/1`` of ``cache verify``."""
        return {
            "schema": schemas.CACHE,
            "action": "verify",
            "task": _named(self.task),
            "seed": self.seed,
            "kept": self.kept,
            "tried": len(self.trials),
            "different": len(self.different),
            "dropped": self.dropped,
            "interrupted": self.interrupted,
            "elsewhere": self.elsewhere,
            "nowhere_else": self.nowhere_else,
            "rows": [
                {
                    "back_end": trial.kept.record.back_end,
                    "skill": trial.kept.record.skill,
                    "present": list(trial.kept.record.present),
                    "absent": list(trial.kept.record.absent),
                    "state": list(trial.state),
                    "same": trial.same,
                    "differs_in": list(trial.differs_in),
                    "kept": _said(trial.kept.record.status, trial.kept.record.reason),
                    "fresh": _said(trial.fresh.status, trial.fresh.reason),
                }
                for trial in self.trials
            ],
        }


@dataclass(frozen=True)
class CacheFilling:
    """The result of checking everything.

    Parameters
    ----------
    task
        The task.
    back_ends
        Names of the back ends that were queried.
    counts
        Numbers of states, queries and checks.
    wall_s
        Duration [s].
    folder
        Folder of the kept verdicts; None if they are not kept.
    """

    task: Task
    back_ends: Sequence[str]
    counts: Enumeration
    wall_s: float
    folder: Path | None = None

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.cache/1`` of ``cache fill``."""
        counts = self.counts
        return {
            "schema": schemas.CACHE,
            "action": "fill",
            "task": _named(self.task),
            "back_ends": list(self.back_ends),
            "folder": None if self.folder is None else str(self.folder),
            "states": counts.states,
            "questions": counts.queries,
            "feasible": counts.feasible,
            "unknown": counts.unknown,
            "checks": counts.checks,
            "cache_hits": counts.hits,
            "executions": counts.executions,
            "executions_by_state": counts.executions_by_state,
            "wall_s": self.wall_s,
            "interrupted": not counts.complete,
        }


def make_clearing_document(folder: Path, task: str | None, removed: int) -> dict[str, Any]:
    """Return the JSON document ``skillplan.cache/1`` of ``cache clear``."""
    return {
        "schema": schemas.CACHE,
        "action": "clear",
        "folder": str(folder),
        "task": task,
        "removed": removed,
    }


def _named(task: Task) -> dict[str, str]:
    return {"name": task.name, "kind": task.kind, "sha256": task.sha256}


def _said(status: VerdictStatus, reason: str) -> dict[str, str]:
    return {"status": status.value, "reason": reason}


def _count(group: Sequence[KeptVerdict], status: VerdictStatus) -> int:
    return sum(verdict.record.status is status for verdict in group)
