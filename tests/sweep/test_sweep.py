"""Parameter studies: what is varied, what the runs show, and what survives whatever happens."""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from same_process import studies_in_this_process
from skillplan import Setup, load_problem, sweep
from skillplan.cli import main
from skillplan.errors import OptionError, SkillplanError
from skillplan.records import (
    GRID,
    Axis,
    Estimate,
    Start,
    StartOutcome,
    Status,
    SweepPlan,
    SweepRecord,
    SweepResult,
    format_setting,
    mean,
    parse_record,
    share,
    t_quantile,
)
from skillplan.views.figures import draw_sweep, render_figure
from skillplan.views.tables import tabulate_settings, tabulate_starts
from thinned import release_case, slow_case

CASES = Path(__file__).parents[2] / "configs" / "swarmitfix_cases.yaml"
QUICK = [("episodes", "300")]
OUTCOME = StartOutcome("C20", Status.SOLVED, 4.0, 4, "", 0.1)
GOOD_LINE = SweepRecord(1, 2, (OUTCOME,)).line()


@pytest.fixture(scope="module")
def walk():
    """To C1, from C20."""
    return load_problem(CASES).tasks[0]


@pytest.fixture
def in_this_process():
    """No processes for the runs; that they change nothing is claimed below."""
    with studies_in_this_process():
        yield


def a_plan(**changes: Any) -> SweepPlan:
    plan = SweepPlan(
        name="cases",
        task="base-1",
        kind="swarmitfix",
        sha256="0" * 64,
        cost_unit="steps",
        step_limit=1000,
        solver="sarsa",
        physics="kinematic",
        collision="",
        design="one-at-a-time",
        axes=(Axis("gamma", (0.8, 0.9)), Axis("alpha", (0.1, 0.5))),
        centre={"gamma": 0.9, "alpha": 0.1},
        fixed={},
        starts=(Start("C20", 4.0),),
        seeds=(0, 1),
    )
    return replace(plan, **changes)


def timeless(document: Any) -> Any:
    """Return a document without what a clock decides."""
    if isinstance(document, dict):
        return {key: timeless(value) for key, value in document.items() if key != "learning_s"}
    return [timeless(item) for item in document] if isinstance(document, list) else document


