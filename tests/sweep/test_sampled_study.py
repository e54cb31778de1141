"""Studies whose settings a sampler chooses: what may be chosen, what counts, and what is shown."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from same_process import studies_in_this_process
from skillplan import sweep
from skillplan.errors import OptionError, PluginError
from skillplan.pipeline import load_problem, registry
from skillplan.records import (
    Choice,
    SampledPlan,
    Span,
    StartOutcome,
    Status,
    SweepRecord,
    Trial,
    TriedSetting,
)
from skillplan.task import Task
from skillplan.views.figures import draw_sweep
from skillplan.views.tables import tabulate_settings

CASES = Path(__file__).parents[2] / "configs" / "swarmitfix_cases.yaml"


@pytest.fixture(scope="module")
def walk():
    return load_problem(CASES).part("base-1")


@pytest.fixture
def in_this_process():
    """No processes for the runs."""
    with studies_in_this_process():
        yield


class Listed(sweep.SharedTrials):
    """Trials in memory: settings from a list, one after another."""

    def __init__(self, settings: Sequence[dict[str, Any]]) -> None:
        self._todo = list(settings)
        self.events: list[str] = []
        self._told: list[sweep.FinishedTrial] = []
        self._asked = 0

    @property
    def about(self) -> dict[str, Any]:
        return {}

    def ask(self) -> Trial:
        self._asked += 1
        self.events.append(f"ask {self._asked - 1}")
        return Trial(self._asked - 1, self._todo[self._asked - 1])

    def tell(self, trial: Trial, value: float | None, lines: Sequence[str]) -> None:
        self.events.append(f"tell {trial.number}")
        self._told.append(sweep.FinishedTrial(trial, value, tuple(lines)))

    def give_up(self, trial: Trial) -> None:
        self.events.append(f"give up {trial.number}")

    def retry(self, numbers: Sequence[int]) -> None:
        self.events.append(f"retry {list(numbers)}")

    def done(self) -> int:
        return len(self._told)

    def finished(self) -> list[sweep.FinishedTrial]:
        return self._told


def a_study(walk: Task, **changes: Any) -> tuple[SampledPlan, sweep.StudyJob]:
    values = changes.pop("values", [("episodes", "50:300"), ("gamma", "0.9:0.99")])
    return sweep.plan_sampled(
        walk, "sarsa", values, sampler="listed", starts=["C20"], runs=2, **changes
    )


def a_run(seed: int, *, cost: float | None = 3.0, steps: int = 4, error: str = "") -> SweepRecord:
    if error:
        return SweepRecord(0, seed, error=error)
    status = Status.SOLVED if cost is not None else Status.UNSOLVED
    taken = steps if cost is not None else None
    return SweepRecord(0, seed, (StartOutcome("C20", status, cost, taken, "", 0.5),), shared=True)


class TestOptions:
    @pytest.mark.parametrize(
        ("text", "expected"),
        [
            ("0.8:0.999", Span("gamma", 0.8, 0.999)),
            ("0.1:1:log", Span("gamma", 0.1, 1.0, logarithmic=True)),
            ("0.8:0.9:3", Choice("gamma", (0.8, 0.85, 0.9), ordered=True)),
            ("0.9,0.8", Choice("gamma", (0.9, 0.8))),
            ("*", Span("gamma", 0.0, 1.0)),
        ],
    )
    def test_ranges_and_lists_say_what_may_be_chosen(self, text, expected):
        assert sweep.read_space("sarsa", [("gamma", text)]).dimensions == (expected,)

    def test_whole_numbered_options_are_chosen_whole(self):
        (item,) = sweep.read_space("sarsa", [("episodes", "50:300:log")]).dimensions
        assert item == Span("episodes", 50, 300, whole=True, logarithmic=True)
        assert item.holds(50)
        assert not item.holds(50.0)
        assert not item.holds(301)

    @pytest.mark.parametrize(
        ("text", "low", "high", "logarithmic"),
        [("40:500", 64, 480, False), ("32:512:log", 32, 512, True), ("*", 4, 1024, False)],
    )
    def test_ranges_hold_the_multiples_that_an_option_allows(self, text, low, high, logarithmic):
        """The width of the relational network is a multiple of 4, the batch of dqn one of 32."""
        solver, name, step = ("dqn", "batch", 32) if text != "*" else ("relational", "width", 4)
        (item,) = sweep.read_space(solver, [(name, text)]).dimensions
        assert item == Span(name, low, high, True, logarithmic, step)
        assert not item.holds(low + 1)

    def test_a_range_without_two_multiples_is_one_clear_error(self):
        with pytest.raises(OptionError, match="must be a multiple of 32, and the range has none"):
            sweep.read_space("dqn", [("batch", "33:63")])
        with pytest.raises(OptionError, match="has only one, 64"):
            sweep.read_space("dqn", [("batch", "33:65")])

    def test_one_value_is_tried_first_or_holds_always(self):
        space = sweep.read_space(
            "sarsa", [("gamma", "0.8:0.99"), ("gamma", "0.9"), ("alpha", "0.5")]
        )
        assert space.centre == {"gamma": 0.9}
        assert space.fixed == {"alpha": 0.5}

    @pytest.mark.parametrize(
        ("name", "text", "message"),
        [
            ("gama", "0.8:0.9", "has no option 'gama'. Did you mean 'gamma'"),
            ("gamma", "0.9:0.8", "from a lower to a higher finite number"),
            ("gamma", "0.9:inf", "from a lower to a higher finite number"),
            ("gamma", "0:1:log", "ends of a logarithmic range are > 0"),
            ("gamma", "a:b", "the ends of a range are numbers"),
            ("episodes", "1.5:9", "the ends of a range are whole numbers"),
            ("gamma", "0.5:1.5", "gamma"),
            ("gamma", "0.5", "needs options of sarsa that vary"),
            ("gamma", "0.5,0.50", "is one value only"),
        ],
    )
    def test_what_cannot_be_chosen_among_is_one_clear_error(self, name, text, message):
        with pytest.raises(OptionError) as caught:
            sweep.read_space("sarsa", [(name, text)])
        assert message in str(caught.value)

    def test_all_of_an_option_without_ends_is_refused(self):
        open_ended = next(
            name
            for name, field in registry.load("solver", "replan").Options.model_fields.items()
            if not any(hasattr(item, "le") for item in field.metadata) and field.annotation is int
        )
        with pytest.raises(OptionError, match="have no two ends"):
            sweep.read_space("replan", [(open_ended, "*")])
        (choice,) = sweep.read_space("replan", [("lookahead", "*")]).dimensions
        assert choice == Choice("lookahead", (False, True))

    def test_spans_and_choices_that_make_no_sense_are_refused(self):
        with pytest.raises(ValueError, match="low < high"):
            Span("x", 1.0, 1.0)
        with pytest.raises(ValueError, match="begins above 0"):
            Span("x", 0.0, 1.0, logarithmic=True)
        with pytest.raises(ValueError, match="at least two"):
            Choice("x", (1,))


class TestValue:
    def test_runs_that_do_not_arrive_count_first(self):
        """However cheap the others are."""
        dear = sweep.rate_setting([a_run(0, cost=900.0), a_run(1, cost=900.0)], "cost")
        half = sweep.rate_setting([a_run(0, cost=1.0), a_run(1, cost=None)], "cost")
        broken = sweep.rate_setting([a_run(0, cost=1.0), a_run(1, error="no memory")], "cost")
        none = sweep.rate_setting([a_run(0, cost=None), a_run(1, cost=None)], "cost")
        assert dear == 900.0
        assert half == broken
        assert half is not None
        assert none is not None
        assert dear < half < none
        assert sweep.rate_setting([a_run(0, error="a"), a_run(1, error="b")], "cost") is None

    def test_what_is_minimised_is_what_was_asked_for(self):
        runs = [a_run(0, cost=3.0, steps=4), a_run(1, cost=5.0, steps=7)]
        assert sweep.rate_setting(runs, "cost") == 4.0
        assert sweep.rate_setting(runs, "steps") == 5.5
        assert sweep.rate_setting(runs, "seconds") == 0.5


@pytest.mark.usefixtures("in_this_process")
class TestStudy:
    SETTINGS = ({"episodes": 60, "gamma": 0.95}, {"episodes": 300, "gamma": 0.91}) * 3

    def test_each_setting_is_chosen_knowing_those_before(self, walk):
        plan, job = a_study(walk)
        trials, seen = Listed(self.SETTINGS), []
        result = sweep.do_sampled(plan, job, trials, 3, on_trial=lambda: seen.append(1))
        assert trials.events == ["ask 0", "tell 0", "ask 1", "tell 1", "ask 2", "tell 2"]
        assert len(seen) == 3
        assert not result.interrupted
        assert len(result.records) == 6
        assert result.missing == 0

    def test_what_is_under_way_when_it_is_stopped_is_given_up(self, walk):
        plan, job = a_study(walk)
        trials = Listed(self.SETTINGS)
        result = sweep.do_sampled(plan, job, trials, 9, stopped=lambda: trials.done() >= 1, jobs=2)
        assert result.interrupted
        ended = [event.split()[-1] for event in trials.events if not event.startswith("ask")]
        queries = [item.split()[-1] for item in trials.events if item.startswith("ask")]
        assert sorted(ended) == queries
        assert "give up" in " ".join(trials.events)
        assert trials.done() == len(result.plan.settings)

    def test_what_was_tried_is_listed_best_first_with_its_runs(self, walk):
        plan, job = a_study(walk)
        result = sweep.do_sampled(plan, job, Listed(self.SETTINGS), 2)
        assert isinstance(result.plan, SampledPlan)
        worth = [sweep.rate_setting(result.records[i : i + 2], "cost") for i in (0, 2)]
        assert worth == sorted(worth, key=lambda first: first or 0)
        document = result.document()
        assert {setting["trial"] for setting in document["settings"]} == {0, 1}
        assert [item["value"] for item in document["settings"]] == worth
        assert ("listed", "cost", "sampled") == tuple(
            document[key] for key in ("sampler", "minimise", "design")
        )
        assert [entry["option"] for entry in document["space"]] == ["episodes", "gamma"]
        json.dumps(document, allow_nan=False)

    def test_a_kept_trial_of_other_options_or_runs_is_damage(self, walk):
        plan, job = a_study(walk)
        for values, seeds in (({"episodes": 60}, (0, 1)), (self.SETTINGS[0], (0, 2))):
            trials = Listed([])
            trials.tell(Trial(0, values), 1.0, [a_run(seed).line() for seed in seeds])
            with pytest.raises(OptionError, match="Trial 0 of the study is damaged"):
                sweep.do_sampled(plan, job, trials, 1)

    def test_the_table_names_the_best_and_says_that_it_cannot_be_repeated(self, walk):
        plan, job = a_study(walk)
        table = tabulate_settings(sweep.do_sampled(plan, job, Listed(self.SETTINGS), 2))
        notes = "\n".join(table.notes)
        assert "2 trials of 2 runs, chosen by listed" in table.title
        assert "best       trial" in notes
        assert "-O episodes=" in notes
        assert "not to be repeated or resumed bit for bit" in notes
        assert "centre" not in notes

    def test_of_many_trials_the_best_twenty_are_shown(self, walk):
        plan, _ = a_study(walk)
        tried = [TriedSetting(Trial(n, self.SETTINGS[0]), float(n)) for n in range(25)]
        shown = tabulate_settings(replace_records(plan.with_tried(tried)))
        assert len(shown.rows) == 20
        assert any("the best 20" in note for note in shown.notes)

    def test_a_point_of_the_figure_is_a_trial(self, walk):
        plan, job = a_study(walk)
        figure = draw_sweep(sweep.do_sampled(plan, job, Listed(self.SETTINGS), 2))
        labels = [axes.get_ylabel() for axes in figure.axes]
        assert [label for label in labels if label] == [
            "arrive [%]",
            "arrive at the\noptimum [%]",
            "steps",
            "cost above the\noptimum [steps]",
            "learning [s]",
        ]


def replace_records(plan: SampledPlan) -> Any:
    """Return a result whose runs all arrive."""
    from skillplan.records import SweepResult

    records = [
        replace(a_run(seed), setting=index)
        for index in range(len(plan.settings))
        for seed in plan.seeds
    ]
    return SweepResult(plan, records)


def test_plans_that_make_no_sense_are_refused(walk):
    plan, _ = a_study(walk)
    with pytest.raises(ValueError, match="an option that varies"):
        replace(plan, space=())
    with pytest.raises(ValueError, match="The quantity to minimise"):
        replace(plan, minimise="luck")


def test_a_sampler_that_is_not_installed_is_named_with_what_installs_it(monkeypatch):
    monkeypatch.setattr(registry, "_providers", lambda kind: {})
    with pytest.raises(PluginError, match="pip install skillplan-optuna"):
        sweep.make_sampler("optuna", {})
