"""Policies followed on a model: what they do, what they cost, and how chance fares."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from run_folders import HOPELESS, OPTIMAL, SWITCHED, lookup_network
from skillplan.env import Observation, SkillVectorEnv
from skillplan.model import SkillModel
from skillplan.pipeline import Setup, load_problem, make_model
from skillplan.solvers import ActionRule, NetworkPolicy, Stop
from skillplan.task import Task
from skillplan.training import (
    measure_random_baseline,
    prove_optimum,
    roll_out_greedily,
    sample_roll_outs,
)

BOARD = Path(__file__).parents[2] / "configs" / "inverter_board.yaml"
BEST = 1.8670860141568904


@pytest.fixture(scope="module")
def board():
    return load_problem(BOARD).task


def followed(task: Task, sequence: str, kind: str = "markov", mask: str = "applicable") -> Any:
    network = lookup_network(task, kind, sequence)
    return roll_out_greedily(make_model(task), Observation.of(task, kind), network, mask)


def an_env(task: Task, places: int = 50, mask: str = "applicable") -> SkillVectorEnv:
    return SkillVectorEnv(make_model(task), places, observation="markov", mask=mask)


class TestGreedy:
    @pytest.mark.parametrize("mask", ["none", "applicable", "feasible"])
    @pytest.mark.parametrize("kind", ["paper", "markov"])
    def test_what_a_policy_does_is_replayed_on_the_model(self, board, kind, mask):
        rolled = followed(board, OPTIMAL, kind, mask)
        assert OPTIMAL == ",".join(map(str, rolled.actions))
        assert pytest.approx(BEST, rel=1e-12) == rolled.cost
        assert ("pick(pcb)", "place(pcb)") == rolled.skills[:2]

    def test_without_a_mask_a_skill_that_fails_ends_it_and_is_named(self, board):
        rolled = followed(board, HOPELESS, mask="none")
        assert ((0, 0), None) == (rolled.actions, rolled.cost)
        assert rolled.reason.startswith("pick(pcb) at step 2: ")

    def test_a_collision_ends_it_though_preconditions_hold(self, board):
        """The switch is placed before the board that it stands on."""
        rolled = followed(board, "2,3")
        assert (2, 3) == rolled.actions
        assert "place(switch_1) at step 2" in rolled.reason

    def test_the_step_limit_ends_it_and_what_is_missing_is_told(self, board):
        rolled = followed(board, "0,1", mask="feasible")
        assert board.step_limit == len(rolled.actions)
        assert "after 20 skills the goal is not reached" in rolled.reason


def softmax(temperature: float) -> ActionRule:
    return ActionRule("softmax", temperature)


class TestSampled:
    def test_epsilon_is_the_share_of_random_actions(self, board):
        """0 is greedy, and 1 is chance alone; 1 of 10 leaves the way, which mostly goes on."""
        network = lookup_network(board, "markov", OPTIMAL)
        rates = [
            sample_roll_outs(
                an_env(board, 500), network, 500, 3, ActionRule("epsilon-greedy", epsilon)
            ).rate
            for epsilon in (0.0, 0.1, 1.0)
        ]
        assert 1.0 == rates[0] > rates[1] > 0.1 > rates[2]

    def test_a_rule_out_of_range_is_refused(self):
        for rule in (("softmax", 0.0), ("epsilon-greedy", 1.5)):
            with pytest.raises(ValueError, match="out of range"):
                ActionRule(*rule)

    def test_a_cold_policy_does_the_same_every_time(self, board):
        network = lookup_network(board, "markov", SWITCHED)
        tally = sample_roll_outs(an_env(board), network, 120, 3, softmax(0.01))
        assert (120, 120) == (tally.successes, tally.episodes)

    def test_a_hot_policy_is_chance_alone(self, board):
        """As often as the random baseline, within what 2,000 episodes tell."""
        network = lookup_network(board, "markov", OPTIMAL)
        hot = sample_roll_outs(an_env(board, 1_000), network, 2_000, 3, softmax(1e6))
        chance = measure_random_baseline(an_env(board, 1_000), 2_000, 4)
        assert hot.rate is not None
        assert chance.tally.rate is not None
        assert 0.005 < chance.tally.rate < 0.08
        assert abs(hot.rate - chance.tally.rate) < 0.02

    def test_the_seed_decides(self, board):
        network = lookup_network(board, "markov", OPTIMAL)
        first, again, other = (
            sample_roll_outs(an_env(board), network, 50, seed, softmax(0.4)) for seed in (1, 1, 2)
        )
        assert first == again
        assert 0 < first.successes < 50
        assert first != other

    def test_episodes_that_fail_early_do_not_count_for_more(self, board):
        """More episodes than places: of every place one at a time, whatever its length."""
        rates = [
            sample_roll_outs(
                an_env(board, places),
                lookup_network(board, "markov", OPTIMAL),
                1_500,
                5,
                softmax(0.4),
            ).rate
            for places in (30, 1_500)
        ]
        assert rates[0] == pytest.approx(rates[1], abs=0.05)

    def test_there_is_at_least_one_episode(self, board):
        with pytest.raises(ValueError, match="at least one episode"):
            sample_roll_outs(
                an_env(board), lookup_network(board, "markov", "0"), 0, 0, softmax(1.0)
            )


class TestBaseline:
    def test_chance_without_a_mask_all_but_never_completes(self, board):
        base = measure_random_baseline(an_env(board, 500, "none"), 1_000, 0, "none")
        assert (0, 1_000, None) == (base.tally.successes, base.tally.episodes, base.best_cost)

    def test_what_it_finds_costs_no_less_than_the_optimum(self, board):
        base = measure_random_baseline(an_env(board, 500), 1_000, 0)
        assert base.best_cost is not None
        assert BEST - 1e-9 <= base.best_cost < 4.0


class TestOptimum:
    def test_it_is_proved_by_the_solver_that_suits(self, board):
        optimum = prove_optimum(board, Setup())
        assert (pytest.approx(BEST), "auto", "") == (optimum.cost, optimum.solver, optimum.reason)
        assert OPTIMAL == ",".join(map(str, optimum.actions))

    def test_without_time_the_reason_is_told(self, board):
        stop = Stop()
        stop.interrupt()
        optimum = prove_optimum(board, Setup(), stop=stop)
        assert optimum.cost is None
        assert optimum.reason.startswith("auto: ")


class TestChance:
    """Picking the first part fails now and then; nothing else differs."""

    def risky(self, task: Task) -> Task:
        first = task.skills[0]
        (does,) = first.outcomes
        outcomes = (
            replace(does, probability=0.8),
            replace(does, probability=0.2, add=task.facts.of(), delete=task.facts.of()),
        )
        return task.replace(skills=(replace(first, outcomes=outcomes), *task.skills[1:]))

    def test_a_policy_costs_what_it_costs_on_average(self, board):
        """One try more in four of picking, from where the arm is then: exactly, and in sum."""
        task = self.risky(board)
        model: SkillModel = make_model(task)
        network = lookup_network(board, "paper", OPTIMAL)
        rolled = roll_out_greedily(model, Observation.of(task, "paper"), network, "applicable")
        again = task.skills[0].cost.at(task.initial)
        assert rolled.complete
        assert OPTIMAL == ",".join(map(str, rolled.actions))
        assert pytest.approx(BEST + 0.25 * again, rel=1e-9) == rolled.cost

    def test_its_optimum_is_proved_by_value_iteration(self, board):
        task = self.risky(board)
        optimum = prove_optimum(task, Setup())
        again = task.skills[0].cost.at(task.initial)
        assert ("value-iteration", ()) == (optimum.solver, optimum.actions)
        assert pytest.approx(BEST + 0.25 * again, rel=1e-6) == optimum.cost


def test_scores_of_a_looked_up_sequence_are_one_for_its_action(board):
    """What the tests here rest on."""
    network: NetworkPolicy = lookup_network(board, "markov", OPTIMAL)
    scores = network.scores(Observation.of(board, "markov").encode(board.initial)[None])
    assert {0.0, 1.0} == set(np.unique(scores).tolist())
    assert 0 == int(scores.argmax())
