"""PPO: what it learns, what it keeps, and that it goes on bit for bit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from deep_learner_suite import DeepLearnerSuite, assert_same
from deep_learner_suite import begun as begun_for
from deep_learner_suite import places as places_for
from deep_learner_suite import resumed as resumed_for
from example_count import examples
from situations import model_of, retry_task, two_roads_task
from skillplan import load_problem
from skillplan.env import COMPLETE, SkillVectorEnv
from skillplan.pipeline import Setup, make_model, solve
from skillplan.testing import SolverSuite, lid_task
from skillplan_torch import PpoSolver, RolloutBuffer
from thinned import release_case, slow_case

pytestmark = pytest.mark.slow(reason="trainings; DQN's in every run")

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"
OPTIMUM_M = 1.86709
SMALL = {"rollout": 96, "batch": 64, "epochs": 2, "width": 32}
STEPS = 600


@pytest.fixture(scope="module")
def board():
    """The inverter board."""
    return load_problem(BOARD).task


def solver(**options):
    return PpoSolver(PpoSolver.Options(**{**SMALL, **options}))


def places(learner, runs, task=None):
    return places_for(learner, runs, task or lid_task())


def begun(learner, seeds, task=None):
    return begun_for(learner, seeds, task or lid_task(), STEPS)


def resumed(learner, seeds, snapshot):
    return resumed_for(learner, seeds, lid_task(), snapshot, STEPS)


class TestPpoSolver(SolverSuite):
    solver = "ppo"
    options = {"steps": 1_000, "rollout": 128, "batch": 64, "width": 32}  # noqa: RUF012

    @pytest.mark.slow(reason="two trainings; runs alone and among others in every run")
    def test_the_same_seed_gives_the_same_plan(self):
        super().test_the_same_seed_gives_the_same_plan()


class TestAsADeepLearner(DeepLearnerSuite):
    learner = PpoSolver
    small = SMALL
    steps = STEPS
    changes = ({"width": 64}, {"rollout": 64}, {"layers": 1})


class TestLearning:
    @pytest.mark.slow(reason="a training; DQN solves the lid task in every run")
    def test_the_cheaper_of_two_roads_is_learned(self):
        result = solve(two_roads_task(), solver(steps=1_500))
        assert result.cost == 3.0

    @pytest.mark.slow(
        reason="a training of 3,000 steps; PpoSolver solves the lid task in every run"
    )
    def test_the_lid_is_screwed_on_at_least_cost(self):
        result = solve(lid_task(), solver(steps=3_000, rollout=128, batch=64))
        assert result.cost == pytest.approx(solve(lid_task(), "exact").cost)

    @pytest.mark.slow(reason="a training; DQN under chance in every run")
    def test_a_skill_that_may_fail_is_tried_again(self):
        result = solve(retry_task(0.5), solver(steps=600))
        assert result.cost == pytest.approx(4.0)

    @pytest.mark.parametrize(
        "runs",
        [
            release_case(1, reason="a run of 10,000 steps"),
            release_case(10, reason="ten runs of 10,000 steps"),
        ],
    )
    @pytest.mark.parametrize(("options", "most"), [({}, 1.03), ({"imitation": 1.0}, 1.02)])
    def test_every_seed_completes_the_board_near_the_optimum(self, board, options, most, runs):
        """Within three percent, with imitation two; the page on learning has what ten runs did."""
        learner = PpoSolver(PpoSolver.Options(**options))
        steps = learner.derived([board])["steps"]
        assert steps == 10_000
        training = learner.begin(places(learner, runs, board), range(runs), steps)
        training.advance(steps)
        costs = [training.learned(run).best_cost for run in range(runs)]
        assert all(cost is not None and cost <= most * OPTIMUM_M for cost in costs)

    def test_masks_hold_in_all_that_is_tried(self):
        task = lid_task()
        model = make_model(task)
        episodes = begun(solver(), [0, 1]).advance(STEPS)
        assert episodes
        for episode in episodes:
            state = model.initial
            for action in episode.actions:
                skill = task.skills[action]
                assert skill in model.applicable(state)
                state = skill.prediction.apply(state)


class TestPoliciesFollowed:
    def test_after_an_update_one_episode_follows_the_policy(self):
        training = begun(solver(), [0])
        updates = range(0, STEPS, SMALL["rollout"])
        followed = [e for e in training.advance(STEPS) if e.greedy]
        assert 0 < len(followed) <= len(updates)
        assert min(e.step for e in followed) > SMALL["rollout"]

    @pytest.mark.slow(reason="a training of 2,400 steps; that of DQN in every run")
    def test_the_best_policy_does_what_it_was_kept_for(self):
        learner, steps = solver(), 2_400
        training = learner.begin(places(learner, 2), [0, 1], steps)
        episodes = training.advance(steps)
        for run in (0, 1):
            learned = training.learned(run)
            followed = [e.cost for e in episodes if e.run == run and e.greedy and e.success]
            assert learned.best_cost <= min(followed)
            env = places(learner, 1)
            observed, infos = env.reset(seed=0)
            cost, end = 0.0, 0
            while not end:
                action = learned.best.greedy(observed, infos["action_mask"])
                observed, _, _, _, infos = env.step(action)
                cost, end = cost + infos["cost"][0], infos["end"][0]
            assert end == COMPLETE
            assert cost == pytest.approx(learned.best_cost)

    def test_a_manifest_tells_that_none_is_followed_under_chance(self):
        learner = PpoSolver()
        assert learner.derived([lid_task()])["follow"] is True
        assert learner.derived([retry_task(0.5)])["follow"] is False

    def test_none_is_followed_where_that_is_switched_off(self):
        training = begun(solver(follow=False), [0])
        assert not any(episode.greedy for episode in training.advance(STEPS))


class TestRunsSideBySide:
    @pytest.mark.parametrize(
        "options",
        [
            slow_case({}, reason="other options in every run"),
            {"mask": "none", "novelty": 1.0, "layers": 1},
        ],
    )
    def test_a_run_is_the_same_alone_and_among_others(self, options):
        learner = solver(**options)
        together = begun(learner, [5, 3, 8])
        steps = STEPS // 2
        episodes = together.advance(steps)
        curves = together.figures()
        for run, seed in ((0, 5), (2, 8)):
            alone = begun(learner, [seed])
            mine = [replace(e, run=0) for e in episodes if e.run == run]
            assert alone.advance(steps) == mine
            assert alone.figures() == [curves[run]]
            ours = together.learned(run).last.weights
            for weight, other in zip(alone.learned(0).last.weights, ours, strict=True):
                assert weight.tobytes() == other.tobytes()

    @pytest.mark.slow(reason="trains large networks; small ones in every run")
    def test_of_networks_as_large_as_the_board_s_that_is_so_to_the_last_bit(self, board):
        learner, steps = PpoSolver(PpoSolver.Options(rollout=256)), 600
        together = learner.begin(places(learner, 3, board), [0, 1, 2], steps)
        alone = learner.begin(places(learner, 1, board), [2], steps)
        episodes = [replace(e, run=0) for e in together.advance(steps) if e.run == 2]
        assert alone.advance(steps) == episodes
        ours = together.learned(2).last.weights
        for weight, other in zip(alone.learned(0).last.weights, ours, strict=True):
            assert weight.tobytes() == other.tobytes()

    @pytest.mark.slow(reason="a training; one of DQN that breaks in every run")
    def test_a_run_that_breaks_is_named_and_the_others_go_on(self):
        learner = solver()
        training = begun(learner, [0, 1])
        training.advance(200)
        snapshot = training.snapshot()
        snapshot.arrays["adam.0.mean"][1] = np.nan
        broken = resumed(learner, [0, 1], snapshot)
        episodes = broken.advance(STEPS - 200)
        assert list(broken.failed) == [1]
        assert "no longer finite" in broken.failed[1]
        whole = [e for e in training.advance(STEPS - 200) if e.run == 0]
        assert [e for e in episodes if e.run == 0] == whole
        assert all(np.isfinite(w).all() for w in broken.learned(1).last.weights)
        assert "policy_loss" not in broken.figures()[1]


class TestGoingOn:
    @pytest.mark.slow(reason="trains again and again; DQN goes on bit for bit in every run")
    @settings(max_examples=examples(12, fewest=2))
    @given(cuts=st.lists(st.integers(0, STEPS), max_size=4), novelty=st.sampled_from([0.0, 1.0]))
    def test_a_training_that_was_interrupted_goes_on_bit_for_bit(self, cuts, novelty):
        learner = solver(novelty=novelty)
        whole = begun(learner, [0, 1])
        episodes = whole.advance(STEPS)
        other, theirs = begun(learner, [0, 1]), []
        for cut in sorted(cuts):
            theirs += other.advance(cut - other.steps)
            other = resumed(learner, [0, 1], other.snapshot())
        theirs += other.advance(STEPS - other.steps)
        assert theirs == episodes
        assert_same(other, whole)
        assert other.figures() == whole.figures()


class TestAdvantages:
    @pytest.fixture
    def roll_out(self):
        created = RolloutBuffer(1, 4, 1, 1)
        created.ends[0] = [0, 1, 0, 0]
        created.drawn[0] = [True, True, False, True]
        return created

    def test_looking_to_the_end_they_are_returns_less_values(self, roll_out):
        worth, values = np.array([[1.0, 2.0, 3.0, 4.0]]), np.full((1, 4), 0.5, dtype=np.float32)
        ahead = np.array([10.0], dtype=np.float32)
        advantages = roll_out.advantages(worth, values, ahead, 0.5, 1.0)
        np.testing.assert_allclose(
            advantages, [[1 + 1 - 0.5, 2 - 0.5, 3 + 2 + 2.5 - 0.5, 4 + 5 - 0.5]]
        )

    def test_looking_one_step_they_are_errors_of_values(self, roll_out):
        worth, values = np.zeros((1, 4)), np.array([[1.0, 2.0, 3.0, 4.0]], dtype=np.float32)
        advantages = roll_out.advantages(worth, values, np.array([5.0], dtype=np.float32), 1.0, 0.0)
        np.testing.assert_allclose(advantages, [[1.0, -2.0, 1.0, 1.0]])

    def test_steps_that_were_not_drawn_count_for_nothing(self, roll_out):
        normalise = roll_out.normalise(np.array([[1.0, 2.0, 100.0, 3.0]], dtype=np.float32))
        np.testing.assert_allclose(normalise, [[-1.2247449, 0.0, 0.0, 1.2247449]], rtol=1e-5)


class TestOptions:
    @pytest.mark.parametrize(
        "wrong", [{"clip": 0.0}, {"gamma": 1.5}, {"rollout": 100}, {"entropy": -1.0}]
    )
    def test_what_is_out_of_range_is_refused(self, wrong):
        with pytest.raises(ValidationError):
            PpoSolver.Options(**wrong)

    def test_the_last_skill_s_cost_can_be_left_uncounted(self):
        setup = Setup(options={"ppo": {**SMALL, "steps": 500, "count_last_cost": False}})
        assert solve(two_roads_task(), "ppo", setup).cost is not None

    def test_figures_are_told_since_the_last_time(self):
        training = begun(solver(), [0])
        training.advance(SMALL["rollout"])
        message = training.figures()[0]
        assert message["entropy"] > 0
        assert 0 <= message["clipped"] <= 1
        assert "entropy" not in training.figures()[0]

    def test_a_model_made_by_hand_without_rewards_is_learned_from_its_costs(self):
        training = solver().begin(SkillVectorEnv(model_of(two_roads_task()), 1), [0], STEPS)
        assert any(episode.success for episode in training.advance(STEPS))
