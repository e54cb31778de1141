"""The vector environment in Stable-Baselines3."""

from __future__ import annotations

import importlib
import sys
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from board_situations import OPTIMAL
from situations import CONFIGS, model_of, retry_task, solver_that
from skillplan.env import OUT_OF_TIME, Sb3VecEnv, SkillEnv, SkillVectorEnv
from skillplan.errors import OptionError
from skillplan.pipeline import make_model, solve
from skillplan.solvers import Plan, Solution

NAME = "skillplan.env:skillplan/Task-v0"


def random_actions(rng, masks):
    return (rng.random(masks.shape) * masks).argmax(axis=1)


@pytest.fixture
def board(board_task):
    envs = Sb3VecEnv(SkillVectorEnv(make_model(board_task), 2))
    envs.seed(0)
    envs.reset()
    return envs


@pytest.mark.parametrize("chance", [False, True], ids=["board", "under chance"])
def test_it_does_what_single_environments_in_their_vec_env_do(board_task, chance):
    """Over episodes that end in every way: completed, infeasible and out of time."""
    model = model_of(retry_task(0.5)) if chance else make_model(board_task)
    ours = Sb3VecEnv(SkillVectorEnv(model, 3))
    theirs = DummyVecEnv([lambda: SkillEnv(model)] * 3)
    observed = []
    for envs in (ours, theirs):
        rng, seen = np.random.default_rng(1), []
        envs.seed(5)
        seen.append(envs.reset().tolist())
        for _ in range(200):
            masks = np.stack(envs.env_method("action_masks"))
            obs, rewards, dones, infos = envs.step(random_actions(rng, masks))
            seen.append((obs.tolist(), rewards.tolist(), dones.tolist()))
            for info in infos:
                last = info.get("terminal_observation")
                seen.append((info["TimeLimit.truncated"], info["cost"], np.array(last).tolist()))
        observed.append(seen)
    assert observed[0] == observed[1]
    assert chance or any(entry[0] is True for entry in observed[0] if len(entry) == 3)


def test_sb3_contrib_finds_the_masks(board):
    assert board.has_attr("action_masks")
    masks = np.stack(board.env_method("action_masks"))
    assert board.envs.action_masks().tolist() == masks.tolist()
    assert masks[1].tolist() == board.get_attr("action_masks", 1)[0]().tolist()
    assert masks[0].tolist() == board.reset_infos[0]["action_mask"].tolist()


def test_the_checker_of_stable_baselines3_has_nothing_to_say_against_single_ones(board_task):
    """A warning would be an error here."""
    check_env(SkillEnv(make_model(board_task), render_mode="rgb_array"))


@pytest.mark.slow(reason="trains; the adapter is compared step by step in every run")
def test_a_learned_policy_gets_the_return_that_the_referee_finds(board_task):
    """MaskablePPO completes the board after 8,192 steps; the docs have other learners."""
    from sb3_contrib import MaskablePPO
    from sb3_contrib.common.maskable.evaluation import evaluate_policy

    model = make_model(board_task)
    envs = Sb3VecEnv(SkillVectorEnv(model, 8, objective="cost"))
    learner = MaskablePPO("MlpPolicy", envs, n_steps=64, seed=0, device="cpu").learn(8192)
    judged = VecMonitor(Sb3VecEnv(SkillVectorEnv(model, 1, objective="cost")))
    mean_return, spread = evaluate_policy(learner, judged, n_eval_episodes=3)
    obs, done, plan = judged.reset(), False, []
    while not done:
        masks = np.stack(judged.env_method("action_masks"))
        actions, _ = learner.predict(obs, action_masks=masks, deterministic=True)
        plan.append(board_task.skills[int(actions[0])].name)
        obs, _, (done,), _ = judged.step(actions)
    solver = solver_that(lambda *_: Solution(Plan(tuple(plan))))
    result = solve(board_task, solver)
    assert ("solved", 0.0) == (result.status, spread)
    assert 10.0 - mean_return == pytest.approx(result.cost, abs=1e-5)


