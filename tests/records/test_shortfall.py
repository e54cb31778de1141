"""Why runs fall short: how far they got, what they ran into, and what to try."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from skillplan.pipeline import load_problem
from skillplan.records import Optimum, Shortfall, TrainingResult, analyse_shortfall
from skillplan.solvers import End, Episode
from skillplan.task import Task
from skillplan.views.tables import tabulate_training

CONFIGS = Path(__file__).parents[2] / "configs"
STEPS = 1_000


@pytest.fixture(scope="module")
def board():
    return load_problem(CONFIGS / "inverter_board.yaml").task


def episode(board: Task, step: int, end: End, *names: str) -> Episode:
    actions = tuple(board.action(board.skill(name)) for name in names)
    return Episode(0, step, end, actions, 0.0, 0.0, greedy=False)


PCB = ("pick(pcb)", "place(pcb)")
FIRST = ("pick(switch_1)", "place(switch_1)")
SECOND = ("pick(switch_2)", "place(switch_2)")


def short(board: Task, *episodes: Episode, mask: str = "applicable") -> Shortfall:
    result = analyse_shortfall(board, "dqn", {"mask": mask}, STEPS, {3: episodes})
    assert result is not None
    return result


def test_how_far_runs_got_is_said_by_goals_and_skills(board):
    """Goals that held at the same time, when first, and what was never there at all."""
    result = short(
        board,
        episode(board, 50, "infeasible", *PCB, *FIRST),
        episode(board, 90, "infeasible", *PCB, *SECOND, *FIRST),
        episode(board, 200, "out-of-time", *PCB, *SECOND),
    )
    assert ((3,), 3, 0) == (result.runs, result.episodes, result.completed)
    assert (8, 2, 90) == (result.goals, result.most_goals, result.last_progress_step)
    assert "placed(switch_1)" in result.missing
    assert not {"placed(pcb)", "placed(switch_2)"} & set(result.missing)
    assert {"place(switch_1)", "fasten(screw_1)"} <= set(result.never)
    assert not {"pick(switch_1)", *PCB, *SECOND} & set(result.never)
    assert (("place(switch_1)", 2),) == result.failed
    assert 1 == result.out_of_time


def test_a_dead_end_is_where_all_that_is_applicable_failed_or_leads_there(board):
    """With a part in hand only its place is left; the state before has other ways on."""
    result = short(board, episode(board, 2, "infeasible", *FIRST))
    assert (1, 1) == (result.dead_states, result.dead_ends)
    # What leads to a goal is none.
    result = short(board, episode(board, 2, "out-of-time", *FIRST))
    assert (0, 0) == (result.dead_states, result.dead_ends)


def test_what_the_mask_hid_is_counted_where_episodes_were(board):
    """At the start six picks and a change of tools are applicable, then one place of sixteen."""
    free, held = 16 - 7, 16 - 1
    result = short(board, episode(board, 2, "infeasible", *FIRST))
    assert result.hidden == pytest.approx((free + held) / 2)
    assert short(board, episode(board, 2, "infeasible", *FIRST), mask="none").hidden is None


@pytest.mark.parametrize(
    ("step", "end", "mask", "cause", "words"),
    [
        (20, "infeasible", "none", "exploration", "-O dqn.mask=applicable"),
        (20, "infeasible", "applicable", "exploration", "--solver learned-model"),
        (20, "infeasible", "feasible", "exploration", "or search-optimal"),
        (900, "infeasible", "applicable", "steps", "--steps 4000: the runs were still getting"),
        (20, "complete", "applicable", "policy", "--steps 4000: the task was completed"),
    ],
)
def test_the_cause_and_what_to_try_follow_from_when_progress_ended(
    board, step, end, mask, cause, words
):
    result = short(board, episode(board, step, end, *PCB, *FIRST), mask=mask)
    assert cause == result.cause
    assert words in result.advice


@pytest.mark.parametrize("solver", ["dqn", "ppo", "learned-model"])
@pytest.mark.parametrize("planning", [False, True])
def test_a_learner_that_does_not_plan_is_told_of_one_that_does(board, solver, planning):
    """Where exploration ended it."""
    item = episode(board, 20, "infeasible", *PCB, *FIRST)
    options = {"mask": "applicable", "planning": planning}
    result = analyse_shortfall(board, solver, options, STEPS, {0: [item]})
    assert result is not None
    message = solver != "learned-model" and not planning
    assert result.advice.startswith("--solver learned-model, which plans") == message
    assert (f"-O {solver}.mask=feasible" in result.advice) == (not message)
    assert "search-optimal" in result.advice


def test_of_no_run_and_under_chance_nothing_is_said(board):
    failing = load_problem(CONFIGS / "inverter_grasps.yaml").task
    item = episode(board, 20, "infeasible", *FIRST)
    assert analyse_shortfall(board, "dqn", {}, STEPS, {}) is None
    assert analyse_shortfall(failing, "dqn", {}, STEPS, {0: [item]}) is None


def test_it_is_told_below_the_table_and_in_the_document(board):
    outcome = short(board, *[episode(board, 20 + k, "infeasible", *PCB, *FIRST) for k in range(3)])
    options: dict[str, Any] = {"mask": "applicable"}
    result = TrainingResult(
        board, "runs", "dqn", STEPS, (), Optimum(reason="none"), options, shortfall=outcome
    )
    (table,) = tabulate_training(result)
    message = "\n".join(table.notes)
    for words in (
        "short      1 run had at most 1 of 8 goals at the same time, first at step 20 of 1,000",
        "failed     place(switch_1) 3 times",
        "dead ends  3 of 3 episodes entered one: 1 state in which every applicable skill failed",
        "of 16 skills on average, and left ",
        "cause      exploration: nothing further was reached after step 20 of 1,000",
        "try        --solver learned-model, which plans with action schemas that it learns; or",
    ):
        assert words in message
    document = result.document()["shortfall"]
    assert ("exploration", 1, 8) == tuple(
        document[key] for key in ("cause", "most_goals_reached", "goals")
    )
    assert replace(result, shortfall=None).document()["shortfall"] is None
