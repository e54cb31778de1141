"""Chains: each level solved on what the one above gave, by whom it is for, and judged."""

from __future__ import annotations

from pathlib import Path

import pytest

from skillplan.domains import Problem
from skillplan.errors import OptionError, PluginError
from skillplan.pipeline import (
    Setup,
    compare_solvers,
    list_solvers,
    load_problem,
    map_solvers,
    solve_chain,
)
from skillplan.records import ChainResult, Status
from skillplan.solvers import Stop

CONFIGS = Path(__file__).parents[2] / "configs"
GOALS = """\
kind: swarmitfix
name: goals
base: {home: C66, goals: [C42, C42, C29, C42]}
"""


def problem(stem: str, **changes: str) -> Problem:
    return load_problem(CONFIGS / f"{stem}.yaml", None, changes)


@pytest.fixture(scope="module")
def polygonal():
    return problem("swarmitfix_polygonal")


@pytest.fixture(scope="module")
def curve():
    return problem("swarmitfix_open_curve")


@pytest.fixture(scope="module")
def curve_by_exact(curve):
    return solve_chain(curve, "exact")


@pytest.fixture(scope="module")
def curve_by_csp(curve):
    return solve_chain(curve, "csp")


@pytest.fixture
def four_goals(tmp_path):
    """Four ways, of which two lead to one goal and one leads nowhere."""
    path = tmp_path / "goals.yaml"
    path.write_text(GOALS)
    return load_problem(path)


def solvers_of(chain: ChainResult) -> dict[str, set[str]]:
    results: dict[str, set[str]] = {}
    for part in chain.parts:
        results.setdefault(part.task.stage, set()).add(part.result.solver)
    return results


class TestLevels:
    def test_they_are_solved_in_the_order_of_the_hierarchy(self, curve_by_exact):
        chain = curve_by_exact
        stages = [part.task.stage for part in chain.parts]
        assert ["heads"] * 3 + ["goals"] + ["base"] * (len(stages) - 4) == stages
        assert len(chain.main) == len(chain.document()["goals"])
        assert (True, "base", True) == (chain.complete, chain.stage, chain.proved_by_level)

    @pytest.mark.slow(reason="a bench more; levels by search in every run")
    def test_a_plan_by_rule_is_judged_but_not_searched(self, polygonal):
        """The goals are the domain's own; the referee holds them against the proved optimum."""
        chain = solve_chain(polygonal, "exact")
        assert {"goals": {"rule"}, "base": {"exact"}} == solvers_of(chain)
        (goals,) = [part for part in chain.parts if part.task.stage == "goals"]
        assert goals.result.cost == goals.optimum == chain.cost

    @pytest.mark.slow(reason="a large workpiece twice; with a choice of rules in test_goal_choice")
    def test_a_rule_that_is_not_the_best_leaves_a_gap(self):
        """Every way is proved, but not that other goals would not take fewer steps."""
        start = {"base.home": "C78"}
        greedy = {**start, "base.goal_choice": "nearest-centroid"}
        chain = solve_chain(problem("swarmitfix_triangular", **greedy), "exact")
        best = solve_chain(problem("swarmitfix_triangular", **start), "exact")
        assert chain.cost is not None
        assert best.cost is not None
        assert best.cost < chain.cost
        assert (best.cost, Status.SOLVED) == (chain.bound_given, chain.status)
        assert (True, False) == (best.proved_by_level, chain.proved_by_level)
        assert all(part.result.status is Status.OPTIMAL for part in chain.main)

    def test_what_a_level_planned_is_what_the_next_stands_on(self, curve_by_exact, curve_by_csp):
        """Other goals than the rule's are where the base then goes."""
        chain = curve_by_csp
        (goals,) = [part for part in chain.parts if part.task.stage == "goals"]
        chosen = [step.place for step in goals.result.steps]
        assert chosen == [part.ends[1] for part in chain.main]
        assert chosen != [part.ends[1] for part in curve_by_exact.main]

    def test_a_single_task_is_a_chain_of_one(self):
        chain = solve_chain(problem("swarmitfix_fleet"), "fleet")
        assert (1, 36.0) == (len(chain.parts), chain.cost)


