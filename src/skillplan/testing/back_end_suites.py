"""Conformance suites of physics engines and collision detectors."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import Any, ClassVar

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import introduce
from skillplan.pipeline import registry
from skillplan.pipeline.solving import make_model
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.testing.tasks import assert_options_described, lid_task, reachable_states


class _BackEndSuite:
    """Requirements on every back end."""

    _kind: ClassVar[str]

    def _name(self) -> str:
        """Return the name of the plugin, from the attribute of its kind."""
        name: str = getattr(self, self._attribute)
        return name

    _attribute: ClassVar[str]

    def task(self) -> Task:
        """Return the task of the queries; override it if yours needs another."""
        return lid_task()

    def make(self, task: Task) -> BackEnd:
        """Return the back end for a task, with default options."""
        plugin = registry.load(self._kind, self._name())
        back_end: BackEnd = plugin(task)
        return back_end

    def queries(self, task: Task) -> Iterator[tuple[Skill, State]]:
        """Yield every applicable skill in every reachable state of a task."""
        model = make_model(task)
        for state in reachable_states(model):
            for skill in model.applicable(state):
                yield skill, state

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry has it under its name, with described options."""
        plugin = registry.load(self._kind, self._name())
        assert plugin.name == self._name()
        assert plugin.version
        assert plugin.expected_s > 0
        assert_options_described(plugin)

    def test_a_verdict_rests_on_facts_that_hold(self) -> None:
        """Present facts hold, and absent ones do not, in the state of the verdict."""
        task = self.task()
        back_end = self.make(task)
        for skill, state in self.queries(task):
            verdict = back_end.check(skill, state)
            assert isinstance(verdict, Verdict)
            assert verdict.grounded(state, back_end.name).applies_in(state)

    def test_a_reused_verdict_equals_a_fresh_one(self) -> None:
        """A fresh check gives the same verdict in every state to which one applies."""
        task = self.task()
        kept: dict[str, list[Verdict]] = {}
        reused = self.make(task)
        for skill, state in self.queries(task):
            fresh = self.make(task).check(skill, state).grounded(state, reused.name)
            for verdict in kept.setdefault(skill.name, []):
                if verdict.applies_in(state):
                    assert verdict == fresh
            kept[skill.name].append(reused.check(skill, state).grounded(state, reused.name))

    def test_it_answers_the_same_whatever_was_checked_before(self) -> None:
        """Verdicts do not depend on the order of the queries."""
        task = self.task()
        queries = list(self.queries(task))
        forward, backward = self.make(task), self.make(task)
        answers = [forward.check(*query) for query in queries]
        again = [backward.check(*query) for query in reversed(queries)]
        assert answers == list(reversed(again))

    def test_it_says_of_no_skill_that_it_takes_less_than_its_bound(self) -> None:
        """In any state, and if only the precondition is known; 0 bounds every time."""
        task = self.task()
        back_end = self.make(task)
        for skill, state in self.queries(task):
            taken_s = back_end.duration_s(skill, state)
            unknown = task.facts.all_bits & ~state.bits
            least_s = back_end.least_duration_s(skill, state.bits, unknown)
            needs = skill.precondition
            anywhere_s = back_end.least_duration_s(skill, needs.requires.bits, needs.forbids.bits)
            assert least_s >= 0
            assert anywhere_s >= 0
            assert taken_s is None or max(least_s, anywhere_s) <= taken_s * (1 + 1e-9)


class DetectorSuite(_BackEndSuite):
    """Requirements on every collision detector."""

    detector: ClassVar[str]
    _kind = "collision"
    _attribute = "detector"


class EngineSuite(_BackEndSuite):
    """Requirements on every physics engine."""

    engine: ClassVar[str]
    _kind = "physics"
    _attribute = "engine"

    def test_what_it_grants_agrees_with_the_prediction(self) -> None:
        """A feasible skill leads to a state in which every body has a pose."""
        task = self.task()
        back_end = self.make(task)
        for skill, state in self.queries(task):
            if back_end.check(skill, state).is_feasible:
                poses = task.scene.at(skill.prediction.apply(state))
                assert set(task.scene.at(state)) <= set(poses)


# The same name and unit for every such engine.
OPTIONS = frozenset(
    {
        "clearance_m",
        "control",
        "drop_height_m",
        "friction",
        "grip_force_n",
        "held_tolerance_m",
        "max_insertion_force_n",
        "min_fastening_force_n",
        "position_tolerance_m",
        "press_force_n",
        "speed_m_per_s",
        "stiffness_per_s2",
        "tilt_tolerance_rad",
    }
)
# A valid order of the lid task.
PLAN = (
    "pick(box)",
    "place(box)",
    "pick(fuse)",
    "place(fuse)",
    "pick(lid)",
    "place(lid)",
    "load(screwdriver)",
    "fasten(screw)",
)


