"""Why a skill is feasible or not in a state: every stage's verdict, facts and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from skillplan.errors import OptionError
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.records import schemas
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


@dataclass(frozen=True)
class Explanation:
    """The verdicts on one skill in one state.

    Parameters
    ----------
    task, skill, state
        What is explained.
    stages
        One verdict a stage, cheapest first, also beyond the first that fails.
    files
        What was drawn of it, such as ``picture``, and where.
    """

    task: Task
    skill: Skill
    state: State
    stages: tuple[Verdict, ...]
    files: Mapping[str, str] = field(default_factory=dict, hash=False)

    def drawn(self, files: Mapping[str, str]) -> Explanation:
        """Return the explanation with what was drawn of it."""
        return replace(self, files=files)

    @property
    def feasible(self) -> bool:
        """Whether every stage passed."""
        return all(verdict.is_feasible for verdict in self.stages)

    @property
    def prediction(self) -> Outcome:
        """What the skill is predicted to change here."""
        skill = self.skill
        return (
            skill.prediction if skill.case(self.state) is None else skill.prediction_in(self.state)
        )

    @property
    def otherwise(self) -> tuple[Outcome, ...]:
        """What may come of it here but is not predicted; empty where nothing is left to chance."""
        skill = self.skill
        fits = not skill.cases or skill.case(self.state) is not None
        return skill.outcomes_in(self.state)[1:] if fits else ()

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.explanation/1``."""
        first = next((v for v in self.stages if not v.is_feasible), None)
        prediction = self.prediction
        return {
            "schema": schemas.EXPLANATION,
            "task": {"name": self.task.name, "sha256": self.task.sha256},
            "skill": self.skill.name,
            "action": self.task.action(self.skill),
            "state": list(self.state),
            "status": first.status.value if first else "feasible",
            "stage": first.stage if first else None,
            "reason": first.reason if first else None,
            "precondition": str(self.skill.condition(self.state)),
            "prediction": {"add": list(prediction.add), "delete": list(prediction.delete)},
            "otherwise": [
                {
                    "probability": outcome.probability,
                    "add": list(outcome.add),
                    "delete": list(outcome.delete),
                }
                for outcome in self.otherwise
            ],
            "stages": [
                {
                    "stage": verdict.stage,
                    "status": verdict.status.value,
                    "reason": verdict.reason or None,
                    "present": list(verdict.present or ()),
                    "absent": list(verdict.absent or ()),
                    "evidence": dict(verdict.evidence),
                }
                for verdict in self.stages
            ],
            "files": dict(self.files),
        }


def explain(model: SkillModel, skill: Skill, state: State) -> Explanation:
    """Return the verdicts on `skill` in a state."""
    return Explanation(model.task, skill, state, tuple(model.feasibility.stages(skill, state)))


def state_after(model: SkillModel, before: Sequence[Skill]) -> State:
    """Return the state that a sequence leads to.

    Raises
    ------
    OptionError
        If the sequence cannot be executed; the message says where it fails.
    """
    walked = replay(model, before)
    if not walked.feasible:
        fault = walked.violations[0]
        raise OptionError(
            f"--after fails at step {fault.step + 1} ({fault.skill}): "
            f"{fault.stage}: {fault.reason}."
        )
    return walked.state