class TestValues:
    def test_a_range_is_evenly_spaced_and_has_both_ends(self):
        assert (0.8, 0.85, 0.9) == sweep.space_evenly("gamma", "0.8:0.9:3")

    def test_a_logarithmic_range_multiplies(self):
        assert (0.01, 0.1, 1.0) == sweep.space_evenly("alpha", "0.01:1:3:log")

    @given(
        st.floats(1e-6, 1e6),
        st.floats(1e-6, 1e6),
        st.integers(2, 200),
        st.sampled_from(["", ":log"]),
    )
    def test_every_range_runs_one_way_between_its_ends(self, first, last, count, how):
        if first == last:
            return
        values = sweep.space_evenly("x", f"{first!r}:{last!r}:{count}{how}")
        assert (first, last) == (values[0], values[-1])
        assert count >= len(values) >= 2
        if abs(first - last) > 1e-3 * max(first, last):
            assert sorted(values, reverse=first > last) == list(values)

    def test_whole_numbered_options_take_the_nearest_whole_values_once(self):
        values = sweep.read_values("sarsa", [("episodes", "1:3:9")])
        assert (1, 2, 3) == values.axes[0].values
        assert values.centre["episodes"] is None

    def test_words_and_truths_can_be_listed(self):
        values = sweep.read_values(
            "sarsa", [("objective", "cost,reward"), ("expected", "true,false")]
        )
        assert [("cost", "reward"), (True, False)] == [axis.values for axis in values.axes]

    def test_text_with_a_comma_is_one_value_of_an_option_that_takes_any_text(self):
        values = sweep.read_values("sarsa", [("watch", "at(C1),at(C2)")])
        assert ((), {"watch": "at(C1),at(C2)"}) == (values.axes, values.fixed)

    def test_one_value_beside_several_is_the_centre(self):
        values = sweep.read_values(
            "sarsa", [("gamma", "0.7"), ("gamma", "0.8,0.9"), ("alpha", "0.2")]
        )
        assert ({"gamma": 0.7}, {"alpha": 0.2}) == (values.centre, values.fixed)

    @pytest.mark.parametrize(
        ("name", "text", "message"),
        [
            ("gamma", "0.8:0.9", "has the form FROM:TO:COUNT"),
            ("gamma", "0.8:0.9:3:lin", "has the form FROM:TO:COUNT"),
            ("gamma", "0.8:x:3", "the ends of a range are numbers"),
            ("gamma", "0.8:inf:3", "the ends of a range are finite numbers"),
            ("gamma", "0.8:0.9:1", "whole number from 2 to 1,000, not '1'"),
            ("gamma", "0.8:0.9:2.5", "whole number from 2 to 1,000, not '2.5'"),
            ("gamma", "0.8:0.9:1001", "whole number from 2 to 1,000, not '1001'"),
            ("gamma", "0.8:0.8:3", "the ends of a range differ"),
            ("gamma", "0:1:3:log", "the ends of a logarithmic range are > 0"),
            ("gamma", "0.8:1.2:3", "gamma"),
            ("gamma", "0.8,,0.9", "a value of the list is missing"),
            ("gamma", "nan,0.5", "gamma"),
            ("gamma", ",".join(map(str, range(1001))), "lists more than 1,000 values"),
            ("gama", "0.8:0.9:3", "Did you mean 'gamma'?"),
            ("expected", "true,perhaps", "expected"),
        ],
    )
    def test_a_wrong_value_is_one_clear_error(self, name, text, message):
        with pytest.raises(OptionError) as caught:
            sweep.read_values("sarsa", [(name, text)])
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)

    @pytest.mark.parametrize("texts", [("0.1", "0.2"), ("0.1,0.2", "0.3,0.4")])
    def test_an_option_given_twice_is_refused(self, texts):
        with pytest.raises(OptionError, match="'alpha' is given twice"):
            sweep.read_values("sarsa", [("alpha", text) for text in texts])


class TestPlans:
    def test_one_at_a_time_varies_around_the_centre_and_does_nothing_twice(self):
        settings = a_plan().settings
        assert [(0.8, 0.1), (0.9, 0.1), (0.9, 0.5)] == [(s["gamma"], s["alpha"]) for s in settings]

    def test_a_grid_takes_all_combinations(self):
        assert 4 == len(a_plan(design=GRID).settings)

    def test_an_axis_shows_the_settings_in_which_the_others_are_at_the_centre(self):
        plan = a_plan()
        assert [[0], [1]] == plan.settings_along(plan.axes[0])
        assert [[1], [2]] == plan.settings_along(plan.axes[1])

    def test_in_a_grid_an_axis_shows_all_settings_of_a_value(self):
        plan = a_plan(design=GRID)
        assert [[0, 1], [2, 3]] == plan.settings_along(plan.axes[0])

    def test_without_axes_there_is_one_setting(self):
        assert [{}] == a_plan(axes=(), centre={}).settings
        assert "defaults" == format_setting({})

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"design": "random"}, "A design is one of"),
            ({"axes": (Axis("gamma", (0.8,)),) * 2}, "An axis occurs twice"),
            ({"centre": {}}, "The centre must hold"),
            ({"starts": ()}, "The starts must be distinct"),
            ({"seeds": (1, 1)}, "The seeds must be distinct"),
        ],
    )
    def test_a_plan_that_makes_no_sense_is_refused(self, changes, message):
        with pytest.raises(ValueError, match=message):
            a_plan(**changes)

    def test_parts_of_a_plan_that_make_no_sense_are_refused(self):
        with pytest.raises(ValueError, match="has no values"):
            Axis("gamma", ())
        with pytest.raises(ValueError, match="has a value twice"):
            Axis("gamma", (0.8, 0.8))
        with pytest.raises(ValueError, match="must be >= 0"):
            Start("C1", -1.0)
        with pytest.raises(ValueError, match="at least one start"):
            sweep.StudyJob({}, "sarsa", Setup())

    @pytest.mark.parametrize(
        ("starts", "message"),
        [
            (["C99"], "--starts C99: no place 'C99'"),
            (["C1", "at(C1)"], "is named twice"),
            (["C1+C2"], "cannot both hold"),
        ],
    )
    def test_a_wrong_start_is_named(self, walk, starts, message):
        with pytest.raises(OptionError) as caught:
            sweep.plan_study(walk, "sarsa", QUICK, starts=starts)
        assert message in str(caught.value)

    def test_too_many_runs_are_refused(self, walk):
        values = [("gamma", "0.1:0.9:500"), ("alpha", "0.1:0.9:500")]
        with pytest.raises(OptionError, match="more than 100,000 runs"):
            sweep.plan_study(walk, "sarsa", values, design=GRID)

    def test_a_solver_that_cannot_serve_the_task_is_told_before_any_run(self, board_task):
        with pytest.raises(OptionError, match="cannot serve 'inverter-board'"):
            sweep.plan_study(board_task, "value-iteration", [("max_states", "10")])