class SimulationSuite(EngineSuite):
    """Requirements on every engine that executes skills with a simulated arm.

    The task is the lid task: parts are lifted by suction and by jaws, set down on and into each
    other, and screwed. If executions are slow, mark overridden tests as slow.
    """

    def beside(self, task: Task) -> tuple[BackEnd, list[BackEnd]]:
        """Return the engine, alone and with the detectors that read its contacts."""
        engine = self.make(task)
        names = getattr(type(engine), "contact_detectors", ())
        readers = [registry.load("collision", name)(task) for name in names[:1]]
        return engine, list(introduce([engine, *readers]))

    def after(self, task: Task, *done: str) -> State:
        """Return the state of a task after some skills."""
        state = task.initial
        for name in done:
            skill = task.skill(name)
            assert skill.applicable(state), name
            state = skill.prediction_in(state).apply(state)
        return state

    def executed(self, name: str, *done: str) -> Verdict:
        """Return the verdict of a fresh engine on a skill after others."""
        task = self.task()
        return self.make(task).check(task.skill(name), self.after(task, *done))

    def test_its_options_are_those_of_every_simulator(self) -> None:
        """By name, so that one task file fits all engines."""
        plugin = registry.load("physics", self.engine)
        assert set(plugin.Options.model_fields) >= OPTIONS
        assert plugin.expensive

    def test_a_part_comes_to_rest_where_it_belongs(self) -> None:
        """Within a tenth of a millimetre; the evidence gives position, rotation and forces."""
        verdict = self.executed("place(box)", "pick(box)")
        assert verdict.is_feasible, verdict.reason
        evidence = verdict.evidence
        assert evidence["body"] == "box"
        assert max(map(abs, evidence["offset_mm"])) < 0.1
        assert evidence["tilt_deg"] < 0.1
        assert len(evidence["pose_m"]) == 3
        assert evidence["sensed"]["tip_error_m"] < 0.001
        assert evidence["steps"] > 100

    def test_a_part_is_felt_between_the_jaws(self) -> None:
        """With its width."""
        verdict = self.executed("pick(fuse)")
        assert verdict.is_feasible, verdict.reason
        assert abs(verdict.evidence["sensed"]["jaw_width_m"] - 0.02) < 0.0025

    def test_a_screw_is_pressed_as_hard_as_it_has_to_be(self) -> None:
        """With the force of the options, and at most twice that."""
        verdict = self.executed("fasten(screw)", *PLAN[:-1])
        assert verdict.is_feasible, verdict.reason
        assert 3.0 <= verdict.evidence["sensed"]["fastening_force_n"] <= 10.0

    def test_a_tool_is_sensed_to_be_attached(self) -> None:
        """By name."""
        verdict = self.executed("load(screwdriver)")
        assert verdict.is_feasible, verdict.reason
        assert verdict.evidence["sensed"]["tool_attached"] == "screwdriver"

    def test_what_has_nothing_beneath_it_does_not_come_to_rest(self) -> None:
        """Without its box, a fuse would end below its goal; the verdict rests on the box."""
        verdict = self.executed("place(fuse)", "pick(fuse)")
        assert verdict.is_infeasible
        assert verdict.reason == "fuse came to rest 10.0 mm below its goal"
        assert "placed(box)" in (verdict.absent or ())

    def test_what_is_in_the_way_is_named(self) -> None:
        """A fuse after the lid: named by the touching bodies, if contacts are read."""
        task = self.task()
        _, back_ends = self.beside(task)
        state = self.after(task, "pick(box)", "place(box)", "pick(lid)", "place(lid)", "pick(fuse)")
        verdicts = [back_end.check(task.skill("place(fuse)"), state) for back_end in back_ends]
        assert any(verdict.is_infeasible for verdict in verdicts)
        named = {name for verdict in verdicts for name in verdict.evidence.get("bodies", ())}
        assert not named or "lid" in named
        assert all(
            "placed(lid)" in (verdict.present or ())
            for verdict in verdicts
            if verdict.is_infeasible
        )

    def test_a_right_order_is_granted_from_the_first_skill_to_the_last(self) -> None:
        """By the engine, and by the reader of its contacts."""
        task = self.task()
        _, back_ends = self.beside(task)
        for skill, state in self._plan(task):
            for back_end in back_ends:
                verdict = back_end.check(skill, state)
                assert verdict.is_feasible, (skill.name, back_end.name, verdict.reason)

    def test_answers_are_equal_to_the_bit_in_any_order(self) -> None:
        """One engine in order, and another in reverse."""
        task = self.task()
        queries = self._plan(task)[1:4]
        forward, backward = self.make(task), self.make(task)
        answers = [written(forward.check(*query)) for query in queries]
        again = [written(backward.check(*query)) for query in reversed(queries)]
        assert answers == again[::-1]

    def test_answers_are_equal_to_the_bit_in_other_processes(self) -> None:
        """Two at once, as with ``--jobs 2``."""
        task = self.task()
        queries = self._plan(task)[1:4]
        answers = []
        for jobs in (1, 2):
            with closing(Feasibility(task, [self.make(task)], jobs=jobs)) as checks:
                answers.append([written(verdict) for verdict in checks.verdicts(queries)])
        assert answers[0] == answers[1]

    def _plan(self, task: Task) -> list[tuple[Skill, State]]:
        return [(task.skill(name), self.after(task, *PLAN[:n])) for n, name in enumerate(PLAN)]


def written(verdict: Verdict) -> str:
    """Return the content of a verdict with all digits, without its stage."""
    facts: Sequence[Any] = [
        None if facts is None else list(facts) for facts in (verdict.present, verdict.absent)
    ]
    return json.dumps([verdict.status, verdict.reason, *facts, dict(verdict.evidence)])
