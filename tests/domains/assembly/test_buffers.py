"""Buffers: parts that are put down in between and taken again, perhaps by another grasp."""

from __future__ import annotations

import pytest

from skillplan import Setup, solve
from skillplan.checks import Feasibility
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.model import SkillModel
from skillplan.testing import reachable_states

BOXES = Setup(collision=("aabb",))
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
