"""Solvers on arrays: starts, refusals, stops, curves; learners sample and do not enumerate."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from example_count import examples
from situations import CONFIGS, make_skill, make_task, model_of, retry_task
from skillplan import load_problem
from skillplan.errors import ModelTooLarge, OptionError, SearchStopped
from skillplan.model import TabularMDP
from skillplan.pipeline import Setup, make_model, make_solver, solve
from skillplan.records import Status
from skillplan.solvers import Stop, compiled, random_bits
from skillplan.solvers.mdp import build_rewards
from skillplan.task import Facts
from skillplan.testing import lid_task
from swarm_situations import base_task, legs_of_table_3, minimal_starts

LEARNERS = ("sarsa", "q-learning", "monte-carlo")
PLANNERS = ("policy-iteration", "value-iteration")
ALL = (*LEARNERS, *PLANNERS)


@pytest.mark.parametrize("name", ALL)
class TestEverySolver:
    def test_its_policy_leads_to_the_goal_from_every_position(self, name):
        solution = make_solver(name, {}).solve(make_model(base_task(66, 42)))
        assert solution.policy is not None
        assert len(solution.policy) == 77
        assert minimal_starts(solution.policy, 42) > 0.9

    def test_it_walks_the_sequences_of_table_3_in_as_many_steps(self, name: str) -> None:
        # In every run every third.
        for start, goal, steps in [*legs_of_table_3()][:: 16 // examples(16, fewest=5)]:
            result = solve(base_task(start, goal), name, seed=1)
            assert result.status in (Status.SOLVED, Status.OPTIMAL), result.reason
            assert result.cost == steps

    def test_it_solves_a_task_with_chance(self, name):
        result = solve(retry_task(0.25), name)
        # The referee confirms a least expected cost; learners claim none.
        proves = name in ("value-iteration", "policy-iteration")
        assert result.status is (Status.OPTIMAL if proves else Status.SOLVED)
        assert result.cost == pytest.approx(8.0)

    def test_it_says_how_long_it_took_and_how_often_it_went_round(self, name):
        result = solve(base_task(66, 42), name)
        assert result.trace["states"] == 78
        assert result.trace["iterations"] >= 1
        assert result.trace["learning_s"] > 0
        assert result.trace["sampling_s" if name in LEARNERS else "enumeration_s"] > 0

    def test_it_has_nothing_to_do_at_the_goal(self, name):
        facts = Facts(("done",))
        task = make_task(facts, [make_skill(facts, "rest")], initial=("done",), goal=("done",))
        result = solve(task, name)
        assert result.status in (Status.SOLVED, Status.OPTIMAL)
        assert result.cost == 0

    def test_it_ends_while_it_enumerates_when_told_to(self, name):
        stop = Stop()
        stop.interrupt()
        assert solve(base_task(66, 42), name, stop=stop).status is Status.UNSOLVED

    def test_a_dead_end_is_not_where_it_goes(self, name):
        """The cheaper way ends where nothing can be done."""
        facts = Facts(("a", "done", "stuck"))
        skills = [
            make_skill(facts, "trap", forbids=("done", "stuck"), add=("stuck",), cost=0.1),
            make_skill(facts, "to_a", forbids=("a", "done", "stuck"), add=("a",), cost=1.0),
            make_skill(facts, "finish", requires=("a",), forbids=("done", "stuck"), add=("done",)),
        ]
        result = solve(make_task(facts, skills, goal=("done",)), name)
        assert [step.skill for step in result.steps] == ["to_a", "finish"]


@pytest.mark.parametrize("name", PLANNERS)
def test_planners_refuse_what_is_too_large_in_words(name):
    result = solve(base_task(66, 42), name, Setup(options={name: {"max_states": 20}}))
    assert result.status is Status.REFUSED
    assert "more than 20 reachable states" in result.reason


@pytest.mark.parametrize("name", LEARNERS)
class TestLearners:
    def test_only_actions_that_are_taken_are_checked(self, name):
        """One episode from C66 to its neighbour asks for the swings that it makes."""
        model = model_of(base_task(66, 42))
        options = {"episodes": 1, "starts": "task", "max_steps": 30}
        trace = make_solver(name, options).solve(model).trace
        assert model.stats.checks + model.stats.cache_hits == trace["actions_tried"] <= 30
        assert trace["states"] <= 31
        assert trace["actions_tried"] < trace["actions_seen"]

    def test_infeasible_actions_fail_when_they_are_taken(self, name):
        """The chart forbids what preconditions allow; no mask allows even more."""
        task = load_problem(str(CONFIGS / "inverter_board.yaml")).task
        trace = make_solver(name, {"episodes": 500}).solve(make_model(task)).trace
        bare = make_solver(name, {"episodes": 500, "mask": "none"}).solve(make_model(task)).trace
        assert bare["failed"] > 0
        assert trace["failed"] > 0
        assert bare["actions_seen"] % len(task.skills) == 0
        assert trace["actions_seen"] < len(task.skills) * trace["states"] / 2

    def test_a_table_that_is_full_ends_the_run_and_says_so(self, name):
        task = load_problem(str(CONFIGS / "inverter_board.yaml")).task
        result = solve(task, name, Setup(options={name: {"max_states": 10}}))
        assert result.status is Status.UNSOLVED
        assert "the table has max_states=10 states" in result.reason
        assert result.trace["ended"] == "table full"
        assert 10 <= result.trace["states"] < 10 + 17

    def test_without_a_completed_episode_there_is_no_policy(self, name):
        options = {name: {"episodes": 1, "max_steps": 1, "starts": "task"}}
        result = solve(base_task(66, 1), name, Setup(options=options))
        assert result.status is Status.UNSOLVED
        assert result.reason == "no episode completed the task"
        assert result.trace["cut_off"] == 1

    def test_given_values_are_not_derived(self, name):
        options = {"episodes": 700, "epsilon": 0.25, "epsilon_end": 0.25, "optimistic": False}
        derived = make_solver(name, options).derived([lid_task()])
        assert derived == {"starts": "task", "alpha_end": 0.1}

    def test_a_circle_that_costs_nothing_does_not_hold_them(self, name):
        facts = Facts(("here", "there", "done"))
        skills = [
            make_skill(facts, "go", requires=("here",), add=("there",), delete=("here",), cost=0),
            make_skill(
                facts, "back", requires=("there",), add=("here",), delete=("there",), cost=0
            ),
            make_skill(facts, "end", requires=("there",), add=("done",), delete=("there",), cost=3),
        ]
        result = solve(make_task(facts, skills, initial=("here",), goal=("done",)), name)
        assert result.cost == 3

    def test_an_interrupted_run_keeps_what_it_has_learned(self, name):
        solver = make_solver(name, {})
        model = make_model(base_task(66, 42))
        assert solver.refuses(model) is None
        run_episodes = solver.run_episodes

        def interrupted(tables, schedule, previous, *rest, **options):
            if previous >= 20_000:
                solver.stop.interrupt()
            return run_episodes(tables, schedule, previous, *rest, **options)

        solver.run_episodes = interrupted
        solution = solver.solve(model)
        assert 20_000 <= solution.trace["iterations"] <= 21_000
        assert solution.trace["ended"] == "interrupted"
        assert minimal_starts(solution.policy or {}, 42) > 0.9

    def test_curves_are_recorded_at_evenly_spaced_episodes(self, name):
        options = {"episodes": 2_500, "record": 5, "watch": "at(C66), at(C13)"}
        trace = solve(base_task(66, 42), name, Setup(options={name: options})).trace
        assert trace["episodes"] == [500, 1000, 1500, 2000, 2500]
        means = trace["steps_per_episode"]
        assert len(means) == 5
        assert sum(means) * 500 == pytest.approx(trace["steps"])
        assert means[0] > means[-1]
        assert set(trace["q_values"]) == {"at(C66)", "at(C13)"}
        curves = trace["q_values"]["at(C66)"]
        assert set(curves) <= {f"B{i}" for i in range(11)}
        assert all(len(curve) == 5 for curve in curves.values())

    def test_recording_changes_nothing(self, name):
        plain, recorded = (
            make_solver(name, {"episodes": 3_000, "record": record}).solve(
                make_model(base_task(66, 42)), seed=3
            )
            for record in (0, 7)
        )
        assert dict(plain.policy or {}) == dict(recorded.policy or {})
        assert plain.trace["steps"] == recorded.trace["steps"]

    def test_nothing_is_recorded_unasked(self, name):
        trace = solve(base_task(66, 42), name).trace
        assert not {"episodes", "steps_per_episode", "q_values"} & set(trace)

    def test_a_watched_fact_that_does_not_exist_is_named(self, name):
        setup = Setup(options={name: {"record": 2, "watch": "at(C66),at(C99)"}})
        with pytest.raises(OptionError, match=r"at\(C99\)"):
            solve(base_task(66, 42), name, setup)

    def test_a_stage_that_knows_none_of_the_watched_facts_is_not_watched(self, name):
        """As the heads of a chain know no position of the base."""
        setup = Setup(options={name: {"record": 2, "watch": "head(1:0)"}})
        assert "q_values" not in solve(base_task(66, 42), name, setup).trace

    def test_other_seeds_give_other_episodes(self, name):
        model = make_model(base_task(66, 42))
        steps = {make_solver(name, {}).solve(model, seed=seed).trace["steps"] for seed in range(4)}
        assert len(steps) == 4

    def test_episodes_are_cut_off(self, name):
        options = {"episodes": 100, "max_steps": 3}
        trace = solve(base_task(66, 1), name, Setup(options={name: options})).trace
        assert trace["steps"] <= 300


@pytest.mark.parametrize(
    ("name", "seeds"),
    [
        ("q-learning", range(1_000, 1_010)),
        ("sarsa", range(1_000, 1_010)),
        ("q-learning", range(86_100, 86_110)),
        ("sarsa", range(86_100, 86_110)),
    ],
)
def test_the_board_is_solved_at_the_optimum_by_defaults(name, seeds):
    """In at least 9 of 10 runs; ties are broken at random, so that runs differ."""
    task = load_problem(str(CONFIGS / "inverter_board.yaml")).task
    traces = [make_solver(name, {}).solve(make_model(task), seed=seed).trace for seed in seeds]
    costs = [trace["best_cost_seen"] for trace in traces]
    assert sum(cost == pytest.approx(1.86708601, abs=1e-8) for cost in costs) >= 9
    assert len({trace["steps"] for trace in traces}) > 5


class TestPayments:
    def test_a_reward_scheme_is_paid_as_it_stands(self):
        model = make_model(base_task(66, 42))
        mdp = TabularMDP.from_model(model)
        assert (build_rewards(model, mdp, "reward").rewards == mdp.rewards).all()

    def test_costs_are_paid_with_a_bonus_that_no_plan_can_outweigh(self):
        model = make_model(lid_task())
        mdp = TabularMDP.from_model(model)
        paid = build_rewards(model, mdp, "reward")
        at_goal = mdp.goal[mdp.successors]
        assert (paid.rewards[~at_goal] == -mdp.costs[~at_goal]).all()
        bonus = paid.rewards[at_goal] + mdp.costs[at_goal]
        assert np.allclose(bonus, model.step_limit * mdp.costs.max())
        assert paid.stuck == pytest.approx(-bonus[0])


class TestEnumeration:
    def test_starts_count_as_states(self):
        with pytest.raises(ModelTooLarge, match="more than 77 reachable states"):
            TabularMDP.from_model(make_model(base_task(66, 42)), 77)

    def test_it_gives_up_when_told_to(self):
        with pytest.raises(SearchStopped, match="it was stopped"):
            TabularMDP.from_model(make_model(lid_task()), stop=lambda: True)

    def test_refusing_and_solving_enumerate_once(self):
        model = model_of(base_task(66, 42))
        solver = make_solver("value-iteration", {})
        assert solver.refuses(model) is None
        queries = model.stats.states
        solver.solve(model)
        assert model.stats.states == queries == 77


class TestCompiled:
    def test_random_numbers_are_those_of_splitmix64(self):
        """The reference implementation's first numbers from 1234567."""
        stream = np.array([1234567], dtype=np.uint64)
        assert [int(random_bits(stream)) for _ in range(5)] == [
            6457827717110365317,
            3203168211198807973,
            9817491932198370423,
            4593380528125082431,
            16408922859458223821,
        ]

    def test_without_a_place_for_the_cache_it_compiles_all_the_same(self, monkeypatch):
        njit = numba.njit

        def fails_to_cache(*args: object, **options: object) -> object:
            if options.get("cache"):
                raise RuntimeError("cannot cache function 'f': no locator available")
            return njit(*args, **options)

        monkeypatch.setattr(numba, "njit", fails_to_cache)

        def twice(x: int) -> int:
            return 2 * x

        assert compiled(twice)(21) == 42

    def test_another_fault_is_not_hidden(self, monkeypatch):
        def fails(*args: object, **options: object) -> object:
            raise RuntimeError("something else")

        monkeypatch.setattr(numba, "njit", fails)
        with pytest.raises(RuntimeError, match="something else"):
            compiled(len)
