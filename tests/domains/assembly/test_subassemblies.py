"""Sub-assemblies: parts that are put together, and then taken as one."""

from __future__ import annotations

import math
from copy import deepcopy

import pytest

from skillplan import Setup, solve
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.task import Box, Cylinder, Mesh, Pose, move_shape

BOXES = Setup(collision=("aabb",))
TOOLS = {
    "hand": {"holder_m": [0.3, 0.4], "type": "gripper", "opening_m": 0.08},
    "driver": {"holder_m": [0.2, 0.4], "type": "screwdriver"},
}
PARTS = {
    "base": {
        "size_m": [0.08, 0.05, 0.02],
        "mass_kg": 0.3,
        "start_m": [0.4, -0.3],
        "goal_m": [0.4, 0.2],
    },
    "cap": {
        "size_m": [0.04, 0.04, 0.03],
        "mass_kg": 0.1,
        "start_m": [0.5, -0.3],
        "goal_m": [0.41, 0.2],
        "goal_on": "base",
    },
    "unit": {"made_of": ["base", "cap", "bolt"], "goal_m": [0.5, 0.0]},
}
LID = {"size_m": [0.02, 0.02, 0.01], "start_m": [0.6, -0.3], "goal_m": [0.38, 0.2]}
BENCH = {"size_m": [0.1, 0.1, 0.02], "at_m": [0.4, 0.2]}
TURNTABLE = {
    "pivot_m": [0.4, 0.2, 0.0],
    "orientations": {"front": {}, "back": {"rpy_rad": [0, 0, 3.14159265]}},
    "fixtures": ["bench"],
}
SCREWS = {"bolt": {"tool": "driver", "hole_m": [0.41, 0.2], "through": "cap", "mass_kg": 0.01}}


def content_of(changes=None, **sections):
    """Return a cap on a base, which move on as one unit."""
    content = {
        "kind": "assembly",
        "name": "unit",
        "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.2},
        "tools": TOOLS,
        "initial_tool": "hand",
        "parts": {
            name: {"tool": "hand", "grasp": {"closing_axis": "y"}, **part}
            for name, part in PARTS.items()
        },
        "screws": SCREWS,
        **sections,
    }
    content = deepcopy(content)
    for name, change in (changes or {}).items():
        content["parts"].setdefault(name, {"tool": "hand"}).update(change)
    return content


def task_of(**sections):
    config = AssemblyConfig.model_validate(content_of(**sections))
    assert list(AssemblyDomain().issues(config)) == []
    (task,) = AssemblyDomain().ground(config, "")
    return task


def plan_of(task):
    result = solve(task, setup=BOXES)
    assert result.status == "optimal"
    assert sum("keep together" in sentence for sentence in result.not_checked) == 1
    return [step.skill for step in result.steps]


def test_members_are_placed_and_fastened_before_the_unit_is_picked_and_placed():
    task = task_of()
    names = plan_of(task)
    assert names.index("fasten(bolt)") < names.index("join(unit)") < names.index("pick(unit)")
    assert names[-1] == "place(unit)"


def test_joining_swaps_the_members_for_one_body_where_they_are():
    task = task_of()
    state = task.initial
    for name in plan_of(task)[:-2]:
        state = task.skill(name).prediction.apply(state)
        assert ("unit" in task.scene.at(state)) == ("apart(unit)" not in state)
    assert set(task.scene.at(state)) == {"unit"}
    assert task.scene.at(state)["unit"].position == pytest.approx((0.4, 0.2, 0.0))
    unit = task.scene.body("unit")
    assert unit.mass_kg == pytest.approx(0.41)
    assert [shape.box.centre[2] for shape in unit.shapes] == pytest.approx([0.01, 0.035, 0.051])


def test_what_stands_on_the_unit_rests_on_its_shape():
    lid = {
        "size_m": [0.02, 0.02, 0.01],
        "start_m": [0.6, -0.3],
        "goal_m": [0.47, 0.0],
        "goal_on": "unit",
    }
    task = task_of(changes={"lid": lid})
    (placed,) = (p for p in task.scene.body("lid").placements if p.fact == "placed(lid)")
    assert placed.pose.position[2] == pytest.approx(0.02)


