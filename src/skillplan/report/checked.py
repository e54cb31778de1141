"""A task file that was found valid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.report.table import Column, Table
from skillplan.task.load import Problem


@dataclass(frozen=True)
class Checked:
    """A valid task file.

    Parameters
    ----------
    problem
        What was loaded.
    back_ends
        Names of the back ends that each of its tasks will ask.
    """

    problem: Problem
    back_ends: Sequence[Sequence[str]]

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.check/1``."""
        problem = self.problem
        return {
            "schema": "skillplan.check/1",
            "task": {"name": problem.name, "kind": problem.kind, "sha256": problem.sha256},
            "valid": True,
            "tasks": [
                {
                    "name": task.name,
                    "skills": len(task.skills),
                    "facts": len(task.facts),
                    "observation": len(task.observation) or len(task.facts),
                    "step_limit": task.step_limit,
                    "back_ends": list(names),
                }
                for task, names in zip(problem.tasks, self.back_ends, strict=True)
            ],
        }

    def table(self) -> Table:
        """Return a row for every task of the file."""
        columns = [
            Column("task"),
            Column("actions", right=True),
            Column("facts", right=True),
            Column("observed", right=True),
            Column("step limit", right=True),
            Column("back ends"),
        ]
        keys = ("skills", "facts", "observation", "step_limit")
        rows = [
            (task["name"], *(str(task[key]) for key in keys), ", ".join(task["back_ends"]))
            for task in self.document()["tasks"]
        ]
        notes = [f"kind       {self.problem.kind}", f"sha256     {self.problem.sha256}"]
        return Table(f"{self.problem.name}: valid", columns, rows, notes)
