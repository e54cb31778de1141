"""Conformance suites of solvers, domains, exporters and samplers."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path, PurePath
from typing import Any, ClassVar

import pytest

from skillplan.domains.domain import Domain
from skillplan.errors import OptionError
from skillplan.exporters.exporter import Exporter, Handover
from skillplan.files.json_file import find_json_fault
from skillplan.model.replay import replay
from skillplan.pipeline import registry
from skillplan.pipeline.exchange import export_files, list_notes, make_exporter, make_handover
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import make_model, make_solver, solve
from skillplan.records.result import Status
from skillplan.records.sweep.plan import Choice, Dimension, Span
from skillplan.solvers.stop import Stop
from skillplan.sweep.parameter_study import make_sampler
from skillplan.sweep.sampler import Question, SharedTrials
from skillplan.task.task import Task
from skillplan.testing.tasks import (
    assert_options_described,
    chance_task,
    hostile_task,
    lid_task,
    reachable_states,
    shut_box_task,
)


class SolverSuite:
    """Requirements on every solver."""

    solver: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def _setup(self) -> Setup:
        return Setup(options={self.solver: self.options})

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry has it under its name, with a summary and described options."""
        plugin = registry.load("solver", self.solver)
        assert plugin.name == self.solver
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()

    def test_it_solves_the_lid_task(self) -> None:
        """The referee accepts the plan."""
        result = solve(lid_task(), self.solver, self._setup())
        assert result.status in (Status.OPTIMAL, Status.SOLVED), result.reason

    def test_the_same_seed_gives_the_same_plan(self) -> None:
        """One seed determines all random numbers."""
        first, second = (solve(lid_task(), self.solver, self._setup(), seed=7) for _ in range(2))
        assert [s.skill for s in first.steps] == [s.skill for s in second.steps]
        assert first.cost == second.cost

    def test_it_is_honest_where_there_is_no_plan(self) -> None:
        """It returns none."""
        result = solve(shut_box_task(), self.solver, self._setup())
        assert result.status in (Status.INFEASIBLE, Status.UNSOLVED), result.reason

    def test_it_stops_when_told_to(self) -> None:
        """An interrupted search returns its best result, not an error."""
        stop = Stop()
        stop.interrupt()
        result = solve(lid_task(), self.solver, self._setup(), stop=stop)
        assert result.status in (Status.OPTIMAL, Status.SOLVED, Status.UNSOLVED), result.reason

    def test_it_refuses_in_words_or_not_at_all(self) -> None:
        """The refusal is a sentence."""
        model = make_model(lid_task())
        refusal = make_solver(self.solver, self.options).find_refusal(model)
        assert refusal is None or (isinstance(refusal, str) and refusal.strip())


class DomainSuite:
    """Requirements on every kind of task."""

    domain: ClassVar[str]
    content: ClassVar[dict[str, Any]] = {}

    def tasks(self) -> list[Task]:
        """Return the tasks of `content`."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        assert list(plugin.issues(config)) == []
        return plugin.ground(config, "")

    def test_it_is_registered_under_its_kind(self) -> None:
        """The name of the entry point is the kind in the file."""
        assert registry.load("domain", self.domain).kind == self.domain
        assert self.domain in entry_points(group="skillplan.domain").names

    def test_grounding_is_deterministic(self) -> None:
        """The same content gives the same tasks."""
        for task, other in zip(self.tasks(), self.tasks(), strict=True):
            assert task.facts.names == other.facts.names
            assert [s.name for s in task.skills] == [s.name for s in other.skills]
            assert task.initial == other.initial

    def test_exclusive_facts_stay_exclusive(self) -> None:
        """In every reachable state, at most one fact of each exclusive group holds."""
        for task in self.tasks():
            groups = [task.facts.of(*group) for group in task.facts.exclusive]
            for state in reachable_states(make_model(task), 500):
                for group in groups:
                    assert len(group & state) <= 1

    def test_costs_and_durations_are_never_negative(self) -> None:
        """Every applicable skill has a cost and a duration >= 0."""
        for task in self.tasks():
            model = make_model(task)
            for state in reachable_states(model, 500):
                for skill in model.applicable(state):
                    assert skill.cost.at(state) >= 0
                    assert skill.duration_s.at(state) >= 0

    def test_a_chain_that_nobody_has_solved_is_followed_as_it_was_grounded(self) -> None:
        """Without plans, from the preset one."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        followed = plugin.follow(config, "", {})
        assert [task.name for task in followed] == [task.name for task in self.tasks()]
        assert [task.initial for task in followed] == [task.initial for task in self.tasks()]

    def test_what_it_says_beyond_the_plans_is_json(self) -> None:
        """Its description can be printed, even for an unsolved file."""
        plugin: Domain = registry.load("domain", self.domain)()
        config = plugin.Config.model_validate(self.content)
        assert find_json_fault(plugin.account(config, {}).document) is None

    def test_the_schema_describes_every_key(self) -> None:
        """Editors can show the meaning of a key."""
        schema = registry.load("domain", self.domain).Config.model_json_schema()
        assert schema["properties"]


