"""The PKM's closed inverse, against its joints' constraints and the real machine's plans."""

import csv
import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import skillplan_swarmitfix as swarm

GEOMETRY = swarm.PkmGeometry()
UPRIGHT = swarm.Pose6(0.0, 0.0, 0.45, 0.0, 0.0, 0.0)

with (Path(__file__).parent / "data" / "pkm_poses.csv").open(encoding="utf-8") as _file:
    PLANNED = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(_file)]


def planned_pose(row: dict[str, float]) -> swarm.Pose6:
    return swarm.Pose6(*(row[field.name] for field in fields(swarm.Pose6)))


def planned_legs(row: dict[str, float]) -> list[float]:
    return [row["l1_m"], row["l2_m"], row["l3_m"]]


angles = st.floats(-math.pi, math.pi)
poses = st.builds(
    swarm.Pose6,
    st.floats(-0.3, 0.3),
    st.floats(-0.3, 0.3),
    st.floats(0.1, 0.6),
    angles,
    angles,
    angles,
)

# A quarter of these poses are within reach of the legs; of poses at limits even fewer.
most_are_out_of_reach = settings(
    suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow]
)


def reachable(pose: swarm.Pose6) -> swarm.PkmJoints:
    """Return the joints of a pose, or tell hypothesis that it is none of the PKM's."""
    try:
        joints = swarm.inverse(GEOMETRY, pose)
    except swarm.OutsideWorkspace:
        joints = None
    assume(joints is not None and all(0.2 < length_m < 0.4 for length_m in joints.legs_m))
    assert joints is not None
    return joints


def platform_of(joints: swarm.PkmJoints) -> swarm.Matrix:
    """Return the platform's axes as turns: the plane about y, then b within it."""
    plane = np.array(
        [
            [math.sin(joints.a_rad), 0.0, -math.cos(joints.a_rad)],
            [0.0, 1.0, 0.0],
            [math.cos(joints.a_rad), 0.0, math.sin(joints.a_rad)],
        ]
    )
    c, s = math.cos(joints.b_rad), math.sin(joints.b_rad)
    return np.asarray(plane @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]))


class TestMachine:
    @pytest.mark.parametrize("row", PLANNED)
    def test_legs_of_the_machines_plans_come_out_within_a_millimetre(self, row):
        legs_m = swarm.inverse(GEOMETRY, planned_pose(row)).legs_m
        assert_allclose(legs_m, planned_legs(row), rtol=0, atol=1e-3)
        # Only leg C differs by more than the plans' six digits.
        assert_allclose(legs_m[:2], planned_legs(row)[:2], rtol=0, atol=1.5e-6)

    @pytest.mark.parametrize("row", PLANNED)
    def test_the_machines_poses_close(self, row):
        pose = planned_pose(row)
        back = swarm.forward(GEOMETRY, swarm.inverse(GEOMETRY, pose))
        assert_allclose(back.position_m, pose.position_m, rtol=0, atol=1e-12)
        assert_allclose(back.rotation, pose.rotation, rtol=0, atol=1e-12)

    def test_there_are_sixteen_of_them(self):
        assert len(PLANNED) == 16


class TestClosure:
    @given(poses)
    @most_are_out_of_reach
    def test_forward_undoes_inverse(self, pose):
        """Forward solves the constraints from the legs and shares no formula with inverse."""
        back = swarm.forward(GEOMETRY, reachable(pose))
        assert_allclose(back.position_m, pose.position_m, rtol=0, atol=1e-9)
        assert_allclose(back.rotation, pose.rotation, rtol=0, atol=1e-9)

    @given(poses)
    @most_are_out_of_reach
    def test_the_joints_of_the_tripod_allow_the_platform(self, pose):
        """Legs A, C stay in the plane across x', leg B across y', the wrist on z'."""
        joints = reachable(pose)
        platform = platform_of(joints)
        centre = pose.position_m - GEOMETRY.head_offset_m * pose.rotation[:, 2]
        origin = centre - GEOMETRY.wrist_offset_m * platform[:, 2]
        legs = origin + GEOMETRY.platform_points_m @ platform.T - GEOMETRY.base_points_m
        assert_allclose(np.linalg.norm(legs, axis=1), joints.legs_m, rtol=0, atol=1e-12)
        assert_allclose(legs[[0, 2]] @ platform[:, 0], 0.0, rtol=0, atol=1e-12)
        assert_allclose(legs[1] @ platform[:, 1], 0.0, rtol=0, atol=1e-12)
        assert_allclose(platform[1, 0], 0.0, rtol=0, atol=1e-12)
        assert joints.h_m == pytest.approx(float(origin @ platform[:, 2]), abs=1e-12)

    @given(poses)
    @most_are_out_of_reach
    def test_the_wrist_turns_the_platform_into_the_head(self, pose):
        joints = reachable(pose)
        head = platform_of(joints) @ swarm.zyz_matrix(*joints.wrist_rad)
        assert_allclose(head, pose.rotation, rtol=0, atol=1e-12)
        assert 0.0 <= joints.wrist_rad[1] <= math.pi

    @given(poses)
    @most_are_out_of_reach
    def test_a_mirrored_pose_swaps_legs_a_and_c(self, pose):
        """The tripod is symmetric about its xz plane."""
        joints = reachable(pose)
        mirror = np.diag([1.0, -1.0, 1.0])
        mirrored = swarm.Pose6.of(mirror @ pose.position_m, mirror @ pose.rotation @ mirror)
        assert_allclose(
            swarm.inverse(GEOMETRY, mirrored).legs_m, joints.legs_m[::-1], rtol=0, atol=1e-12
        )

    def test_forward_reads_the_driven_joints_only(self):
        joints = swarm.inverse(GEOMETRY, planned_pose(PLANNED[0]))
        blind = replace(joints, a_rad=0.0, b_rad=0.0, h_m=0.0)
        assert swarm.forward(GEOMETRY, joints) == swarm.forward(GEOMETRY, blind)

    @given(
        st.builds(
            swarm.PkmGeometry,
            *(st.floats(0.03, 0.08) for _ in range(2)),
            st.floats(0.12, 0.25),
            st.floats(0.06, 0.11),
            *(st.floats(0.0, 0.15) for _ in range(2)),
        ),
        st.floats(-0.05, 0.05),
        st.floats(-0.05, 0.05),
    )
    def test_other_lengths_close_as_well(self, geometry, x_m, y_m):
        z_m = 0.28 + geometry.wrist_offset_m + geometry.head_offset_m
        pose = swarm.Pose6(x_m, y_m, z_m, 0.3, 0.2, 0.1)
        back = swarm.forward(geometry, swarm.inverse(geometry, pose))
        assert_allclose(back.position_m, pose.position_m, rtol=0, atol=1e-9)

    def test_upright_legs_are_what_pythagoras_says(self):
        joints = swarm.inverse(GEOMETRY, UPRIGHT)
        h_m = 0.45 - 0.0725 - 0.0905
        assert joints.legs_m == pytest.approx((h_m, math.hypot(h_m, 0.18 - 0.086), h_m))
        assert (joints.a_rad, joints.b_rad) == pytest.approx((math.pi / 2, 0.0))
        assert joints.h_m == pytest.approx(h_m)


