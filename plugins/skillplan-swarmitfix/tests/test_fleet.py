"""Several bases on one bench, against breadth-first searches over pins and a simulator."""

from __future__ import annotations

import random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from fleet_instances import Robots, fewest, random_robots, task_of
from situations import FakeSetup, fake_back_end
from skillplan.judge import referee
from skillplan.pipeline import make_model, solve
from skillplan.records import Result
from skillplan.solvers import Stop
from skillplan.task import Skill, State, Task, Verdict
from thinned import slow_case

BENCH = swarm.Bench(6, 13, 0.34)
# Benches by rows and columns, and how many bases fit on them, with little room to move.
CROWDED = {(1, 7): 2, (2, 5): 2, (2, 7): 3, (3, 5): 3}
SMALL = [(1, 7), (2, 5), (3, 5), (3, 7)]


def bench_of(size: tuple[int, int]) -> swarm.Bench:
    return swarm.Bench(*size, 0.34)


@pytest.fixture(autouse=True, scope="module")
def _short_audits():
    """Whole audits with the whole suite; what is claimed is held against other searches here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(referee, "AUDIT_STATES", examples(referee.AUDIT_STATES))
        patch.setattr(referee, "AUDIT_SKILLS", examples(referee.AUDIT_SKILLS))
        yield


def never() -> bool:
    return False


def solved(task: Task, seed: int = 0, stop: Stop | None = None, **options: Any) -> Result:
    return solve(
        task, swarm.FleetSolver(swarm.FleetSolver.Options(**options)), seed=seed, stop=stop
    )


def problem_of(task: Task) -> swarm.MultiAgentProblem:
    return swarm.MultiAgentProblem.from_model(make_model(task))


def assert_valid(bench: swarm.Bench, robots: Robots, result: Result) -> None:
    """Assert that the simulator lets the schedule pass, in steps and in seconds."""
    assert result.status in ("optimal", "solved"), result.reason
    trace = result.trace
    steps = [
        [
            (robot, int(action[1:]), bench.position(start), bench.position(end))
            for robot, action, start, end in step
        ]
        for step in trace["schedule"]
    ]
    assert swarm.simulate(bench, robots, steps) is None
    assert len(steps) == trace["parallel_makespan"] >= trace["independent_bound_max"]
    assert sum(map(len, steps)) == result.cost >= trace["independent_bound_sum"]
    swings = [
        swarm.FleetSwing(
            robot, int(action[1:]), bench.position(start), bench.position(end), begin_s, end_s
        )
        for begin_s, end_s, robot, action, start, end in trace["timetable"]
    ]
    assert swarm.simulate_timed(bench, robots, swings) is None
    assert max((swing.end_s for swing in swings), default=0.0) == trace["parallel_makespan_s"]
    assert trace["parallel_makespan_s"] <= (result.makespan_s or 0.0) + 1e-9


@pytest.mark.slow(reason="two robots; how they end in every run")
class TestTwo:
    @given(st.sampled_from(SMALL), st.integers(0, 10_000))
    @settings(max_examples=examples(40))
    def test_the_fewest_swings_are_proved(self, size, seed):
        """Against breadth-first search over pins, plans or none."""
        bench = bench_of(size)
        robots = random_robots(bench, 2, seed)
        best = fewest(bench, robots, at_once=False)
        result = solved(task_of(bench, robots))
        if best is None:
            assert result.status == "infeasible"
        else:
            assert ("optimal", best) == (result.status, result.cost)
            assert_valid(bench, robots, result)

    @given(st.sampled_from(SMALL), st.integers(0, 10_000))
    @settings(max_examples=examples(40))
    def test_the_fewest_parallel_steps_are_found(self, size, seed):
        bench = bench_of(size)
        robots = random_robots(bench, 2, seed)
        best = fewest(bench, robots, at_once=True)
        result = solved(task_of(bench, robots), objective="makespan")
        if best is None:
            assert result.status == "infeasible"
        else:
            assert best == result.trace["parallel_makespan"]
            assert result.trace["makespan_proved"]
            assert_valid(bench, robots, result)

    @pytest.mark.slow(reason="two robots on the whole bench; on smaller ones in every run")
    def test_exact_search_agrees_on_the_papers_bench(self):
        for seed in range(examples(2, fewest=1)):
            task = task_of(BENCH, random_robots(BENCH, 2, seed))
            assert solve(task, "exact").cost == solved(task).cost

    def test_two_that_change_places_go_round_each_other(self):
        robots = {"a": (BENCH.position("C42"), BENCH.position("C45")), "b": (44, 41)}
        result = solved(task_of(BENCH, robots))
        assert result.status == "optimal"
        assert result.trace["independent_bound_sum"] < (result.cost or 0)
        assert_valid(BENCH, robots, result)

    def test_in_a_corridor_nobody_gets_past(self):
        """On one row of triangles two bases cannot change sides."""
        corridor = swarm.Bench(1, 9, 0.34)
        result = solved(task_of(corridor, {"a": (0, 8), "b": (8, 0)}))
        assert result.status == "infeasible"
        assert (
            solved(task_of(corridor, {"a": (0, 8), "b": (8, 0)}), method="prioritised").status
            == "infeasible"
        )

    def test_who_is_there_already_does_nothing(self):
        result = solved(task_of(BENCH, {"a": (0, 0), "b": (20, 20)}))
        assert (result.status, result.cost, result.trace["schedule"]) == ("optimal", 0.0, [])


@pytest.mark.slow(reason="many robots; how they end in every run")
class TestMany:
    @given(
        st.sampled_from(sorted(CROWDED)),
        st.integers(0, 10_000),
        st.sampled_from(["swings", "makespan"]),
    )
    @settings(max_examples=examples(50))
    def test_there_is_a_plan_if_and_only_if_one_is_found(self, size, seed, objective):
        """The prioritised method is complete; nothing it claims is below what is possible."""
        bench, count = bench_of(size), CROWDED[size]
        robots = random_robots(bench, count, seed)
        best = fewest(bench, robots, at_once=False)
        task = task_of(bench, robots)
        result = solved(task, seed, method="prioritised", objective=objective)
        if best is None:
            assert result.status == "infeasible"
        else:
            assert_valid(bench, robots, result)
            assert best <= (result.cost or 0)
            assert best >= (result.lower_bound or 0)

    @pytest.mark.slow(reason="jointly; two robots in every run")
    @given(st.integers(0, 1_000))
    @settings(max_examples=15)
    def test_three_can_be_searched_jointly(self, seed):
        bench = bench_of((2, 7))
        robots = random_robots(bench, 3, seed)
        result = solved(task_of(bench, robots), method="joint")
        assert fewest(bench, robots, at_once=False) == result.cost

    @pytest.mark.parametrize(
        "count",
        [*(2, 3), *(slow_case(count, reason="2 and 3 in every run") for count in (4, 5, 6, 7, 8))],
    )
    @pytest.mark.parametrize("objective", ["swings", "makespan"])
    def test_random_fleets_on_the_papers_bench_are_solved(self, count, objective):
        for seed in range(examples(2, fewest=1)):
            robots = random_robots(BENCH, count, seed)
            result = solved(task_of(BENCH, robots), objective=objective, rounds=20)
            assert_valid(BENCH, robots, result)

    def test_three_rotate(self):
        bench = bench_of((3, 7))
        (a, b, c) = (start for start, _ in random_robots(bench, 3, 2).values())
        robots = {"a": (a, b), "b": (b, c), "c": (c, a)}
        assert_valid(bench, robots, solved(task_of(bench, robots)))

    @pytest.mark.slow(reason="two fleets of six; random fleets in every run")
    def test_the_same_seed_gives_the_same_schedule(self):
        task = task_of(BENCH, random_robots(BENCH, 6, 3))
        first, second = (solved(task, seed=5).trace["schedule"] for _ in range(2))
        assert first == second

    @pytest.mark.slow(reason="three fleets of six; random fleets in every run")
    def test_more_rounds_are_no_worse(self):
        task = task_of(BENCH, random_robots(BENCH, 6, 3))
        costs = [solved(task, rounds=rounds).cost for rounds in (0, 30, 200)]
        assert sorted(costs, reverse=True) == costs


class TestEnds:
    def test_a_model_without_agents_is_refused_in_words(self, lid_task):
        result = solved(lid_task)
        assert result.status == "refused"
        assert "is not a multi-agent problem" in result.reason

    def test_an_interrupted_search_claims_nothing(self):
        stop = Stop()
        stop.interrupt()
        for count in (2, 6):
            result = solved(task_of(BENCH, random_robots(BENCH, count, 0)), stop=stop)
            assert result.status == "unsolved"

    @pytest.mark.slow(reason="searches for two seconds; its other ends in every run")
    def test_interrupted_in_its_improvement_it_has_a_plan(self):
        robots = random_robots(BENCH, 8, 0)
        stop = Stop(time_limit_s=2)
        result = solved(task_of(BENCH, robots), stop=stop, rounds=10_000_000)
        assert result.status == "solved"
        assert "time limit" in result.reason
        assert_valid(BENCH, robots, result)

    @pytest.mark.parametrize("method", ["joint", "prioritised"])
    def test_a_limit_on_places_is_named(self, method):
        task = task_of(BENCH, random_robots(BENCH, 4, 0))
        result = solved(task, method=method, max_nodes=2)
        assert result.status == "unsolved"
        assert "limit of 2 joint places" in result.reason

    @pytest.mark.parametrize("method", ["joint", "prioritised"])
    def test_a_step_limit_below_the_ways_alone_is_infeasible(self, method):
        bench = bench_of((3, 7))
        robots = {"a": (0, bench.n_positions - 1), "b": (bench.n_positions - 1, 0)}
        result = solved(task_of(bench, robots, step_limit=3), method=method)
        assert solved(task_of(bench, robots)).trace["independent_bound_sum"] > 3
        assert result.status == "infeasible"

    def test_a_step_limit_below_the_optimum_is_infeasible(self):
        bench = bench_of((3, 7))
        robots = {"a": (8, 11), "b": (11, 8)}
        best = solved(task_of(bench, robots)).cost or 0.0
        below = task_of(bench, robots, step_limit=int(best) - 1)
        assert best - 1 >= 2
        assert solved(below).status == "infeasible"
        assert solved(below, method="prioritised").status == "unsolved"


def own_place(skill: Skill, state: State) -> Verdict:
    """Let some swings pass nowhere that depends on others."""
    (here,) = (fact for fact in state if fact.startswith(f"at({skill.agents[0]},"))
    facts = state.facts
    if (len(here) + int(skill.name[-1]) + sum(map(ord, here))) % 5 == 0:
        return Verdict.infeasible("it slips", facts.of(here), facts.none)
    return Verdict.feasible(facts.of(here), facts.none)


def both_places(skill: Skill, state: State) -> Verdict:
    """Let some swings pass by where the other stands."""
    if (sum(map(ord, str(state))) + int(skill.name[-1])) % 4 == 0:
        return Verdict.infeasible("the other is in the way", state, state.facts.none)
    return Verdict.feasible(state, state.facts.none)


def nothing_said(skill: Skill, state: State) -> Verdict:
    """Name no facts."""
    if (sum(map(ord, str(state))) + int(skill.name[-1])) % 4 == 0:
        return Verdict.infeasible("it is so")
    return Verdict.feasible()


class TestRejectedMoves:
    """What back ends do not let pass is not used, and every claim holds all the same."""

    @given(
        st.sampled_from([own_place, both_places, nothing_said]),
        st.sampled_from(["joint", "prioritised"]),
        st.integers(0, 1_000),
    )
    @settings(max_examples=examples(40))
    def test_the_claims_are_those_of_exact_search(self, rule, method, seed):
        bench = bench_of((2, 7))
        task = task_of(bench, random_robots(bench, 2, seed))
        setup = FakeSetup(make=lambda task: [fake_back_end(task, rule)])
        best = solve(task, "exact", setup)
        options = swarm.FleetSolver.Options(method=method)  # type: ignore[arg-type]
        result = solve(task, swarm.FleetSolver(options), setup)
        if best.status == "infeasible":
            assert result.status == "infeasible"
        elif method == "joint":
            assert ("optimal", best.cost) == (result.status, result.cost)
        else:
            assert result.status in ("optimal", "solved"), result.reason
            assert (best.cost or 0) <= (result.cost or 0)

    def test_an_unknown_verdict_proves_nothing(self):
        task = task_of(BENCH, {"a": (65, 53), "b": (20, 20)})
        setup = FakeSetup(make=lambda task: [fake_back_end(task, Verdict.unknown("no idea"))])
        result = solve(task, swarm.FleetSolver(), setup, stop=Stop(time_limit_s=2))
        assert result.status == "unsolved"


class TestParts:
    def test_searches_end_with_a_way_or_with_everything_seen(self):
        corridor = swarm.Bench(1, 9, 0.34)
        problem = problem_of(task_of(corridor, {"a": (0, 8), "b": (8, 0)}))
        result = swarm.search_with_restarts(
            problem, random.Random(0), never, restarts=3, max_nodes=10**6
        )
        assert (result.complete, result.plans) == (True, ())
        search = swarm.ConfigurationSearch(problem, random.Random(0), never)
        assert search.run(3) is None
        assert not search.exhausted

    def test_a_joint_search_says_how_far_it_got(self):
        problem = problem_of(task_of(BENCH, random_robots(BENCH, 2, 2)))
        whole = swarm.search_jointly(problem, swarm.Objective.SWINGS, never, 10**6)
        part = swarm.search_jointly(problem, swarm.Objective.SWINGS, never, 10)
        assert part.steps is None
        assert not part.complete
        assert part.floor <= whole.floor == sum(len(step) for step in whole.steps or ())

    def test_an_improvement_keeps_every_step_free_of_clashes(self):
        problem = problem_of(task_of(BENCH, random_robots(BENCH, 6, 1)))
        steps = swarm.ConfigurationSearch(problem, random.Random(0), never).run(10_000)
        assert steps is not None
        for objective in swarm.Objective:
            search = swarm.ScheduleImprovement(problem, objective, random.Random(1), never)
            for step in search.run(steps, 40):
                for i, item in enumerate(step):
                    assert not any(item.clashes(other) for other in step[:i])

    def test_an_improvement_wants_moves_that_pass_whoever_stands_where(self):
        problem = problem_of(task_of(BENCH, random_robots(BENCH, 2, 0)))
        move = problem.moves[0][0][0]
        other = problem.place_bits[1][50]
        rejected = problem.without(move, move.start_bit | other, 0)
        with pytest.raises(
            ValueError, match="no moves that are rejected depending on where others stand"
        ):
            swarm.ScheduleImprovement(rejected, swarm.Objective.SWINGS, random.Random(0), never)