_BY_CHART = Setup(collision=("precedence",))


class ExporterSuite:
    """Requirements on every exporter."""

    exporter: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def make(self) -> Exporter:
        """Return the exporter with the options of the suite."""
        return make_exporter(self.exporter, self.options)

    def handover(self, task: Task) -> Handover:
        """Return a task and its best plan, by its chart."""
        return solved_lid(task)

    def files(self, task: Task) -> Mapping[str, str | bytes]:
        """Return the files of a task and its best plan."""
        return export_files(self.make(), self.handover(task))

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry has it under its name, with a summary and described options."""
        plugin = registry.load("exporter", self.exporter)
        assert plugin.name == self.exporter
        assert plugin.suffix == "" or plugin.suffix.startswith(".")
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()

    def test_it_makes_files_of_plain_names(self) -> None:
        """One file if it has a suffix; none is empty, and texts are valid UTF-8."""
        files = self.files(lid_task())
        assert files
        assert len(files) == 1 or not self.make().suffix
        for name, content in files.items():
            assert PurePath(name).name == name
            assert content.encode() if isinstance(content, str) else content

    def test_the_same_plan_makes_the_same_files(self) -> None:
        """Byte for byte, so that files can be compared."""
        assert self.files(lid_task()) == self.files(lid_task())

    def test_names_that_are_no_identifiers_do_no_harm(self) -> None:
        """Quotes, brackets, ends of comments, line breaks, and names that differ only in case."""
        assert self.files(hostile_task())

    def test_without_a_plan_it_hands_over_the_task_or_says_that_it_needs_one(self) -> None:
        """With the source of plans."""
        model = make_model(lid_task(), _BY_CHART)
        with closing(model.feasibility):
            handover = make_handover(model, _BY_CHART, None)
            if self.make().needs_policies:
                with pytest.raises(OptionError, match="exports a policy: give a folder of train"):
                    export_files(self.make(), handover)
                return
            if not self.make().needs_plan:
                assert export_files(self.make(), handover)
                return
            with pytest.raises(OptionError, match="hands over a plan: give a RESULT"):
                export_files(self.make(), handover)

    def test_chance_is_handed_over_or_refused_in_words(self) -> None:
        """A grasp that may fail is reported."""
        handover = self.handover(chance_task())
        refusal = self.make().refuses(handover)
        if refusal is None:
            assert export_files(self.make(), handover)
            return
        assert "chance" in refusal
        with pytest.raises(OptionError, match="cannot be exported"):
            export_files(self.make(), handover)

    def test_its_notes_are_sentences(self) -> None:
        """If there are any."""
        assert all(note.strip() for note in list_notes(self.make(), self.handover(lid_task())))


def solved_lid(task: Task) -> Handover:
    """Return a variant of the lid task in names or chance, and its best plan."""
    model = make_model(task, _BY_CHART)
    # The hostile task has other names in the same order.
    walked = replay(model, [task.skills[action] for action in _plan()])
    assert walked.complete, walked.violations
    model.feasibility.close()
    return make_handover(model, _BY_CHART, walked)


@cache
def _plan() -> tuple[int, ...]:
    """Return the best plan of the lid task."""
    result = solve(lid_task(), "exact", _BY_CHART)
    return tuple(step.action for step in result.steps)


SPACE: tuple[Dimension, ...] = (
    Span("rate", 1e-4, 1.0, logarithmic=True),
    Span("share", -1.0, 1.0),
    Span("count", 1, 9, whole=True),
    Span("batch", 32, 512, whole=True, multiple_of=32),
    Span("width", 64, 8_192, whole=True, logarithmic=True, multiple_of=64),
    Choice("kind", ("plain", "bent")),
    Choice("size", (8, 16, 32), ordered=True),
    Choice("quick", (False, True)),
)


class SamplerSuite:
    """Requirements on every sampler."""

    sampler: ClassVar[str]
    options: ClassVar[dict[str, Any]] = {}

    def join(self, folder: Path, first: dict[str, Any] | None = None) -> SharedTrials:
        """Return the trials of a folder, for the study of this suite."""
        question = Question(SPACE, {"study": "of the suite"}, first or {}, seed=7)
        return make_sampler(self.sampler, self.options).join(folder, question)

    def test_it_is_registered_and_its_options_are_described(self) -> None:
        """The registry has it under its name, with a summary and described options."""
        plugin = registry.load("sampler", self.sampler)
        assert plugin.name == self.sampler
        assert_options_described(plugin)
        assert (plugin.__doc__ or "").strip()
        assert Path(plugin.keeps).name == plugin.keeps

    def test_what_it_chooses_is_allowed(self, tmp_path: Path) -> None:
        """Values are in their ranges, integers if required, and of the listed types."""
        trials = self.join(tmp_path)
        for count in range(15):
            trial = trials.ask()
            assert set(trial.values) == {dimension.option for dimension in SPACE}
            for dimension in SPACE:
                assert dimension.holds(trial.values[dimension.option]), dimension
            trials.tell(trial, float(count % 4), [])

    def test_what_is_to_be_tried_first_is(self, tmp_path: Path) -> None:
        """If it leaves options out, these are chosen."""
        first = {"rate": 0.25, "kind": "bent", "size": 16, "quick": True, "count": 3, "batch": 96}
        trials = self.join(tmp_path, first)
        assert trials.ask().values.items() >= first.items()
        assert not trials.ask().values.items() >= first.items()

    def test_what_was_told_is_there_for_every_process(self, tmp_path: Path) -> None:
        """Values, figures and lines, by number, without aborted and running trials."""
        first = self.join(tmp_path)
        another = self.join(tmp_path)
        trials = [first.ask(), another.ask(), first.ask(), another.ask()]
        assert len({trial.number for trial in trials}) == 4
        another.tell(trials[1], 2.5, ["second", "line"])
        first.tell(trials[0], None, ["first"])
        another.give_up(trials[3])
        late = self.join(tmp_path)
        assert late.about == {"study": "of the suite"}
        for seen in (first, another, late):
            assert seen.done() == 2
            finished = sorted(seen.finished(), key=lambda each: each.trial.number)
            assert [each.trial for each in finished] == sorted(
                trials[:2], key=lambda trial: trial.number
            )
            by_number = {each.trial.number: each for each in finished}
            assert by_number[trials[0].number].value is None
            assert by_number[trials[1].number].value == 2.5
            assert by_number[trials[1].number].lines == ("second", "line")

    def test_a_trial_is_tried_again_on_request(self, tmp_path: Path) -> None:
        """Its settings come first, and it counts no longer."""
        trials = self.join(tmp_path)
        failed, kept = trials.ask(), trials.ask()
        trials.tell(failed, None, ["failed"])
        trials.tell(kept, 1.0, ["kept"])
        trials.retry([failed.number])
        assert [each.trial for each in trials.finished()] == [kept]
        again = self.join(tmp_path).ask()
        assert again.values == failed.values
        assert again.number != failed.number

    def test_two_processes_do_not_begin_alike(self, tmp_path: Path) -> None:
        """The draw depends on the number of the trial, not only on the seed."""
        shares = [self.join(tmp_path).ask().values["share"] for _ in range(4)]
        assert len(set(shares)) == 4