def test_a_monitor_reports_return_and_length(board_task):
    envs = VecMonitor(Sb3VecEnv(SkillVectorEnv(make_model(board_task), 2)))
    envs.reset()
    rewards = []
    for action in OPTIMAL:
        _, reward, dones, infos = envs.step(np.array([action, action]))
        rewards.append(float(reward[0]))
    assert [True, True] == dones.tolist()
    assert len(OPTIMAL) == infos[0]["episode"]["l"]
    assert sum(rewards) == pytest.approx(infos[0]["episode"]["r"], abs=1e-5)


def test_step_limits_are_marked_as_such(board_task):
    envs = Sb3VecEnv(SkillVectorEnv(make_model(board_task), 1))
    envs.reset()
    for step in range(20):
        last, _, dones, infos = envs.step(np.array([13 - step % 2]))
    assert dones[0]
    assert (True, OUT_OF_TIME) == (infos[0]["TimeLimit.truncated"], infos[0]["end"])
    assert last[0].tolist() != infos[0]["terminal_observation"].tolist()


def test_episodes_begin_in_a_state_that_was_set_once():
    chain = CONFIGS / "swarmitfix_polygonal.yaml"
    envs = Sb3VecEnv(gymnasium.make_vec(NAME, num_envs=2, task=chain, part="base-1"))
    first = envs.reset()
    envs.set_options({"start": "C20"})
    assert first.tolist() != envs.reset().tolist()
    assert first.tolist() == envs.reset().tolist()
    envs.set_options([{"start": "C20"}, {"start": "C21"}])
    with pytest.raises(ValueError, match="must be equal"):
        envs.reset()
    envs.set_options({"strat": "C20"})
    with pytest.raises(OptionError, match="Did you mean 'start'"):
        envs.reset()


def test_images_are_tiled(board_task):
    envs = Sb3VecEnv(SkillVectorEnv(make_model(board_task), 2, render_mode="rgb_array"))
    envs.reset()
    assert (960, 640, 3) == envs.render().shape


def test_what_single_episodes_do_not_have_is_refused(board):
    with pytest.raises(AttributeError, match="no method 'state'; they have action_masks"):
        board.env_method("state")
    with pytest.raises(AttributeError, match="no attribute 'mask' of their own"):
        board.set_attr("mask", "none")
    assert [False, False] == board.env_is_wrapped(gymnasium.Wrapper)
    with pytest.raises(gymnasium.error.ResetNeeded, match="call step_async"):
        board.step_wait()


@pytest.mark.parametrize("indices", [5, [0, 2], -3])
def test_a_sub_environment_that_does_not_exist_is_refused(board, indices):
    uses = (
        partial(board.env_method, "action_masks"),
        partial(board.get_attr, "action_space"),
        partial(board.env_is_wrapped, gymnasium.Wrapper),
    )
    for use in uses:
        with pytest.raises(OptionError, match=r"the indices 0 to 1, not (5|2|-3)\."):
            use(indices=indices)
    (last,) = board.env_method("action_masks", indices=-1)
    assert last.tolist() == board.envs.action_masks()[1].tolist()


def test_nothing_goes_after_it_was_closed(board):
    board.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="make a new one"):
        board.reset()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="make a new one"):
        board.step(np.array([0, 0]))


def test_a_wrapper_of_gymnasium_is_refused_and_the_one_of_sb3_named(board_task):
    envs = RecordEpisodeStatistics(SkillVectorEnv(make_model(board_task), 2))
    message = r"such as RecordEpisodeStatistics: .* VecMonitor\(Sb3VecEnv\(envs\)\) records"
    with pytest.raises(TypeError, match=message):
        Sb3VecEnv(envs)


def test_other_environments_are_refused(board_task):
    with pytest.raises(TypeError, match=r"gymnasium\.make_vec returns, not a SkillEnv"):
        Sb3VecEnv(SkillEnv(make_model(board_task)))


def test_without_stable_baselines3_it_names_the_package(monkeypatch):
    monkeypatch.delitem(sys.modules, "skillplan.env.sb3_vec_env")
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    with pytest.raises(ModuleNotFoundError, match="pip install stable-baselines3"):
        importlib.import_module("skillplan.env.sb3_vec_env")
