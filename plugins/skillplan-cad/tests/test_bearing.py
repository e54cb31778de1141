"""What bears a part, which side is up, and what of a product one arm is not asked to place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold

from cad_fixtures import box, part_of, rod
from cad_products import product as fixture
from cad_products import related, relation
from skillplan_cad import (
    ATTITUDES,
    Bearing,
    Face,
    LeftOut,
    Planner,
    Product,
    Watch,
    add_turns,
    build_task,
    choose_attitude,
    find_bearing,
    find_best_bearing,
    list_attitude_warnings,
    list_turn_lines,
)

UP = ATTITUDES["z"]
PLATE = box(0, 0, 0, 60, 60, 10)
SLEEVE = box(20, 20, 10, 40, 40, 50) - box(25, 25, 10, 35, 35, 50)
# Fills the sleeve, and ends above the plate.
RAM = box(25, 25, 20, 35, 35, 60)


def product_of(**solids):
    """Return a product of solids in millimetres."""
    return Product("made", tuple(part_of(*item) for item in solids.items()), "mm", 0.0)


def borne(product, up=UP):
    """Return what bears the parts of a product."""
    return find_bearing(product, related(product), up)


def test_parts_stand_on_the_table_and_on_what_stands():
    bearing = borne(product_of(plate=PLATE, sleeve=SLEEVE))
    assert bearing.order == ("plate", "sleeve")
    assert bearing.on == {"plate": (), "sleeve": ("plate",)}
    assert bearing.why_not == {}


def test_what_only_its_fit_holds_is_not_borne_and_neither_is_what_stands_on_it():
    knob = box(20, 20, 60, 40, 40, 65)
    bearing = borne(product_of(plate=PLATE, sleeve=SLEEVE, ram=RAM, knob=knob))
    assert bearing.order == ("plate", "sleeve")
    assert "only its fit to sleeve or knob holds it" in bearing.why_not["ram"].text
    assert "stands on ram alone, which nothing bears" in bearing.why_not["knob"].text


def test_the_fewest_supports_hold_what_does_not_stay():
    """The knob stands on the ram once that is held."""
    knob = box(20, 20, 60, 40, 40, 65)
    product = product_of(plate=PLATE, sleeve=SLEEVE, ram=RAM, knob=knob)
    bearing = find_bearing(product, related(product), UP, holding=True)
    assert bearing.order == ("plate", "sleeve", "ram", "knob")
    assert bearing.held == ("ram",)
    assert bearing.why_not == {}


@pytest.mark.parametrize("up", ["z", "-x"])
def test_no_support_holds_what_only_a_left_out_part_connects_to_the_rest(up):
    """Cap and knob touch each other, and would hang in the air without the lid."""
    product = product_of(
        foot=box(0, 0, -10, 60, 60, 0),
        body=box(0, 0, 0, 60, 60, 30),
        lid=box(0, 0, 30, 60, 60, 34),
        cap=box(20, 20, 34, 40, 40, 44),
        knob=box(25, 25, 44, 35, 35, 50),
    )
    known = related(product)
    for earlier in ({}, {"firm": ["foot", "body"], "earlier": [UP]}):
        bearing = find_bearing(product, known, ATTITUDES[up], ["lid"], holding=True, **earlier)
        assert bearing.why_not.keys() == {"cap", "knob"}
    assert "lid" in bearing.why_not["cap"].by
    whole = find_bearing(product, known, ATTITUDES[up], holding=True)
    assert set(whole.order) == {"foot", "body", "lid", "cap", "knob"}


def test_the_product_stands_on_its_next_part_if_the_lowest_one_is_left_out():
    """The rivet has a head on both sides of the plate, so neither comes without the other."""
    rivet = box(2, 2, -4, 12, 12, 0) + box(5, 5, 0, 9, 9, 10) + box(2, 2, 10, 12, 12, 14)
    plate = PLATE - box(5, 5, 0, 9, 9, 10)
    product = product_of(rivet=rivet, plate=plate, sleeve=SLEEVE, ram=RAM)
    bearing = find_bearing(product, related(product), UP, holding=True)
    assert bearing.order == ("plate", "sleeve", "ram")
    assert bearing.held == ("ram",)
    assert bearing.why_not["rivet"].kind == "closed in"


def test_a_closed_frame_lacks_one_beam_only():
    """Each corner takes the ends of two beams, one in x and one in y, so no last part goes in."""
    beam_x, beam_y = box(18, 4, 2, 52, 12, 10), box(4, 18, 2, 12, 52, 10)
    beams = {"south": beam_x, "north": beam_x.translate([0, 54, 0])}
    beams |= {"west": beam_y, "east": beam_y.translate([54, 0, 0])}
    corners = {}
    for name, x, y in (("sw", 0, 0), ("se", 50, 0), ("nw", 0, 50), ("ne", 50, 50)):
        corners[name] = box(x, y, 0, x + 20, y + 20, 16)
        for beam in beams.values():
            corners[name] -= beam
    product = product_of(**corners, **beams)
    bearing = find_bearing(product, related(product), UP, holding=True)
    assert len(bearing.order) == 7
    ((name, reason),) = bearing.why_not.items()
    assert name in beams
    assert reason.kind == "closed in"


def test_parts_are_held_until_the_last_one_bears_them_if_more_parts_come_then():
    """Two arms on pegs fall without the yoke, which goes onto both from a side at the end."""

    def mirror(solid):
        return solid.scale([1, -1, 1]).translate([0, 60, 0])

    inner, outer, lead = (
        box(20, 3, 8, 28, 7, 12),
        box(72, 3, 8, 80, 7, 12),
        box(13, 10, 8, 17, 18, 12),
    )
    corner = box(10, 0, 0, 20, 10, 20) + inner + lead
    arm = box(20, 0, 5, 80, 10, 15) - inner - outer
    solids = {
        "yoke": box(80, 0, 0, 90, 60, 20) + outer + mirror(outer),
        "south": corner,
        "north": mirror(corner),
        "tie": box(10, 10, 5, 20, 50, 15) - lead - mirror(lead),
        "arm": arm,
        "other": mirror(arm),
    }
    corners = {"south": (11, 1, 20), "north": (11, 51, 20), "tie": (11, 28, 15)}
    corners |= {"arm": (48, 2, 15), "other": (48, 52, 15), "yoke": (81, 28, 20)}
    for name, (x, y, z) in corners.items():
        for k in (0, 4):
            solids[f"{name}_{k}"] = box(x + k, y, z, x + k + 3, y + 5, z + 5)
    product = product_of(**solids)
    relation = related(product)
    assert "other" in find_bearing(product, relation, UP, holding=True).why_not
    bearing = find_bearing(product, relation, UP, holding=True, between=True)
    assert {*bearing.order} == {*solids}
    assert {*bearing.held} == {"tie", "arm", "other"}
    assert bearing.order.index("yoke") == 5


def test_what_stands_by_itself_is_not_held():
    product = product_of(plate=PLATE, sleeve=SLEEVE)
    assert find_bearing(product, related(product), UP, holding=True).held == ()


def bolted(**solids):
    """Return supports of a product with bolts and nuts, without and with holders."""
    product = product_of(**solids)
    known = related(product)
    return [find_bearing(product, known, UP, holding=holding) for holding in (False, True)]


def test_a_nut_in_the_air_is_held_while_its_bolt_is_driven():
    """It cannot be tightened against the plate, which is 20 mm above it."""
    plate = box(0, 0, 30, 60, 60, 40) - rod(30, 30, 30, 4, 10)
    legs = box(0, 0, 0, 5, 60, 30) + box(55, 0, 0, 60, 60, 30)
    alone, held = bolted(
        plate=plate + legs,
        **{
            "M8 bolt": rod(30, 30, 0, 4, 40) + rod(30, 30, 40, 7, 5),
            "M8 nut": rod(30, 30, 3, 7, 6) - rod(30, 30, 3, 4, 6),
        },
    )
    assert alone.undriven.keys() == {"M8 nut"}
    assert held.undriven == {}
    assert held.held == ("M8 nut",)


def test_a_rod_is_held_while_its_nuts_are_driven():
    walls = box(0, 0, 0, 10, 40, 40) + box(50, 0, 0, 60, 40, 40) + box(0, 0, 0, 60, 40, 5)
    bore = rod(0, 0, 0, 5, 60).rotate([0, 90, 0]).translate([0, 20, 25])
    nut = (rod(0, 0, 0, 9, 8) - rod(0, 0, 0, 4.6, 8)).rotate([0, 90, 0])
    alone, held = bolted(
        frame=walls - bore,
        rod=rod(0, 0, 0, 5, 90).rotate([0, 90, 0]).translate([-15, 20, 25]),
        **{
            "M10 nut 1": nut.translate([-8, 20, 25]),
            "M10 nut 2": nut.translate([60, 20, 25]),
        },
    )
    assert "turns rod with it" in alone.undriven["M10 nut 1"].text
    assert held.undriven == {}
    assert held.held == ("rod",)


def turned_screw(x, y, z):
    """Return a screw from below, with its seat at a point."""
    return rod(x, y, z - 3, 3.5, 3) + rod(x, y, z, 2, 9)


def hollow_body():
    """Return a body with a recess in its underside, a cover for that, and its screws."""
    body, cover = (
        box(0, 0, 0, 60, 60, 30) - box(6, 6, -1, 54, 54, 6),
        box(6.3, 6.3, 2, 53.7, 53.7, 6),
    )
    solids = {}
    for number, at in enumerate(((15, 15), (45, 45)), 1):
        body -= rod(*at, 5, 2, 9)
        cover -= rod(*at, 1, 2.2, 6)
        solids[f"screw_{number}"] = turned_screw(*at, 2)
    return {"body": body, "cover": cover, **solids}


def test_what_is_driven_from_below_comes_after_a_turn_and_so_does_what_needs_no_hold_then():
    """Before the turn the cover would wait in the air for the body."""
    product = product_of(**hollow_body())
    known = related(product)
    alone = find_bearing(product, known, UP, holding=True)
    assert set(alone.undriven) == {"screw_1", "screw_2"}
    assert "cover" in alone.held
    bearing = add_turns(product, known, alone)
    assert bearing.order == ("body", "cover")
    assert bearing.turned == dict.fromkeys(("cover", "screw_1", "screw_2"), ATTITUDES["-z"])
    assert (bearing.held, bearing.why_not, bearing.undriven) == (("body",), {}, {})


def test_no_table_bears_what_stands_beside_the_base_of_a_turned_product():
    """A bar stands on the table, and beneath the body only after the turn."""
    solids = hollow_body()
    bar = box(60, 0, 0, 70, 60, 20)
    product = product_of(**solids, bar=bar)
    known = related(product)
    alone = find_bearing(product, known, UP, holding=True)
    assert "bar" not in alone.held
    bearing = add_turns(product, known, alone)
    assert bearing.order[0] == "body"
    assert "bar" in bearing.held


def screwed_plate():
    """Return a plate with a block on it, and the screws that join them from below."""
    plate, block = box(-20, -20, 0, 80, 80, 6), box(10, 10, 6, 50, 50, 16)
    screws = {}
    for number, at in enumerate(((15, 15), (45, 45)), 1):
        plate -= rod(*at, -1, 2.2, 8)
        block -= rod(*at, 5, 2, 5)
        screws[f"screw_{number}"] = turned_screw(*at, 0)
    return {"plate": plate, "block": block, **screws}


def test_a_part_that_would_shut_out_a_screw_after_a_turn_waits_for_it():
    """A bracket goes in from the side, beneath a screw that is driven from below."""
    bracket = box(-25, 10, -8, -20, 20, 6) + box(-25, 10, -8, 20, 20, -3.1)
    product = product_of(**screwed_plate(), bracket=bracket)
    known = related(product)
    alone = find_bearing(product, known, UP, holding=True)
    bearing = add_turns(product, known, alone, early=alone.order)
    assert (bearing.why_not, bearing.undriven) == ({}, {})
    assert bearing.turned.keys() == {"bracket", "screw_1", "screw_2"}


def test_a_part_that_waits_for_a_turn_in_vain_has_a_reason():
    """If the bracket alone waits, the key goes in before it and shuts it out, so both wait."""
    bracket = box(-25, 10, -8, -20, 20, 6) + box(-25, 10, -8, 22, 20, -3.1)
    bracket += box(22, 10, -12, 38, 20, 0) - box(24, 11.5, -10, 36, 18.5, -5)
    bracket -= box(27, 13, -6, 33, 17, 1)
    key = box(24.5, 12, -9.5, 35.5, 18, -5.5) + box(27.5, 13.5, -6, 32.5, 16.5, 0)
    product = product_of(**screwed_plate(), bracket=bracket, key=key)
    known = related(product)
    alone = find_bearing(product, known, UP, holding=True)
    bearing = add_turns(product, known, alone, early=alone.order)
    assert bearing.turned.keys() == {"bracket", "screw_1", "screw_2"}
    assert bearing.why_not.keys() == {"key"}


def test_a_turn_holds_what_no_screw_joins_to_the_base():
    lid = {"lid": box(0, 0, 30, 60, 60, 34)}
    for held, screws in ((("body", "lid"), {}), (("body",), {"top_screw": 30})):
        solids = hollow_body() | lid
        for name, z in screws.items():
            solids["body"] -= rod(30, 30, z - 8, 2, 9)
            solids["lid"] -= rod(30, 30, z - 1, 2.2, 9)
            solids[name] = turned_screw(0, 0, 0).mirror((0, 0, 1)).translate((30, 30, 34))
        product = product_of(**solids)
        known = related(product)
        bearing = add_turns(product, known, find_bearing(product, known, UP, holding=True))
        assert bearing.held == held
        assert "lid" not in bearing.turned


def test_a_part_that_goes_in_early_does_not_wait_for_a_turn_to_save_a_support():
    solids = hollow_body() | {"lid": box(0, 0, 30, 60, 60, 34), "cap": box(20, 20, 34, 40, 40, 44)}
    product = product_of(**solids)
    known = related(product)
    alone = find_bearing(product, known, UP, holding=True)
    assert {"lid", "cap"} <= add_turns(product, known, alone).turned.keys()
    bearing = add_turns(product, known, alone, early=("lid", "cap"))
    assert bearing.turned == dict.fromkeys(("cover", "screw_1", "screw_2"), ATTITUDES["-z"])
    assert bearing.held == ("body", "lid", "cap")


def test_the_reason_after_a_turn_names_no_part_that_comes_in_then():
    """The body has no opening as long as the screw above its head."""
    body = box(0, 0, 0, 60, 60, 60) - box(6, 6, -1, 54, 54, 6) - rod(30, 30, 5, 2.2, 26)
    body -= box(20, -1, 30, 40, 61, 45)
    cover = box(6.3, 6.3, 2, 53.7, 53.7, 6) - rod(30, 30, 1, 2, 6)
    screw = rod(30, 30, 30, 3.5, 3) + rod(30, 30, 3, 2, 27)
    product = product_of(body=body, cover=cover, screw_1=screw)
    known = related(product)
    late = {"cover": LeftOut("cover", "no grasp", "comes after a turn")}
    alone = find_bearing(product, known, UP, late, holding=True)
    assert "cover, which is left out" in alone.undriven["screw_1"].text
    bearing = add_turns(product, known, alone, later=late)
    assert "cover" in bearing.turned
    assert bearing.undriven["screw_1"].kind == "from below"


def test_a_product_that_comes_from_above_is_not_turned():
    product = product_of(plate=PLATE, sleeve=SLEEVE)
    alone = borne(product)
    assert add_turns(product, related(product), alone) == alone


@pytest.mark.slow(reason="tries grasps and a turn with swept; the bearing in every run")
def test_a_written_turn_is_checked_and_brings_all_parts():
    product = product_of(**hollow_body())
    known = related(product)
    plan = Planner(product, known).plan()
    bearing = find_bearing(product, known, UP, holding=True)
    task = build_task(product, known, plan, bearing=bearing, holding=True, turning=True)
    assert (task.left_out, task.faults, task.doubt) == ({}, (), "")
    assert "turn(flip_station.down)" in task.skills
    assert task.document["holders"].keys() == {"hold_body"}
    orientations = {name: entry["orientation"] for name, entry in task.document["parts"].items()}
    assert orientations == {"body": "up", "cover": "down"}
    assert any(words.startswith("is carried by a workholder") for words in task.limits["body"])
    assert list_turn_lines(task, {**bearing.why_not, **bearing.undriven}) == [
        "the product turns until -z points up, for cover, screw_1 and screw_2; without it each of "
        "screw_1 and screw_2 is driven from below",
        "the task has 1 turn, the least of those tried",
    ]


@pytest.mark.slow(reason="tries grasps and turns with swept; which parts wait in every run")
def test_a_part_that_fails_after_a_turn_for_which_it_waited_goes_in_before_it():
    """Upside down, the cap would wait in the air for the lid, and runs into the body."""
    solids = hollow_body() | {"lid": box(0, 0, 30, 60, 60, 34), "cap": box(20, 20, 34, 40, 40, 44)}
    product = product_of(**solids)
    known = related(product)
    plan = Planner(product, known).plan()
    bearing = find_bearing(product, known, UP, holding=True)
    task = build_task(product, known, plan, bearing=bearing, holding=True, turning=True)
    assert (task.left_out, task.doubt) == ({}, "")
    assert task.bearing.get_up("cap") == UP


@pytest.mark.slow(reason="tries grasps and a turn with swept; no cheaper case has a turn")
def test_a_turned_task_without_a_known_order_replaces_none_with_an_order():
    """Time ends in the search for the order of the turned task."""
    searches: list[str] = []

    class Stopped(Watch):
        def report(self, text):
            if "finding an order" in text:
                searches.append(text)

    product = product_of(**hollow_body())
    known = related(product)
    plan = Planner(product, known).plan()
    bearing = find_bearing(product, known, UP, holding=True)
    watch = Stopped(must_stop=lambda share: len(searches) > 1)
    task = build_task(
        product, known, plan, bearing=bearing, holding=True, turning=True, watch=watch
    )
    assert len(searches) == 2
    assert task.skills
    assert task.bearing.turned == {}


FRAME = box(0, 0, 0, 60, 40, 40) - box(10, -1, 10, 50, 41, 41)
LYING = rod(0, 0, 0, 5, 60).rotate([0, 90, 0]).translate([0, 20, 25])


def test_a_shaft_that_lies_in_bores_stays_and_comes_from_the_side():
    """Contact forces of the lower halves of the bores balance its weight."""
    product = product_of(frame=FRAME - LYING, shaft=LYING)
    known = related(product)
    bearing = find_bearing(product, known, UP)
    assert bearing.order == ("frame", "shaft")
    assert bearing.on["shaft"] == ("frame",)
    plan = Planner(product, known).plan()
    (along,) = [step.along for step in plan.steps if step.parts == ("shaft",)]
    assert abs(along[0]) == pytest.approx(1.0)


@pytest.mark.slow(reason="tries grasps with swept; the direction in every run")
def test_a_shaft_in_bores_is_left_out_if_fingers_do_not_pass_the_posts():
    product = product_of(frame=FRAME - LYING, shaft=LYING)
    known = related(product)
    plan = Planner(product, known).plan()
    task = build_task(product, known, plan, bearing=find_bearing(product, known, UP))
    assert "runs into frame" in task.left_out["shaft"].text


def test_supports_do_not_bear_each_other_in_a_circle():
    """A rod lies in two posts, and a post without a plate would hang on the rod."""
    posts = [box(x, 10, 10, x + 10, 30, 40) - LYING for x in (5, 45)]
    bearing = borne(product_of(plate=PLATE, left=posts[0], right=posts[1], rod=LYING))
    assert bearing.order == ("plate", "left", "right", "rod")


def test_a_pin_in_a_through_hole_falls_and_one_on_the_floor_of_a_hole_stays():
    """It stands on an edge beside its centre of mass: the wall of the hole keeps it upright."""
    pin = rod(30, 30, 2, 5, 18)
    through = borne(product_of(plate=PLATE - rod(30, 30, 0, 5, 10), pin=pin))
    assert through.why_not["pin"].kind == "not level"
    half = box(20, 20, 0, 28, 40, 2)
    blind = borne(
        product_of(plate=box(0, 0, 0, 60, 60, 14) - rod(30, 30, 0, 5, 14) + half, pin=pin)
    )
    assert blind.order == ("plate", "pin")


SLIM = box(29, 10, 10, 31, 50, 70)
CONE = Manifold.cylinder(5, 0, 5, 48).translate([30, 30, 4])


@pytest.mark.parametrize(
    ("part", "plate", "stands"),
    [
        (SLIM, PLATE, False),
        (SLIM, PLATE + box(20, 10, 10, 40, 50, 45) - SLIM, True),
        (SLIM, PLATE + box(20, 10, 10, 40, 50, 13) - SLIM, False),
        (
            CONE + rod(30, 30, 9, 5, 18),
            PLATE - CONE + rod(30, 30, 9, 9, 13) - CONE - rod(30, 30, 9, 5, 18),
            True,
        ),
    ],
    ids=["slim", "deep slot", "flat slot", "pointed pin in a drilled hole"],
)
def test_a_part_stands_with_a_margin_or_because_its_fit_keeps_it_from_tipping(part, plate, stands):
    """It would also stand if the table were tilted by 2 degrees."""
    bearing = borne(product_of(plate=plate, part=part))
    assert bearing.order == (("plate", "part") if stands else ("plate",))


def test_a_plate_that_only_leans_on_a_wall_is_left_out():
    """Friction at its foot would hold it, but the next move would drag it along."""
    leaning = box(0, 10, 0, 5, 50, 60).rotate([0, 14, 0]).translate([20, 0, 11.22])
    wall = box(39.37, 10, 10, 60, 50, 80)
    bearing = borne(product_of(plate=PLATE, wall=wall, leaning=leaning))
    assert bearing.order == ("plate", "wall")


def test_the_order_leaves_out_what_no_order_lets_pass():
    """A lid that must be lifted off sideways, by a post that comes from below it."""
    lid = box(-10, -10, 10, 70, 70, 20) - box(25, 25, 10, 35, 35, 18)
    post = box(25, 25, 10, 35, 35, 18)
    bearing = borne(product_of(plate=PLATE, post=post, lid=lid))
    assert bearing.order == ("plate", "post", "lid")
    hook = post + box(35, 25, 12, 45, 35, 16)
    locked = lid - box(35, 25, 12, 45, 35, 16)
    bearing = borne(product_of(plate=PLATE, post=hook, lid=locked))
    assert bearing.order == ("plate", "lid")
    assert (bearing.why_not["post"].kind, bearing.why_not["post"].by) == ("closed in", ("lid",))


def test_what_stands_on_a_part_that_is_left_out_follows_it():
    product = product_of(plate=PLATE, sleeve=SLEEVE, shelf=box(15, 15, 50, 45, 45, 54))
    bearing = find_bearing(product, related(product), UP, {"sleeve"})
    assert bearing.order == ("plate",)
    assert (bearing.why_not["shelf"].kind, bearing.why_not["shelf"].by) == ("follows", ("sleeve",))


def test_a_part_with_its_centre_of_mass_beside_what_bears_it_would_tip():
    bearing = borne(product_of(plate=PLATE, board=box(50, 0, 10, 150, 60, 14)))
    assert "would tip off plate" in bearing.why_not["board"].text


def test_without_what_hangs_below_all_others_they_stand():
    """A collar round the foot of a block, held there by its fit alone."""
    block, hole = box(0, 0, 0, 40, 40, 60), box(0, 0, -10, 40, 40, 20)
    collar = box(-5, -5, -10, 45, 45, 20) - hole
    shelf = box(5, 5, 60, 35, 35, 70)
    bearing = borne(product_of(block=block, collar=collar, shelf=shelf))
    assert bearing.order == ("block", "shelf")
    assert "stands lower than all others" in bearing.why_not["collar"].text


def test_the_side_is_up_with_which_the_arm_brings_most_parts_and_z_where_none_has_more():
    lying = product_of(
        plate=box(0, 0, 0, 10, 60, 60),
        post=box(10, 20, 20, 60, 40, 40),
        cap=box(60, 20, 20, 70, 40, 40),
    )
    bearing = find_best_bearing(lying, related(lying))
    assert (bearing.up, bearing.order) == (ATTITUDES["x"], ("plate", "post", "cap"))
    flat = borne(lying)
    assert flat.order == ("post", "cap")
    assert "stands lower than all others" in flat.why_not["plate"].text
    standing = product_of(plate=PLATE, sleeve=SLEEVE)
    assert find_best_bearing(standing, related(standing)).up == UP
    # Both parts stand either way, and the plug comes straight down only with its pocket up.
    pocket = box(10, -1, 10, 30, 30, 30)
    shelf = product_of(body=box(0, 0, 0, 40, 40, 40) - pocket, plug=box(10, 5, 10, 30, 30, 30))
    assert find_best_bearing(shelf, related(shelf)).up == ATTITUDES["-y"]
    # No arm puts a block of 62 kg on a plate; one puts the plate on the block.
    heavy = product_of(plate=box(-30, -30, 0, 230, 230, 10), block=box(0, 0, 10, 200, 200, 210))
    assert find_best_bearing(heavy, related(heavy)).up == ATTITUDES["-z"]


def test_a_round_part_that_lies_does_not_stand_on_the_chord_beneath_it():
    """However CAD is cut into triangles; it stands on either end."""
    shaft = part_of("shaft", rod(0, 0, 0, 5, 60))
    corners = shaft.vertices_m[shaft.triangles]
    wall = np.flatnonzero(np.ptp(corners[:, :, 2], axis=1) > 0)
    shaft = replace(shaft, faces=(Face("cylinder", wall, radius_m=0.005),))
    known = related(product_of(shaft=rod(0, 0, 0, 5, 60), plate=PLATE))
    alone = Product("one", (shaft,), "mm", 0.0)
    sides = {name: find_bearing(alone, known, up).order for name, up in ATTITUDES.items()}
    assert [name for name, order in sides.items() if order] == ["z", "-z"]


@pytest.fixture(scope="module")
def rammed():
    """A task of three parts of which one is held by its fit alone."""
    product = product_of(plate=PLATE, sleeve=SLEEVE, ram=RAM)
    known = related(product)
    bearing = find_bearing(product, known, UP)
    return build_task(product, known, Planner(product, known).plan(), bearing=bearing)


def test_what_is_not_borne_is_left_out_of_the_task_with_the_reason_in_the_file(rammed):
    assert list(rammed.document["parts"]) == ["plate", "sleeve"]
    assert list(rammed.left_out) == ["ram"]
    assert rammed.document["description"].startswith("2 of 3 parts")
    comment = " ".join(
        line.removeprefix("#").strip()
        for line in rammed.files["product.yaml"].splitlines()
        if line.startswith("#")
    )
    assert "Left out: ram has no level face beneath it: only its fit to sleeve" in comment
    assert not any("ram" in name for name in rammed.files)


@pytest.mark.parametrize(("name", "left_out"), [("floating", ["balloon"]), ("l_slot", ["key"])])
@pytest.mark.slow(reason="reads a product; what its fit holds is left out in every run")
def test_what_floats_or_comes_round_a_corner_is_left_out(name, left_out):
    product, known = fixture(name), relation(name)
    plan, bearing = Planner(product, known).plan(), find_best_bearing(product, known)
    assert list(build_task(product, known, plan, bearing=bearing).left_out) == left_out


def test_what_check_refuses_is_left_out_with_its_words():
    """Whatever was thought to bear it."""
    product = product_of(plate=PLATE, balloon=box(20, 20, 40, 40, 40, 50))
    known = related(product)
    wrong = Bearing(UP, ("plate", "balloon"), {"plate": (), "balloon": ("plate",)})
    task = build_task(product, known, Planner(product, known).plan(), bearing=wrong)
    assert list(task.document["parts"]) == ["plate"]
    assert task.left_out["balloon"].text.startswith("is refused: 'balloon' floats 30.0 mm above")
    assert task.faults == ()


def test_where_nothing_stands_there_is_no_task_and_a_warning_says_so():
    """As of round parts that lie; here they are only said to."""
    product = product_of(plate=PLATE, sleeve=SLEEVE)
    known = related(product)
    rolling = {name: LeftOut(name, "not level", "rolls") for name in ("plate", "sleeve")}
    none = Bearing(UP, (), {}, rolling)
    task = build_task(product, known, Planner(product, known).plan(), bearing=none)
    assert (task.document, task.files) == ({}, {})
    assert task.left_out == rolling
    message = list_attitude_warnings(product, known, none, "z")
    assert message[0] == ("with z up 0 of 2 parts stand by themselves; with --up z it would be 2.")
    assert message[1] == "with z up no part stands by itself: all need a nest or a fixture."


def test_another_side_up_than_z_is_told_and_so_is_a_better_one_than_was_asked_for():
    lying = product_of(plate=box(0, 0, 0, 10, 60, 60), post=box(10, 20, 20, 60, 40, 40))
    known = related(lying)
    result = choose_attitude(lying, known, "auto")
    (chosen,) = list_attitude_warnings(lying, known, result, "auto")
    assert chosen.startswith("x points up, as then 2 of 2 parts stand by themselves")
    choice = choose_attitude(lying, known, "z")
    (better,) = list_attitude_warnings(lying, known, choice, "z")
    assert better.endswith("1 of 2 parts stand by themselves; with --up x it would be 2.")


@pytest.mark.slow(reason="reads products; solids in every run")
def test_turned_over_what_bears_the_others_comes_first():
    """A dovetail on its slide, and a plate on its edge, beside which all else hangs."""
    product, known = fixture("dovetail"), relation("dovetail")
    assert find_bearing(product, known, ATTITUDES["-z"]).order == ("slide", "rail")
    product, known = fixture("mirrored"), relation("mirrored")
    bearing = find_bearing(product, known, ATTITUDES["x"])
    assert bearing.order == ("plate",)
    assert sorted(bearing.why_not) == ["left_1", "left_2", "right"]
