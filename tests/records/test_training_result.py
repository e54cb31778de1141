"""Several training runs as one document and one table."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.model import replay
from skillplan.pipeline import load_problem, make_model
from skillplan.records import (
    MISSING,
    TABLE_III,
    Difference,
    GreedyRollOut,
    LayoutOutcome,
    LayoutsResult,
    Optimum,
    RandomBaseline,
    RunOutcome,
    RunStatus,
    Sampling,
    Tally,
    TrainingRecord,
    TrainingResult,
    describe_changes,
    differences,
    get_published_runs,
    resolve_config,
    summarise_training,
)
from skillplan.solvers import Episode, deviation
from skillplan.task import Task
from skillplan.views import render_csv, render_markdown
from skillplan.views.tables import tabulate_layouts, tabulate_training

CONFIGS = Path(__file__).parents[2] / "configs"
BEST = 1.8670860141568904


@pytest.fixture(scope="module")
def board():
    return load_problem(CONFIGS / "inverter_board.yaml").task


def a_roll_out(cost: float | None = BEST, kept: Any = "best") -> GreedyRollOut:
    reason = "" if cost is not None else "pick(pcb) at step 2: the hand is full"
    return GreedyRollOut(kept, (0, 1), ("pick(pcb)", "place(pcb)"), cost, 400, reason)


def a_run(run: int = 0, cost: float | None = BEST, **more: Any) -> RunOutcome:
    best = a_roll_out(cost) if cost is not None else None
    return RunOutcome(run, 7 + run, best=best, last=a_roll_out(cost, "last"), **more)


def a_result(task: Task, *outcomes: RunOutcome, **more: Any) -> TrainingResult:
    more.setdefault("optimum", Optimum(BEST, (0, 1)))
    return TrainingResult(task, "runs", "dqn", 20_000, outcomes, **more)


def an_episode(step: int, cost: float | None = None) -> Episode:
    end: Any = "infeasible" if cost is None else "complete"
    return Episode(0, step, end, (step % 7,), cost or 0.0, 0.0, greedy=False)


class TestRecord:
    def test_it_counts_all_episodes_and_those_of_the_last_2000_steps(self):
        episodes = [
            an_episode(500),
            an_episode(1_000, 3.0),
            an_episode(1_001),
            an_episode(3_000, 2),
        ]
        record = summarise_training(episodes, 3_000, 1.5)
        assert (Tally(2, 4), Tally(1, 2)) == (record.every, record.recent)
        assert (1_000, 2.0, (4,), 1.5) == (
            record.first_success_step,
            record.best_cost,
            record.best_actions,
            record.wall_s,
        )

    def test_a_run_without_success_has_no_best(self):
        record = summarise_training([an_episode(5)], 10)
        assert (None, None, ()) == (
            record.first_success_step,
            record.best_cost,
            record.best_actions,
        )

    def test_a_run_without_an_episode_has_no_rate(self):
        assert summarise_training([], 10).recent.rate is None

    @pytest.mark.parametrize("counts", [(2, 1), (-1, 3)])
    def test_more_successes_than_episodes_are_refused(self, counts):
        with pytest.raises(ValueError, match="make no sense"):
            Tally(*counts)


class TestOutcome:
    def test_a_run_stands_for_its_best_policy(self):
        run = RunOutcome(0, 7, best=a_roll_out(2.0), last=a_roll_out(None, "last"))
        assert (RunStatus.COMPLETE, 2.0, "") == (run.status, run.cost, run.reason)

    def test_without_a_best_one_it_stands_for_its_last(self):
        run = RunOutcome(0, 7, last=a_roll_out(None, "last"))
        assert RunStatus.INCOMPLETE is run.status
        assert "pick(pcb) at step 2: the hand is full" == run.reason

    def test_a_run_that_failed_says_why_and_may_have_a_policy_all_the_same(self):
        run = RunOutcome(0, 7, "its figures are not finite", best=a_roll_out(2.0))
        assert (RunStatus.FAILED, "its figures are not finite", 2.0) == (
            run.status,
            run.reason,
            run.cost,
        )

    def test_a_roll_out_has_a_cost_or_a_reason(self):
        with pytest.raises(ValueError, match="or there is a reason"):
            GreedyRollOut("best", (), (), 1.0, reason="no")
        with pytest.raises(ValueError, match="or there is a reason"):
            GreedyRollOut("best", (), (), None)

    def test_what_a_proof_leaves_open_is_no_deviation(self):
        assert 0.0 == deviation(BEST * (1 - 5e-7), BEST)
        assert 0.0 == deviation(BEST * (1 + 5e-7), BEST)
        assert pytest.approx(1.25e-5, rel=0.02) == deviation(1.86710934, BEST)

    def test_nothing_costs_too_much_where_nothing_is_free(self):
        assert deviation(None, 1.0) is None
        assert deviation(1.0, None) is None
        assert 0.0 == deviation(0.0, 0.0)
        assert deviation(1.0, 0.0) is None


class TestResult:
    def test_runs_are_counted_by_how_near_they_come(self, board):
        costs = [BEST, 1.867109595246078, 1.88012, 1.939, None]
        result = a_result(board, *(a_run(i, cost) for i, cost in enumerate(costs)))
        document = result.document()
        assert (4, 1, 2, 3) == tuple(
            document[key]
            for key in ("completed_runs", "optimal_runs", "zero_percent_runs", "one_percent_runs")
        )

    def test_without_a_proof_nothing_is_said_of_deviations(self, board):
        result = a_result(board, a_run(), optimum=Optimum(reason="exact: unsolved, time limit"))
        document = result.document()
        for key in ("optimum", "optimal_runs", "zero_percent_runs", "deviation_iqm"):
            assert document[key] is None, key
        assert document["runs"][0]["deviation"] is None
        assert BEST == document["cost_iqm"]["value"]
        assert [] == document["published"]

    def test_what_was_seen_on_other_layouts_is_not_held_to_this_ones_optimum(self, board):
        record = summarise_training([an_episode(10, 2.2)], 100, 1.0)
        (own,) = a_result(board, a_run(training=record)).document()["runs"]
        (other,) = a_result(board, a_run(training=record), family=True).document()["runs"]
        assert 2.2 == own["best_cost_seen"] == other["best_cost_seen"]
        assert own["best_deviation_seen"] > 0.1
        assert other["best_deviation_seen"] is None

    def test_success_is_of_sampled_roll_outs_where_there_are_any(self, board):
        record = TrainingRecord(20_000, Tally(5, 50), Tally(3, 4))
        trained = a_result(board, a_run(training=record), a_run(1, training=record))
        assert Tally(6, 8) == trained.success
        sampled = a_result(
            board,
            a_run(training=record, sampled=Tally(9, 10)),
            a_run(1, training=record, sampled=Tally(0, 10)),
            sampling=Sampling(10, 0.05, 0),
        )
        document = sampled.document()
        assert (0.45, "sampled", 0.75) == (
            document["success_rate"],
            document["success_of"],
            document["training_success_rate"],
        )
        low, high = document["success_ci95"]
        assert 0.25 < low < 0.45 < high < 0.66

    def test_the_document_is_json(self, board):
        result = a_result(
            board,
            a_run(),
            RunOutcome(1, 8, "broke down"),
            baseline=RandomBaseline(Tally(0, 100), None, "none"),
            steps_per_s=1234.5,
        )
        document = json.loads(json.dumps(result.document(), allow_nan=False))
        assert "skillplan.training/1" == document["schema"]
        assert [1] == document["failed_runs"]
        assert 0.0 == document["random_baseline"]["success_rate"]
        keys = (
            "run seed status actions skills cost deviation success_rate best_cost_seen wall_s "
            "completed_step training_success_rate"
        )
        for run in document["runs"]:
            assert set(keys.split()) <= set(run)

    @pytest.mark.parametrize("words", [{}, {"cost": 1.0, "reason": "no"}], ids=["neither", "both"])
    def test_an_optimum_is_proved_or_there_is_a_reason(self, words):
        with pytest.raises(ValueError, match="proved, or there is a reason"):
            Optimum(**words)


class TestPublished:
    def test_every_sequence_of_table_iii_costs_what_is_printed(self, board):
        """Replayed on the board; the optimum rounds to the paper's."""
        model = make_model(board)
        for item in TABLE_III:
            if item.cost is not None:
                walked = replay(model, [board.skill(action) for action in item.actions])
                assert walked.complete
                assert item.cost == round(walked.cost, 3)
                assert item.deviation == pytest.approx(item.cost / 1.867 - 1, abs=6e-5)

    def test_it_stands_beside_runs_on_the_papers_board(self, board):
        assert TABLE_III == get_published_runs(board, BEST)

    def test_it_stands_beside_no_other_task(self, board):
        """Not beside a board whose optimum is another one or not known, nor another board."""
        other = load_problem(CONFIGS / "motor_drive.yaml").task
        assert () == get_published_runs(board, None)
        assert () == get_published_runs(board, 1.9)
        assert () == get_published_runs(board.replace(name="my-board"), BEST)
        assert () == get_published_runs(other.replace(name="inverter-board"), BEST)


