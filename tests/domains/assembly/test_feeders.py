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
from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.env import SkillEnv
from skillplan.errors import OptionError, TaskError
from skillplan.model import SkillModel, replay
from skillplan.testing import reachable_states

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


# Buffers: parts that are put down in between and taken again, perhaps by another grasp.


GRASPS = [{"closing_axis": "x"}, {"approach": [1, 0, 0], "closing_axis": "y"}]


def content_of(part=None, **sections):
    """Return an assembly of a peg and a plate, which may go into a buffer."""
    shared = {"tool": "hand", "size_m": [0.03, 0.03, 0.06]}
    return {
        "kind": "assembly",
        "name": "buffer",
        "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.2},
        "tools": {"hand": {"holder_m": [0.3, 0.4], "type": "gripper"}},
        "initial_tool": "hand",
        "buffers": {"bench": {"at_m": [0.5, 0.0]}},
        "parts": {
            "peg": {
                **shared,
                "grasp": GRASPS,
                "buffers": "bench",
                "start_m": [0.4, -0.2],
                "goal_m": [0.5, 0.2],
                **(part or {}),
            },
            "block": {**shared, "start_m": [0.6, -0.2], "goal_m": [0.6, 0.2]},
        },
        **sections,
    }


def config_of(*arguments, **sections):
    return AssemblyConfig.model_validate(content_of(*arguments, **sections))


def issues_of(*arguments, **sections):
    config = config_of(*arguments, **sections)
    return [(".".join(map(str, i.path)), i.message) for i in AssemblyDomain().issues(config)]


def task_of(*arguments, **sections):
    config = config_of(*arguments, **sections)
    assert list(AssemblyDomain().issues(config)) == []
    (task,) = AssemblyDomain().ground(config, "")
    return task


def test_a_part_is_picked_by_each_grasp_wherever_it_lies():
    names = {skill.name for skill in task_of().skills}
    assert {"pick(peg.top_x)", "pick(peg.-x_y)"} <= names
    assert {"pick(peg.bench.top_x)", "pick(peg.bench.-x_y)", "place(peg.bench)"} <= names
    assert {"place(peg)", "pick(block)", "place(block)"} <= names


def test_a_work_comes_before_a_part_with_buffers_as_before_any_other():
    tools = {
        "hand": {"holder_m": [0.3, 0.4], "type": "gripper"},
        "glue": {"holder_m": [0.4, 0.4], "type": "dispenser"},
    }
    bead = {"tool": "glue", "part": "block", "at_m": [0.6, 0.2], "before": ["peg"]}
    task = task_of(tools=tools, works={"bead": bead})
    assert "dispensed(bead)" in task.skill("place(peg)").precondition.requires


def test_the_state_tells_by_which_grasp_a_part_is_held():
    """The place then takes the visit of that grasp, and lets go of it."""
    task = task_of()
    pick, place = task.skill("pick(peg.-x_y)"), task.skill("place(peg)")
    held = pick.prediction.apply(task.initial)
    assert "grasp(peg.-x_y)" in held
    (visit,) = place.motion.visits(held)
    assert visit.grasp.approach == (1.0, 0.0, 0.0)
    assert "grasp(peg.-x_y)" not in place.prediction.apply(held)


def test_a_part_in_a_buffer_stands_there():
    task = task_of()
    state = task.initial
    for name in ("pick(peg.top_x)", "place(peg.bench)"):
        state = task.skill(name).prediction.apply(state)
    assert task.scene.at(state)["peg"].position == (0.5, 0.0, 0.0)


def test_a_buffer_holds_one_part_at_a_time():
    content = content_of()
    content["parts"]["block"]["buffers"] = "bench"
    config = AssemblyConfig.model_validate(content)
    (task,) = AssemblyDomain().ground(config, "")
    taken = task.facts.of("in_buffer(peg.bench)", "held(block)", "tool(hand)", "at(home)")
    assert not task.skill("place(block.bench)").applicable(taken)


def test_no_visit_to_a_buffer_is_made_without_need():
    result = solve(task_of(), setup=BOXES)
    assert result.status == "optimal"
    assert "place(peg.bench)" not in [step.skill for step in result.steps]


def test_only_parts_with_buffers_have_more_states():
    """The block has the same facts and states as in a file without buffers."""
    plain = content_of()
    del plain["buffers"]
    del plain["parts"]["peg"]["buffers"]
    (before,) = AssemblyDomain().ground(AssemblyConfig.model_validate(plain), "")
    both, single = ({f for f in t.facts.names if "block" in f} for t in (task_of(), before))
    assert both == single
    counts = [
        len(reachable_states(SkillModel(Feasibility(task)), 1000)) for task in (before, task_of())
    ]
    assert counts == [9, 19]


@pytest.mark.parametrize(
    ("part", "buffers", "path", "words"),
    [
        ({"buffers": "bank"}, None, "parts.peg.buffers.0", "unknown buffer 'bank'"),
        ({"buffers": ["bench", "bench"]}, None, "parts.peg.buffers.1", "stands twice"),
        ({}, {"bench": {"at_m": [2.0, 0.0]}}, "buffers.bench.at_m", "out of reach"),
        ({}, {"bench": {"at_m": [0.5, 0.0, 0.1]}}, "parts.peg.buffers.0", "floats 100.0 mm"),
        ({}, {"bench": {"at_m": [0.5, 0.0, -0.01]}}, "parts.peg.buffers.0", "10.0 mm deep"),
        ({"buffers": None}, None, "buffers.bench", "no part names 'bench'"),
    ],
)
def test_faults_of_buffers(part, buffers, path, words):
    sections = {} if buffers is None else {"buffers": buffers}
    found = issues_of(part, **sections)
    assert (path, True) in [(where, words in message) for where, message in found]


def test_auto_does_not_name_the_grasp_that_a_state_tells():
    with pytest.raises(ValueError, match="give a list of grasps"):
        config_of({"grasp": "auto"})
