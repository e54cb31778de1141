"""Arms of the catalogue against figures of data sheets and of public descriptions.

Payload, reach, ranges and speeds are from the sources that each file of the catalogue names. Tips
were computed by pinocchio from descriptions of makers and ROS-Industrial: franka_description,
Universal_Robots_ROS2_Description, iiwa_description, xarm_ros, ros_kortex, abb_irb1200_support,
kuka_kr6_support and fanuc_crx_description.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import skillplan
from skillplan.robots import ARMS, compute_link_frames
from skillplan.robots.home_posture import _Solids

UR = ((-360, 360), (-360, 360), (-180, 180), (-360, 360), (-360, 360), (-360, 360))
IIWA = tuple((-angle, angle) for angle in (170, 120, 170, 120, 170, 120, 175))
GEN3 = tuple((-angle, angle) for angle in (360, 128.3, 360, 147.3, 360, 119.7, 360))
POSED_DEG = (10, 20, -30, -40, 50, 60, -70)
# Payload [kg], reach [m], ranges and speeds [degrees], and tip at zero and at `POSED_DEG` [m].
FACTS = {
    "fr3": (
        3,
        0.855,
        (
            (-157.2, 157.2),
            (-102.2, 102.2),
            (-166.2, 166.2),
            (-174.3, -8.7),
            (-160.8, 160.8),
            (31.2, 258.8),
            (-172.8, 172.8),
        ),
        (150.1, 150.1, 150.1, 150.1, 301.4, 239.5, 301.4),
        (0.088, 0.0, 0.926),
        (0.5521, 0.0127, 0.7985),
    ),
    "panda": (
        3,
        0.855,
        ((-166, 166), (-101, 101), (-166, 166), (-176, -4), (-166, 166), (-1, 215), (-166, 166)),
        (124.6, 124.6, 124.6, 124.6, 149.5, 149.5, 149.5),
        (0.088, 0.0, 0.926),
        (0.5521, 0.0127, 0.7985),
    ),
    "ur3e": (
        3,
        0.5,
        UR,
        (180, 180, 180, 360, 360, 360),
        (-0.4568, -0.2231, 0.0665),
        (-0.5082, -0.2828, 0.1048),
    ),
    "ur5e": (
        5,
        0.85,
        UR,
        (180, 180, 180, 180, 180, 180),
        (-0.8172, -0.2329, 0.0628),
        (-0.8629, -0.3525, 0.0796),
    ),
    "ur10e": (
        12.5,
        1.3,
        UR,
        (120, 120, 180, 180, 180, 180),
        (-1.1842, -0.2907, 0.0608),
        (-1.225, -0.4689, 0.0617),
    ),
    "ur20": (
        20,
        1.75,
        UR,
        (120, 120, 150, 210, 210, 210),
        (-1.5907, -0.3553, 0.077),
        (-1.6473, -0.5953, 0.0562),
    ),
    "ur30": (
        30,
        1.3,
        UR,
        (120, 120, 150, 210, 210, 210),
        (-1.1407, -0.3553, 0.077),
        (-1.2209, -0.5201, 0.0941),
    ),
    "iiwa7": (
        7,
        0.8,
        IIWA,
        (98, 98, 100, 130, 140, 180, 180),
        (0.0, 0.0, 1.266),
        (0.5772, -0.0031, 0.8884),
    ),
    "iiwa14": (
        14,
        0.82,
        IIWA,
        (85, 85, 100, 75, 130, 135, 135),
        (0.0, 0.0, 1.306),
        (0.5839, -0.0019, 0.9272),
    ),
    "xarm6": (
        5,
        0.7,
        ((-360, 360), (-118, 120), (-225, 11), (-360, 360), (-97, 180), (-360, 360)),
        (180,) * 6,
        (0.207, 0.0, 0.112),
        (0.2836, 0.0334, 0.0701),
    ),
    "xarm7": (
        3.5,
        0.7,
        ((-360, 360), (-118, 120), (-360, 360), (-11, 225), (-360, 360), (-97, 180), (-360, 360)),
        (180,) * 7,
        (0.206, 0.0, 0.1205),
        (-0.2001, 0.0995, 0.2391),
    ),
    "gen3_7dof": (
        4,
        0.902,
        GEN3,
        (80, 80, 80, 80, 70, 70, 70),
        (0.0, -0.0249, 1.1874),
        (0.1372, -0.239, 1.0564),
    ),
    "irb1200_5_90": (
        5,
        0.901,
        ((-170, 170), (-100, 130), (-200, 70), (-270, 270), (-130, 130), (-360, 360)),
        (288, 240, 300, 400, 405, 600),
        (0.533, 0.0, 0.8891),
        (0.6475, 0.0732, 0.9015),
    ),
    "kr6_r900": (
        6,
        0.9015,
        ((-170, 170), (-190, 45), (-120, 156), (-185, 185), (-120, 120), (-350, 350)),
        (360, 300, 360, 381, 388, 615),
        (0.98, 0.0, 0.435),
        (0.9118, -0.1208, 0.3145),
    ),
    "m710ic_45m": (
        45,
        2.606,
        ((-180, 180), (-90, 135), (-80.5, 205), (-360, 360), (-125, 125), (-360, 360)),
        (180, 180, 180, 250, 250, 360),
        (1.62, 0.0, 1.885),
        (1.6467, 0.2029, 0.7427),
    ),
    "m710ic_50": (
        50,
        2.05,
        ((-180, 180), (-90, 135), (-80.5, 205), (-360, 360), (-125, 125), (-360, 360)),
        (175, 175, 175, 250, 250, 355),
        (1.341, 0.0, 1.605),
        (1.3758, 0.1551, 0.6933),
    ),
    "crx10ia": (
        10,
        1.249,
        ((-190, 190), (-179.9, 179.9), (-71, 251), (-190, 190), (-179.9, 179.9), (-225, 225)),
        (120, 120, 180, 180, 180, 180),
        (0.7, -0.15, 0.785),
        (0.6205, -0.0873, 0.2584),
    ),
}


def tip_m(name: str, posture_rad) -> np.ndarray:
    return compute_link_frames(ARMS[name][0], np.array([posture_rad]))[-1][0, :3, 3]


def test_the_catalogue_has_these_arms_the_default_first():
    assert set(ARMS) == set(FACTS)
    assert len(ARMS) == len(FACTS)
    assert next(iter(ARMS)) == "panda"
    assert "kuka" not in ARMS
    with pytest.raises(KeyError):
        ARMS["kuka"]


@pytest.mark.parametrize("name", sorted(FACTS))
class TestArm:
    def test_payload_reach_ranges_and_speeds_are_those_of_the_sources(self, name):
        payload_kg, reach_m, ranges_deg, speeds_deg, _, _ = FACTS[name]
        arm, _ = ARMS[name]
        assert (arm.payload_kg, arm.reach_m) == (payload_kg, reach_m)
        low_deg, high_deg = zip(*ranges_deg, strict=True)
        assert np.degrees(arm.low_rad) == pytest.approx(low_deg, abs=0.06)
        assert np.degrees(arm.high_rad) == pytest.approx(high_deg, abs=0.06)
        assert np.degrees(arm.speed_rad_per_s) == pytest.approx(speeds_deg, abs=0.1)

    def test_the_tip_is_where_public_descriptions_have_it(self, name):
        """Descriptions that round half a turn to 3.1416 differ by up to 0.008 mm."""
        *_, zero_m, posed_m = FACTS[name]
        count = len(ARMS[name][0].joints)
        assert tip_m(name, np.zeros(count)) == pytest.approx(zero_m, abs=1e-4)
        assert tip_m(name, np.radians(POSED_DEG[:count])) == pytest.approx(posed_m, abs=1e-4)

    def test_the_hand_points_down_at_home_in_front_of_the_base(self, name):
        """Its jaws close across. The UR5e keeps its older home: along -x, jaws closing along x."""
        arm, hand = ARMS[name]
        pose = compute_link_frames(arm, np.array([arm.home_rad]))[-1][0]
        assert pose[:3, 2] == pytest.approx((0, 0, -1), abs=1e-9)
        if name == "ur5e":
            assert pose[0, 3] < -0.25
            return
        yaw = hand.on_flange.rpy_rad[2]
        closing = pose[:3, :3] @ (-math.sin(yaw), math.cos(yaw), 0.0)
        assert abs(closing[1]) == pytest.approx(1.0, abs=1e-9)
        assert pose[0, 3] > 0.25

    def test_no_links_that_are_not_neighbours_touch_at_home(self, name):
        """`find_home` keeps a posture without contacts; so is the one in the file."""
        arm, _ = ARMS[name]
        frames = compute_link_frames(arm, np.array([arm.home_rad]))
        assert _Solids(arm).find_contacts([frame[0] for frame in frames[:-1]], 0.0) == frozenset()

    def test_every_link_has_a_shape_and_none_is_beyond_the_flange_by_more_than_a_plate(self, name):
        arm, _ = ARMS[name]
        assert arm.without_shape == ()
        flange = compute_link_frames(arm, np.zeros((1, len(arm.joints))))
        inverse = np.linalg.inv(flange[-1][0]) @ flange[-2][0]
        for hull in arm.shapes[-1]:
            for corner in hull.corners_m:
                assert (inverse @ (*corner, 1.0))[2] < 0.005

    def test_the_file_names_its_sources(self, name):
        path = Path(skillplan.__file__).parent / "robots" / "arms" / f"{name}.json"
        data = json.loads(path.read_text("utf-8"))
        assert len(data["sources"]) >= 3
        assert all(isinstance(source, str) and source for source in data["sources"])
