"""A URDF is data: the chain from its base to a link becomes an arm, or it is said why not."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan import robots
from skillplan.xml_tree import MAX_DEPTH, MAX_ELEMENTS
from urdf_text import CAPSULE, joint, link, urdf, urdf_of


def no_mesh(name, scale):
    """Return nothing: there is no file."""
    raise robots.UrdfError(f"there is no {name}")


def read(text, tip="flange", home_rad=None, mesh=no_mesh) -> robots.ArmDescription:
    return robots.read_urdf(text.encode(), tip, home_rad, mesh)


def fault(text, tip="flange", home_rad=None) -> robots.UrdfError:
    with pytest.raises(robots.UrdfError) as caught:
        read(text, tip, home_rad)
    return caught.value


@pytest.mark.parametrize("arm", [robots.PANDA, robots.UR5E], ids=lambda arm: arm.name)
def test_a_description_that_is_written_as_a_urdf_is_read_back(arm):
    """Places of joints, axes, limits, masses and inertias; accelerations no URDF has."""
    back = read(urdf_of(arm), home_rad=arm.home_rad)
    assert [item.name for item in back.joints] == [entry.name for entry in arm.joints]
    for first, other in zip(back.joints, arm.joints, strict=True):
        assert_same(first.placement, other.placement)
        assert first.axis == other.axis
        assert (first.low_rad, first.high_rad) == (other.low_rad, other.high_rad)
        assert (first.speed_rad_per_s, first.torque_nm) == (other.speed_rad_per_s, other.torque_nm)
        assert first.link.mass_kg == pytest.approx(other.link.mass_kg)
        frame = other.link.frame
        centre = robots.Rigid.of(frame.xyz_m, frame.rpy_rad).apply(other.link.centre_m)
        assert first.link.centre_m == pytest.approx(centre)
    assert_same(back.tip, arm.tip)
    assert back.home_rad == arm.home_rad


def assert_same(this, other):
    first, second = (robots.Rigid.of(item.xyz_m, item.rpy_rad) for item in (this, other))
    assert first.origin == pytest.approx(second.origin, abs=1e-12)
    for row, its in zip(first.rows, second.rows, strict=True):
        assert row == pytest.approx(its, abs=1e-12)


@pytest.mark.parametrize("limits", ['lower="-3" upper="3"', 'lower="0.5" upper="2"'])
def test_a_home_is_found_where_none_is_given(limits):
    """Within the limits, the hand pointing down, and the same every time."""
    text = urdf({3: joint(3, limits=limits)})
    arm = read(text)
    assert all(
        low <= angle <= high
        for low, angle, high in zip(arm.low_rad, arm.home_rad, arm.high_rad, strict=True)
    )
    flange = robots.compute_link_frames(arm, np.array([arm.home_rad]))[-1][0]
    assert flange[2, 2] < -0.7
    assert read(text).home_rad == arm.home_rad


def test_a_continuous_joint_turns_once_either_way():
    """It has no limits of its own."""
    arm = read(urdf({1: joint(1, kind="continuous", limits="")}))
    assert (arm.low_rad[0], arm.high_rad[0]) == (-2 * math.pi, 2 * math.pi)


def test_what_is_fixed_to_a_link_is_part_of_it():
    """Its mass, and its shape where it is."""
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    more = link("camera", box) + (
        '<joint name="holder" type="fixed"><parent link="link_4"/><child link="camera"/>'
        '<origin xyz="0.5 0 0" rpy="0 0 0"/></joint>\n'
    )
    arm = read(urdf(more=more))
    carrier = arm.joints[3].link
    assert carrier.mass_kg == 2.0
    assert carrier.centre_m == pytest.approx((0.25, 0.0, 0.0))
    # Two bodies of 1 kg, 0.25 m from their centre across y.
    assert carrier.tensor_kg_m2[1] == pytest.approx(2 * (0.01 + 0.25**2))
    hull = arm.shapes[4][1]
    assert isinstance(hull, robots.Hull)
    assert {round(x, 6) for x, _, _ in hull.corners_m} == {0.45, 0.55}


def test_shapes_are_boxes_balls_cylinders_and_meshes():
    """Meshes are asked for by name and scale."""
    ball = (
        '<collision><origin xyz="0 0 1"/><geometry><sphere radius="0.05"/></geometry></collision>'
    )
    mesh = (
        '<collision><origin xyz="0 0 1"/><geometry>'
        '<mesh filename="a.stl" scale="2 2 2"/></geometry></collision>'
    )
    queries = []

    def pieces(name, scale):
        queries.append((name, scale))
        return [((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]

    arm = read(urdf(collisions={1: ball, 2: mesh}), mesh=pieces)
    assert arm.shapes[1] == (robots.Capsule((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 0.05),)
    assert queries == [("a.stl", (2.0, 2.0, 2.0))]
    (hull,) = arm.shapes[2]
    assert isinstance(hull, robots.Hull)
    assert hull.corners_m[0] == (0.0, 0.0, 1.0)
    (rod,) = arm.shapes[3]
    assert isinstance(rod, robots.Rod)
    assert (rod.start_m, rod.end_m) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.2))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (urdf(head="<a/>"), "junk after document element"),
        ("<sdf/>", "its root is <sdf>"),
        (urdf(more=link("flange")), "two links are called 'flange'"),
        (urdf(more="<link/>\n"), "a <link> has no name"),
        (urdf({2: joint(2, parent="nowhere")}), "'joint_2' has no parent link"),
        (urdf({2: joint(2, kind="spherical")}), "'joint_2' is spherical"),
        (urdf({2: joint(2).replace("0 1 0", "0 0 0")}), "an axis of length 0"),
        (urdf({2: joint(2).replace("0 1 0", "0 1")}), "xyz='0 1' are not three numbers"),
        (urdf({2: joint(2).replace('"2.0"', '"fast"')}), "needs a number as 'velocity'"),
        (urdf({2: joint(2).replace('"2.0"', '"nan"')}), "needs a number as 'velocity'"),
        (urdf({2: joint(2).replace('"2.0"', '"1_0"')}), "'velocity', and has '1_0'"),
        (urdf({2: joint(2).replace('"2.0"', '"\u0662"')}), "'velocity', and has '\u0662'"),
        (urdf({2: joint(2).replace('"2.0"', '"0x10"')}), "'velocity', and has '0x10'"),
        (urdf({2: joint(2, limits='lower="inf" upper="2"')}), "<limit> has inf as 'lower', where"),
        (urdf({2: joint(2).replace('"2.0"', '"1e-300"')}), "turns at 1e-300 rad/s; 1e-06 is the"),
        (urdf({2: joint(2, limits='lower="1e308" upper="2"')}), "1e+308 as 'lower', where"),
        (urdf({2: joint(2).replace("0 0 0.16", "0 0 1e308")}), "1e+308 as 'xyz', where 100 is"),
        (urdf({2: joint(2).replace("0 0 0.16", "0 0 160")}), "[m]; is the file in millimetres?"),
        (
            urdf(more=link("table", CAPSULE)),
            "no joint leads from 'link_0' to link 'table', so its place is unknown",
        ),
        (
            urdf({2: joint(2, more='<mimic joint="other"/>')}),
            "<mimic> of joint 'joint_2': there is no joint 'other'",
        ),
        (
            urdf({n: joint(n, more=f'<mimic joint="joint_{5 - n}"/>') for n in (2, 3)}),
            "<mimic> of joint 'joint_2': a loop: joint_2 follows joint_3 follows joint_2",
        ),
        (urdf().replace('value="1.0"', 'value="1e308"'), "<mass> has 1e+308 as 'value'"),
        (urdf(collisions={1: CAPSULE * 401}), "407 collision shapes, where 400 are the most"),
        (urdf().replace('value="1.0"', 'value="-1"'), "has a negative mass"),
        (urdf(collisions={1: "<collision/>"}), "has no shape"),
        (
            urdf(collisions={1: "<collision><geometry><plane/></geometry></collision>"}),
            "<plane> is no shape",
        ),
        (urdf(more="".join(link(f"more_{n}") for n in range(200))), "more than 200 links"),
        (urdf(more="<a>" * (MAX_DEPTH + 1) + "</a>" * (MAX_DEPTH + 1)), "deep"),
        (urdf(more="<a/>" * MAX_ELEMENTS), "elements"),
    ],
)
def test_what_is_no_arm_is_refused_with_its_line(text, words):
    """In words, whatever it is."""
    result = fault(text)
    assert words in str(result)
    assert result.key == "model"


@pytest.mark.parametrize("text", ["2", " 2 ", "+2.", ".2e1", "2E0", "20e-1"])
def test_numbers_are_written_as_xml_writes_them(text):
    arm = read(urdf({2: joint(2).replace('"2.0"', f'"{text}"')}))
    assert arm.joints[1].speed_rad_per_s == 2.0


PIECES = [
    b"<", b">", b'"', b"/", b"\0", b"\xff", b"nan", b"1e400", b"-", b"1e308", b"0", b"9" * 5000,
    b"<collision>", b"</link>", b"&amp;", b"&#x202e;", "\u0663".encode(), b'type="fixed"',
]  # fmt: skip


@given(
    st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 9), st.sampled_from(PIECES) | st.binary()),
        max_size=4,
    )
)
def test_any_file_is_an_arm_or_is_refused_in_words(changes):
    """Bytes are left out and others put in anywhere; numbers stay within what can be computed."""
    content = urdf().encode()
    for share, gone, piece in changes:
        start = int(share * len(content))
        content = content[:start] + piece + content[start + gone :]
    arm, refusal = None, ""
    try:
        arm = robots.read_urdf(content, "flange", None, no_mesh)
    except (robots.UrdfError, ValueError) as error:
        refusal = str(error)
    assert refusal or math.isfinite(sum(arm.low_rad) + sum(arm.high_rad) + arm.works_within_m)


def test_a_joint_beside_the_arm_stands_still():
    """As a second arm's: at the limit next to 0, its link an obstacle of the base."""
    more = link("other", CAPSULE) + joint(1, limits='lower="0.5" upper="1"').replace(
        "joint_1", "aside"
    ).replace("link_1", "other")
    arm = read(urdf(more=more.replace('xyz="0 0 0.0"', 'xyz="1 0 0"')))
    assert "joints beside the chain stand still: aside at 0.5 rad" in arm.assumptions
    _, rod = arm.shapes[0]
    assert isinstance(rod, robots.Rod)
    assert rod.start_m == pytest.approx((1.0, 0.0, 0.0))


def test_entities_are_never_expanded():
    """A file that declares any is refused before."""
    head = '<?xml version="1.0"?>\n<!DOCTYPE robot [<!ENTITY a "aaaa">]>\n'
    result = fault(urdf(head=head))
    assert result.line == 2
    assert "document type" in str(result)
