"""A task file that was found valid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from skillplan.domains.load import Problem
from skillplan.records import schemas
from skillplan.records.preview import Preview


@dataclass(frozen=True)
class Checked:
    """A valid task file.

    Parameters
    ----------
    problem
        What was loaded.
    back_ends
        Names of the back ends that each of its tasks will query.
    preview
        What is known of it before anything is solved.
    not_checked
        Sentences of these back ends about what they leave unchecked.
    """

    problem: Problem
    back_ends: Sequence[Sequence[str]]
    preview: Preview = field(default_factory=Preview)
    not_checked: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.check/1``."""
        problem = self.problem
        return {
            "schema": schemas.CHECK,
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
            "not_checked": list(self.not_checked),
            **self.preview.document(),
        }
