"""What is kept of verdicts, what became of a test of them, and what filling the cache came to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.checks.verdict_folder import KeptVerdict
from skillplan.checks.verification import Trial
from skillplan.model.enumeration import Enumeration
from skillplan.task.task import Task
from skillplan.task.verdict import VerdictStatus
from skillplan.views.tables.table import Column, Table

SCHEMA = "skillplan.cache/1"


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
            "schema": SCHEMA,
            "action": "show",
            "folder": str(self.folder),
            "task": None if self.task is None else _named(self.task),
            "verdicts": len(self.kept),
            "took_s": sum(one.record.took_s for one in self.kept),
            "unusable_files": self.others,
            "rows": self.rows(),
        }

    def table(self) -> Table:
        """Return a row for every back end and task."""
        columns = [
            Column("back end"),
            Column("task"),
            *(Column(name, right=True) for name in ("verdicts", "feasible", "infeasible")),
            *(Column(name, right=True) for name in ("size", "newest", "oldest", "took [s]")),
        ]
        rows = [
            (
                row["back_end"],
                row["task"],
                f"{row['verdicts']:,}",
                f"{row['feasible']:,}",
                f"{row['infeasible']:,}",
                _size(row["size_bytes"]),
                _age(row["newest_s"]),
                _age(row["oldest_s"]),
                f"{row['took_s']:.1f}",
            )
            for row in self.rows()
        ]
        notes = [f"folder  {self.folder}"]
        if self.kept:
            total_s = sum(one.record.took_s for one in self.kept)
            notes.append(f"saved   {total_s:.1f} s of checks, whenever all of them are needed")
        if self.others:
            notes.append(
                f"{self.others} more files are damaged, unfinished or of an earlier version: "
                "'skillplan cache clear' removes them."
            )
        what = "verdicts kept"
        if self.task is not None:
            what = f"{self.task.name}: verdicts that it would use"
        return Table(f"{what}: {len(self.kept):,}", columns, rows, notes)


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
    """

    task: Task
    kept: int
    trials: Sequence[Trial]
    seed: int
    interrupted: bool = False
    dropped: int = 0

    @property
    def different(self) -> list[Trial]:
        """Those whose fresh verdict is another."""
        return [trial for trial in self.trials if not trial.same]

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.cache/1`` of ``cache verify``."""
        return {
            "schema": SCHEMA,
            "action": "verify",
            "task": _named(self.task),
            "seed": self.seed,
            "kept": self.kept,
            "tried": len(self.trials),
            "different": len(self.different),
            "dropped": self.dropped,
            "interrupted": self.interrupted,
            "rows": [
                {
                    "back_end": trial.kept.record.back_end,
                    "skill": trial.kept.record.skill,
                    "present": list(trial.kept.record.present),
                    "absent": list(trial.kept.record.absent),
                    "same": trial.same,
                    "differs_in": list(trial.differs_in),
                    "kept": _said(trial.kept.record.status, trial.kept.record.reason),
                    "fresh": _said(trial.fresh.status, trial.fresh.reason),
                }
                for trial in self.trials
            ],
        }

    def table(self) -> Table:
        """Return a row for every verdict tried."""
        columns = [Column(name) for name in ("back end", "skill", "kept", "fresh")]
        columns += [Column("differs in"), Column("rests on", below=True)]
        rows = [
            (
                row["back_end"],
                row["skill"],
                row["kept"]["status"],
                "same" if row["same"] else row["fresh"]["status"],
                ", ".join(row["differs_in"]) or "-",
                ", ".join([*row["present"], *(f"not {name}" for name in row["absent"])])
                or "no fact",
            )
            for row in self.document()["rows"]
        ]
        notes = [f"tried {len(self.trials)} of {self.kept:,} kept verdicts, seed {self.seed}"]
        if not self.kept:
            notes = ["Nothing is kept that this task would use: 'skillplan cache fill' does that."]
        elif self.different:
            stuck = len(self.different) - self.dropped
            notes.append(f"{len(self.different)} are different and have been dropped")
            if stuck:
                notes[-1] = f"{len(self.different)} are different; {stuck} could not be removed"
        elif self.trials:
            notes.append("every one of them is the same, bit for bit")
        if self.interrupted:
            notes.append("interrupted")
        return Table(f"{self.task.name}: kept verdicts asked anew", columns, rows, notes)


@dataclass(frozen=True)
class CacheFilling:
    """What asking everything came to.

    Parameters
    ----------
    task
        What was asked about.
    back_ends
        Names of those asked.
    counts
        Of states, questions and checks.
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
            "schema": SCHEMA,
            "action": "fill",
            "task": _named(self.task),
            "back_ends": list(self.back_ends),
            "folder": None if self.folder is None else str(self.folder),
            "states": counts.states,
            "questions": counts.questions,
            "feasible": counts.feasible,
            "unknown": counts.unknown,
            "checks": counts.checks,
            "cache_hits": counts.hits,
            "executions": counts.executions,
            "executions_by_state": counts.executions_by_state,
            "wall_s": self.wall_s,
            "interrupted": not counts.complete,
        }

    def table(self) -> Table:
        """Return the counts in one row."""
        counts = self.counts
        columns = [
            Column(name, right=True)
            for name in ("states", "questions", "feasible", "executions", "by state", "s")
        ]
        figures = (
            counts.states,
            counts.questions,
            counts.feasible,
            counts.executions,
            counts.executions_by_state,
        )
        rows = [(*(f"{figure:,}" for figure in figures), f"{self.wall_s:.1f}")]
        notes = [
            "by state: executions with verdicts kept by state and skill instead of by facts",
            "nothing is kept on disk" if self.folder is None else f"kept in {self.folder}",
        ]
        if counts.unknown:
            notes.append(f"{counts.unknown:,} questions could not be decided")
        if not counts.complete:
            notes.append("interrupted: what was decided by then is kept")
        title = f"{self.task.name}: complete feasibility by {', '.join(self.back_ends)}"
        return Table(title, columns, rows, notes)


def clearing_document(folder: Path, task: str | None, removed: int) -> dict[str, Any]:
    """Return the JSON document ``skillplan.cache/1`` of ``cache clear``."""
    return {
        "schema": SCHEMA,
        "action": "clear",
        "folder": str(folder),
        "task": task,
        "removed": removed,
    }


def clearing_table(folder: Path, task: str | None, removed: int) -> Table:
    """Return how many files were removed."""
    columns = [Column("of"), Column("files removed", right=True)]
    rows = [("all tasks" if task is None else task, f"{removed:,}")]
    return Table("kept verdicts removed", columns, rows, [f"folder  {folder}"])


def _named(task: Task) -> dict[str, str]:
    return {"name": task.name, "kind": task.kind, "sha256": task.sha256}


def _said(status: VerdictStatus, reason: str) -> dict[str, str]:
    return {"status": status.value, "reason": reason}


def _count(group: Sequence[KeptVerdict], status: VerdictStatus) -> int:
    return sum(one.record.status is status for one in group)


def _size(size_bytes: int) -> str:
    return f"{size_bytes / 1000:,.1f} kB"


def _age(age_s: float) -> str:
    for unit, length_s in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if age_s >= length_s:
            return f"{age_s / length_s:.0f} {unit}"
    return f"{age_s:.0f} s"
