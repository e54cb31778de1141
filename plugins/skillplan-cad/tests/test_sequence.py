"""Orders of assembly are stable and connected where there is a choice, with the base said why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skillplan_cad as cad
from cad_fixtures import box, part_of, relation_by_hand, rod

UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def on_top(
    lower: str, upper: str, x0: float, y0: float, x1: float, y1: float, z: float
) -> cad.Contact:
    """Return the contact of a part that lies on another in a rectangle [mm]."""
    points = [(x / 1e3, y / 1e3, z / 1e3) for x in (x0, x1) for y in (y0, y1)]
    area = (x1 - x0) * (y1 - y0) * 1e-6
    return cad.Contact((lower, upper), "plane", area, (UP,), points_m=tuple(points))


def arch() -> tuple[cad.Product, cad.Relation]:
    """Two posts on a plate, a beam on both, a ledge that only the beam's weight keeps there."""
    solids = {
        "plate": box(0, 0, 0, 60, 20, 5),
        "left": box(5, 5, 5, 10, 15, 25),
        "right": box(50, 5, 5, 55, 15, 25),
        "beam": box(0, 5, 25, 60, 15, 30),
    }
    product = cad.Product("arch", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)
    relation = relation_by_hand(
        product_names(product),
        {
            "+x": {"left": "right"},
            "+y": {},
            "+z": {"plate": "left right beam", "left": "beam", "right": "beam"},
        },
    )
    contacts = (
        on_top("plate", "left", 5, 5, 10, 15, 5),
        on_top("plate", "right", 50, 5, 55, 15, 5),
        on_top("left", "beam", 5, 5, 10, 15, 25),
        on_top("right", "beam", 50, 5, 55, 15, 25),
    )
    return product, replace(relation, contacts=contacts)


def product_names(product: cad.Product) -> list[str]:
    return [part.name for part in product]


@pytest.fixture(scope="module")
def bridge():
    product, relation = arch()
    return product, relation, cad.Stability(product, relation)


def sequencer(product, relation, stability, tools=None):
    precedence = cad.derive_precedence(relation)
    tools = {product.index(name): tool for name, tool in (tools or {}).items()}
    return cad.Sequencer(
        precedence, relation.directions, cad.find_touching(relation), stability, tools
    )


def test_a_beam_stays_on_two_posts_and_not_on_one(bridge):
    product, _, stability = bridge
    beam = product.index("beam")
    assert stability.stays(beam, cad.encode_set([0, 1, 2]), UP)
    assert not stability.stays(beam, cad.encode_set([0, 1]), UP)
    assert not stability.stays(beam, cad.encode_set([0]), UP)


def test_a_hand_under_the_beam_holds_all_that_hangs_upside_down(bridge):
    product, _, stability = bridge
    everything = cad.encode_set(range(4))
    assert stability.must_be_held(everything, 0, UP) == ()
    assert stability.must_be_held(everything, 0, DOWN) == (product.index("beam"),)


def test_a_product_on_a_narrow_foot_tips(bridge):
    stability = bridge[2]
    assert not stability.tips(cad.encode_set([0, 1]), UP)
    assert stability.tips(cad.encode_set([0, 1]), DOWN)


def test_the_cheapest_order_is_stable_connected_and_without_turns(bridge):
    product, relation, _ = bridge
    sequence = sequencer(*bridge).sequence(cad.encode_set(range(4)), 0, UP)
    assert sequence.cheapest
    assert [product.parts[part].name for part in sequence.assembly][-1] == "beam"
    assert sequence.turns == 0
    assert all(
        removal.stays and removal.connected and not removal.tips for removal in sequence.removals
    )
    assert {relation.directions[item.direction] for item in sequence.removals} == {UP}


def test_tools_are_changed_as_seldom_as_precedence_allows(bridge):
    product, relation, stability = bridge
    tools = {"left": "cup", "right": "gripper", "beam": "cup"}
    sequence = sequencer(product, relation, stability, tools).sequence(
        cad.encode_set(range(4)), 0, UP
    )
    assert [removal.tool for removal in sequence.removals] == ["cup", "cup", "gripper"]


def test_friction_holds_on_a_gentle_slope_and_not_on_a_steep_one():
    for angle_deg, stays in ((10, True), (25, False)):
        turn = np.radians(angle_deg)
        up = (float(np.sin(turn)), 0.0, float(np.cos(turn)))
        product = cad.Product(
            "slope",
            (part_of("plate", box(0, 0, 0, 60, 60, 5)), part_of("disc", rod(30, 30, 5, 10, 4))),
            "mm",
            0.0,
        )
        relation = relation_by_hand(["plate", "disc"], {"+x": {}, "+y": {}, "+z": {}})
        relation = replace(relation, contacts=(on_top("plate", "disc", 22, 22, 38, 38, 5),))
        assert cad.Stability(product, relation).stays(1, 1, up) == stays