class TestTable:
    def test_a_row_says_what_table_iii_says_and_no_run_is_paired_with_one_of_the_paper(self, board):
        (table,) = tabulate_training(a_result(board, a_run(), a_run(1, 1.8801202), a_run(2, None)))
        cells = [dict(zip((c.heading for c in table.columns), r, strict=True)) for r in table.rows]
        assert ["0,1", "0,1", "N/A"] == [row["sequence"] for row in cells]
        assert ["1.86709", "1.88012", "N/A"] == [row["distance [m]"] for row in cells]
        assert ["0.00 %", "0.70 %", "N/A"] == [row["deviation"] for row in cells]
        assert not any("paper" in column.heading for column in table.columns)

    def test_only_the_papers_task_has_a_note_on_the_paper(self, board):
        other = load_problem(CONFIGS / "motor_drive.yaml").task
        noted = [
            any("Moller" in note for note in tabulate_training(a_result(task, a_run()))[0].notes)
            for task in (board, other)
        ]
        assert [True, False] == noted

    def test_seeds_of_a_planner_get_no_interval(self, board):
        """Their episodes were planned with a learned model; runs that explored are a sample."""
        for explores in (False, True):
            record = TrainingRecord(500, planned=9, settled_step=400, explores=explores)
            runs = [
                a_run(i, cost, training=record) for i, cost in enumerate((BEST, BEST, 1.8801202))
            ]
            result = a_result(board, *runs)
            text = render_markdown(tabulate_training(result)[0])
            document = result.document()
            for key in ("completion", "deviation_iqm", "cost_iqm"):
                assert (document[key]["ci95"] is None) is not explores, key
            assert ("seeds of a planner do not form a sample" in text) is not explores
            assert ("settled in 3 of 3 runs after 400 steps" in text) is not explores
            assert ("explored 3 of 3 runs without plans" in text) is explores
            assert ("interquartile mean 0.23 % (95 %" in text) is explores

    def test_below_stand_optimum_counts_intervals_and_what_failed(self, board):
        record = TrainingRecord(20_000, Tally(5, 50), Tally(3, 4), 900, 1.9)
        result = a_result(
            board,
            a_run(training=record),
            a_run(1, 1.8801202),
            RunOutcome(2, 9, "its figures are not finite"),
            baseline=RandomBaseline(Tally(1, 100), 1.9, "none"),
            interrupted=True,
        )
        text = render_markdown(tabulate_training(result)[0])
        for part in (
            "optimum 1.86709 m, proved by auto",
            "2 of 3 complete, 1 at 0.00 % (1 at the optimum itself), 2 within 1 %, 1 failed",
            "interquartile mean 0.35 %, of the 2 runs that complete",
            "75.0 % (95 %: 30.1 % to 95.4 %) of the 4 episodes",
            "1.90000 m while learning, deviation 1.76 %",
            "1.0 % (95 %: 0.2 % to 5.4 %) of 100 episodes of even chance, mask none",
            "run 2 failed: its figures are not finite",
            "Table III: 8 of 10 complete, 4 at 0.00 %",
            "train --resume goes on",
        ):
            assert part in text, part

    @pytest.mark.parametrize(("steps", "shown"), [(600, "600"), (2_000, "2,000"), (9_000, "2,000")])
    def test_a_training_counts_no_more_steps_than_it_had(self, board, steps, shown):
        """Its success is that of the last 2,000 steps, or of all if there were fewer."""
        episodes = [an_episode(steps // 2, BEST), an_episode(steps, BEST)]
        run = a_run(training=summarise_training(episodes, steps))
        text = render_markdown(tabulate_training(a_result(board, run))[0])
        assert f"that ended in the last {shown} steps of a run completed the task" in text

    def test_csv_has_a_line_for_every_run(self, board):
        text = render_csv(tabulate_training(a_result(board, a_run(), a_run(1)))[0])
        assert 3 == len(text.splitlines())
        assert text.startswith("run,seed,sequence,distance [m],deviation,success")


class TestLayouts:
    def a_result(self, *costs: tuple[float | None, ...], **more: Any) -> LayoutsResult:
        rows = tuple(
            LayoutOutcome(
                f"board/{number}",
                Optimum(2.0, wall_s=0.05),
                tuple(a_roll_out(cost) for cost in answers),
                (0.01,) * len(answers),
            )
            for number, answers in enumerate(costs)
        )
        return LayoutsResult(rows, 40, **more)

    def test_answers_are_counted_over_all_layouts(self):
        result = self.a_result((2.0, 2.01), (2.1, None))
        assert (3, 2, 1) == (
            sum(row.completed for row in result.rows),
            result.at_most(0.01),
            result.at_most(0.0),
        )
        assert result.complete_share is not None
        assert 0.75 == result.complete_share.value

    def test_a_layout_counts_once_however_many_answers_it_has(self):
        """The mean of its answers that complete; of none it has no figure."""
        item = self.a_result((2.0, 2.2), (2.4,), (None,)).deviation_iqm
        assert item is not None
        assert pytest.approx((0.05 + 0.2) / 2) == item.value

    def test_training_pays_off_after_the_layouts_whose_proofs_it_saves(self, board):
        notes = tabulate_layouts(self.a_result((2.0,), training_s=8.0), board).notes
        assert any("pays off after 200 layouts" in note for note in notes)

    def test_training_does_not_pay_off_where_no_answer_completes(self, board):
        notes = tabulate_layouts(self.a_result((None, None), training_s=8.0), board).notes
        assert any("no answer completes" in note for note in notes)
        assert not any("layouts" in note for note in notes if note.startswith("training"))

    def test_where_a_proof_is_no_slower_it_is_said(self, board):
        slow = LayoutOutcome("board/0", Optimum(2.0, wall_s=0.01), (a_roll_out(2.0),), (0.02,))
        notes = tabulate_layouts(LayoutsResult((slow,), 40, 8.0), board).notes
        assert any("never pays off" in note for note in notes)

    def test_a_layout_that_no_policy_completes_is_shown(self, board):
        (row,) = tabulate_layouts(self.a_result((None, None)), board).rows
        assert ["board/0", "2.00000", "0.0500", "0 of 2", "N/A", "N/A", "N/A", "0.0100"] == row


# What differs between two task files is named key by key.


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(),
    lambda values: st.lists(values) | st.dictionaries(st.text(), values),
    max_leaves=12,
)


@given(JSON)
def test_nothing_differs_from_itself(value):
    assert [] == differences(value, copy.deepcopy(value))


@given(JSON, JSON)
def test_whatever_differs_is_found(one, other):
    def text(value: Any) -> str:
        return repr(value)

    if text(one) == text(other):
        return
    result = differences(one, other)
    if isinstance(one, dict) and isinstance(other, dict) and one == other:
        # Of mappings the order does not count.
        return
    assert result
    assert all(str(difference) for difference in result)


@pytest.mark.parametrize(
    ("was", "now", "text"),
    [
        ({"a": {"b": [1, 2]}}, {"a": {"b": [1, 3]}}, "a.b[1]: 2 there, 3 now"),
        ({"a": 1}, {}, "a: 1 there, nothing now"),
        ({}, {"a": None}, "a: nothing there, null now"),
        ({"a": [1]}, {"a": [1, 2]}, "a: [1] there, [1, 2] now"),
        ({"a": 1}, {"a": True}, "a: 1 there, true now"),
        ({"a": 1}, {"a": 1.0}, "a: 1 there, 1.0 now"),
        ({"a": "x" * 90}, {"a": ""}, f'a: "{"x" * 56}... there, "" now'),
    ],
)
def test_a_difference_is_told_with_its_key(was, now, text):
    assert [text] == [str(difference) for difference in differences(was, now)]


def test_a_key_that_is_missing_is_no_key_that_is_null():
    assert [Difference("a", MISSING, None)] == differences({}, {"a": None})


def test_of_a_file_what_was_set_is_what_changed():
    path = CONFIGS / "inverter_board.yaml"
    changes = {"parts.pcb.mass_kg": "0.5", "step_limit": "33"}
    was, now = (resolve_config(load_problem(path, None, some)) for some in ({}, changes))
    message = describe_changes(was, now)
    assert "parts.pcb.mass_kg: " in message
    assert "step_limit: 20 there, 33 now" in message
    assert 1 == message.count("; ")


def test_what_does_not_make_another_task_is_not_named():
    path = CONFIGS / "inverter_board.yaml"
    was, now = (
        resolve_config(load_problem(path, None, some)) for some in ({}, {"description": "other"})
    )
    assert "nothing that its file says" == describe_changes(was, now)


def test_many_differences_are_counted():
    message = describe_changes(
        {str(i): 0 for i in range(20)}, {str(i): 1 for i in range(20)}, most=3
    )
    assert message.endswith("; and 17 more")
    assert 3 == message.count(" there, ")
