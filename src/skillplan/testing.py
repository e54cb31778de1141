"""Conformance suites for plugin authors: inherit one, name your plugin, and run pytest.

::

    class TestMySolver(SolverSuite):
        solver = "my-solver"

Every built-in passes the same suites. The tasks they use are small and made here, so that
an installed skillplan is all they need; they go through the registry and the referee like any
other run.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import entry_points
from typing import Any, ClassVar

from pydantic import BaseModel

from skillplan.domains.assembly.grounding import ground
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.domain import Domain
from skillplan.files.plain_json import json_fault
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.run import make_model, make_solver, solve
from skillplan.pipeline.setup import Setup
from skillplan.records.result import Status
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

__all__ = [
    "DetectorSuite",
    "DomainSuite",
    "EngineSuite",
    "SolverSuite",
    "lid_content",
    "lid_task",
    "reachable_states",
    "shut_box_task",
]


def lid_task() -> Task:
    """Return a box, a fuse that goes into it, and a lid that is screwed on: two tools."""
    return ground(AssemblyConfig.model_validate(lid_content()), "")


def shut_box_task() -> Task:
    """Return the same with a chart that wants the fuse in the box after the lid: no plan."""
    content = lid_content()
    content["chart"] = [
        {"before": "box", "after": ["fuse", "lid"]},
        {"before": "lid", "after": ["screw"]},
        {"before": "screw", "after": ["fuse"]},
    ]
    content["collision"] = {"precedence": {}, "aabb": {}}
    return ground(AssemblyConfig.model_validate(content), "")


def reachable_states(model: SkillModel, most: int = 5_000) -> list[State]:
    """Return the states that feasible skills lead to, breadth first, at most so many."""
    found = {model.initial: None}
    for state in (queue := [model.initial]):
        if model.is_goal(state):
            continue
        for step in model.transitions(state):
            for _, following in step.outcomes:
                if following not in found and len(found) < most:
                    found[following] = None
                    queue.append(following)
    return list(found)


def lid_content() -> dict[str, Any]:
    """Return the content of the lid task, to be varied."""
    return {
        "kind": "assembly",
        "name": "lid",
        "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.15},
        "tools": {
            "gripper": {"holder_m": [0.6, 0.2]},
            "screwdriver": {"holder_m": [0.6, 0.2]},
        },
        "initial_tool": "gripper",
        "parts": {
            "box": {
                "tool": "gripper",
                "size_m": [0.1, 0.1, 0.01],
                "grasp": {"type": "suction"},
                "start_m": [0.4, -0.2],
                "goal_m": [0.5, 0.0],
            },
            "fuse": {
                "tool": "gripper",
                "size_m": [0.02, 0.02, 0.02],
                "start_m": [0.4, 0.2],
                "goal_m": [0.5, 0.0],
                "goal_on": "box",
            },
            "lid": {
                "tool": "gripper",
                "boxes": [
                    {"size_m": [0.1, 0.1, 0.005], "centre_m": [0.0, 0.0, 0.0325]},
                    {"size_m": [0.01, 0.1, 0.03], "centre_m": [0.045, 0.0, 0.015]},
                    {"size_m": [0.01, 0.1, 0.03], "centre_m": [-0.045, 0.0, 0.015]},
                ],
                "grasp": {"type": "suction"},
                "start_m": [0.5, -0.3],
                "goal_m": [0.5, 0.0],
                "goal_on": "box",
            },
        },
        "screws": {"screw": {"tool": "screwdriver", "hole_m": [0.545, 0.0], "through": "lid"}},
        "chart": [
            {"before": "box", "after": ["fuse", "lid"]},
            {"before": "fuse", "after": ["lid"]},
            {"before": "lid", "after": ["screw"]},
        ],
        "step_limit": 12,
    }


class SolverSuite:
    """What every solver owes its users."""

    solver: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def _setup(self) -> Setup:
        return Setup(options={self.solver: self.options})

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry finds it under its name, with a summary and described options."""
        plugin = registry.load("solver", self.solver)
        assert plugin.name == self.solver
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()

    def test_it_solves_the_lid_task(self) -> None:
        """The referee grants a plan."""
        result = solve(lid_task(), self.solver, self._setup())
        assert result.status in (Status.OPTIMAL, Status.SOLVED), result.reason

    def test_the_same_seed_gives_the_same_plan(self) -> None:
        """One seed governs all randomness."""
        first, second = (solve(lid_task(), self.solver, self._setup(), seed=7) for _ in range(2))
        assert [s.skill for s in first.steps] == [s.skill for s in second.steps]
        assert first.cost == second.cost

    def test_it_is_honest_where_there_is_no_plan(self) -> None:
        """It finds none, and does not pretend."""
        result = solve(shut_box_task(), self.solver, self._setup())
        assert result.status in (Status.INFEASIBLE, Status.UNSOLVED), result.reason

    def test_it_stops_when_told_to(self) -> None:
        """An interrupted search ends with what it has, not with an error."""
        stop = Stop()
        stop.interrupt()
        result = solve(lid_task(), self.solver, self._setup(), stop=stop)
        assert result.status in (
            Status.OPTIMAL,
            Status.SOLVED,
            Status.UNSOLVED,
        ), result.reason

    def test_it_refuses_in_words_or_not_at_all(self) -> None:
        """A refusal is a sentence."""
        model = make_model(lid_task())
        refusal = make_solver(self.solver, self.options).refuses(model)
        assert refusal is None or (isinstance(refusal, str) and refusal.strip())