class TestIntervals:
    @pytest.mark.parametrize(
        ("freedom", "quantile"),
        [(1, 12.7062), (2, 4.3027), (4, 2.7764), (9, 2.2622), (29, 2.0452), (1000, 1.9623)],
    )
    def test_quantiles_are_those_of_the_printed_table(self, freedom, quantile):
        assert quantile == pytest.approx(t_quantile(freedom), abs=5e-5)

    def test_quantiles_have_no_step_where_the_formula_changes(self):
        assert t_quantile(1000) == pytest.approx(t_quantile(1001), abs=1e-5)

    def test_ten_of_ten_may_still_fail_one_time_in_four(self):
        """Wilson's interval does not shrink to a point; Brown, Cai and DasGupta (2001)."""
        ten = share(10, 10)
        assert ten is not None
        assert ten.low == pytest.approx(0.7225, abs=1e-4)
        assert 1.0 == ten.high

    @given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
    def test_a_share_and_its_complement_mirror_each_other(self, counts):
        count, total = counts
        first, other = share(count, total), share(total - count, total)
        assert first is not None
        assert other is not None
        assert first.low is not None
        assert other.high is not None
        assert first.low == pytest.approx(1 - other.high, abs=1e-12)
        assert 0 <= first.low <= first.value

    @pytest.mark.slow(reason="many draws; single intervals in every run")
    def test_the_interval_of_a_mean_covers_it_95_times_of_100(self):
        rng, covered = random.Random(1), 0
        for _ in range(2000):
            estimate = mean([rng.gauss(3.0, 2.0) for _ in range(5)])
            assert estimate is not None
            assert estimate.low is not None
            assert estimate.high is not None
            covered += estimate.low <= 3.0 <= estimate.high
        assert 0.95 == pytest.approx(covered / 2000, abs=0.012)

    def test_too_few_runs_give_no_interval(self):
        assert (None, None) == (mean([]), share(0, 0))
        assert Estimate(2.0) == mean([2.0])
        assert Estimate(5.5) == mean([3.0, 8.0])
        assert mean([3.0, 8.0, 5.0]).low is not None

    def test_runs_of_a_deterministic_solver_are_no_samples(self, walk):
        """Their shares and means have no interval, their times have."""
        plan, job = sweep.plan_study(walk, "value-iteration", starts=["C20"], runs=3)
        result = SweepResult(plan, [sweep.do_run(job, 0, {}, seed) for seed in plan.seeds])
        summary = result.summary([0])
        assert (Estimate(1.0), Estimate(0.0)) == (summary.arrived_share, summary.excess)
        assert summary.learning_s.low is not None
        table = tabulate_settings(result)
        shown = "\n".join([*map(" ".join, table.rows), *table.notes])
        assert "deterministic" in shown
        assert "value-iteration does not depend on the seed" in shown

    def test_what_makes_no_sense_is_refused(self):
        with pytest.raises(ValueError, match="makes no sense"):
            share(2, 1)
        with pytest.raises(ValueError, match="must be >= 1"):
            t_quantile(0)
        with pytest.raises(ValueError, match="two ends"):
            Estimate(1.0, 0.5)
        with pytest.raises(ValueError, match="lies outside"):
            Estimate(1.0, 2.0, 3.0)


