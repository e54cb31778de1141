"""Parts that arrive at a time, and feeders that need time for the next part or run empty."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate, pairwise, permutations
from math import hypot

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from skillplan import Setup, Status, load_problem, make_model, solve
from skillplan.env import SkillEnv
from skillplan.errors import OptionError, TaskError
from skillplan.model import replay

SPEED_M_PER_S, DWELL_S, CYCLE_S = 0.25, 0.5, 5.6
HOME, FEEDER = (0.35, 0.0), (0.5, -0.2)
GOALS = {"nut_1": (0.45, 0.05), "nut_2": (0.50, 0.05), "clip": (0.55, 0.1)}
CLIP = (0.4, -0.2)
NONE_ARRIVES = dict.fromkeys(GOALS, 0.0)
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


BOXES = Setup(collision=("aabb",))


@pytest.fixture
def load(tmp_path):
    """Return the task of the cell with some keys of its feeder."""

    def of(**keys):
        path = tmp_path / "cell.yaml"
        feeder = {"position_m": list(FEEDER), "height_m": 0.02, **keys}
        path.write_text(yaml.safe_dump({**CELL, "feeders": {"nuts": feeder}}))
        return load_problem(path).task

    return of


@pytest.fixture(scope="module")
def belt(tmp_path_factory):
    """Return the task of the cell with changed values; its feeder has no cycle."""
    path = tmp_path_factory.mktemp("belt") / "cell.yaml"
    feeder = {"position_m": list(FEEDER), "height_m": 0.02}
    path.write_text(yaml.safe_dump({**CELL, "feeders": {"nuts": feeder}}))

    def of(**changes):
        named = {key.replace("__", "."): str(value) for key, value in changes.items()}
        return load_problem(path, changes=named).task

    return of


def time_of(order, cycle_s=CYCLE_S, arrives_s=NONE_ARRIVES):
    """Return the time of an order of the parts [s], by a clock."""
    now_s, here, last_s = 0.0, HOME, None
    for part in order:
        start = CLIP if part == "clip" else FEEDER
        now_s = max(now_s, arrives_s[part])
        now_s += hypot(start[0] - here[0], start[1] - here[1]) / SPEED_M_PER_S + DWELL_S
        if part != "clip":
            now_s = now_s if last_s is None else max(now_s, last_s + cycle_s)
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


def test_a_cup_on_another_hand_waits_for_the_feeder(belt):
    cup = {"type": "suction", "mounted_on": "hand", "mass_kg": 0.1, "length_m": 0.12}
    task = belt(
        tools__hand={"holder_m": [0.25, 0.4]},
        tools__cup={**cup, "mount_m": [0.0, 0.08, 0.0]},
        initial_tool="hand",
        feeders__nuts__cycle_s=CYCLE_S,
    )
    assert solve(task, setup=BOXES).cost == pytest.approx(min(map(time_of, permutations(GOALS))))


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


def length_of(order):
    """Return the path of an order of the parts [m]."""
    length_m, here = 0.0, HOME
    for part in order:
        for place in (CLIP if part == "clip" else FEEDER, GOALS[part]):
            length_m += hypot(place[0] - here[0], place[1] - here[1])
            here = place
    return length_m


@settings(max_examples=6, deadline=None)
@given(times=st.lists(st.floats(0, 25), min_size=3, max_size=3), per_m=st.floats(0, 20))
def test_the_least_cost_contains_the_waits_for_parts_that_arrive(belt, times, per_m):
    """Of time alone, and of time with a path: as the best order has by a clock."""
    arrives_s = dict(zip(GOALS, times, strict=True))
    orders = list(permutations(GOALS))
    times_s = [time_of(order, cycle_s=0.0, arrives_s=arrives_s) for order in orders]
    given = {"parts__nut__arrives_s": times[:2], "parts__clip__arrives_s": times[2]}
    weights = {"unit": "ct", "per_m": per_m, "per_s": 0.5}
    sums = [per_m * length_of(o) + 0.5 * t for o, t in zip(orders, times_s, strict=True)]
    for cost, optimum in (("time", min(times_s)), (weights, min(sums))):
        result = solve(belt(**given, cost=cost), setup=BOXES)
        assert result.status is Status.OPTIMAL
        assert result.cost == pytest.approx(optimum)


def test_a_late_part_with_a_slow_tool_does_not_hide_the_best_order(belt):
    tools = {
        "tools__slow": {"type": "suction", "holder_m": [0.25, 0.3], "durations_s": {"pick": 60}}
    }
    late = {"parts__clip__arrives_s": 4.0}
    alone = solve(belt(**late), setup=BOXES)
    both = solve(belt(**tools, **late, parts__clip__tool=["slow", "cup"]), "exact", setup=BOXES)
    assert (both.status, both.cost) == (Status.OPTIMAL, pytest.approx(alone.cost))


def test_a_late_part_that_another_one_replaces_does_not_hide_the_best_order(belt):
    spare = {**PART, "start_m": [0.6, -0.3], "goal_m": [0.6, 0.2], "interchangeable": "clip"}
    same = {
        "parts__clip__interchangeable": "clip",
        "goal": ["placed(spare)", "placed(nut_1)"],
        "holders__fork": {"kind": "hold", "parts": "nut_1"},
    }
    early, late = (belt(parts__spare={**spare, "arrives_s": s}, **same) for s in (0.0, 100.0))
    least = solve(early, "exact", setup=BOXES).cost
    briefly = replace(BOXES, options={"exact": {"max_labels": 1}})
    assert solve(late, "exact", setup=BOXES).cost == pytest.approx(least)
    assert solve(late, "exact", setup=briefly).lower_bound <= least


def test_waits_do_not_change_a_path_but_the_time_of_its_plan(belt):
    times = {"nut_1": 30.0, "nut_2": 0.0, "clip": 0.0}
    task = belt(parts__nut__arrives_s=[30.0, 0.0], cost="distance")
    result = solve(task, setup=BOXES)
    assert result.cost == pytest.approx(min(map(length_of, permutations(GOALS))))
    order = [step.skill[6:-1] for step in result.steps if step.skill.startswith("place")]
    assert result.makespan_s == pytest.approx(time_of(order, cycle_s=0.0, arrives_s=times))
    waits_s = {step.skill: step.wait_s for step in result.steps if step.wait_s}
    assert waits_s.keys() == {"pick(nut_1)"}


def test_what_cannot_count_waits_refuses_them(belt):
    task = belt(parts__clip__arrives_s=30.0)
    for solver in ("portfolio", "value-iteration", "exhaustive"):
        assert "take exact" in solve(task, solver, setup=BOXES).reason
    with pytest.raises(OptionError, match="Take cost: distance"):
        SkillEnv(make_model(task, BOXES))


def test_times_of_arrival_that_decide_nothing_are_faults(belt):
    with pytest.raises(TaskError, match="grasp of 'nut_1' may fail"):
        belt(parts__clip__arrives_s=3.0, parts__nut__grasp_failure=0.1)
    with pytest.raises(TaskError, match="2 parts"):
        belt(parts__nut__arrives_s=[3.0])
    with pytest.raises(TaskError, match="has 'cycle_s'"):
        belt(parts__nut__arrives_s=[3.0, 4.0], feeders__nuts__cycle_s=CYCLE_S)
