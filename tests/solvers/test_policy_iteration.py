"""Policy iteration, and what it shares with value iteration: both against brute force."""

from __future__ import annotations

import itertools
import random
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import (
    cheapest_by_length,
    make_skill,
    make_task,
    model_of,
    optimum,
    small_tasks,
    two_places_task,
)
from skillplan.model import TabularMDP
from skillplan.pipeline import Setup, make_model, registry, solve
from skillplan.records import Status
from skillplan.solvers import EpisodicSolver, Learner, Stop
from skillplan.solvers.mdp import (
    BellmanSolver,
    PolicyIterationSolver,
    ValueIterationSolver,
    compute_costs_to_go,
)
from skillplan.task import DistanceReward, Facts, Task
from skillplan.testing import SolverSuite
from skillplan_swarmitfix import Bench
from swarm_situations import base_task, grounding, minimal_starts
from thinned import slow_case

PLANNERS = ("policy-iteration", "value-iteration")


class TestPolicyIterationSolver(SolverSuite):
    solver: ClassVar[str] = "policy-iteration"


class TestPolicyIterationOnRewards(SolverSuite):
    solver: ClassVar[str] = "policy-iteration"
    options: ClassVar = {"objective": "reward"}


@st.composite
def chances(draw: st.DrawFn) -> TabularMDP:
    """Draw a model of a few states with chance; some costs are 0, some states are lost."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    n = draw(st.integers(2, 5))
    rows, outcomes, successors, probabilities, costs = [0], [0], [], [], []
    for _ in range(n - 1):
        for _ in range(rng.randint(0, 3)):
            reached = rng.sample(range(n), rng.randint(1, 2))
            share = rng.choice([0.2, 0.5, 0.9])
            successors += reached
            probabilities += [share, 1 - share] if len(reached) == 2 else [1.0]
            outcomes.append(len(successors))
            costs.append(rng.choice([0.0, 0.0, 0.5, 1.0, 3.0]))
        rows.append(len(costs))
    rows.append(len(costs))
    goal = np.zeros(n, dtype=np.bool_)
    goal[-1] = True
    facts = Facts(tuple(f"s{i}" for i in range(n)))
    return TabularMDP(
        states=tuple(facts.of(name) for name in facts.names),
        goal=goal,
        rows=np.array(rows),
        actions=np.arange(len(costs)),
        costs=np.array(costs, dtype=np.float64),
        durations_s=np.array([rng.choice([1.0, 2.0]) for _ in costs]),
        outcomes=np.array(outcomes),
        successors=np.array(successors, dtype=np.int64),
        probabilities=np.array(probabilities, dtype=np.float64),
        rewards=np.zeros(len(successors)),
    )


def policy_value(mdp: TabularMDP, rows: tuple[int, ...]) -> np.ndarray:
    """Return expected cost and time of a policy, infinite where it may miss the goal."""
    n = len(mdp.states)
    chain = np.zeros((n, n))
    gains = np.zeros((n, 2))
    for state, row in enumerate(rows):
        if row >= 0:
            gains[state] = mdp.costs[row], mdp.durations_s[row]
            for k in range(mdp.outcomes[row], mdp.outcomes[row + 1]):
                chain[state, mdp.successors[k]] += mdp.probabilities[k]
    linked = np.linalg.matrix_power(np.eye(n) + chain, n) > 0
    to_goal = linked[:, mdp.goal].any(axis=1)
    proper = np.array([to_goal[linked[state]].all() for state in range(n)])
    value = np.full((n, 2), np.inf)
    inside = np.ix_(proper, proper)
    value[proper] = np.linalg.solve((np.eye(n) - chain)[inside], gains[proper])
    return value


@pytest.mark.parametrize("solver", [PolicyIterationSolver, ValueIterationSolver])
@given(mdp=chances())
@settings(max_examples=examples(120))
def test_expected_costs_are_the_least_of_all_policies(solver, mdp):
    """Then the least time; and what is chosen reaches the goal, whatever costs nothing."""
    least_cost = solver().least_cost(mdp)
    options = [
        tuple(range(begin, end)) or (-1,) for begin, end in itertools.pairwise(mdp.rows.tolist())
    ]
    values = np.array([policy_value(mdp, rows) for rows in itertools.product(*options)])
    assert least_cost.finished
    np.testing.assert_allclose(least_cost.values, values[..., 0].min(axis=0), rtol=1e-9, atol=1e-9)
    own = policy_value(mdp, tuple(least_cost.chosen.tolist()))
    np.testing.assert_allclose(own[:, 0], least_cost.values, rtol=1e-9, atol=1e-9)
    for state in range(len(mdp.states)):
        cheapest = values[:, state, 0] <= least_cost.values[state] + 1e-9
        assert own[state, 1] <= values[cheapest, state, 1].min() + 1e-6


@pytest.mark.parametrize("name", PLANNERS)
class TestClaims:
    @given(task=small_tasks())
    @settings(max_examples=examples(60))
    def test_without_chance_it_proves_what_brute_force_finds(self, name: str, task) -> None:  # type: ignore[no-untyped-def]
        """Also where the cheapest way is longer than the step limit."""
        best = optimum(cheapest_by_length(model_of(task)))
        result = solve(task, name)
        if best is None:
            assert result.status is Status.INFEASIBLE
        else:
            assert result.status is Status.OPTIMAL, result.reason
            assert result.cost == pytest.approx(best[0])
            assert len(result.steps) <= task.step_limit

    def test_an_expected_cost_is_claimed_as_bound(self, name):
        facts = Facts(("done",))
        outcomes = [(0.5, ("done",), ()), (0.5, (), ())]
        skills = [make_skill(facts, "try", forbids=("done",), outcomes=outcomes, cost=2.0)]
        model = model_of(make_task(facts, skills, goal=("done",)))
        solution = _solver(name).solve(model)
        assert solution.proved
        assert solution.lower_bound == pytest.approx(4.0)

    def test_where_no_policy_is_certain_nothing_is_claimed(self, name):
        facts = Facts(("done", "lost"))
        outcomes = [(0.5, ("done",), ()), (0.5, ("lost",), ())]
        skills = [make_skill(facts, "try", forbids=("done", "lost"), outcomes=outcomes)]
        result = solve(make_task(facts, skills, goal=("done",)), name)
        assert result.status is Status.UNSOLVED
        assert "certainty" in result.reason

    def test_two_states_that_need_each_other_are_solved(self, name):
        """Improving one state at a time from any policy would never leave either."""
        facts = Facts(("a", "b", "done"))
        hop = {"delete": ("a",), "outcomes": [(0.5, ("done",), ("a",)), (0.5, ("b",), ("a",))]}
        skills = [
            make_skill(facts, "stay_a", requires=("a",)),
            make_skill(facts, "hop", requires=("a",), outcomes=hop["outcomes"]),
            make_skill(facts, "stay_b", requires=("b",)),
            make_skill(facts, "back", requires=("b",), add=("a",), delete=("b",)),
        ]
        result = solve(make_task(facts, skills, initial=("a",), goal=("done",)), name)
        assert result.status is Status.OPTIMAL
        assert result.cost == pytest.approx(3.0)

    def test_of_equal_costs_the_faster_way_is_taken_then_the_lowest_action(self, name):
        facts = Facts(("done",))
        skills = [
            make_skill(facts, "slow", forbids=("done",), add=("done",), duration_s=3.0),
            make_skill(facts, "fast", forbids=("done",), add=("done",), duration_s=1.0),
            make_skill(facts, "same", forbids=("done",), add=("done",), duration_s=1.0),
        ]
        result = solve(make_task(facts, skills, goal=("done",)), name)
        assert [step.skill for step in result.steps] == ["fast"]

    def test_too_many_cells_leave_an_honest_bound(self, name, monkeypatch):
        from skillplan.solvers.mdp import bellman_solver

        monkeypatch.setattr(bellman_solver, "MOST_CELLS", 1)
        task = base_task(66, 1).replace(step_limit=2)
        result = solve(task, name)
        assert result.status is Status.UNSOLVED
        assert "the limit is 2" in result.reason

    def test_told_to_stop_it_claims_nothing(self, name):
        facts = Facts(("done",))
        outcomes = [(0.01, ("done",), ()), (0.99, (), ())]
        skills = [make_skill(facts, "try", forbids=("done",), outcomes=outcomes)]
        model = model_of(make_task(facts, skills, goal=("done",)))
        solver = _solver(name)
        assert solver.refuses(model) is None
        solver.stop = Stop()
        solver.stop.interrupt()
        solution = solver.solve(model)
        assert solution.proved or solution.lower_bound is None

    def test_rewards_lead_to_the_goal_in_the_fewest_steps(self, name):
        setup = Setup(options={name: {"objective": "reward"}})
        result = solve(base_task(66, 42), name, setup)
        assert result.status is Status.SOLVED
        assert result.cost == 2


def test_its_rounds_are_about_as_many_as_in_the_paper():
    """Table 3: 8 to 10."""
    assert 6 <= solve(base_task(66, 42), "policy-iteration").trace["iterations"] <= 10


def test_both_agree_in_all_values_of_a_reward():
    model = make_model(base_task(66, 42))
    options = PolicyIterationSolver.Options(objective="reward")
    results = [
        dict(solver(options).solve(model).policy or {})
        for solver in (PolicyIterationSolver, ValueIterationSolver)
    ]
    assert results[0] == results[1]


def _solver(name: str) -> BellmanSolver:
    return {"policy-iteration": PolicyIterationSolver, "value-iteration": ValueIterationSolver}[
        name
    ]()


# Value iteration, and the label setting that it uses where nothing is left to chance.


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
    costs = compute_costs_to_go(offsets, bench.successors.flatten(), goal)
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


# Chance that depends on the state: every installed learner solves it, or refuses in words.


LEARNERS = (Learner, EpisodicSolver, BellmanSolver)
# They are made for chance, and learn nothing.
STATE_PLANNERS = ("auto", "job-values", "replan")
# These have to solve it.
SOLVE = {
    *("dqn", "ppo", "learned-model", "q-learning", "sarsa", "monte-carlo"),
    *("value-iteration", "policy-iteration", "auto"),
}


def installed():
    """Return the names of the solvers; a learner of a new plugin is among them."""
    names = registry.names("solver")
    loaded = {name: registry.load("solver", name) for name in names}
    learners = [name for name, solver in loaded.items() if issubclass(solver, LEARNERS)]
    return sorted({*learners, *STATE_PLANNERS} & set(names))


@pytest.mark.parametrize("name", installed())
def test_the_place_where_the_skill_mostly_succeeds_is_chosen(name):
    """Success in 1 of 10 tries here, in 9 of 10 at the other place: 1 + 1 / 0.9 against 10."""
    result = solve(two_places_task(), name, seed=1)
    if result.status is Status.REFUSED and name not in SOLVE:
        assert result.reason
        return
    assert result.status in (Status.SOLVED, Status.OPTIMAL), result.reason
    assert result.cost == pytest.approx(1 + 1 / 0.9)
    assert next(step.skill for step in result.steps) == "go"


def test_the_list_has_all_learners_of_this_project():
    assert set(installed()) >= SOLVE