class TestRecords:
    def test_a_record_survives_its_line(self):
        for record in (
            SweepRecord(1, 2, (OUTCOME,), True, 300),
            SweepRecord(1, 2, (replace(OUTCOME, status=Status.UNSOLVED, cost=None, steps=None),)),
            SweepRecord(0, 0, error="refused: it is Monday"),
        ):
            assert record == parse_record(record.line())

    @pytest.mark.parametrize(
        "line",
        [
            "",
            "7",
            "[]",
            "{}",
            '{"outcomes": 3}',
            '{"setting": 0, "seed": 0, "outcomes": []}',
            GOOD_LINE[:-9],
            GOOD_LINE.replace('"seed": 2', '"seed": "2"'),
            GOOD_LINE.replace("solved", "soluble"),
        ],
    )
    def test_a_damaged_line_is_never_trusted(self, line):
        parse_record(GOOD_LINE)
        with pytest.raises(ValueError):  # noqa: PT011  # what is wrong differs
            parse_record(line)

    def test_records_that_make_no_sense_are_refused(self):
        with pytest.raises(ValueError, match="does not fit its cost"):
            replace(OUTCOME, cost=None)
        with pytest.raises(ValueError, match="finite and >= 0"):
            replace(OUTCOME, learning_s=-1.0)
        with pytest.raises(ValueError, match="must be >= 0"):
            SweepRecord(-1, 0, (OUTCOME,))
        with pytest.raises(ValueError, match="either outcomes or an error"):
            SweepRecord(0, 0)
        with pytest.raises(ValueError, match="occurs twice"):
            SweepResult(a_plan(), [SweepRecord(0, 0, (OUTCOME,))] * 2)
        with pytest.raises(ValueError, match="is not of this study"):
            SweepResult(a_plan(), [SweepRecord(9, 0, (OUTCOME,))])


