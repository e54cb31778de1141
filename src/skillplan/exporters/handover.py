"""What an exporter is given: a task as it is checked, and a plan of it, skill by skill."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from skillplan.model.replay import Replay, Step
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


@dataclass(frozen=True, slots=True)
class PlannedSkill:
    """A skill of a plan, with the states around it.

    Parameters
    ----------
    step
        What it costs and how long it takes.
    skill
        The skill.
    before, after
        The state where it starts, and the nominal one where it ends.
    origin, destination
        Names of the places where the robot stands then; empty where the task has none.
    """

    step: Step
    skill: Skill
    before: State
    after: State
    origin: str
    destination: str

    @property
    def subject(self) -> str:
        """What the skill is done to: ``pcb`` of ``pick(pcb)``."""
        return argument(self.skill.name)

    @property
    def tool(self) -> str:
        """The tool that it uses; empty where it names none."""
        return self.skill.parameters.get("tool", "")


@dataclass(frozen=True)
class Handover:
    """A task and a plan that are handed over.

    Parameters
    ----------
    model
        The task with the back ends that judge it.
    plan
        Replayed, feasible and complete; None where only the task is handed over.
    charted
        Whether the hand-made chart is all that the detectors go by.
    """

    model: SkillModel
    plan: Replay | None = None
    charted: bool = False

    @property
    def task(self) -> Task:
        """The task."""
        return self.model.task

    @cached_property
    def skills(self) -> tuple[PlannedSkill, ...]:
        """The skills of the plan, in order; none without a plan."""
        found = []
        state = self.model.initial
        for step in () if self.plan is None else self.plan.steps:
            skill = self.task.skills[step.action]
            after = skill.prediction_in(state).apply(state)
            places = _place(self.task, skill, state), _place(self.task, skill, after)
            found.append(PlannedSkill(step, skill, state, after, *places))
            state = after
        return tuple(found)

    @property
    def chance(self) -> str:
        """The first skill of several outcomes, whose outcome is left to chance; else empty."""
        return next((skill.name for skill in self.task.skills if not skill.deterministic), "")


def argument(name: str) -> str:
    """Return what stands in brackets: ``pcb`` of ``placed(pcb)``; else nothing."""
    _, bracket, rest = name.partition("(")
    return rest.removesuffix(")") if bracket else ""


def _place(task: Task, skill: Skill, state: State) -> str:
    if skill.motion is not None:
        fact, _ = task.scene.robot(skill.motion.robot).place(state)
        return argument(fact) or fact
    names = [place.name for place in task.places_in(state)]
    return names[0] if len(names) == 1 else ""


def decimal_text(value: float) -> str:
    """Return a number with 12 significant digits, the noise of binary fractions rounded away."""
    return f"{value + 0.0:.12g}"
