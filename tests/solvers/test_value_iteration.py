"""Value iteration, and the label setting that it uses where nothing is left to chance."""

from __future__ import annotations

import random
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.pipeline import Setup, make_model, solve
from skillplan.solvers.mdp import ValueIterationSolver, compute_costs_to_go
from skillplan.task import DistanceReward, Task
from skillplan.testing import SolverSuite
from skillplan_swarmitfix import Bench
from swarm_situations import base_task, grounding, minimal_starts
from thinned import slow_case


class TestValueIterationSolver(SolverSuite):
    solver: ClassVar[str] = "value-iteration"


class TestValueIterationOnRewards(SolverSuite):
    solver: ClassVar[str] = "value-iteration"
    options: ClassVar = {"objective": "reward"}


def in_pitches(task: Task) -> Task:
    """Return a base task whose rewards count distances in pitches instead of metres."""
    assert isinstance(task.reward, DistanceReward)
    pitch_m = grounding().bench.pitch_m
    distances = {bit: d / pitch_m for bit, d in task.reward.distances.items()}
    return task.replace(reward=DistanceReward(distances, 1.0, task.reward.infeasible))


@pytest.mark.parametrize("unit", ["metres", slow_case("pitches", reason="in metres in every run")])
def test_the_way_of_the_largest_reward_is_step_minimal_for_all_pairs(unit):
    """Eqs 6 and 7 at the paper's discount, for all 6006 pairs of start and goal."""
    solver = ValueIterationSolver(ValueIterationSolver.Options(objective="reward", gamma=0.999))
    # In every run every sixth goal.
    for goal in range(1, 79, 78 // examples(78, fewest=13)):
        task = base_task(66 if goal != 66 else 1, goal)
        task = task if unit == "metres" else in_pitches(task)
        policy = solver.solve(make_model(task)).policy
        assert policy is not None
        assert minimal_starts(policy, goal) == 1


@st.composite
def weighted_graphs(draw: st.DrawFn):  # type: ignore[no-untyped-def]
    """Draw rows, successors, goals, costs and ties; some rows lead nowhere."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    n = draw(st.integers(1, 12))
    counts = [rng.randint(0, 4) for _ in range(n)]
    rows = np.concatenate([[0], np.cumsum(counts)])
    m = int(rows[-1])
    successors = np.array([rng.randint(-1, n - 1) for _ in range(m)], dtype=np.int64)
    goal = np.array([rng.random() < 0.3 for _ in range(n)])
    uniform = draw(st.booleans())
    costs = np.array([1.5 if uniform else rng.choice([0.0, 0.1, 0.2, 0.3]) for _ in range(m)])
    ties = np.array([rng.choice([0.0, 1.0, 2.5]) for _ in range(m)])
    return rows, successors, goal, costs, ties


def relaxed(rows, successors, goal, *weights):  # type: ignore[no-untyped-def]
    """Return the least sums by relaxing all rows until nothing changes, weight after weight."""
    n = len(goal)
    usable = np.ones(len(successors), dtype=bool)
    sums = []
    for weight in weights:
        value = np.where(goal, 0.0, np.inf)
        for _ in range(n + 1):
            for state in np.flatnonzero(~goal):
                for row in range(rows[state], rows[state + 1]):
                    if usable[row] and successors[row] >= 0:
                        value[state] = min(value[state], weight[row] + value[successors[row]])
        for state in range(n):
            for row in range(rows[state], rows[state + 1]):
                total = weight[row] + value[successors[row]] if successors[row] >= 0 else np.inf
                usable[row] &= total <= value[state] + 1e-9
        sums.append(value)
    return sums


@given(weighted_graphs())
@settings(max_examples=examples(200))
def test_label_setting_finds_the_least_costs_then_the_least_ties(graph) -> None:  # type: ignore[no-untyped-def]
    rows, successors, goal, costs, ties = graph
    result = compute_costs_to_go(rows, successors, goal, costs, ties)
    costs_only = compute_costs_to_go(rows, successors, goal, costs)
    minimum, least_tie = relaxed(rows, successors, goal, costs, ties)
    np.testing.assert_allclose(result.costs, minimum, atol=1e-9)
    np.testing.assert_allclose(result.ties, least_tie, atol=1e-9)
    np.testing.assert_allclose(costs_only.costs, minimum, atol=1e-9)
    for start in np.flatnonzero(np.isfinite(minimum)):
        state, cost, tie, steps = start, 0.0, 0.0, 0
        while not goal[state]:
            row = result.chosen[state]
            assert rows[state] <= row < rows[state + 1]
            cost, tie, state, steps = cost + costs[row], tie + ties[row], successors[row], steps + 1
            assert steps <= len(goal)
        assert (cost, tie) == pytest.approx((minimum[start], least_tie[start]))
    assert (result.chosen[goal] == -1).all()


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 3), (6, 13), (20, 31)])
def test_on_a_lattice_it_counts_the_fewest_swings(rows, cols):
    bench = Bench(rows, cols, 0.34)
    goal = np.zeros(bench.n_positions, dtype=np.bool_)
    goal[bench.n_positions // 2] = True
    offsets = np.arange(bench.n_positions + 1) * bench.actions
    costs = compute_costs_to_go(offsets, bench.successors.ravel(), goal)
    assert (costs.costs == bench.distances(bench.n_positions // 2)).all()


def test_of_ways_as_short_the_one_of_less_time_is_taken():
    """As exact search does."""
    for start, goal in ((66, 42), (78, 1), (13, 66), (1, 78)):
        task = base_task(start, goal)
        ours, proved = solve(task, "value-iteration"), solve(task, "exact")
        assert (ours.cost, ours.makespan_s) == pytest.approx((proved.cost, proved.makespan_s))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": np.array([0, 1])}, "do not fit"),
        ({"costs": np.array([-1.0])}, "finite weight"),
        ({"costs": np.array([np.nan])}, "finite weight"),
        ({"ties": np.array([1.0, 2.0])}, "finite weight"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, message: str) -> None:  # type: ignore[no-untyped-def]
    arrays = {
        "rows": np.array([0, 1, 1]),
        "successors": np.array([1]),
        "goal": np.array([False, True]),
    }
    with pytest.raises(ValueError, match=message):
        compute_costs_to_go(**{**arrays, **change})


def test_a_large_number_of_rows_is_refused_by_name():
    class Endless(np.ndarray):
        def __len__(self) -> int:
            return 2**31

    successors = np.zeros(1, dtype=np.int32).view(Endless)
    with pytest.raises(ValueError, match="2,147,483,648 rows"):
        compute_costs_to_go(np.array([0, 2**31]), successors, np.array([False]))


def test_costs_that_differ_only_in_the_order_of_adding_tie():
    """0.1 + 0.2 + 0.3 and 0.3 + 0.2 + 0.1 differ as floating-point sums."""
    rows = np.array([0, 2, 3, 4, 5, 6, 6])
    successors = np.array([1, 3, 2, 5, 4, 5])
    costs = np.array([0.1, 0.3, 0.2, 0.3, 0.2, 0.1])
    goal = np.array([False] * 5 + [True])
    slow_first = np.array([9.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    assert compute_costs_to_go(rows, successors, goal, costs, slow_first).chosen[0] == 1
    assert compute_costs_to_go(rows, successors, goal, costs).chosen[0] == 0


def test_its_options_say_what_is_discounted():
    setup = Setup(options={"value-iteration": {"objective": "reward", "gamma": 0.5}})
    assert solve(base_task(66, 42), "value-iteration", setup).cost == 2