class TestWorkspace:
    @pytest.mark.parametrize(
        ("pose", "claim"),
        [
            (swarm.Pose6(0.0, 0.0, -0.2, 0, 0, 0), "behind the PKM's base"),
            (swarm.Pose6(0.0, 0.0, 0.0725, 0, 0, 0), "behind the PKM's base"),
            (swarm.Pose6(0.12, 0.0, 0.0925, 0, 0, 0), "platform would turn over"),
            (swarm.Pose6(0.0, 0.0, 0.12, 0, 0, 0), "behind the line AC"),
            (swarm.Pose6(-0.1, 0.3, 0.2, 0, 0, 0), "singularity"),
        ],
    )
    def test_a_pose_outside_is_refused_in_words(self, pose, claim):
        with pytest.raises(swarm.OutsideWorkspace, match=claim):
            swarm.inverse(GEOMETRY, pose)

    def test_legs_that_do_not_close_are_refused(self):
        joints = replace(swarm.inverse(GEOMETRY, UPRIGHT), legs_m=(0.2, 0.9, 0.2))
        with pytest.raises(swarm.OutsideWorkspace, match=r"B 0\.9000 m.*do not close"):
            swarm.forward(GEOMETRY, joints)


class TestAngles:
    @given(angles, angles, angles)
    def test_zyz_angles_give_their_matrix_back(self, a, b, c):
        matrix = swarm.zyz_matrix(a, b, c)
        assert_allclose(swarm.zyz_matrix(*swarm.zyz_angles(matrix)), matrix, rtol=0, atol=1e-14)

    @given(angles, st.floats(-1e-7, 1e-7), angles, st.booleans())
    def test_so_they_do_where_the_middle_axis_is_lost(self, a, b, c, over):
        """Only the sum, or the difference, of the outer angles counts there."""
        matrix = swarm.zyz_matrix(a, b + math.pi * over, c)
        assert_allclose(swarm.zyz_matrix(*swarm.zyz_angles(matrix)), matrix, rtol=0, atol=1e-14)

    def test_a_quarter_turn_about_y_leads_z_to_x(self):
        assert_allclose(swarm.zyz_matrix(0.0, math.pi / 2, 0.0) @ [0, 0, 1], [1, 0, 0], atol=1e-15)


class TestChecks:
    @pytest.mark.parametrize("name", [field.name for field in fields(swarm.PkmGeometry)])
    @pytest.mark.parametrize("value", [-0.01, math.nan, math.inf])
    def test_lengths_are_positive_and_finite(self, name, value):
        with pytest.raises(ValueError, match=f"PkmGeometry {name} must be finite"):
            replace(GEOMETRY, **{name: value})

    def test_only_offsets_may_be_zero(self):
        assert replace(GEOMETRY, wrist_offset_m=0.0).wrist_offset_m == 0.0
        with pytest.raises(ValueError, match="base_arm_m must be finite and > 0, not 0"):
            replace(GEOMETRY, base_arm_m=0.0)

    @pytest.mark.parametrize("name", [field.name for field in fields(swarm.Pose6)])
    def test_poses_are_finite(self, name):
        with pytest.raises(ValueError, match=f"Pose6 {name} must be finite, not nan"):
            replace(UPRIGHT, **{name: math.nan})

    @pytest.mark.parametrize(
        ("change", "claim"),
        [
            ({"legs_m": (0.3, 0.0, 0.3)}, "leg B must be finite and > 0"),
            ({"legs_m": (math.inf, 0.3, 0.3)}, "leg A must be finite and > 0"),
            ({"wrist_rad": (0.0, math.nan, 0.0)}, "six finite values"),
            ({"wrist_rad": (0.0, 0.0)}, "six finite values"),
            ({"h_m": math.inf}, "six finite values"),
        ],
    )
    def test_joints_are_finite(self, change, claim):
        joints = swarm.inverse(GEOMETRY, UPRIGHT)
        with pytest.raises(ValueError, match=claim):
            replace(joints, **change)  # type: ignore[arg-type]
