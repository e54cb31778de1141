"""`learned-model`: what it plans, when it stops planning, and that its runs resume bit for bit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from pydantic import ValidationError

from situations import retry_task, two_roads_task
from skillplan.env import SkillVectorEnv
from skillplan.pipeline import load_problem, make_model, make_solver, solve
from skillplan.solvers import (
    GOAL,
    LearnedModelSolver,
    LearnedModelTraining,
    ObservationCounts,
    OutcomeTable,
    Snapshot,
    lookup_network,
)
from skillplan.task import Task
from skillplan.testing import SolverSuite

CONFIGS = Path(__file__).parents[2] / "configs"


class TestLearnedModelSolver(SolverSuite):
    solver: ClassVar[str] = "learned-model"
    options: ClassVar[dict[str, object]] = {"steps": 500}


@pytest.fixture(scope="module")
def board():
    return load_problem(CONFIGS / "inverter_board.yaml").task


@pytest.fixture(scope="module")
def walk():
    return load_problem(CONFIGS / "swarmitfix_cases.yaml").task


def begin(task: Task, seeds: list[int], snapshot: Snapshot | None = None) -> LearnedModelTraining:
    env = SkillVectorEnv(make_model(task), len(seeds), observation="markov", mask="applicable")
    solver = LearnedModelSolver()
    if snapshot is None:
        training = solver.begin(env, seeds, 1_000)
    else:
        notes = json.loads(json.dumps(snapshot.notes))
        training = solver.resume(env, seeds, 1_000, Snapshot(dict(snapshot.arrays), notes))
    assert isinstance(training, LearnedModelTraining)
    return training


def test_it_settles_at_the_optimum_of_the_board(board):
    training = begin(board, [0])
    episodes = training.advance(1_000)
    settled = training.remarks(0)["settled_step"]
    assert training.learned(0).best_cost == pytest.approx(1.86709, abs=1e-5)
    assert training.remarks(0)["fallback"] is None
    assert [True, False] == [episodes[0].planned, episodes[-1].planned]
    assert settled == max(episode.step for episode in episodes if episode.planned)
    late = max(settled, 600 + board.step_limit)
    assert all(episode.greedy for episode in episodes if episode.step > late)


@pytest.mark.parametrize("name", ["board", "walk"])
def test_an_interrupted_training_resumes_bit_for_bit(name, request):
    """While it plans, and while it explores."""
    task = request.getfixturevalue(name)
    whole, cut = begin(task, [3, 4]), begin(task, [3, 4])
    first = cut.advance(250)
    rest = begin(task, [3, 4], cut.snapshot())
    assert whole.advance(650) == first + rest.advance(400)
    ours, theirs = rest.snapshot(), whole.snapshot()
    assert ours.notes == theirs.notes
    assert ours.arrays.keys() == theirs.arrays.keys()
    for key, array in ours.arrays.items():
        assert array.tobytes() == theirs.arrays[key].tobytes(), key


@pytest.mark.parametrize("name", ["board", "walk"])
def test_a_run_does_not_depend_on_the_others(name, request):
    task = request.getfixturevalue(name)
    alone, among = begin(task, [7]).advance(300), begin(task, [5, 7, 9]).advance(300)
    assert [(item.step, item.actions) for item in alone] == [
        (entry.step, entry.actions) for entry in among if entry.run == 1
    ]


def test_effects_that_differ_between_states_end_planning(walk):
    """A swing moves a base to another place from every place; the run explores and arrives."""
    training = begin(walk, [100, 101, 102])
    training.advance(1_000)
    for run in range(3):
        assert training.learned(run).best_cost == 4.0
        assert training.remarks(run)["settled_step"] is None
        assert "differ between states" in training.remarks(run)["fallback"]
        assert training.figures()[run]["explores"] == 1.0


def test_chance_is_explored_and_said():
    result = solve(retry_task(0.5), make_solver("learned-model", {"steps": 300}))
    assert result.cost == pytest.approx(4.0)
    assert "without chance" in result.trace["fallback"]


def test_the_cheaper_of_two_roads_is_learned():
    assert solve(two_roads_task(), make_solver("learned-model", {"steps": 300})).cost == 3.0


def test_layouts_are_not_observed_in_bits():
    with pytest.raises(ValidationError, match="observation"):
        LearnedModelSolver.Options(observation="layout")


def test_a_lookup_network_acts_only_where_it_was_shown():
    bits = np.array([[0, 1, 1], [1, 0, 0], [0, 0, 0]], dtype=np.float32)
    network = lookup_network(bits, np.array([2, 1, 3]), 4)
    assert [2, 1, 3] == network.greedy(bits).tolist()
    others = np.array([[1, 1, 1], [0, 1, 0]], dtype=np.float32)
    assert not network.scores(others).any()


def test_a_table_leaves_dead_ends_and_takes_the_least_mean_cost():
    """Action 0 leads to a dead end; 1 fails every other time and costs 1; 2 costs 3."""
    counts = ObservationCounts(1, 1, 3)
    for bit in (0.0, 1.0):
        counts.indices(np.array([[bit]], dtype=np.float32), np.ones((1, 3), dtype=np.bool_))
    table = OutcomeTable(counts, 0, 10)
    for action, successor, cost in ((0, 1, 0.0), (1, 0, 1.0), (1, GOAL, 1.0), (2, GOAL, 3.0)):
        table.add(0, action, successor, cost)
    for action in range(3):
        table.add(1, action, 1, 0.0)
    indices, actions = table.policy()
    assert ([0], [1]) == (indices.tolist(), actions.tolist())