class _BackEndSuite:
    """What engines and detectors alike owe the model."""

    _kind: ClassVar[str]

    def _name(self) -> str:
        """Return the plugin's name, which stands in the attribute named after its kind."""
        name: str = getattr(self, self._attribute)
        return name

    _attribute: ClassVar[str]

    def task(self) -> Task:
        """Return the task to ask about; override it where yours needs another."""
        return lid_task()

    def make(self, task: Task) -> BackEnd:
        """Return the back end for a task, with default options."""
        plugin = registry.load(self._kind, self._name())
        back_end: BackEnd = plugin(task)
        return back_end

    def questions(self, task: Task) -> Iterator[tuple[Skill, State]]:
        """Yield every applicable skill in every reachable state of a task."""
        model = make_model(task)
        for state in reachable_states(model):
            for skill in model.applicable(state):
                yield skill, state

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry finds it under its name, with described options."""
        plugin = registry.load(self._kind, self._name())
        assert plugin.name == self._name()
        assert plugin.version
        assert plugin.expected_s > 0
        assert_options_described(plugin)

    def test_a_verdict_rests_on_facts_that_hold(self) -> None:
        """Present facts hold and absent ones do not, where the verdict was made."""
        task = self.task()
        back_end = self.make(task)
        for skill, state in self.questions(task):
            verdict = back_end.check(skill, state)
            assert isinstance(verdict, Verdict)
            assert verdict.grounded(state, back_end.name).applies_in(state)

    def test_a_reused_verdict_equals_a_fresh_one(self) -> None:
        """Wherever a verdict applies, asking anew gives the same verdict."""
        task = self.task()
        kept: dict[str, list[Verdict]] = {}
        asked = self.make(task)
        for skill, state in self.questions(task):
            fresh = self.make(task).check(skill, state).grounded(state, asked.name)
            for verdict in kept.setdefault(skill.name, []):
                if verdict.applies_in(state):
                    assert verdict == fresh
            kept[skill.name].append(asked.check(skill, state).grounded(state, asked.name))

    def test_it_answers_the_same_whatever_was_asked_before(self) -> None:
        """The order of the questions changes no answer."""
        task = self.task()
        questions = list(self.questions(task))
        forward, backward = self.make(task), self.make(task)
        answers = [forward.check(*question) for question in questions]
        again = [backward.check(*question) for question in reversed(questions)]
        assert answers == list(reversed(again))


class DetectorSuite(_BackEndSuite):
    """What every collision detector owes the model."""

    detector: ClassVar[str]
    _kind = "collision"
    _attribute = "detector"


class EngineSuite(_BackEndSuite):
    """What every physics engine owes the model."""

    engine: ClassVar[str]
    _kind = "physics"
    _attribute = "engine"

    def test_what_it_grants_agrees_with_the_prediction(self) -> None:
        """A feasible skill leads to a state whose scene has every body in its place."""
        task = self.task()
        back_end = self.make(task)
        for skill, state in self.questions(task):
            if back_end.check(skill, state).is_feasible:
                poses = task.scene.at(skill.prediction.apply(state))
                assert set(task.scene.at(state)) <= set(poses)


class DomainSuite:
    """What every kind of task owes the rest."""

    domain: ClassVar[str]
    content: ClassVar[dict[str, Any]] = {}

    def tasks(self) -> list[Task]:
        """Return the tasks of `content`."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        assert list(plugin.issues(config)) == []
        return plugin.ground(config, "")

    def test_it_is_registered_under_its_kind(self) -> None:
        """The entry point's name is the kind in the file."""
        assert registry.load("domain", self.domain).kind == self.domain
        assert self.domain in entry_points(group="skillplan.domain").names

    def test_grounding_is_deterministic(self) -> None:
        """The same content gives the same tasks."""
        for one, other in zip(self.tasks(), self.tasks(), strict=True):
            assert one.facts.names == other.facts.names
            assert [s.name for s in one.skills] == [s.name for s in other.skills]
            assert one.initial == other.initial

    def test_exclusive_facts_stay_exclusive(self) -> None:
        """In every reachable state at most one fact of each exclusive group holds."""
        for task in self.tasks():
            for state in reachable_states(make_model(task), 500):
                for group in task.facts.exclusive:
                    assert sum(fact in state for fact in group) <= 1

    def test_costs_and_durations_are_never_negative(self) -> None:
        """Every applicable skill has a cost and a duration of at least 0."""
        for task in self.tasks():
            model = make_model(task)
            for state in reachable_states(model, 500):
                for skill in model.applicable(state):
                    assert skill.cost.at(state) >= 0
                    assert skill.duration_s.at(state) >= 0

    def test_a_chain_that_nobody_has_solved_is_followed_as_it_was_grounded(self) -> None:
        """Without plans, what follows is what stands in for them."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        followed = plugin.follow(config, "", {})
        assert [task.name for task in followed] == [task.name for task in self.tasks()]
        assert [task.initial for task in followed] == [task.initial for task in self.tasks()]

    def test_what_it_says_beyond_the_plans_is_json(self) -> None:
        """Its account can be printed, also of a file that nobody has solved."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        assert json_fault(plugin.account(config, {}).document) is None

    def test_the_schema_describes_every_key(self) -> None:
        """Editors can show what a key of the file means."""
        schema = registry.load("domain", self.domain).Config.model_json_schema()
        assert schema["properties"]


def assert_options_described(plugin: type[Any]) -> None:
    """Assert that every option says what it is, so that the command line can.

    Raises
    ------
    AssertionError
        If a field has no description.
    """
    model: type[BaseModel] = plugin.Options
    for name, field in model.model_fields.items():
        assert field.description, f"option {name!r} of {plugin.name!r} has no description"
