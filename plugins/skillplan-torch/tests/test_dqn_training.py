"""Trainings of DQN by the command line: killed at random instants, they lose nothing."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from situations import two_roads_task
from skillplan.cli import main
from skillplan.env import COMPLETE, GOES_ON, INFEASIBLE, OUT_OF_TIME, SkillVectorEnv
from skillplan.errors import OptionError
from skillplan.pipeline import Setup, load_problem, make_model
from skillplan.task import DistanceReward
from skillplan.training import Trainer, TrainingFolder, plan_training
from skillplan_torch import RewardScaling
from thinned import release_case, slow_case
from training_situations import BOARD, learned_bytes

PATIENCE_S = 240
# The paper's DQN as the page about learning writes it out.
WRITTEN_OUT = (
    "observation=paper mask=none complete=10 failure=10 steps_worth=0.411489 step_floor=1000000 "
    "count_last_cost=false gamma=0.99 updates=1 epsilon=1 epsilon_end=0.05 explore_until=0.05 "
    "learning_rate_end=0.001 width=64 layers=2 capacity=20000"
)
OWN_OPTIONS = {
    "moller": "target_rate=0.005 warm_up=64 replay=distinct clip_values=true",
    "moller-strict": "target_rate=0.0005 warm_up=1 loss=squared limit_is_failure=true",
}


def command(folder: Path, runs: int, steps: int) -> list[str]:
    """Return the call that trains in a folder."""
    words = [sys.executable, "-m", "skillplan", "train", str(BOARD), "--solver", "dqn"]
    words += ["--runs", str(runs), "--steps", str(steps), "--checkpoint", "100"]
    return [*words, "--out", str(folder)]


def train(folder: Path, runs: int, steps: int, *more: str) -> int:
    """Train to the end, in this process; return 0, or 1 where no run completes the task."""
    words = [*command(folder, runs, steps)[3:], "--jobs", "1", *more]
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code in (0, 1)
    return int(ended.value.code)


def noted_bytes(folder: Path) -> int:
    """Return how much all runs have noted [bytes]."""
    return sum(path.stat().st_size for path in folder.glob("runs/*/metrics.jsonl"))


def checkpoints(folder: Path) -> dict[str, bytes]:
    """Return the checkpoints of all groups."""
    ordered = sorted(folder.glob("groups/*/checkpoint.safetensors"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in ordered}


def stopped_at(folder: Path, runs: int, steps: int, reports: int | None, **more: bool) -> None:
    """Train in a folder; stop after so many reports."""
    problem = load_problem(BOARD)
    setup = Setup(options={"dqn": {"width": 64, "batch": 32}})
    queries = {"runs": runs, "steps": steps, "checkpoint_steps": 100}
    plan = plan_training(problem, "dqn", setup, **queries)
    with TrainingFolder(str(folder), plan, problem, **more) as opened:
        trainer = Trainer(opened.plan, opened, jobs=1, time_limit_s=30.0)
        seen = []

        def on_report(report: object) -> None:
            seen.append(report)
            if len(seen) == reports:
                trainer.interrupt()

        trainer.on_report = on_report
        assert trainer.train().interrupted == (reports is not None)


@pytest.mark.slow(reason="three trainings; going on bit for bit in every run")
def test_a_stop_changes_nothing(tmp_path):
    """Metrics, policies and checkpoints are the same to the byte."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    stopped_at(whole, 2, 200, None)
    stopped_at(cut, 2, 200, 1)
    stopped_at(cut, 2, 200, None, resume=True)
    assert learned_bytes(cut) == learned_bytes(whole)
    assert len(checkpoints(cut)) == 2
    assert checkpoints(cut) == checkpoints(whole)


@pytest.mark.slow(reason="six trainings; another learner is extended in every run")
@pytest.mark.parametrize("solver", ["dqn", "ppo"])
def test_an_extended_training_is_the_one_that_was_asked_for_in_whole(tmp_path, solver):
    """Twice, beyond the end of its schedules: metrics, policies and checkpoints, to the byte."""
    for name, steps in (("whole", 700), ("grown", 300), ("grown", 400), ("grown", 700)):
        words = ["train", str(BOARD), "--solver", solver, "--runs", "2", "--steps", str(steps)]
        words += ["--checkpoint", "100", "--out", str(tmp_path / name), "-O", f"{solver}.width=64"]
        words += ["-O", f"{solver}.schedule_steps=300"] if name == "whole" else []
        words += ["--resume"] if name == "grown" and steps > 300 else []
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code in (0, 1)
    whole, grown = tmp_path / "whole", tmp_path / "grown"
    assert learned_bytes(whole) == learned_bytes(grown)
    assert checkpoints(whole) == checkpoints(grown)


def wait_for_end_of_group(group):
    """Wait until the killed processes have released the folder, at most five seconds."""
    for _ in range(100):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)


