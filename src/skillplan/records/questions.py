"""Answers about a task file: is it valid, why does a skill fail, which order does geometry give.

The documents of ``check``, ``explain`` and ``chart``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from skillplan.chart.precedence_chart import DerivedChart
from skillplan.domains.domain import Overview
from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.records import schemas
from skillplan.records.stored.product_relation import Obstacle, ProductRelation
from skillplan.task.pose import Point
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


@dataclass(frozen=True)
class Explanation:
    """The verdicts on one skill in one state.

    Parameters
    ----------
    stages
        One verdict for each stage, cheapest first, including stages after the first failure.
    files
        Kind of a drawn file, such as ``picture``, to its path.
    """

    task: Task
    skill: Skill
    state: State
    stages: tuple[Verdict, ...]
    files: Mapping[str, str] = field(default_factory=dict, hash=False)

    def drawn(self, files: Mapping[str, str]) -> Explanation:
        """Return the explanation with its drawn files."""
        return replace(self, files=files)

    @property
    def feasible(self) -> bool:
        """True if every stage passed."""
        return all(verdict.is_feasible for verdict in self.stages)

    @property
    def prediction(self) -> Outcome:
        """The predicted changes by the skill."""
        skill = self.skill
        return (
            skill.prediction if skill.case(self.state) is None else skill.prediction_in(self.state)
        )

    @property
    def otherwise(self) -> tuple[Outcome, ...]:
        """The outcomes that may happen but are not predicted; empty without chance."""
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
            "notes": list(self.task.notes.get(self.skill.name, ())),
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


def find_state_after(model: SkillModel, before: Sequence[Skill]) -> State:
    """Return the state after a sequence.

    Raises
    ------
    OptionError
        If the sequence cannot be executed; the message names the step.
    """
    walked = replay(model, before)
    if not walked.feasible:
        fault = walked.violations[0]
        raise OptionError(
            f"--after fails at step {fault.step + 1} ({fault.skill}): "
            f"{fault.stage}: {fault.reason}."
        )
    return walked.state


def make_chart_document(
    chart: DerivedChart, task: Task, back_ends: Sequence[str]
) -> dict[str, Any]:
    """Return the JSON document ``skillplan.chart/1``."""
    hand_made = chart.hand_made or ()
    return {
        "schema": schemas.CHART,
        "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
        "back_ends": list(back_ends),
        "relations": [
            {"before": r.before, "after": r.after, "reason": r.reason, "evidence": dict(r.evidence)}
            for r in chart.relations
        ],
        "hand_made": [{"before": before, "after": after} for before, after in hand_made],
        "missing": [{"before": before, "after": after} for before, after in chart.missing],
        "extra": [{"before": r.before, "after": r.after, "reason": r.reason} for r in chart.extra],
        "impossible": dict(chart.impossible),
        "undecided": list(chart.undecided),
        "circle": list(chart.cycle),
        "contradiction": list(chart.contradiction),
        "conditional": {skill: list(facts) for skill, facts in chart.conditional.items()},
        "alternatives": [
            {
                "component": alternative.component,
                "skill": alternative.skill,
                "any_of": [
                    [{"before": before, "after": after} for before, after in pairs]
                    for pairs in alternative.any_of
                ],
            }
            for alternative in chart.alternatives
        ],
    }


@dataclass(frozen=True)
class DerivedOrder:
    """The precedence relation that the back ends allow for a task.

    Parameters
    ----------
    task
        Name of the task.
    back_ends
        Names of the back ends that were queried; may be empty.
    pairs
        Number of ordered pairs of components.
    cycle
        Components that would have to come before each other, ending with the first; empty without
        a cycle.
    never
        Skills that are feasible in no state, with the reason.
    lines
        Messages about a missing order; empty with an order, or if a skill is never feasible.
    not_derived
        Property of the task because of which no order was derived; empty if one was.
    contradictions
        Messages about pairs of the chart in the file that contradict the derived order.
    """

    task: str
    back_ends: tuple[str, ...]
    pairs: int = 0
    cycle: tuple[str, ...] = ()
    never: Mapping[str, str] = field(default_factory=dict)
    lines: tuple[str, ...] = ()
    not_derived: str = ""
    contradictions: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return the order as JSON values."""
        return {
            "task": self.task,
            "back_ends": list(self.back_ends),
            "pairs": self.pairs,
            "cycle": list(self.cycle),
            "never_feasible": dict(self.never),
            "contradictions": list(self.contradictions),
        }