class TestStudies:
    @pytest.mark.usefixtures("in_this_process")
    def test_one_policy_answers_from_all_starts_within_its_optima(self, walk):
        """The paper's five cases at its best parameters."""
        starts = ["C20", "C6", "C35", "C52", "C78"]
        plan, job = sweep.plan_study(walk, "sarsa", starts=starts, runs=2)
        result = sweep.do_study(plan, job)
        assert result.shared
        assert [4.0, 3.0, 5.0, 8.0, 9.0] == [start.optimum for start in plan.starts]
        for start in plan.starts:
            summary = result.summary([0], start.name)
            assert (2, 2) == (summary.runs, summary.arrived)
            assert summary.excess is not None
            assert 0.0 <= summary.excess.value
        times = {outcome.learning_s for outcome in result.records[0].outcomes}
        assert 1 == len(times)

    @pytest.mark.usefixtures("in_this_process")
    def test_a_solver_of_plans_is_run_once_for_every_start(self, walk):
        plan, job = sweep.plan_study(walk, "exact", starts=["C20", "C6"], runs=1)
        result = sweep.do_study(plan, job)
        assert not result.shared
        assert [4, 3] == [outcome.steps for outcome in result.records[0].outcomes]
        assert 1 == result.summary([0]).best

    @pytest.mark.slow(
        reason="two processes that compile; a run in a process of its own that fails in every run"
    )
    def test_results_depend_neither_on_processes_nor_on_their_order(self, walk):
        values = [("episodes", "200,400"), ("alpha", "0.1,0.5")]
        plan, job = sweep.plan_study(walk, "sarsa", values, starts=["C20", "C78"], runs=2)
        two = sweep.do_study(plan, job, jobs=2).document()
        with studies_in_this_process():
            document = sweep.do_study(plan, job).document()
        assert timeless(document) == timeless(two)

    def test_figures_are_those_of_the_runs(self):
        far = replace(OUTCOME, cost=6.0, steps=6)
        lost = StartOutcome("C20", Status.UNSOLVED, None, None, "lost", 0.3)
        plan = a_plan(seeds=(0, 1, 2, 3))
        records = [SweepRecord(0, seed, (item,)) for seed, item in enumerate((OUTCOME, far, lost))]
        result = SweepResult(plan, [*records, SweepRecord(0, 3, error="broke")])
        summary = result.summary([0], "C20")
        assert (3, 2, 1) == (summary.runs, summary.arrived, summary.best)
        assert summary.steps is not None
        assert summary.excess is not None
        assert summary.learning_s is not None
        assert (5.0, 1.0) == (summary.steps.value, summary.excess.value)
        assert summary.learning_s.value == pytest.approx(statistics.mean([0.1, 0.1, 0.3]))
        assert (1, 8) == (len(result.failed), result.missing)

    def test_tables_name_what_failed_and_what_is_missing(self):
        result = SweepResult(a_plan(), [SweepRecord(2, 1, error="out of memory")])
        notes = "\n".join(tabulate_settings(result).notes)
        assert "gamma = 0.9, alpha = 0.5, seed 1: out of memory" in notes
        assert "5 of the runs have not been done" in notes
        assert 3 == len(tabulate_starts(result).rows)

    def test_a_run_that_goes_wrong_says_so_and_raises_nothing(self, board_task):
        _, job = sweep.plan_study(board_task, "value-iteration", [("max_states", "1000")])
        record = sweep.do_run(job, 0, {"max_states": 10}, 0)
        assert "refused" in (record.error or "")
        assert "no option" in (sweep.do_run(job, 0, {"gama": 1}, 0).error or "")

    @pytest.mark.usefixtures("in_this_process")
    def test_a_stopped_study_keeps_what_is_done(self, walk):
        plan, job = sweep.plan_study(walk, "sarsa", QUICK, runs=50)
        seen: list[SweepRecord] = []
        result = sweep.do_study(plan, job, stopped=lambda: len(seen) >= 2, on_run=seen.append)
        assert result.interrupted
        assert 50 == len(result.records) + result.missing
        assert 2 <= len(result.records) < 50


@pytest.fixture(scope="module")
def study(walk):
    """Four short runs."""
    return sweep.plan_study(walk, "sarsa", [("episodes", "200,300")], runs=2)


@pytest.fixture(scope="module")
def done(study, tmp_path_factory):
    """The folder of the study once all is done, and its document."""
    path = tmp_path_factory.mktemp("done") / "study"
    plan, job = study
    with studies_in_this_process(), sweep.StudyFolder(str(path), plan) as folder:
        return path, sweep.do_study(plan, job, folder=folder).document()


