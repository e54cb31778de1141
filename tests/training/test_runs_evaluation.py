"""Stored policies on their task: every run for itself, whatever has become of the others."""

from __future__ import annotations

from pathlib import Path

import pytest

from run_folders import HOPELESS, OPTIMAL, SWITCHED, changed, problem_of, write_runs
from skillplan.errors import OptionError
from skillplan.pipeline import Setup, load_problem, make_model
from skillplan.records import Optimum, RunFolder, RunStatus, Sampling, Tally, TrainingResult
from skillplan.training import RunsEvaluation, check_same_task

CONFIGS = Path(__file__).parents[2] / "configs"
BOARD = str(CONFIGS / "inverter_board.yaml")
DRAWN = Sampling(40, 0.01, 0)


def evaluated(path: Path, task_file: str = BOARD, drawn: Sampling = DRAWN) -> TrainingResult:
    task = problem_of(task_file, Path(task_file).read_bytes()).task
    evaluation = RunsEvaluation(RunFolder(path), task, drawn, changed_task=task_file != BOARD)
    return evaluation.evaluate(make_model(task), Setup(), Optimum(1.8670860141568904))


def test_every_run_is_followed_greedily_and_by_chance(tmp_path):
    result = evaluated(write_runs(tmp_path / "runs", BOARD, [OPTIMAL, SWITCHED, HOPELESS]))
    assert [RunStatus.COMPLETE, RunStatus.COMPLETE, RunStatus.INCOMPLETE] == [
        outcome.status for outcome in result.outcomes
    ]
    assert [0.0, pytest.approx(0.00698, abs=1e-5)] == result.deviations
    assert [Tally(40, 40), Tally(40, 40)] == [item.sampled for item in result.outcomes[:2]]
    assert (2, 120) == (result.completed, result.success.episodes)
    assert ["best", "best", "last"] == [
        entry.greedy.kept for entry in result.outcomes if entry.greedy
    ]


def test_success_is_greedy_and_by_the_policies_own_rule(tmp_path):
    """Epsilon-greedy with the final epsilon of the options, unless a temperature is requested."""
    path = write_runs(tmp_path / "runs", BOARD, [OPTIMAL, HOPELESS], epsilon_end=0.5)
    own = evaluated(path, drawn=Sampling(40, None, 0))
    assert ("epsilon-greedy", 0.5) == (own.sampling.rule.kind, own.sampling.rule.value)
    assert [Tally(1, 1), Tally(0, 1)] == [item.greedy_tally for item in own.outcomes]
    assert 0 < own.outcomes[0].sampled.successes < 40
    assert Tally(1, 2) == own.greedy_success
    document = own.document()
    assert (0.5, 0.5, None) == (
        document["greedy_success_rate"],
        document["sampling"]["epsilon"],
        document["sampling"]["temperature"],
    )
    assert "temperature 0.01" == evaluated(path).sampling.rule.words


def test_under_chance_greedy_success_is_of_as_many_roll_outs(tmp_path):
    grasps = str(CONFIGS / "inverter_grasps.yaml")
    path = write_runs(tmp_path / "runs", grasps, [OPTIMAL])
    (item,) = evaluated(path, grasps, Sampling(30, None, 0)).outcomes
    assert 30 == item.greedy_tally.episodes == item.sampled.episodes


def test_a_run_does_not_depend_on_those_beside_it(tmp_path):
    drawn = Sampling(60, 0.4, 3)
    alone = evaluated(write_runs(tmp_path / "one", BOARD, [OPTIMAL]), drawn=drawn)
    beside = evaluated(write_runs(tmp_path / "three", BOARD, [OPTIMAL] * 3), drawn=drawn)
    assert alone.outcomes[0] == beside.outcomes[0]
    tallies = [outcome.sampled.successes for outcome in beside.outcomes if outcome.sampled]
    assert len(set(tallies)) > 1


