"""What is kept of verdicts, what became of a test of them, and what filling the cache came to."""

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
    """What is kept.

    Parameters
    ----------
    folder
        Where.
    kept
        The verdicts.
    now_s
        The present time [s since 1970].
    others
        How many files there are besides from which no verdict is read.
    task
        The task whose back ends would use them all; None where all there is was looked at.
    """

    folder: Path
    kept: Sequence[KeptVerdict]
    now_s: float
    others: int = 0
    task: Task | None = None

    def rows(self) -> list[dict[str, Any]]:
        """Return what is kept by back end and task, as JSON values; ages in seconds."""
        groups: dict[tuple[str, str], list[KeptVerdict]] = {}
        for one in self.kept:
            groups.setdefault((one.record.back_end, one.record.task), []).append(one)
        return [
            {
                "back_end": back_end,
                "task": task,
                "verdicts": len(group),
                "feasible": _count(group, VerdictStatus.FEASIBLE),
                "infeasible": _count(group, VerdictStatus.INFEASIBLE),
                "size_bytes": sum(one.size_bytes for one in group),
                "newest_s": max(0.0, self.now_s - max(one.modified_s for one in group)),
                "oldest_s": max(0.0, self.now_s - min(one.modified_s for one in group)),
                "took_s": sum(one.record.took_s for one in group),
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
            "took_s": sum(one.record.took_s for one in self.kept),
            "unusable_files": self.others,
            "rows": self.rows(),
        }


@dataclass(frozen=True)
class CacheTest:
    """What became of a test of kept verdicts.

    Parameters
    ----------
    task
        Whose verdicts.
    kept
        How many there are to choose from.
    trials
        Those that were tried.
    seed
        Governed the choice.
    interrupted
        Whether it was ended before all chosen were tried.
    dropped
        How many of those that are different have been removed.
    elsewhere
        Whether they were tried in other states than they were made in.
    nowhere_else
        How many of those chosen apply in no other state that was found.
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
        """Those whose fresh verdict is another."""
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
    """What checking everything came to.

    Parameters
    ----------
    task
        What was checked.
    back_ends
        Names of those queried.
    counts
        Of states, queries and checks.
    wall_s
        Time it took [s].
    folder
        Where the verdicts are kept now; None where they are not.
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


def clearing_document(folder: Path, task: str | None, removed: int) -> dict[str, Any]:
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
    return sum(one.record.status is status for one in group)