@pytest.mark.usefixtures("in_this_process")
class TestFolders:
    @pytest.fixture
    def copied(self, done, tmp_path):
        """The same folder, to be changed freely."""
        return Path(shutil.copytree(done[0], tmp_path / "study"))

    def test_what_is_there_is_not_done_again(self, study, done, copied):
        plan, job = study
        with sweep.StudyFolder(str(copied), plan, resume=True) as folder:
            assert 4 == len(folder.records)
            again = sweep.do_study(plan, job, folder=folder)
        assert done[1] == again.document()

    @pytest.mark.parametrize(
        "length",
        [
            -1,
            slow_case(17, reason="torn elsewhere in every run"),
            slow_case(0, reason="torn elsewhere in every run"),
        ],
    )
    def test_a_torn_last_line_is_dropped_and_its_run_done_again(self, study, done, copied, length):
        plan, job = study
        runs = copied / "runs.jsonl"
        left = runs.read_bytes()[:length]
        runs.write_bytes(left)
        with sweep.StudyFolder(str(copied), plan, resume=True) as folder:
            assert left.count(b"\n") == len(folder.records) < 4
            again = sweep.do_study(plan, job, folder=folder)
        assert timeless(done[1]) == timeless(again.document())
        assert 4 == runs.read_bytes().count(b"\n")

    def test_another_damaged_line_is_named(self, study, copied):
        plan, _ = study
        runs = copied / "runs.jsonl"
        runs.write_bytes(b"oops\n" + runs.read_bytes())
        with pytest.raises(OptionError, match=r"runs.jsonl:1: is damaged: .* Delete the line"):
            sweep.StudyFolder(str(copied), plan, resume=True)

    def test_failed_runs_are_done_again(self, study, tmp_path):
        plan, job = study
        with sweep.StudyFolder(str(tmp_path), plan) as folder:
            folder.add(SweepRecord(0, 0, error="out of memory"))
        with sweep.StudyFolder(str(tmp_path), plan, resume=True) as folder:
            assert [] == folder.records
            assert [] == sweep.do_study(plan, job, folder=folder).failed

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"sha256": "f" * 64}, "differs in the task"),
            ({"seeds": (0, 1, 2)}, "the seeds: \\[0, 1\\] there, \\[0, 1, 2\\] now"),
            ({"step_limit": 5}, "the step limit: 1000 there, 5 now"),
            ({"starts": (Start("C6"),)}, "differs in the starts"),
            ({"fixed": {"sarsa": {"alpha": 0.2}}}, "differs in the fixed options"),
            ({"axes": (Axis("episodes", (200,)),)}, "differs in the values of the options"),
        ],
    )
    def test_another_study_is_refused_in_words(self, study, tmp_path, changes, message):
        plan, _ = study
        sweep.StudyFolder(str(tmp_path), plan).close()
        with pytest.raises(OptionError, match=message):
            sweep.StudyFolder(str(tmp_path), replace(plan, **changes), resume=True)

    def test_nothing_there_is_overwritten(self, study, tmp_path):
        plan, _ = study
        (tmp_path / "thesis.tex").write_text("words")
        with pytest.raises(OptionError, match="is not empty"):
            sweep.StudyFolder(str(tmp_path), plan)
        with pytest.raises(OptionError, match=r"holds no manifest.json"):
            sweep.StudyFolder(str(tmp_path), plan, resume=True)
        assert ["thesis.tex"] == [path.name for path in tmp_path.iterdir()]

    def test_two_studies_do_not_write_to_one_folder(self, study, tmp_path):
        pytest.importorskip("fcntl")
        plan, _ = study
        with (
            sweep.StudyFolder(str(tmp_path), plan),
            pytest.raises(OptionError, match="another study is writing there"),
        ):
            sweep.StudyFolder(str(tmp_path), plan, resume=True)

    @pytest.mark.parametrize("content", ["", "{", "[]", '{"schema": "skillplan.sweep-manifest/9"}'])
    def test_a_manifest_that_is_none_is_refused(self, study, tmp_path, content):
        plan, _ = study
        (tmp_path / "manifest.json").write_text(content)
        with pytest.raises(OptionError, match=r"--out"):
            sweep.StudyFolder(str(tmp_path), plan, resume=True)


