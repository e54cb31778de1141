"""What nobody chooses is chosen by the task, and said."""

from __future__ import annotations

import pytest

from skillplan.cli import main
from skillplan.pipeline import load_problem
from skillplan.solvers import usual_steps
from skillplan.training import plan_training
from training_situations import BOARD

CONFIGS = BOARD.parent


def steps_of(*names: str, factor: float = 1.0) -> int:
    """Return how long a training on configs usually is."""
    return usual_steps([load_problem(CONFIGS / f"{name}.yaml").task for name in names], factor)


class TestLength:
    def test_it_grows_with_the_pairs_of_skills(self):
        assert [5_000, 10_000, 24_000] == [
            steps_of(name) for name in ("inverter_board", "battery_module", "motor_drive")
        ]

    def test_chance_and_families_take_longer(self):
        assert steps_of("inverter_grasps") == steps_of("inverter_board", "inverter_board")
        assert steps_of("inverter_grasps") >= 8 * steps_of("inverter_board")

    def test_it_is_never_too_short_to_learn_anything(self):
        assert 2_000 == steps_of("drawer_module") == steps_of("drawer_module", factor=0.001)


class TestPlan:
    def test_what_is_given_is_not_derived(self, learner):
        plan = plan_training(load_problem(BOARD), learner, steps=300)
        assert {"horizon": 20} == plan.derived

    def test_what_is_derived_stands_among_the_options(self, learner):
        plan = plan_training(load_problem(BOARD), learner)
        assert {"steps": 5_000, "horizon": 20} == plan.derived
        assert 5_000 == plan.options["steps"] == plan.steps
        assert not plan.steps_said


def test_a_training_says_what_was_derived(learner, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["train", str(BOARD), "--solver", learner, "--runs", "1", "--out", f"{tmp_path}/a"])
    message = capsys.readouterr().err.splitlines()
    assert "derived from the task: steps 5,000, horizon 20" in message
