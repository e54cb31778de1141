"""What engines and detectors owe the model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from skillplan.pipeline import registry
from skillplan.pipeline.solving import make_model
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.testing.options import assert_options_described
from skillplan.testing.tasks import lid_task, reachable_states


class _BackEndSuite:
    """What engines and detectors alike owe the model."""

    _kind: ClassVar[str]

    def _name(self) -> str:
        """Return the plugin's name, which stands in the attribute named after its kind."""
        name: str = getattr(self, self._attribute)
        return name

    _attribute: ClassVar[str]

    def task(self) -> Task:
        """Return the task to query; override it where yours needs another."""
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
        for skill, state in self.queries(task):
            verdict = back_end.check(skill, state)
            assert isinstance(verdict, Verdict)
            assert verdict.grounded(state, back_end.name).applies_in(state)

    def test_a_reused_verdict_equals_a_fresh_one(self) -> None:
        """Wherever a verdict applies, checking again gives the same verdict."""
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
        """The order of the queries changes no answer."""
        task = self.task()
        queries = list(self.queries(task))
        forward, backward = self.make(task), self.make(task)
        answers = [forward.check(*query) for query in queries]
        again = [backward.check(*query) for query in reversed(queries)]
        assert answers == list(reversed(again))

    def test_it_says_of_no_skill_that_it_takes_less_than_its_bound(self) -> None:
        """In any state, and where only the precondition is known; 0 bounds every time."""
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
        for skill, state in self.queries(task):
            if back_end.check(skill, state).is_feasible:
                poses = task.scene.at(skill.prediction.apply(state))
                assert set(task.scene.at(state)) <= set(poses)
