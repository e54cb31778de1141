"""Feeders that need time for the next part, and that run empty."""

from __future__ import annotations

from itertools import accumulate, pairwise, permutations
from math import hypot

import pytest
import yaml

from skillplan import Setup, Status, load_problem, make_model, solve
from skillplan.errors import TaskError
from skillplan.model import replay

SPEED_M_PER_S, DWELL_S, CYCLE_S = 0.25, 0.5, 5.6
HOME, FEEDER = (0.35, 0.0), (0.5, -0.2)
GOALS = {"nut_1": (0.45, 0.05), "nut_2": (0.50, 0.05), "clip": (0.55, 0.1)}
CLIP = (0.4, -0.2)
PART = {"tool": "cup", "size_m": [0.02, 0.02, 0.01]}
CELL = {
    "kind": "assembly",
    "name": "cell",
    "robot": {"home_m": list(HOME), "safe_height_m": 0.2, "travel_speed_m_per_s": SPEED_M_PER_S},
    "cost": "time",
    "durations_s": {"pick": DWELL_S, "place": DWELL_S},
    "tools": {"cup": {"type": "suction", "holder_m": [0.25, 0.4]}},
    "initial_tool": "cup",
    "parts": {
        "nut": {
            **PART,
            "count": 2,
            "feeder": "nuts",
            "goal_m": list(GOALS["nut_1"]),
            "goal_pattern": {"grid": [2, 1], "pitch_m": [0.05, 0.1]},
        },
        "clip": {**PART, "start_m": list(CLIP), "goal_m": list(GOALS["clip"])},
    },
}


@pytest.fixture
def load(tmp_path):
    """Return the task of the cell with some keys of its feeder."""

    def of(**keys):
        path = tmp_path / "cell.yaml"
        feeder = {"position_m": list(FEEDER), "height_m": 0.02, **keys}
        path.write_text(yaml.safe_dump({**CELL, "feeders": {"nuts": feeder}}))
        return load_problem(path).task

    return of


def time_of(order):
    """Return the time of an order of the parts [s], by a clock."""
    now_s, here, last_s = 0.0, HOME, None
    for part in order:
        start = CLIP if part == "clip" else FEEDER
        now_s += hypot(start[0] - here[0], start[1] - here[1]) / SPEED_M_PER_S + DWELL_S
        if part != "clip":
            now_s = now_s if last_s is None else max(now_s, last_s + CYCLE_S)
            last_s = now_s
        here = GOALS[part]
        now_s += hypot(here[0] - start[0], here[1] - start[1]) / SPEED_M_PER_S + DWELL_S
    return now_s


def test_a_pick_waits_for_the_feeder_unless_other_work_fills_the_time(load):
    result = solve(load(cycle_s=CYCLE_S), setup=Setup(collision=("aabb",)))
    assert result.status is Status.OPTIMAL
    assert result.cost == pytest.approx(min(map(time_of, permutations(GOALS))))
    picks = [step.skill for step in result.steps if step.skill.startswith("pick")]
    assert picks[1] == "pick(clip)"


def test_the_wait_counts_in_times_of_trajectories(load):
    task = load(cycle_s=CYCLE_S)
    names = ["pick(nut_1)", "place(nut_1)", "pick(nut_2)", "place(nut_2)"]
    for setup in (Setup(collision=("aabb",)), Setup(collision=("swept",))):
        steps = replay(make_model(task, setup), [task.skill(name) for name in names]).steps
        ends_s = list(accumulate(step.duration_s for step in steps))
        takes_s = [end_s for name, end_s in zip(names, ends_s, strict=True) if "pick" in name]
        assert [b - a for a, b in pairwise(takes_s)] == pytest.approx([CYCLE_S])


def test_what_the_state_cannot_tell_is_refused_with_the_longest_cycle(load):
    with pytest.raises(TaskError, match=r"30 s is more than the .* give at most \d+"):
        load(cycle_s=30.0)


def test_a_feeder_runs_empty(load):
    with pytest.raises(TaskError, match="it holds 1, and 2 come from it"):
        load(capacity=1)
    assert load(capacity=2)