@dataclass(frozen=True)
class Preview:
    """Results of ``check`` on a valid file, in addition to its tasks.

    Parameters
    ----------
    warnings
        Messages with their place in the file.
    orders
        One for each task of which an order can be derived.
    overview
        Properties that the kind of task shows.
    """

    warnings: tuple[str, ...] = ()
    orders: tuple[DerivedOrder, ...] = ()
    overview: Overview = field(default_factory=Overview)

    def document(self) -> dict[str, Any]:
        """Return the additional keys of ``skillplan.check/1``."""
        return {
            **self.overview.document,
            "precedence": [order.document() for order in self.orders if order.back_ends],
            "warnings": list(self.warnings),
        }


@dataclass(frozen=True)
class Checked:
    """A valid task file.

    Parameters
    ----------
    problem
        The loaded file.
    back_ends
        Names of the back ends that each of its tasks will query.
    preview
        Results of the early checks.
    not_checked
        Sentences of these back ends about unchecked properties.
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


_MM_PER_M = 1000.0


@dataclass(frozen=True, slots=True)
class Way:
    """A straight motion of unlimited length.

    Parameters
    ----------
    direction
        Unit vector in the world of the task, or in the file of the product without a task.
    in_file
        The same vector in the file of the product.
    obstacles
        The parts that block it, the nearest first; empty if it is free.
    """

    direction: Point
    in_file: Point
    obstacles: tuple[Obstacle, ...]


@dataclass(frozen=True)
class Freedom:
    """The directions of one part among the parts in place.

    Parameters
    ----------
    task
        The task of the product; None for a relation without one.
    path
        Path of the relation.
    part
        Name of the part in the task, or in the relation without one.
    present
        The other parts in place, in the order of the file.
    stuck
        Parts of the whole product that no searched motion frees.
    tolerance_m
        Radius of the disc that must be blocked to count [m].
    ways
        The directions in the order of the file.
    files
        Kind of a drawn file, such as ``picture``, to its path.
    """

    task: Task | None
    path: Path
    part: str
    present: tuple[str, ...]
    stuck: tuple[str, ...]
    tolerance_m: float
    ways: tuple[Way, ...]
    files: Mapping[str, str] = field(default_factory=dict, hash=False)

    def drawn(self, files: Mapping[str, str]) -> Freedom:
        """Return the directions with their drawn files."""
        return replace(self, files=files)

    @property
    def free(self) -> bool:
        """True if at least one direction is free."""
        return any(not way.obstacles for way in self.ways)

    @property
    def blockers(self) -> tuple[str, ...]:
        """The parts that block a direction, each once."""
        parts = (obstacle.part for way in self.ways for obstacle in way.obstacles)
        return tuple(dict.fromkeys(parts))

    def document(self) -> dict[str, Any]:
        """Return them as JSON; lengths in mm, directions and points in the world of the task."""
        task = self.task
        return {
            "schema": schemas.FREEDOM,
            "task": None if task is None else {"name": task.name, "sha256": task.sha256},
            "part": self.part,
            "free": self.free,
            "stuck": self.part in self.stuck,
            "present": list(self.present),
            "tolerance_mm": _mm(self.tolerance_m),
            "directions": [
                {
                    "direction": list(way.direction),
                    "in_file": list(way.in_file),
                    "free": not way.obstacles,
                    "blocked_by": [
                        {
                            "part": obstacle.part,
                            "distance_mm": _mm(obstacle.distance_m),
                            "width_mm": _mm(obstacle.width_m),
                            "point_mm": [_mm(value) for value in obstacle.point_m],
                            "sensitive": obstacle.sensitive,
                        }
                        for obstacle in way.obstacles
                    ],
                }
                for way in self.ways
            ],
            "files": dict(self.files),
        }


def find_freedom(
    task: Task | None, relation: ProductRelation, part: str, state: State | None = None
) -> Freedom:
    """Return the directions in which a part is free.

    Parameters
    ----------
    task
        The task of the product; None for a relation without one.
    relation
        Relation of the product.
    part
        Name of the part in the relation.
    state
        State with the parts in place; None for the whole product.

    Raises
    ------
    OptionError
        If there is no such part.
    """
    name = relation.part(part)
    others = (other for other in relation.parts if other != name)
    present = tuple(
        other
        for other in others
        if task is None or state is None or is_in_place(task, other, state)
    )
    ways = tuple(
        Way(
            direction,
            in_file,
            tuple(
                obstacle
                for obstacle in relation.obstacles.get((name, number), ())
                if obstacle.part in present
            ),
        )
        for number, (direction, in_file) in enumerate(relation.directions)
    )
    return Freedom(task, relation.path, name, present, relation.stuck, relation.tolerance_m, ways)


def is_in_place(task: Task, part: str, state: State) -> bool:
    """Return whether the goal of a part is reached in a state."""
    facts = [fact for fact in task.goal.requires if fact.endswith(f"({part})")]
    return bool(facts) and all(fact in state for fact in facts)


def _mm(length_m: float) -> float:
    return round(length_m * _MM_PER_M, 6) + 0.0