def test_best_and_last_are_both_followed(tmp_path):
    """The run stands for the best."""
    path = write_runs(tmp_path / "runs", BOARD, [OPTIMAL])
    other = write_runs(tmp_path / "other", BOARD, [SWITCHED])
    for suffix in (".json", ".safetensors"):
        (other / "runs/00/last").with_suffix(suffix).replace(
            (path / "runs/00/last").with_suffix(suffix)
        )
    (item,) = evaluated(path).outcomes
    assert item.best is not None
    assert item.last is not None
    assert OPTIMAL == ",".join(map(str, item.best.actions))
    assert SWITCHED == ",".join(map(str, item.last.actions))
    assert item.greedy is item.best


def test_chance_gets_as_many_episodes_as_all_runs_and_the_same_mask(tmp_path):
    base = evaluated(write_runs(tmp_path / "runs", BOARD, [OPTIMAL] * 3, mask="none")).baseline
    assert base is not None
    assert (Tally(0, 120), "none") == (base.tally, base.mask)


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda run: (run / "policy.json").write_text("{"), "policy.json: is damaged"),
        (lambda run: (run / "policy.safetensors").unlink(), "policy.safetensors: cannot be read"),
        (lambda run: (run / "policy.safetensors").write_bytes(b"x"), "is damaged"),
        (lambda run: (run / "metrics.jsonl").write_text("{}\n"), "metrics.jsonl:1: is damaged"),
        (
            lambda run: changed(run / "policy.json", "schema", to="skillplan.network-policy/9"),
            "another version",
        ),
        (
            lambda run: changed(run / "policy.json", "task", "sha256", to="0" * 64),
            "learned on another task, inverter-board",
        ),
        (
            lambda run: changed(run / "last.json", "actions", 0, to="pick(nothing)"),
            "learned on other actions: pick(nothing) where the task has pick(pcb)",
        ),
        (
            lambda run: changed(run / "policy.json", "mask", to="no-such-mask"),
            "learned with another mask than manifest.json has",
        ),
        (
            lambda run: [(run / f"policy.{end}").unlink() for end in ("json", "safetensors")],
            "its policy.json is missing",
        ),
    ],
)
def test_a_run_that_cannot_be_read_is_named_and_the_others_are_shown(tmp_path, break_it, message):
    path = write_runs(tmp_path / "runs", BOARD, [OPTIMAL, OPTIMAL])
    break_it(path / "runs" / "00")
    broken, sound = evaluated(path).outcomes
    assert RunStatus.FAILED is broken.status
    assert message in broken.reason
    assert broken.tally.rate is None
    assert (RunStatus.COMPLETE, Tally(40, 40)) == (sound.status, sound.sampled)


def test_a_run_whose_training_was_cut_off_says_how_to_go_on(tmp_path):
    result = evaluated(write_runs(tmp_path / "runs", BOARD, [OPTIMAL, None], done=2_000))
    assert "it has no policy yet: its training was cut off; train --resume goes on" == (
        result.outcomes[1].reason
    )
    assert result.interrupted


def test_another_task_is_named_by_what_has_changed(tmp_path):
    folder = RunFolder(write_runs(tmp_path / "runs", BOARD, [OPTIMAL]))
    check_same_task(folder, load_problem(BOARD))
    with pytest.raises(OptionError) as message:
        check_same_task(folder, load_problem(BOARD, changes={"parts.pcb.mass_kg": "0.2"}))
    assert "parts.pcb.mass_kg: 0.12 there, 0.2 now" in str(message.value)
    assert "--changed-task" in str(message.value)


def test_on_a_task_with_other_skills_no_policy_can_act(tmp_path):
    path = write_runs(tmp_path / "runs", BOARD, [OPTIMAL])
    with pytest.raises(OptionError, match=r"can act on motor-drive: it was learned on other"):
        evaluated(path, str(CONFIGS / "motor_drive.yaml"))