class TestKilling:
    @pytest.mark.parametrize(
        "kills",
        [
            slow_case(1, reason="a study killed and done again; a training cut short in every run"),
            release_case(6, reason="6 kills; one in the whole suite"),
        ],
    )
    def test_killed_at_any_instant_and_resumed_it_equals_an_uninterrupted_study(
        self, tmp_path, capsys, kills
    ):
        """SIGKILL at random moments, from the start of the program on and amid its runs."""
        runs = tmp_path / "killed" / "runs.jsonl"

        def noted() -> int:
            return runs.read_bytes().count(b"\n") if runs.exists() else 0

        def words(folder: str) -> list[str]:
            command = ["sweep", str(CASES), "--resume", "--starts", "C20,C78", "--jobs", "2"]
            values = ["-O", "gamma=0.8:0.999:4", "-O", "episodes=4000", "--runs", str(kills)]
            return [*command, *values, "--out", str(tmp_path / folder), "--format", "json"]

        def uninterrupted(folder: str) -> Any:
            with studies_in_this_process(), pytest.raises(SystemExit) as ended:
                main(words(folder))
            captured = capsys.readouterr()
            assert 0 == ended.value.code, captured.err
            return json.loads(captured.out)

        whole = uninterrupted("whole")
        rng = random.Random(7)
        for kill in range(kills):
            before = noted()
            process = subprocess.Popen(
                [sys.executable, "-m", "skillplan", *words("killed")],
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
            amid = kill % 2 == 0
            if amid:
                while noted() == before and process.poll() is None:
                    time.sleep(0.01)
            time.sleep(rng.uniform(0.0, 0.1) if amid else rng.uniform(0.1, 3.0))
            process.send_signal(signal.SIGKILL)
            process.wait()
        lines = noted()
        resumed = uninterrupted("killed")
        assert 0 < lines <= 4 * kills
        assert timeless(whole) == timeless(resumed)
        assert timeless(whole) == timeless(
            json.loads((tmp_path / "killed" / "sweep.json").read_text())
        )

    @pytest.mark.slow(
        reason="a study that is killed; every run kills a program whose processes check skills"
    )
    def test_processes_end_with_the_program_that_started_them(self, tmp_path):
        """However abruptly that ends."""
        if not Path("/proc").is_dir():
            pytest.skip("processes are looked up in /proc")
        command = [sys.executable, "-m", "skillplan", "sweep", str(CASES), "--jobs", "2"]
        process = subprocess.Popen(
            [*command, "-O", "episodes=100000000", "--out", str(tmp_path / "a")],
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        deadline_s = time.monotonic() + 30
        while len(in_session(process.pid)) < 3:
            assert time.monotonic() < deadline_s
            time.sleep(0.02)
        process.kill()
        process.wait()
        while in_session(process.pid):
            assert time.monotonic() < deadline_s
            time.sleep(0.02)


def in_session(session: int) -> list[int]:
    """Return the processes of a session."""
    results = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if os.getsid(int(entry.name)) == session:
                    results.append(int(entry.name))
            except ProcessLookupError:
                continue
    return results


class TestFigures:
    @pytest.mark.usefixtures("in_this_process")
    @pytest.mark.parametrize(
        "design",
        [
            slow_case("one-at-a-time", reason="draws a study; other figures in every run"),
            slow_case("grid", reason="draws a study; other figures in every run"),
        ],
    )
    def test_there_is_a_column_for_every_option(self, walk, design):
        values = [("episodes", "100,200,1000"), ("objective", "cost,reward")]
        plan, job = sweep.plan_study(
            walk, "sarsa", values, starts=["C20", "C6"], runs=2, design=design
        )
        figure = draw_sweep(sweep.do_study(plan, job))
        assert 6 == len(figure.axes)
        assert ["episodes", "objective"] == [axes.get_xlabel() for axes in figure.axes[4:]]
        assert render_figure(figure, ".svg") == render_figure(figure, ".svg")

    def test_what_cannot_be_drawn_is_said(self):
        nothing = SweepResult(a_plan(axes=(), centre={}), [SweepRecord(0, 0, (OUTCOME,))])
        with pytest.raises(OptionError, match="1 to 6 options that vary, not 0"):
            draw_sweep(nothing)
        starts = tuple(Start(f"C{i}") for i in range(9))
        with pytest.raises(SkillplanError, match="up to 8 starts, not 9"):
            draw_sweep(SweepResult(a_plan(starts=starts), []))