@pytest.mark.parametrize(
    ("runs", "steps", "kills"),
    [
        slow_case(
            2,
            600,
            1,
            reason="it loads torch again; a stop, and kills of another learner, in every run",
        ),
        release_case(6, 3_000, 20, reason="20 kills"),
    ],
)
def test_sigkill_at_random_instants_changes_nothing(tmp_path, runs, steps, kills):
    """Of the whole group: metrics, policies and checkpoints are the same to the byte."""
    whole, cut = tmp_path / "whole", tmp_path / "cut"
    code = train(whole, runs, steps)
    chance, done = random.Random(kills), 0
    for _ in range(kills):
        size, deadline_s = noted_bytes(cut), time.monotonic() + PATIENCE_S
        process = subprocess.Popen(
            [*command(cut, runs, steps), "--jobs", "2", "--resume"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            # Until it has noted something, or cut off what is beyond its checkpoint.
            while noted_bytes(cut) == size and process.poll() is None:
                assert time.monotonic() < deadline_s
                time.sleep(0.01)
            time.sleep(chance.uniform(0.0, 0.3))
            done += process.poll() is None
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            wait_for_end_of_group(process.pid)
    # The machine may be so fast that the last ones found it done.
    assert done >= kills // 2 + 1
    assert train(cut, runs, steps, "--resume") == code
    ours, theirs = learned_bytes(cut), learned_bytes(whole)
    assert sum("policy.safetensors" in name for name in ours) == runs
    assert ours == theirs
    assert len(checkpoints(cut)) == 2
    assert checkpoints(cut) == checkpoints(whole)


class TestPresets:
    def plan(self, preset, solver="dqn", steps=None, **options):
        setup = Setup(options={solver: options})
        return plan_training(load_problem(BOARD), solver, setup, steps=steps, preset=preset)

    @pytest.mark.parametrize("preset", OWN_OPTIONS)
    def test_a_preset_equals_the_options_written_out(self, preset):
        words = f"steps=20000 {WRITTEN_OUT} {OWN_OPTIONS[preset]}".split()
        options = dict(word.split("=") for word in words)
        assert self.plan(preset).options == self.plan(None, **options).options

    def test_options_and_steps_override_it(self):
        plan = self.plan("moller", steps=400, updates="2", replay="fifo")
        assert plan.options == {
            **self.plan("moller").options,
            "steps": 400,
            "updates": 2.0,
            "replay": "fifo",
        }

    @pytest.mark.parametrize(
        ("solver", "preset", "message"),
        [
            ("dqn", "mollr", "The solver 'dqn' has no preset 'mollr'. Did you mean 'moller'?"),
            ("ppo", "moller", "The solver 'ppo' has no preset 'moller'. It has no presets."),
        ],
    )
    def test_an_unknown_preset_is_refused(self, solver, preset, message):
        with pytest.raises(OptionError) as refused:
            self.plan(preset, solver)
        assert str(refused.value) == message

    def test_the_manifest_stores_the_options_so_that_resume_compares_them(self, tmp_path, capsys):
        assert train(tmp_path / "a", 1, 100, "--preset", "moller-strict") == 1
        manifest = json.loads((tmp_path / "a" / "manifest.json").read_text("utf-8"))
        assert manifest["options"] == self.plan("moller-strict", steps=100).options
        entries = f"{WRITTEN_OUT} {OWN_OPTIONS['moller-strict']}".split()
        same = [word for entry in entries for word in ("-O", entry)]
        assert train(tmp_path / "a", 1, 100, "--resume", *same) == 1
        with pytest.raises(SystemExit) as refused:
            main([*command(tmp_path / "a", 1, 100)[3:], "--resume", "--preset", "moller"])
        assert refused.value.code == 2
        assert "replay" in capsys.readouterr().err

    def test_plugins_lists_presets(self, capsys):
        with pytest.raises(SystemExit):
            main(["plugins", "solver", "dqn"])
        assert "--preset moller-strict" in capsys.readouterr().out


# What steps are paid apart from ends, against figures computed by hand.


@pytest.fixture(scope="module")
def board():
    """The inverter board: 10 for completing, -10 for failing, -0.1 a metre, -2.5 for tools."""
    return load_problem(BOARD).task


def walked(task, actions, objective="reward"):
    """Return rewards, costs and ends of actions from the start."""
    env = SkillVectorEnv(make_model(task), 1, mask="none", objective=objective)
    env.reset(seed=0)
    steps = []
    for action in actions:
        _, rewards, _, _, infos = env.step(np.array([action]))
        steps.append((rewards[0], infos["cost"][0], infos["end"][0]))
    return tuple(np.array(column) for column in zip(*steps, strict=True))


class TestOfTheBoard:
    OPTIMAL = (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)

    def test_every_step_of_the_optimal_sequence_pays_a_tenth_of_its_way(self, board):
        rewards, costs, ends = walked(board, self.OPTIMAL)
        assert ends.tolist() == [GOES_ON] * 14 + [COMPLETE]
        assert rewards[-1] == 10.0
        paid = RewardScaling.of(board, "reward", counts_last=True).of_steps(rewards, costs, ends)
        np.testing.assert_allclose(paid, -0.1 * costs, atol=1e-12)
        assert paid.sum() == pytest.approx(-0.186709, abs=1e-6)

    def test_as_table_ii_has_it_the_last_way_is_free(self, board):
        rewards, costs, ends = walked(board, self.OPTIMAL)
        paid = RewardScaling.of(board, "reward", counts_last=False).of_steps(rewards, costs, ends)
        assert paid[-1] == 0.0
        assert paid.sum() == pytest.approx(-0.1 * costs[:-1].sum())

    def test_a_skill_that_fails_pays_for_no_way(self, board):
        rewards, costs, ends = walked(board, [1])
        assert (rewards.tolist(), ends.tolist()) == ([-10.0], [INFEASIBLE])
        pay = RewardScaling.of(board, "reward", counts_last=True)
        assert pay.of_steps(rewards, costs, ends).tolist() == [0.0]

    def test_at_the_step_limit_the_last_way_counts_and_the_end_does_not(self, board):
        rewards, costs, ends = walked(replace(board, step_limit=2), [0, 1])
        assert rewards.tolist() == [pytest.approx(-0.1 * costs[0]), -10.0]
        assert ends.tolist() == [GOES_ON, OUT_OF_TIME]
        pay = RewardScaling.of(board, "reward", counts_last=False)
        np.testing.assert_allclose(pay.of_steps(rewards, costs, ends), -0.1 * costs)

    def test_a_tool_changed_again_pays_its_penalty(self, board):
        names = [skill.name for skill in board.skills]
        tools = [i for i, name in enumerate(names) if name.startswith("load")]
        others = [i for i in tools if "gripper" not in names[i]]
        rewards, costs, ends = walked(board, [others[0], (set(tools) - set(others)).pop()])
        assert ends.tolist() == [GOES_ON, GOES_ON]
        paid = RewardScaling.of(board, "reward", counts_last=True).of_steps(rewards, costs, ends)
        assert paid.tolist() == rewards.tolist()
        assert -2.5 in paid

    def test_by_cost_every_step_pays_its_cost(self, board):
        rewards, costs, ends = walked(board, self.OPTIMAL, "cost")
        for counts_last in (False, True):
            pay = RewardScaling.of(board, "cost", counts_last=counts_last)
            np.testing.assert_allclose(pay.of_steps(rewards, costs, ends), -costs, atol=1e-12)

    def test_a_typical_step_is_the_mean_of_all_skills_that_can_be_priced_at_the_start(self, board):
        priced = []
        for skill in board.skills:
            try:
                priced.append(skill.cost.at(board.initial))
            except ValueError:
                assert skill.name == "load(gripper)"
        assert len(priced) == 15
        pay = RewardScaling.of(board, "cost", counts_last=True)
        assert pay.typical == pytest.approx(sum(priced) / 15)


class TestOfOtherTasks:
    @pytest.mark.parametrize("objective", ["reward", "cost"])
    @pytest.mark.parametrize("counts_last", [False, True])
    def test_without_a_scheme_every_step_pays_its_cost(self, objective, counts_last):
        task = two_roads_task()
        pay = RewardScaling.of(task, objective, counts_last=counts_last)
        assert pay.typical == (1 + 1 + 3 + 1) / 4
        for limit, actions in ((20, [0, 1, 3]), (1, [2]), (2, [0, 1])):
            rewards, costs, ends = walked(replace(task, step_limit=limit), actions, objective)
            assert ends[-1] == (COMPLETE if limit == 20 else OUT_OF_TIME)
            np.testing.assert_allclose(pay.of_steps(rewards, costs, ends), -costs, atol=1e-12)

    @pytest.mark.parametrize(
        ("limit", "actions"), [(20, [0, 1, 3]), (1, [2]), (2, [0, 1])], ids=str
    )
    def test_where_distances_are_paid_no_step_gains(self, limit, actions):
        """Veeramani and Muthuswamy: a distance each step, 1 for completing."""
        task = two_roads_task(step_limit=limit)
        a, b = (int(task.facts.of(name).bits) for name in ("a", "b"))
        reward = DistanceReward({a: 2.0, b: 3.0, 0: 0.0}, complete=1.0, infeasible=-5.0)
        task = replace(task, reward=reward)
        rewards, costs, ends = walked(task, actions)
        paid = RewardScaling.of(task, "reward", counts_last=True).of_steps(rewards, costs, ends)
        # Of where a step starts, whatever it comes to.
        distances = {0: 0.0, 1: 2.0, 2: 0.0, 3: 3.0}
        assert paid.tolist() == [-distances[action] for action in actions]
