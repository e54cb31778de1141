"""The arm of an engine waits for parts that arrive, and for feeders."""

from pathlib import Path

import pytest

from skillplan import load_problem
from skillplan_mujoco import MujocoEngine

CONFIG = Path(__file__).parents[3] / "configs/cell_arrivals.yaml"
SLOW = {"robot.travel_speed_m_per_s": "0.05", "feeders.nuts.cycle_s": "16"}


@pytest.mark.slow(reason="executes seven skills; costs with waits in every run")
def test_an_engine_waits_for_a_part_and_for_a_feeder():
    task = load_problem(CONFIG, changes={**SLOW, "parts.box.arrives_s": "[50, 0, 0]"}).task
    names = ["pick(board)", "place(board)", "pick(nut_1)", "place(nut_1)", "pick(nut_2)"]
    names += ["place(nut_2)", "pick(box_1)"]
    performance = MujocoEngine(task).perform([task.skill(name) for name in names])
    done = {entry.skill: entry for entry in performance.skills}
    assert all(entry.verdict.is_feasible for entry in done.values())
    cycle_s = done["pick(nut_2)"].end_s - done["pick(nut_1)"].end_s
    assert cycle_s == pytest.approx(16.0, abs=0.1)
    arrived = done["pick(box_1)"]
    assert arrived.begin_s + arrived.waited_s == pytest.approx(50.0, abs=0.05)