def test_a_unit_may_be_part_of_another():
    plate = {
        "size_m": [0.1, 0.07, 0.01],
        "start_m": [0.6, 0.3],
        "goal_m": [0.5, 0.0],
        "mass_kg": 0.2,
    }
    whole = {"made_of": ["plate", "unit"], "goal_m": [0.3, -0.3], "grasp": {"at_m": [0.01, 0.0]}}
    changes = {"plate": plate, "unit": {"goal_on": "plate"}, "whole": whole}
    task = task_of(changes=changes)
    assert task.scene.body("whole").mass_kg == pytest.approx(0.61)
    names = plan_of(task)
    assert names.index("place(unit)") < names.index("join(whole)") < names.index("place(whole)")


@pytest.mark.parametrize(
    ("changes", "sections", "where", "words"),
    [
        ({"unit": {"made_of": ["base", "cup"]}}, {}, "parts.unit.made_of.1", "Did you mean 'cap'?"),
        ({"unit": {"made_of": ["base", "base"]}}, {}, "parts.unit.made_of.1", "twice"),
        (
            {"unit": {"made_of": ["cap", "bolt"]}, "base": {"goal_on": "unit"}},
            {},
            "parts.unit",
            "itself",
        ),
        ({"unit": {"made_of": ["base", "bolt"]}}, {}, "parts.unit.made_of.1", "not part of 'unit'"),
        ({"cap": {"optional": True}}, {}, "parts.unit.made_of.1", "optional"),
        ({"lid": {**LID, "goal_on": "base"}}, {}, "parts.lid.goal_on.0", "goes away with 'unit'"),
        ({}, {"family": {"start_shift_m": 0.01}}, "family", "sub-assemblies"),
        (
            {"unit": {"made_of": ["base", "cap"]}},
            {},
            "screws.bolt.through",
            "'cap' goes away with 'unit': name 'bolt' in its 'made_of'.",
        ),
        (
            {"lid": {**LID, "fits": {"base": {"kind": "clearance", "drawn_m": 1e-4}}}},
            {},
            "parts.lid.fits.base",
            "'base' goes away with 'unit'. Name that.",
        ),
        (
            {"base": {"goal_on": "bench"}},
            {"fixtures": {"bench": BENCH}, "workholders": {"table": TURNTABLE}},
            "parts.base.goal_m",
            "which turns. Put 'unit' together on a body that stands.",
        ),
    ],
)
def test_a_fault_names_the_member_and_what_is_wrong(changes, sections, where, words):
    config = AssemblyConfig.model_validate(content_of(changes, **sections))
    found = [(".".join(map(str, i.path)), i.message) for i in AssemblyDomain().issues(config)]
    assert any(path.startswith(where) and words in message for path, message in found), found


@pytest.mark.parametrize("key", ["size_m", "mass_kg", "start_m"])
def test_shape_mass_and_start_of_a_unit_are_not_given(key):
    value = {"size_m": [0.1, 0.1, 0.1], "mass_kg": 1.0, "start_m": [0.1, 0.1]}[key]
    with pytest.raises(ValueError, match="its members give it"):
        AssemblyConfig.model_validate(content_of({"unit": {key: value}}))


@pytest.mark.parametrize(
    "shape", [Box((0.1, 0.2, 0.3), (0.01, 0.02, 0.03)), Cylinder(0.1, 0.3, (0.01, 0.02, 0.03))]
)
@pytest.mark.parametrize("rpy_rad", [(0, 0, math.pi / 2), (math.pi, 0, 0), (0.3, 0.2, 0.1)])
def test_a_moved_shape_reaches_as_far_as_before(shape, rpy_rad):
    """Along every axis; the polygon of a leaning cylinder misses 0.2 % of its radius."""
    pose = Pose.turned((0.1, -0.2, 0.3), rpy_rad)
    moved = move_shape(shape, pose)
    assert isinstance(moved, Mesh) == (rpy_rad == (0.3, 0.2, 0.1))
    for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1)):
        away_m = shape.reach_m(pose.inverse().rotate(axis))
        expected_m = away_m + sum(a * p for a, p in zip(axis, pose.position, strict=True))
        assert moved.reach_m(axis) == pytest.approx(expected_m, abs=1e-4)
