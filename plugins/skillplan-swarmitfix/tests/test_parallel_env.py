"""A fleet as a parallel environment of PettingZoo."""

from __future__ import annotations

import importlib
import sys

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from fleet_instances import fewest, random_robots, task_of
from situations import CONFIGS, fake_back_end, model_of, solver_that, two_roads_task
from skillplan.pipeline import load_problem, make_model, solve
from skillplan.solvers import Plan, Solution
from skillplan.task import Verdict

BENCH = swarm.Bench(6, 13, 0.34)
SMALL = [(1, 7), (2, 5), (3, 5), (3, 7)]


@pytest.fixture(scope="module")
def fleet():
    return load_problem(CONFIGS / "swarmitfix_fleet.yaml")


def two(first, second, **more):
    ends = {"left": first, "right": second}
    robots = {name: tuple(map(BENCH.position, places)) for name, places in ends.items()}
    return task_of(BENCH, robots, **more)


def choose(env, **skills):
    """Return actions by agent: skills by their last names, and else waiting."""
    names = {agent: f"{agent}.{skills[agent]}" for agent in skills}
    return {
        agent: env.skills[agent].index(names[agent]) + 1 if agent in names else 0
        for agent in env.agents
    }


def follow(env, schedule):
    """Make the moves of a solver's schedule; return the sum of rewards of the first agent."""
    env.reset()
    total = 0.0
    for step in schedule:
        actions = choose(env, **{robot: action for robot, action, _, _ in step})
        _, rewards, _, _, infos = env.step(actions)
        total += rewards[env.possible_agents[0]]
        assert all(info["executed"] or not info["skill"] for info in infos.values())
    return total


def play(env, seed):
    """Make random possible moves until the episode ends; return its last flags."""
    rng = np.random.default_rng(seed)
    _, infos = env.reset()
    while env.agents:
        masks = {agent: infos[agent]["action_mask"] for agent in env.agents}
        actions = {agent: int(rng.choice(np.flatnonzero(mask))) for agent, mask in masks.items()}
        _, _, ended, cut, infos = env.step(actions)
    return set(ended.values()), set(cut.values())


class TestPettingZoo:
    @pytest.mark.filterwarnings("ignore:The old environment creation")
    def test_its_own_tests_pass(self, fleet):
        from pettingzoo.test.parallel_test import parallel_api_test
        from pettingzoo.test.seed_test import parallel_seed_test

        parallel_api_test(swarm.FleetParallelEnv(make_model(fleet.task)), num_cycles=30)
        parallel_seed_test(lambda: swarm.FleetParallelEnv(make_model(fleet.task)), num_cycles=10)

    @pytest.mark.slow(reason="turns are a conversion of PettingZoo; its tests in every run")
    @pytest.mark.filterwarnings("ignore:We recommend agents", "ignore:The old environment creation")
    def test_agents_can_take_turns(self, fleet):
        from pettingzoo.test import api_test, seed_test
        from pettingzoo.utils import parallel_to_aec

        def make():
            return parallel_to_aec(swarm.FleetParallelEnv(make_model(fleet.task)))

        api_test(make(), num_cycles=100)
        seed_test(make, num_cycles=30)

    def test_without_it_the_message_names_the_package(self, monkeypatch):
        monkeypatch.delitem(sys.modules, "skillplan_swarmitfix.multiagent.parallel_env")
        monkeypatch.setitem(sys.modules, "pettingzoo", None)
        with pytest.raises(ModuleNotFoundError, match="pip install pettingzoo"):
            importlib.import_module("skillplan_swarmitfix.multiagent.parallel_env")

    def test_a_task_of_one_robot_is_refused(self):
        with pytest.raises(swarm.NotMultiAgent, match="not a multi-agent problem"):
            swarm.FleetParallelEnv(model_of(two_roads_task()))


