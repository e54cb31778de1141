"""A plan names its base and why, goes by paths where no line is free, and says what is stuck."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import skillplan_cad as cad
from cad_fixtures import box, part_of, relation_by_hand

TUNNEL = box(0, 0, 0, 40, 40, 12) - box(5, 5, 3, 35, 15, 9)
BOTH = {"body": "key", "key": "body"}


def keyed(body, lid=True):
    """Return a key in a tunnel of a body, with a lid on top of the body."""
    solids = {"body": body, "key": box(6, 6, 3, 14, 14, 9)}
    blocked = {"+x": BOTH, "+y": BOTH, "+z": BOTH}
    touches = ["body key"]
    if lid:
        solids["lid"] = box(0, 0, 12, 40, 40, 14)
        blocked["+z"] = {"body": "key lid", "key": "body lid"}
        touches.append("body lid")
    product = cad.Product("keyed", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    masses = {part.name: part.mass_kg for part in product}
    return product, relation_by_hand(solids, blocked, touches, masses)


def test_a_part_comes_by_the_path_that_was_found_once_what_is_in_its_way_is_absent():
    product, relation = keyed(TUNNEL - box(25, 5, 3, 35, 40, 9))
    plan = cad.Planner(product, relation).plan()
    assert (plan.base, plan.complete, plan.cheapest) == ("body", True, True)
    assert "% of the mass and touches 2 of the 2 other parts" in plan.why_base
    steps = {step.parts: step for step in plan.steps}
    assert list(steps) == [("key",), ("lid",)]
    key, lid = steps.values()
    assert np.allclose(key.along, (0, -1, 0))
    assert len(key.path) == 2
    assert (lid.along, lid.path) == ((0.0, 0.0, -1.0), ())


def test_what_is_stuck_is_named_with_the_word_and_with_what_is_in_its_way():
    product, relation = keyed(TUNNEL, lid=False)
    plan = cad.Planner(product, relation, budget=40).plan()
    (stuck,) = plan.stuck
    assert (stuck.part, stuck.among) == ("key", ("body",))
    assert stuck.search.outcome in ("closed", "budget spent")
    assert [met.part for met in stuck.search.in_the_way] == ["body"]
    assert not plan.complete
    marked = cad.add_groups(relation, plan)
    assert marked.stuck == ("key",)
    assert marked.groups == (("body", "key"),)


def test_without_a_stuck_part_the_others_come_together():
    """Body and key leave the lid as one, and the smaller one cannot leave the other."""
    product, relation = keyed(TUNNEL)
    plan = cad.Planner(product, relation, budget=40).plan("lid")
    assert plan.withdrawn == ("key",)
    assert [step.parts for step in plan.steps] == [("body",)]
    assert [stuck.part for stuck in plan.stuck] == ["key"]
    reason = cad.list_stuck(plan, relation)["key"]
    assert (reason.kind, reason.by) == ("stuck", ("body",))


def test_a_plate_that_locks_several_pins_is_left_out_rather_than_the_pins():
    """They leave the base as one; each headed pin is caught in the heavier plate."""
    heads = [box(x, 4, 4, x + 4, 8, 8) + box(x + 1, 5, 2, x + 3, 7, 4) for x in (4, 14, 24)]
    pins = {
        name: pin + box(*at)
        for name, pin, at in zip(
            "abc", heads, [(x, 4, 0, x + 4, 8, 2) for x in (4, 14, 24)], strict=True
        )
    }
    plate = box(0, 0, 2, 32, 12, 4)
    for x in (4, 14, 24):
        plate -= box(x + 1, 5, 2, x + 3, 7, 4)
    solids = {"base": box(0, 0, -20, 32, 12, 0), "plate": plate, **pins}
    caught = {"plate": "a b c", "a": "plate", "b": "plate", "c": "plate"}
    blocked = {"+x": caught, "+y": caught, "+z": {**caught, "base": "plate a b c"}}
    touches = ["base a", "base b", "base c", "plate a", "plate b", "plate c"]
    masses = {"base": 1.0, "plate": 0.1, "a": 0.01, "b": 0.01, "c": 0.01}
    product = cad.Product("caught", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    relation = relation_by_hand(solids, blocked, touches, masses)
    plan = cad.Planner(product, relation, budget=40).plan("base")
    assert plan.withdrawn == ("plate",)
    assert {name for step in plan.steps for name in step.parts} == {"a", "b", "c"}


def test_of_parts_that_overlap_those_are_left_out_that_bear_few_others():
    """Two clips are drawn inside a frame that bears three blocks; one clip also locks a block."""
    solids = {
        "base": box(0, 0, -20, 60, 20, 0),
        "frame": box(0, 0, 0, 60, 20, 10),
        "clip": box(50, 5, 5, 65, 15, 14),
        "hook": box(-5, 5, 5, 10, 15, 14),
        **{name: box(x, 5, 10, x + 8, 15, 18) for name, x in zip("abc", (12, 24, 36), strict=True)},
    }
    tangled = {"frame": "clip hook", "clip": "frame", "hook": "frame a", "a": "hook"}
    blocked = {
        "+x": tangled,
        "+y": tangled,
        "+z": {**tangled, "base": "frame", "frame": "clip hook a b c"},
    }
    touches = ["base frame", "frame a", "frame b", "frame c", "frame clip", "frame hook"]
    product = cad.Product("tangled", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    relation = relation_by_hand(solids, blocked, touches, {"base": 1.0})
    overlapping = {frozenset(("frame", "clip")), frozenset(("frame", "hook"))}
    contacts = tuple(
        replace(contact, overlap_m3=4e-7) if frozenset(contact.parts) in overlapping else contact
        for contact in relation.contacts
    )
    plan = cad.Planner(product, replace(relation, contacts=contacts), effort=0).plan("base")
    assert set(plan.withdrawn) == {"clip", "hook"}
    assert {name for step in plan.steps for name in step.parts} == {"frame", "a", "b", "c"}
    reasons = cad.list_stuck(plan, relation)
    assert {name: (reason.kind, reason.by) for name, reason in reasons.items()} == {
        "clip": ("stuck", ("frame",)),
        "hook": ("stuck", ("frame",)),
    }


def test_when_time_is_over_no_path_is_searched_and_what_needs_one_is_left_out():
    product, relation = keyed(TUNNEL - box(25, 5, 3, 35, 40, 9))
    plan = cad.Planner(product, relation, watch=cad.Watch(must_stop=lambda share: True)).plan()
    assert [step.parts for step in plan.steps] == [("lid",)]
    (stuck,) = plan.stuck
    assert (stuck.part, stuck.search.outcome) == ("key", "not searched")
    assert cad.list_stuck(plan, relation)["key"].kind == "not examined"


def test_a_part_whose_search_the_limit_of_work_left_out_is_not_called_late():
    """More time does not help it."""
    product, relation = keyed(TUNNEL - box(25, 5, 3, 35, 40, 9))
    plan = cad.Planner(product, relation, effort=0).plan()
    reason = cad.list_stuck(plan, relation)["key"]
    assert reason.kind == "not examined"
    assert "limit of work" in reason.text
    assert "time" not in reason.text


def test_an_option_that_joins_two_parts_fits_no_other():
    names = ("cylinder body", "cylinder rod", "unit/case", "unit/rod[1]", "pin 1", "pin 2", "pin 3")
    assert cad.find_common_pattern(("cylinder body", "cylinder rod"), names) == "cylinder *"
    assert cad.find_common_pattern(("unit/case", "unit/rod[1]"), names) == "unit/*"
    assert cad.find_common_pattern(("pin 1", "pin 2"), names) is None


def test_two_links_in_a_case_come_as_one_after_they_were_put_together():
    solids = {
        "case": box(0, 0, 0, 40, 40, 20) - box(5, 5, 5, 35, 35, 20),
        "hook": box(6, 6, 5, 16, 34, 15),
        "eye": box(17, 6, 5, 30, 34, 15),
    }
    inside = {"case": "hook eye", "hook": "case eye", "eye": "case hook"}
    blocked = {"+x": inside, "+y": inside, "+z": {"case": "hook eye", "hook": "eye", "eye": "hook"}}
    # Apart from the case one slides out of the other along x.
    blocked["+x"] = {"case": "hook eye", "hook": "case", "eye": "case hook"}
    product = cad.Product("case", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    relation = relation_by_hand(solids, blocked, ["case hook", "case eye", "hook eye"])
    plan = cad.Planner(product, relation).plan("case")
    assert plan.why_base == "It was asked for."
    assert plan.subassemblies == (("eye", "hook"),)
    assert [step.parts for step in plan.steps] == [("hook",), ("hook", "eye")]
    assert [step.onto for step in plan.steps] == ["eye", "case"]
    assert plan.steps[1].along == (0.0, 0.0, -1.0)