class TestSolvers:
    def test_a_solver_for_one_stage_leaves_the_others_to_exact_search(self, curve_by_csp):
        assert {"heads": {"exact"}, "goals": {"csp"}, "base": {"exact"}} == solvers_of(curve_by_csp)

    @pytest.mark.slow(reason="solves a bench; from the command line in every run")
    def test_every_stage_may_have_a_solver_of_its_own(self, curve):
        spec = "base=policy-iteration,goals=csp"
        assert {"heads": {"exact"}, "goals": {"csp"}, "base": {"policy-iteration"}} == solvers_of(
            solve_chain(curve, spec)
        )
        assert ("policy-iteration", "csp") == list_solvers(spec)
        assert ("exact",) == list_solvers("exact")

    def test_an_unknown_stage_is_named(self):
        with pytest.raises(OptionError, match="No stage 'bases' in this task"):
            map_solvers("bases=exact", ["heads", "goals", "base"])

    def test_an_unknown_solver_of_a_stage_is_named(self):
        with pytest.raises(PluginError, match="exat"):
            map_solvers("base=exat", ["base"])

    @pytest.mark.slow(reason="solves a sheet by several solvers; one for every stage in every run")
    def test_several_solvers_run_one_after_the_other(self, polygonal):
        """With a stop each, and none after one that the user has interrupted."""
        names = ["exact", "policy-iteration"]
        chains = compare_solvers(polygonal, names)
        assert names == [chain.solver for chain in chains]
        assert [17.0, 17.0] == [chain.cost for chain in chains]

        def interrupted(name: str) -> Stop:
            stop = Stop()
            stop.interrupted = name == "exact"
            return stop

        (only,) = compare_solvers(polygonal, names, make_stop=interrupted)
        assert only.interrupted


class TestPolicies:
    @pytest.mark.slow(reason="learns a bench; a policy of one way in every run")
    def test_a_policy_answers_later_ways_to_the_same_goal(self, polygonal):
        """Learned once for C17, C37, C60 and C15 each, from wherever the base comes."""
        chain = solve_chain(polygonal, "policy-iteration")
        goals = [part.ends[1] for part in chain.main]
        first = [goals.index(goal) for goal in goals]
        assert [index != number for number, index in enumerate(first)] == [
            part.reused for part in chain.main
        ]
        assert (17.0, Status.OPTIMAL) == (chain.cost, chain.status)

    def test_a_stored_policy_is_judged_anew_from_the_other_start(self, four_goals):
        """Its cost is that of the way it leads from there."""
        chain = solve_chain(four_goals, "policy-iteration")
        assert [False, True, False, True] == [part.reused for part in chain.parts]
        assert [2, 0, 1, 1] == [part.result.cost for part in chain.parts]
        assert [2, 0, 1, 1] == [part.optimum for part in chain.parts]
        assert ["C29", "C42"] == chain.parts[3].path

    def test_the_effort_of_a_stored_policy_counts_once(self, four_goals):
        chain = solve_chain(four_goals, "policy-iteration")
        learned = [part.result for part in chain.parts if not part.reused]
        assert sum(result.wall_s for result in learned) == chain.wall_s
        assert sum(result.expanded or 0 for result in learned) == chain.iterations

    def test_a_learner_is_held_against_the_proved_optimum(self, four_goals):
        """It proves nothing itself; exact search stands beside it."""
        chain = solve_chain(four_goals, "sarsa", Setup(options={"sarsa": {"episodes": "3000"}}))
        assert [2, 0, 1, 1] == [part.optimum for part in chain.parts]
        assert chain.complete
        assert 4.0 == chain.lower_bound

    def test_the_same_seed_learns_the_same(self, four_goals):
        setup = Setup(options={"sarsa": {"episodes": "500"}})
        first, other = (solve_chain(four_goals, "sarsa", setup, seed=5) for _ in range(2))
        assert [part.path for part in first.parts] == [part.path for part in other.parts]
        assert [p.result.expanded for p in first.parts] == [p.result.expanded for p in other.parts]


class TestFailure:
    def test_what_is_not_solved_ends_the_chain(self, polygonal):
        """With the reason, and without a cost."""
        chain = solve_chain(polygonal, "csp", Setup(options={"csp": {"replans": "0"}}))
        assert (1, 17, 0) == (len(chain.parts), chain.expected, chain.replans)
        assert (Status.UNSOLVED, None, None) == (chain.status, chain.cost, chain.makespan)
        assert chain.reason.startswith("goals: nothing that ")

    def test_a_solver_may_ask_for_finer_plans_above_it(self, polygonal):
        """As often as its option says; the heads of the account are then the finer ones."""
        setup = Setup(options={"csp": {"replans": "2"}})
        chain = solve_chain(polygonal, "csp", setup)
        assert 2 == chain.replans
        heads = chain.document()["heads"]
        assert 3 * 16 == sum(not head["inserted"] for head in heads)

    def test_a_time_limit_is_for_the_whole_chain(self, polygonal):
        chain = solve_chain(polygonal, "exact", stop=Stop(time_limit_s=1e-6))
        assert Status.UNSOLVED is chain.status
        assert "time limit" in chain.reason
        assert len(chain.parts) < chain.expected

    def test_an_interruption_leaves_what_was_solved(self, four_goals):
        stop = Stop()
        stop.interrupted = True
        chain = solve_chain(four_goals, "exact", stop=stop)
        assert (True, 1, False) == (chain.interrupted, len(chain.parts), chain.complete)
