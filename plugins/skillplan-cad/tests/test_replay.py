"""A plan is taken apart again with solids, and a wrong one is told with step, pair and place."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cad_fixtures import box, part_of, relation_by_hand
from skillplan_cad import Planner, Product, replay

L_TUNNEL = box(0, 0, 0, 40, 40, 12) - box(5, 5, 3, 35, 15, 9) - box(25, 5, 3, 35, 40, 9)
BOTH = {"body": "key", "key": "body"}


@pytest.fixture(scope="module")
def keyed():
    solids = {"body": L_TUNNEL, "key": box(6, 6, 3, 14, 14, 9), "lid": box(0, 0, 12, 40, 40, 14)}
    blocked = {"+x": BOTH, "+y": BOTH, "+z": {"body": "key lid", "key": "body lid"}}
    product = Product("keyed", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    relation = relation_by_hand(solids, blocked, ["body key", "body lid"])
    return product, relation, Planner(product, relation).plan()


def test_a_plan_with_a_path_round_a_corner_stands(keyed):
    plan = replay(*keyed)
    assert plan.agrees
    assert plan.samples > 40


def test_a_step_in_a_wrong_direction_is_told_with_the_pair_and_the_place(keyed):
    product, relation, plan = keyed
    number = [step.parts for step in plan.steps].index(("lid",))
    wrong = replace(plan.steps[number], along=(0.0, 0.0, 1.0))
    steps = (*plan.steps[:number], wrong, *plan.steps[number + 1 :])
    result = replay(product, relation, replace(plan, steps=steps))
    fault = result.faults[0]
    assert not result.agrees
    assert (fault.step, fault.part, fault.by) == (number, "lid", "body")
    assert 0.0 < fault.point_m[2] < 0.0121


def test_a_part_that_comes_too_early_is_told(keyed):
    product, relation, plan = keyed
    straight = replace(plan.steps[0], path=())
    result = replay(product, relation, replace(plan, steps=(straight, *plan.steps[1:])))
    assert {(fault.part, fault.by) for fault in result.faults} == {("key", "body")}


def test_a_lid_before_what_lies_beneath_it_is_a_wrong_order():
    """The block would have to come through the lid."""
    solids = {
        "tray": box(0, 0, 0, 40, 40, 12) - box(5, 5, 3, 35, 35, 12),
        "block": box(10, 10, 3, 30, 30, 12),
        "lid": box(0, 0, 12, 40, 40, 14),
    }
    across = {"tray": "block", "block": "tray"}
    blocked = {"+x": across, "+y": across, "+z": {"tray": "block lid", "block": "lid"}}
    product = Product("box", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    relation = relation_by_hand(solids, blocked, ["tray block", "tray lid"])
    plan = Planner(product, relation).plan("tray")
    assert [step.parts for step in plan.steps] == [("block",), ("lid",)]
    assert replay(product, relation, plan).agrees
    result = replay(product, relation, replace(plan, steps=plan.steps[::-1]))
    assert {(fault.step, fault.part, fault.by) for fault in result.faults} == {(1, "block", "lid")}
