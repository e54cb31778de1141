"""Which bodies stand by themselves."""

from __future__ import annotations

import math

import pytest

from skillplan.collision import Solid, decide_standing, find_touches, weigh
from skillplan.task import Box, Cylinder, Pose

TABLE = Solid([Box((1, 1, 0.1), (0, 0, -0.05))], Pose((0, 0, 0)))


def block(size, at=(0, 0, 0), yaw_rad=0.0):
    """Return a block whose bottom is at a height."""
    return Solid([Box(size, (0, 0, size[2] / 2))], Pose.upright(at, yaw_rad))


def decide(loose, firm=None, masses=None, **options):
    """Return the verdict on bodies, of 1 kg each unless stated."""
    touches = find_touches({**(firm or {"table": TABLE}), **loose})
    weights = {name: weigh(solid, (masses or {}).get(name, 1.0)) for name, solid in loose.items()}
    return decide_standing(weights, touches, **options)


def hole(diameter_m, depth_m):
    """Return a block with a square hole and a floor; the hole begins at a height of 0."""
    half, wall = diameter_m / 2, 0.03
    walls = [
        Box((wall, 0.1, depth_m), (side * (half + wall / 2), 0, depth_m / 2)) for side in (-1, 1)
    ]
    walls += [
        Box((diameter_m, wall, depth_m), (0, side * (half + wall / 2), depth_m / 2))
        for side in (-1, 1)
    ]
    return Solid([*walls, Box((0.1, 0.1, 0.02), (0, 0, -0.01))], Pose((0, 0, 0)))


def test_what_lies_on_the_table_stands_and_what_lies_on_nothing_falls():
    assert decide({"it": block((0.1, 0.1, 0.1))}).stands
    fallen = decide({"it": block((0.1, 0.1, 0.1), (0, 0, 0.2))})
    assert (fallen.moving, fallen.how, fallen.only_tilted) == ("it", "falls", False)
    assert fallen.reason == "'it' falls: nothing beneath it bears it"


def test_a_body_tips_to_the_side_where_nothing_bears_it():
    ledge = block((0.1, 0.1, 0.05))
    tipped = decide({"it": block((0.2, 0.1, 0.02), (0.06, 0, 0.05))}, {"ledge": ledge})
    assert (tipped.how, tipped.towards) == ("tips", (1.0, 0.0, 0.0))
    assert decide({"it": block((0.2, 0.1, 0.02), (0.04, 0, 0.05))}, {"ledge": ledge}).stands


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3])
@pytest.mark.parametrize("size_m", [(0.01, 0.02), (0.03, 0.03), (0.1, 0.15)])
@pytest.mark.parametrize("under", [TABLE, block((0.2, 0.2, 0.03), (0, 0, -0.03))])
def test_a_can_stands_on_every_side(size_m, yaw_rad, under):
    diameter_m, height_m = size_m
    at = Pose.upright((0.018, -0.007, 0), yaw_rad)
    can = Solid([Cylinder(diameter_m, height_m, (0, 0, height_m / 2))], at)
    assert decide({"can": can}, {"under": under}).reason == ""


def test_a_tall_body_on_a_narrow_face_stands_on_level_ground_only():
    narrow = {"it": block((0.002, 0.05, 0.1))}
    tipped = decide(narrow)
    assert tipped.only_tilted
    assert "if the ground is tilted by 2 degrees" in tipped.reason
    assert decide(narrow, tilt_deg=0).stands


@pytest.mark.parametrize(
    ("depth_mm", "stands"), [(26, True), (2, False)], ids=["deeper than half", "flat"]
)
def test_a_round_pin_stands_in_a_hole_that_is_deep_enough(depth_mm, stands):
    pin = Solid([Cylinder(0.002, 0.05, (0, 0, 0.025))], Pose((0, 0, 0)))
    assert decide({"pin": pin}, {"block": hole(0.002, depth_mm / 1e3)}).stands is stands


def test_a_shaft_stays_between_a_slope_and_a_wall():
    """The wall pushes as hard as the slope needs."""
    half_m = 0.1 * math.tan(math.pi / 8)
    slope = Pose.turned((half_m, 0, 0), (0, -math.pi / 4, 0))
    firm = {
        "slope": Solid([Box((0.4, 0.4, 0.1), (0, 0, -0.05))], slope),
        "wall": block((0.1, 0.4, 0.4), (-0.15, 0, -0.1)),
    }
    lying = Pose.turned((0, 0, 0.1), (math.pi / 2, 0, 0))
    assert decide({"shaft": Solid([Cylinder(0.2, 0.1, (0, 0, 0))], lying)}, firm).how == ""


def test_walls_clamp_nothing():
    """Forces in equilibrium exist with friction, but only a preload would bring them about."""
    walls = {name: block((0.1, 0.1, 0.1), (x_m, 0, 0.1)) for name, x_m in (("a", -0.1), ("b", 0.1))}
    assert decide({"it": block((0.1, 0.1, 0.05), (0, 0, 0.12))}, walls).how == "falls"


@pytest.mark.parametrize("lid", [False, True], ids=["free", "under a lid"])
@pytest.mark.parametrize(("slope_deg", "stands"), [(13, True), (18, False)])
def test_friction_on_a_slope_is_that_of_the_weight(slope_deg, stands, lid):
    """A lid that touches adds no friction: 0.3 is the tangent of 16.7 degrees."""
    pose = Pose.turned((0, 0, 0.3), (0, math.radians(slope_deg), 0))
    firm = {"ramp": Solid([Box((0.4, 0.4, 0.02), (0, 0, -0.01))], pose)}
    if lid:
        firm["lid"] = Solid([Box((0.4, 0.4, 0.02), (0, 0, 0.03))], pose)
    verdict = decide({"it": Solid([Box((0.1, 0.1, 0.02), (0, 0, 0.01))], pose)}, firm)
    assert verdict.stands is stands
    if not stands:
        assert verdict.how == "slides"
        assert verdict.towards[0] > 0.9


def seesaw(**more):
    """Return a beam that is out of balance on a foot."""
    foot, beam = block((0.1, 0.1, 0.1)), block((0.3, 0.05, 0.02), (0.06, 0, 0.1))
    return {"foot": foot, "beam": beam, **more}


def test_a_counterweight_a_hold_or_a_joint_keeps_a_beam():
    load = block((0.04, 0.05, 0.04), (-0.06, 0, 0.12))
    assert decide(seesaw()).moving == "beam"
    assert decide(seesaw(load=load), masses={"load": 2.0}).stands
    assert decide(seesaw(), held={"beam"}).stands
    heavy = {"foot": 20.0}
    assert decide(seesaw(), masses=heavy, joined=[("foot", "beam")]).stands
    assert not decide(seesaw(), masses=heavy).stands


def test_gravity_may_pull_in_any_direction():
    turned = {"it": block((0.1, 0.1, 0.1))}
    assert decide(turned, up=(0, 0, -1)).how == "falls"
    beside = {"wall": Solid([Box((0.1, 1, 1), (-0.1, 0, 0))], Pose((0, 0, 0)))}
    assert decide({"it": block((0.1, 0.1, 0.1))}, beside, up=(1, 0, 0)).stands
