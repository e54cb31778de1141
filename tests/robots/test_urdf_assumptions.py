"""A URDF that leaves something out is read, and each assumption is a sentence."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan import robots
from urdf_text import CAPSULE, joint, link, urdf

HOME = [0.1] * 6


def read(text, tip="flange", home_rad=HOME):
    return robots.read_urdf(text.encode(), tip, home_rad, lambda name, scale: [])


def finger(name, more="", parent="flange"):
    """Return a link that turns on another one."""
    return link(f"{name}_link") + (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/>'
        f'<child link="{name}_link"/><axis xyz="1 0 0"/>'
        f'<limit lower="0" upper="0.8" effort="5" velocity="1"/>{more}</joint>\n'
    )


def test_a_whole_file_needs_no_assumption():
    higher = CAPSULE.replace("0 0 0.1", "0 0 0.2")
    assert read(urdf(collisions={1: higher})).assumptions == ()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (urdf().replace('velocity="2.0"', ""), "no speed of joint_1, joint_2, joint_3"),
        (urdf().replace('effort="100"', 'effort="0"'), "no effort of joint_1, joint_2"),
        (urdf().replace('<mass value="1.0"/>', ""), "no mass of link_1, link_2, link_3"),
        (urdf().replace('ixx="0.01"', 'ixx="9"'), "an inertia that no body has, of link_0"),
        (urdf({3: joint(3, limits='lower="-150" upper="9"')}), "limits of joint_3 (-150 to 9) rad"),
        (urdf({3: joint(3).replace('"2.0"', '"170"')}), "speeds of joint_3 (170) rad/s"),
        (urdf(more=finger("left")), "joints beyond the tip, left: left out"),
        (
            urdf(more=finger("wheel", parent="link_0")),
            "joints beside the chain stand still: wheel at 0 rad",
        ),
        (
            urdf(more=finger("bar", '<mimic joint="nothing"/>', "link_0")),
            "<mimic> of bar (there is no joint 'nothing'): passed over",
        ),
        (
            urdf(
                more=finger("left", '<mimic joint="right"/>', "link_0")
                + finger("right", '<mimic joint="left"/>', "link_0")
            ),
            "<mimic> of left (a loop: left follows right follows left), right (a loop:",
        ),
        (urdf(more=link("frame")), "links that no joint leads to from the base, frame: left out"),
        (
            urdf({3: joint(3, limits='lower="-1e16" upper="1e16"')}),
            "limits beyond 1,000,000 rad of joint_3: none, as of a continuous joint",
        ),
        (
            urdf({3: joint(3, kind="prismatic", limits='lower="-inf" upper="1"')}),
            "travel without an end of joint_3: 5 m to that side are assumed",
        ),
        (
            urdf().replace('effort="100"', 'effort="inf"'),
            "no effort of joint_1 (infinite), joint_2",
        ),
        (urdf({3: joint(3).replace('"2.0"', '"inf"')}), "no speed of joint_3 (infinite): "),
        (
            urdf(more=finger("bar", '<mimic joint="joint_2"/>', "link_1")),
            "shapes that follow a joint of the chain, bar: left out",
        ),
        (urdf(collisions={2: CAPSULE.replace("collision", "visual")}), "no <collision> of link_2"),
        (
            urdf(collisions={2: '<collision><geometry><box size="0 0 0"/></geometry></collision>'}),
            "no volume in a shape of link_2 (<box>)",
        ),
    ],
)
def test_each_assumption_is_told_by_name(text, sentence):
    assert sentence in "; ".join(read(text).assumptions)


def test_values_that_are_assumed_are_stated():
    """One rad/s, a stroke of 0.25 m/s, unknown torques and weights, a turn either way."""
    text = urdf(
        {3: joint(3, limits='lower="-150" upper="9"'), 4: joint(4, kind="prismatic")}
    ).replace('velocity="2.0" effort="100"', "")
    arm = read(text.replace('<mass value="1.0"/>', ""))
    assert arm.speed_rad_per_s == (1.0, 1.0, 1.0, 0.25, 1.0, 1.0)
    assert {item.torque_nm for item in arm.joints} == {None}
    assert {item.link for item in arm.joints} == {None}
    assert (arm.low_rad[2], arm.high_rad[2]) == (-2 * math.pi, 2 * math.pi)
    assert any(sentence.startswith("weight of the links") for sentence in arm.not_checked)


def test_a_joint_without_range_is_locked():
    """At its one angle, and no longer a joint."""
    text = urdf({3: joint(3, limits='lower="0.5" upper="0.5"')})
    arm = read(text, home_rad=[0.1] * 5)
    assert [item.name for item in arm.joints] == [f"joint_{n}" for n in (1, 2, 4, 5, 6)]
    free = read(urdf())
    posture = np.array([[0.2, -0.3, 0.4, 0.6, -0.7]])
    locked = robots.compute_link_frames(arm, posture)[-1][0]
    same = robots.compute_link_frames(free, np.insert(posture, 2, 0.5, axis=1))[-1][0]
    assert locked == pytest.approx(same, abs=1e-12)
    assert "no range of joint_3 (at 0.5 rad): locked" in arm.assumptions


@pytest.mark.parametrize(
    ("limits", "low_rad", "high_rad"),
    [
        ('lower="-1e16" upper="1e16"', -2 * math.pi, 2 * math.pi),
        ('lower="-1e16" upper="1"', -2 * math.pi, 1.0),
        ('lower="-1" upper="1e16"', -1.0, 2 * math.pi),
    ],
)
def test_a_limit_that_no_joint_reaches_is_none(limits, low_rad, high_rad):
    arm = read(urdf({3: joint(3, limits=limits)}))
    assert (arm.low_rad[2], arm.high_rad[2]) == (low_rad, high_rad)


def test_a_planar_joint_in_the_chain_is_not_told_as_one_beside_it():
    arm = read(urdf({3: joint(3, kind="planar")}), home_rad=[0.1] * 5)
    assert "joints between base and tip stand still at 0: joint_3 (planar)" in arm.assumptions
    assert not any("beside the chain" in sentence for sentence in arm.assumptions)


def test_limits_that_an_exporter_left_blank_are_refused_at_once():
    """All joints in one message, with the keys to fill in."""
    blank = urdf().replace(
        'lower="-3" upper="3" velocity="2.0" effort="100"', 'lower="0" upper="0"'
    )
    with pytest.raises(robots.UrdfError) as caught:
        read(blank)
    assert str(caught.value).endswith(
        "range, speed and torque of joint_1, joint_2, joint_3, joint_4, joint_5, joint_6 are 0; "
        "fill in lower, upper, velocity and effort of <limit>"
    )


def test_all_faults_come_in_one_message():
    text = urdf(
        {1: joint(1).replace('"2.0"', '"fast"'), 4: joint(4, limits='lower="3" upper="-3"')},
        collisions={2: "<collision/>"},
    )
    with pytest.raises(robots.UrdfError) as caught:
        read(text)
    words = str(caught.value)
    assert words.startswith("3 faults: line ")
    for part in (
        "needs a number as 'velocity'",
        "lower 3, where it must be below upper",
        "has no shape",
    ):
        assert part in words


def test_capsules_are_shapes():
    """The ends are not counted in the length (URDF 1.2)."""
    shape = CAPSULE.replace("cylinder", "capsule")
    arm = read(urdf(collisions={2: shape}))
    (capsule,) = arm.shapes[2]
    assert isinstance(capsule, robots.Capsule)
    assert capsule.start_m == pytest.approx((0.0, 0.0, 0.0))
    assert capsule.end_m == pytest.approx((0.0, 0.0, 0.2))


def test_what_hangs_beyond_the_tip_is_no_part_of_the_last_link():
    arm = read(urdf(more=finger("left", parent="flange")))
    assert arm.joints[-1].link.mass_kg == 1.0
    assert len(arm.shapes[6]) == 1


def test_a_mimic_joint_beside_the_chain_stands_where_its_leader_puts_it():
    more = finger("lead", parent="link_0").replace('lower="0" upper', 'lower="0.5" upper')
    more += finger("other", '<mimic joint="lead" multiplier="2" offset="0.1"/>', "link_0").replace(
        link("other_link"), link("other_link", CAPSULE)
    )
    arm = read(urdf(more=more))
    _, rod = arm.shapes[0]
    # Turned about x by 2 * 0.5 + 0.1.
    assert rod.end_m == pytest.approx((0.0, -0.2 * math.sin(1.1), 0.2 * math.cos(1.1)))


def test_a_follower_in_the_chain_moves_with_its_leader():
    """Its limits bind the leader, and home_rad has no number for it."""
    text = urdf({4: joint(4, more='<mimic joint="joint_3" multiplier="-2" offset="0.5"/>')})
    arm = read(text, home_rad=[0.1] * 5)
    assert arm.freedoms == 5
    assert arm.joints[3].follows == (2, -2.0, 0.5)
    assert arm.home_rad == pytest.approx((0.1, 0.1, 0.1, 0.3, 0.1, 0.1))
    assert (arm.low_rad[2], arm.high_rad[2]) == (-1.25, 1.75)
    assert (arm.low_rad[3], arm.high_rad[3]) == (-3.0, 3.0)


NUMBERS = st.floats(-1, 1).map(lambda value: round(value, 3))
TRIPLES = st.tuples(NUMBERS, NUMBERS, NUMBERS)
JOINTS = st.lists(
    st.tuples(
        st.sampled_from(["revolute", "prismatic", "continuous", "fixed"]),
        TRIPLES,
        TRIPLES,
        TRIPLES.filter(lambda axis: math.hypot(*axis) > 0.1),
        NUMBERS,
    ),
    min_size=4,
    max_size=10,
).filter(lambda rows: 4 <= sum(row[0] != "fixed" for row in rows) <= 8)


def turn(axis, angle):
    """Return a rotation by the exponential of a skew matrix, as a series."""
    x, y, z = axis
    skew = angle * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    total, term = np.eye(3), np.eye(3)
    for n in range(1, 25):
        term = term @ skew / n
        total = total + term
    return total


@given(rows=JOINTS)
@settings(max_examples=examples(60), deadline=None)
def test_the_tip_is_the_product_of_all_transforms(rows):
    """Composed by hand from the numbers of the file."""
    links = "".join(f'<link name="l{n}"/>' for n in range(len(rows) + 1))
    joints, here, posture = "", np.eye(4), []
    for n, (kind, xyz, rpy, axis, value) in enumerate(rows):
        joints += (
            f'<joint name="j{n}" type="{kind}"><parent link="l{n}"/><child link="l{n + 1}"/>'
            f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
            f'<axis xyz="{" ".join(map(str, axis))}"/>'
            '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        )
        placed, moved = np.eye(4), np.eye(4)
        placed[:3, 3] = xyz
        placed[:3, :3] = turn((0, 0, 1), rpy[2]) @ turn((0, 1, 0), rpy[1]) @ turn((1, 0, 0), rpy[0])
        unit = np.array(axis) / math.hypot(*axis)
        if kind == "prismatic":
            moved[:3, 3] = value * unit
        elif kind != "fixed":
            moved[:3, :3] = turn(unit, value)
        posture += [value] * (kind != "fixed")
        here = here @ placed @ moved
    arm = read(f"<robot>{links}{joints}</robot>", f"l{len(rows)}", posture)
    assert robots.compute_link_frames(arm, np.array([posture]))[-1][0] == pytest.approx(
        here, abs=1e-9
    )


def test_shapes_that_overlap_in_most_postures_are_not_checked():
    """A wrist in a fork: the hull of the fork fills it. Results say so."""
    fork = CAPSULE.replace('radius="0.05" length="0.2"', 'radius="0.15" length="0.6"')
    arm = read(urdf(collisions={4: fork}))
    assert (4, 6) in arm.overlaps
    assert any("link 6 with link 4" in sentence for sentence in arm.not_checked)
    assert robots.find_home(robots.PANDA).overlaps == robots.find_home(robots.UR5E).overlaps == ()


def test_shapes_of_the_first_link_end_at_the_underside_of_the_base():
    """Coarse capsules about the first axis reach deeper, where the base stands on something."""
    deep = CAPSULE.replace('length="0.2"', 'length="0.5"')
    arm = read(urdf(collisions={1: deep}))
    (hull,) = arm.shapes[1]
    heights = [z for _, _, z in hull.corners_m]
    assert (min(heights), max(heights)) == pytest.approx((0.01, 0.35))
    assert "shapes of the first link are cut at the underside of the base" in arm.assumptions


def test_links_may_have_any_name():
    text = urdf().replace('"flange"', '"/Flansch 1 (Werkzeug)"')
    assert read(text, "/Flansch 1 (Werkzeug)").freedoms == 6