class TestPlans:
    def test_a_schedule_of_the_solver_takes_its_makespan_and_the_referee_accepts_it(self, fleet):
        result = solve(fleet.task, "fleet")
        env = swarm.FleetParallelEnv(make_model(fleet.task))
        total = follow(env, result.trace["schedule"])
        assert env.agents == []
        account = fleet.account({fleet.task.name: env.plan}).document
        assert -total == len(env.schedule) == 9
        assert (account["parallel_makespan"], account["simulated"]) == (9, "valid")
        solver = solver_that(lambda model, seed: Solution(Plan(env.plan, 36.0)))
        assert (solve(fleet.task, solver).status, result.cost) == ("solved", 36.0)

    @pytest.mark.slow(reason="searches; random moves in every run")
    @given(st.sampled_from(SMALL), st.integers(0, 10_000))
    @settings(max_examples=examples(20))
    def test_the_fewest_steps_are_those_of_a_search_over_pins(self, size, seed):
        bench = swarm.Bench(*size, 0.34)
        robots = random_robots(bench, 2, seed)
        task = task_of(bench, robots)
        result = solve(task, swarm.FleetSolver(swarm.FleetSolver.Options(objective="makespan")))
        best = fewest(bench, robots, at_once=True)
        if best is not None:
            assert -best == follow(
                swarm.FleetParallelEnv(make_model(task)), result.trace["schedule"]
            )

    @given(st.integers(0, 10_000))
    @settings(max_examples=examples(10))
    def test_random_moves_never_share_a_pin_and_can_be_made_in_either_order(self, seed):
        """By the simulator, which knows pins and nothing of tasks, and by the model."""
        bench = swarm.Bench(3, 7, 0.34)
        robots = random_robots(bench, 3, seed)
        task = task_of(bench, robots, step_limit=60)
        env, model = swarm.FleetParallelEnv(make_model(task)), make_model(task)
        ended, cut = play(env, seed)
        places = {robot: start for robot, (start, _) in robots.items()}
        steps = []
        for skills in env.schedule:
            moves = []
            for skill in skills:
                robot, _, action = skill.rpartition(".B")
                end = int(bench.successors[places[robot], int(action)])
                moves.append((robot, int(action), places[robot], end))
                places[robot] = end
            steps.append(moves)
        violation = swarm.simulate(bench, robots, steps)
        assert violation is None or "not at its goal" in violation.reason
        assert ({violation is None}, {violation is not None}) == (ended, cut)
        for order in (1, -1):
            state = model.initial
            for name in [skill for skills in env.schedule for skill in skills[::order]]:
                skill = task.skill(name)
                assert model.verdict(state, skill).is_feasible
                state = skill.prediction_in(state).apply(state)
            assert model.is_goal(state) == (violation is None)
        assert len(env.plan) <= 60


class TestConflicts:
    """`left` comes before `right` in the order of agents."""

    @pytest.fixture
    def env(self):
        env = swarm.FleetParallelEnv(make_model(two(("C1", "C13"), ("C5", "C66"))))
        env.reset()
        return env

    def clashing(self, env):
        """Return a possible move of each that both need a pin for, which is free."""
        _, infos = env.reset()
        options = {
            agent: [int(action) for action in np.flatnonzero(infos[agent]["action_mask"])[1:]]
            for agent in env.agents
        }
        for first in options["left"]:
            for other in options["right"]:
                env.reset()
                actions = {"left": first, "right": other}
                *_, infos = env.step(actions)
                if not infos["right"]["executed"]:
                    return actions, infos
        raise AssertionError("no moves clash")

    def test_the_earlier_agent_moves_and_the_later_waits(self, env):
        actions, infos = self.clashing(env)
        first = env.skills["left"][actions["left"] - 1]
        assert infos["left"]["executed"]
        assert f"clashes with {first}" == infos["right"]["reason"]
        assert ((first,), 0.0) == (env.plan, infos["right"]["cost"])
        assert infos["left"]["cost"] == 1.0

    def test_the_later_agent_moves_alone(self, env):
        actions, _ = self.clashing(env)
        env.reset()
        _, rewards, _, _, infos = env.step({**actions, "left": 0})
        assert (infos["right"]["executed"], infos["left"]["skill"]) == (True, "")
        assert rewards == {"left": -1.0, "right": -1.0}

    def test_what_is_impossible_is_not_made(self, env):
        _, infos = env.reset()
        action = int(np.flatnonzero(infos["left"]["action_mask"] == 0)[0])
        *_, infos = env.step({"left": action, "right": 0})
        assert "from at(left,C1)" in infos["left"]["reason"]
        assert env.plan == ()

    def test_what_back_ends_reject_is_not_made(self):
        task = two(("C1", "C13"), ("C78", "C66"))
        back_end = fake_back_end(task, Verdict.infeasible("the plate sags"))
        env = swarm.FleetParallelEnv(model_of(task, back_end))
        _, infos = env.reset()
        action = int(np.flatnonzero(infos["left"]["action_mask"])[1])
        *_, infos = env.step({"left": action, "right": 0})
        assert (infos["left"]["executed"], infos["left"]["reason"]) == (False, "the plate sags")


