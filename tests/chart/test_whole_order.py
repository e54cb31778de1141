"""An order of all parts of a task, or the parts that are in none."""

from __future__ import annotations

from typing import Any

from situations import assembly
from skillplan import Setup
from skillplan.chart import Order, find_order
from skillplan.model import SkillModel, replay
from skillplan.pipeline import make_feasibility
from skillplan.task import Task

BY_BOXES = Setup(collision=("aabb",))
ROOM_M = 0.02


def part(size_m: list[float], goal_m: list[float], **more: Any) -> dict[str, Any]:
    return {"tool": "cup", "size_m": size_m, "goal_m": goal_m, "grasp": {"type": "suction"}, **more}


def garage(apart_m: float = 0.08) -> Task:
    """Return the task of two roofs on posts, with a car below both of them.

    Parameters
    ----------
    apart_m
        Half of the distance between the centres of the roofs, which are 0.1 m wide [m].
    """
    posts = {
        f"post_{side}": part(
            [0.02, 0.3, ROOM_M + 0.01], [0.5 + x, 0.0, 0.0], start_m=[0.3 + x, -0.3]
        )
        for side, x in (("left", -0.1), ("right", 0.1))
    }
    roofs = {
        f"roof_{side}": part(
            [0.2, 0.1, 0.01],
            [0.5, y, ROOM_M + 0.01],
            start_m=[0.2, 2 * y + 0.2],
            goal_on=list(posts),
        )
        for side, y in (("front", -apart_m), ("back", apart_m))
    }
    return assembly(
        {
            "kind": "assembly",
            "name": "garage",
            "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.25},
            "tools": {"cup": {"type": "suction", "holder_m": [0.7, 0.3]}},
            "initial_tool": "cup",
            "parts": posts
            | roofs
            | {"car": part([0.05, 0.2, ROOM_M], [0.5, 0.0, 0.0], start_m=[0.6, -0.3])},
            "step_limit": 30,
        }
    )


def order_of(task: Task) -> Order:
    needs = dict.fromkeys(("roof_front", "roof_back"), ("post_left", "post_right"))
    roofs_first = ("post_left", "post_right", "roof_front", "roof_back", "car")
    return find_order(task, make_feasibility(task, BY_BOXES), roofs_first, needs)


def test_a_part_that_two_others_cover_goes_in_before_both():
    """Neither of them alone is to blame, so no exchange of two parts helps."""
    task = garage()
    order = order_of(task)
    assert order.ended
    assert not order.conflicts
    assert set(order.parts[-2:]) == {"roof_front", "roof_back"}
    plan = replay(SkillModel(make_feasibility(task, BY_BOXES)), order.skills)
    assert plan.feasible
    assert plan.complete


def test_of_parts_that_shut_each_other_out_only_one_is_left_out():
    """Roofs that overlap meet, whichever comes first."""
    order = order_of(garage(apart_m=0.03))
    (name,) = order.conflicts
    assert name in ("roof_front", "roof_back")
    assert set(order.conflicts[name].by) == {"roof_front", "roof_back"} - {name}
    assert set(order.parts) == {"post_left", "post_right", "car", *order.conflicts[name].by}
    assert order.ended
