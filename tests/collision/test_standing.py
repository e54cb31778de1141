"""Which bodies stand by themselves."""

from __future__ import annotations

import math
from itertools import product

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from skillplan.collision import Solid, decide_standing, find_touches, weigh
from skillplan.task import Box, Cylinder, Mesh, Pose

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


@pytest.mark.parametrize(("thick_mm", "stands"), [(1.5, False), (8, True)], ids=["sheet", "block"])
def test_a_sheet_on_a_ledge_tips_although_a_pin_goes_through_it(thick_mm, stands):
    """With the play of its hole the sheet tilts before both rims of the hole meet the pin."""
    thick_m, wide_m = thick_mm / 1e3, 0.095
    walls = [
        Box((wide_m, 0.2, thick_m), (side * (0.01 + wide_m) / 2, 0, thick_m / 2))
        for side in (-1, 1)
    ]
    walls += [
        Box((0.01, wide_m, thick_m), (0, side * (0.01 + wide_m) / 2, thick_m / 2))
        for side in (-1, 1)
    ]
    firm = {"ledge": block((0.01, 0.2, 0.05), (0.095, 0, -0.05)), "pin": block((0.01, 0.01, 0.05))}
    assert decide({"it": Solid(walls, Pose((0, 0, 0)))}, firm).stands is stands


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


def lathe(profile_m, shift_m=(0, 0, 0), turn=(0, 0, 0)):
    """Return a turned part: a closed outline of radii and heights, anticlockwise, about z."""
    count, size = 24, len(profile_m)
    corners = tuple(
        (r_m * math.cos(angle), r_m * math.sin(angle), z_m)
        for angle in (2 * math.pi * i / count for i in range(count))
        for r_m, z_m in profile_m
    )
    faces = []
    for i, j in product(range(count), range(size)):
        a, b = i * size + j, i * size + (j + 1) % size
        c, d = ((i + 1) % count * size + k % size for k in (j + 1, j))
        faces += [(a, d, c), (a, c, b)]
    return Solid([Mesh(corners, tuple(faces), convex=False)], Pose.turned(shift_m, turn))


def extrude(outline_m, thickness_m):
    """Return a plate on its edge, in front of y = 0: a convex outline of x and z, anticlockwise."""
    count = len(outline_m)
    corners = [(x_m, y_m, z_m) for y_m in (-thickness_m, 0) for x_m, z_m in outline_m]
    faces = [(0, i, i + 1) for i in range(1, count - 1)]
    faces += [(count, count + i + 1, count + i) for i in range(1, count - 1)]
    for i in range(count):
        j = (i + 1) % count
        faces += [(i, i + count, j + count), (i, j + count, j)]
    return Solid([Mesh(tuple(corners), tuple(faces))], Pose((0, 0, 0)))


@pytest.mark.parametrize("chamfer_m", [0.0, 2e-4, 5e-4])
@pytest.mark.parametrize("lean", [0.0, 0.2])
def test_posts_behind_a_plate_on_its_edge_do_not_keep_it_from_falling_forwards(chamfer_m, lean):
    """Neither their chamfers nor their rims, at slanted sides of the plate, bear it."""
    rim_m = 0.017 - 2.4 * chamfer_m
    outline_m = [(1e-6, 0), (0.017, 0), (0.017, 0.015 - chamfer_m), (rim_m, 0.015), (1e-6, 0.015)]
    posts = {
        f"post_{x_m:+}": lathe(outline_m, (x_m, 0.0151, 0.058), (math.pi / 2, 0, 0))
        for x_m in (-0.073, 0.073)
    }
    low_m, high_m = (0.073 + rim_m + lean * (z_m - 0.058) for z_m in (0, 0.134))
    plate = extrude([(-low_m, 0), (low_m, 0), (high_m, 0.134), (-high_m, 0.134)], 0.002)
    tipped = decide({"plate": plate}, {"table": TABLE, **posts})
    assert tipped.how == "tips"
    assert tipped.towards[1] < -0.99
    front = block((0.2, 0.01, 0.08), (0, -0.007, 0))
    assert decide({"plate": plate}, {"table": TABLE, "front": front, **posts}).stands


@pytest.mark.parametrize(("head_m", "stands"), [(0.008, True), (0.0049, False)])
def test_a_countersunk_peg_hangs_by_its_head_alone(head_m, stands):
    """A chamfer bears the chamfer above it; that of a hole bears no peg that passes through it."""
    ring = lathe([(0.005, 0), (0.02, 0), (0.02, 0.02), (0.008, 0.02), (0.005, 0.017)])
    neck_m = 0.02 - (head_m - 0.0049)
    peg = lathe([(1e-6, 0.005), (0.0049, 0.005), (0.0049, neck_m), (head_m, 0.02), (1e-6, 0.02)])
    assert decide({"peg": peg}, {"ring": ring}).stands is stands


@settings(max_examples=20, deadline=None)
@given(st.floats(-0.03, 0.03), st.floats(0.01, 0.05), st.floats(0.01, 0.04), st.floats(-3, 3))
def test_a_box_stands_on_a_ledge_if_and_only_if_its_middle_is_over_it(
    beyond_m, width_m, height_m, yaw_rad
):
    assume(abs(beyond_m) > 0.002)
    pose = Pose.upright((0, 0, 0), yaw_rad)
    ledge = Solid([Box((0.2, 0.2, 0.02), (-0.1, 0, -0.01))], pose)
    box = Solid([Box((width_m, 0.03, height_m), (beyond_m, 0.02, height_m / 2))], pose)
    assert decide({"box": box}, {"ledge": ledge}).stands is (beyond_m < 0)


@pytest.mark.parametrize("level_m", [-1.5e-4, 0, 1.5e-4])
@pytest.mark.parametrize("gap_m", [-1e-4, 0, 1e-4])
def test_rims_bear_no_box_between_them(level_m, gap_m):
    ledges = {
        f"ledge_{side}": block((0.1, 0.1, 0.05), (side * (0.07 + gap_m), 0, 0)) for side in (-1, 1)
    }
    box = block((0.04, 0.04, 0.03), (0, 0, 0.05 + level_m))
    assert decide({"box": box}, ledges).stands is False


@settings(max_examples=10, deadline=None)
@given(st.floats(20, 70), st.floats(20, 70), st.floats(0.005, 0.05))
def test_a_rod_stays_in_a_groove_and_leaves_a_slope(left_deg, right_deg, radius_m):
    slopes = {}
    for side, slope_deg in ((-1, left_deg), (1, right_deg)):
        slope = Box((0.4, 0.4, 0.02), (side * 0.2, 0, -0.01))
        slopes[f"slope_{side}"] = Solid(
            [slope], Pose.turned((0, 0, 0), (0, -side * math.radians(slope_deg), 0))
        )
    # Its axis is at the same distance from both slopes.
    tilt, half = (math.radians(left_deg - right_deg) / 2, math.radians(left_deg + right_deg) / 2)
    reach_m = radius_m / math.cos(half)
    at_m = (reach_m * math.sin(tilt), 0, reach_m * math.cos(tilt))
    rod = Solid([Cylinder(2 * radius_m, 0.1, (0, 0, 0))], Pose.turned(at_m, (math.pi / 2, 0, 0)))
    assert decide({"rod": rod}, slopes).reason == ""
    assert not decide({"rod": rod}, {"slope": slopes["slope_1"]}).stands


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