class TestSpaces:
    def test_an_agent_sees_its_place_and_goal_first(self, fleet):
        env = swarm.FleetParallelEnv(make_model(fleet.task))
        observations, _ = env.reset()
        bits = np.array(list(observations.values())).reshape(4, 5, 78)
        assert (bits.sum(axis=2) == 1.0).all()
        places = bits.argmax(axis=2)
        corners = [BENCH.position(name) for name in ("C1", "C13", "C66", "C78")]
        assert corners == places[:, 0].tolist()
        assert [BENCH.position(name) for name in ("C78", "C66", "C13", "C1")] == places[
            :, 1
        ].tolist()
        assert corners[1:] + corners[:1] == [*places[0, 2:].tolist(), places[0, 0]]
        assert env.state_space.contains(env.state())
        assert corners == env.state().reshape(4, 78).argmax(axis=1).tolist()

    def test_the_step_limit_truncates(self):
        env = swarm.FleetParallelEnv(make_model(two(("C1", "C13"), ("C78", "C66"), step_limit=2)))
        env.reset()
        assert env.step({"left": 0, "right": 0})[3] == {"left": False, "right": False}
        assert env.step({"left": 0, "right": 0})[3] == {"left": True, "right": True}
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step({"left": 0, "right": 0})

    @pytest.mark.parametrize("actions", [{"left": 0}, {"left": 0, "right": 11}])
    def test_missing_and_unknown_actions_are_refused(self, actions):
        env = swarm.FleetParallelEnv(make_model(two(("C1", "C13"), ("C78", "C66"))))
        env.reset()
        with pytest.raises(gymnasium.error.InvalidAction, match=r"of right are 0 \(wait\) to 10"):
            env.step(actions)

    def test_it_is_rendered_as_text(self, fleet):
        env = swarm.FleetParallelEnv(make_model(fleet.task), render_mode="ansi")
        env.reset()
        env.step(choose(env, north_west="B4"))
        assert env.render().startswith("step 1; north_west.B4; {at(north_west,C15)")

    @pytest.mark.slow(reason="an image; those of a walk in every run")
    def test_it_is_rendered_as_an_image(self, fleet):
        env = swarm.FleetParallelEnv(make_model(fleet.task), render_mode="rgb_array")
        env.reset()
        assert env.render().shape == (480, 640, 3)


# Sequences of moves, run as early as they allow.


def move(agent: int, occupies: int, duration_s: float = 1.0) -> swarm.Move:
    return swarm.Move(
        0, agent, 0, 1, 1 << 2 * agent, 2 << 2 * agent, "go", 0, occupies, 1.0, duration_s
    )


def steps_of(*moves: swarm.Move) -> list[int]:
    return [timed.step for timed in swarm.ParallelSchedule.earliest(moves).moves]


def test_moves_that_do_not_clash_are_made_at_once():
    assert steps_of(move(0, 0b01), move(1, 0b10)) == [0, 0]


def test_moves_of_one_agent_follow_each_other():
    assert steps_of(move(0, 0b01), move(0, 0b10)) == [0, 1]


def test_moves_that_clash_keep_their_order():
    assert steps_of(move(0, 0b01), move(1, 0b11), move(2, 0b10)) == [0, 1, 2]


def test_seconds_do_not_wait_for_a_step_to_end():
    """The second agent's second move starts while the first agent's long one runs."""
    schedule = swarm.ParallelSchedule.earliest(
        [move(0, 0b001, 9.0), move(1, 0b010, 2.0), move(1, 0b010, 3.0), move(2, 0b001, 1.0)]
    )
    assert [timed.start_s for timed in schedule.moves] == [0.0, 0.0, 2.0, 9.0]
    assert schedule.makespan_s == 10.0
    assert schedule.makespan == 2
    assert [len(step) for step in schedule.steps()] == [2, 2]


def test_nothing_takes_no_time():
    nothing = swarm.ParallelSchedule.earliest(())
    assert (nothing.makespan, nothing.makespan_s, nothing.steps()) == (0, 0.0, ())


def test_a_step_with_a_clash_is_refused():
    with pytest.raises(ValueError, match="go clashes with another move of its step"):
        swarm.ParallelSchedule(
            (swarm.TimedMove(move(0, 1), 0, 0.0), swarm.TimedMove(move(1, 1), 0, 0.0))
        )


@pytest.mark.parametrize(("step", "start_s"), [(-1, 0.0), (0, -1.0)])
def test_nothing_starts_before_the_beginning(step, start_s):
    with pytest.raises(ValueError, match="A move cannot be made"):
        swarm.TimedMove(move(0, 1), step, start_s)
