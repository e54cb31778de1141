"""The PKM's closed inverse, against its joints' constraints and the real machine's plans."""

import csv
import json
import math
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import skillplan_swarmitfix as swarm
from example_count import examples

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


# Where the PKM reaches from a base position, and what it says where it does not.


MACHINE, LIMITS, MOUNT = swarm.PkmGeometry(), swarm.PkmLimits(), swarm.Mount()
REACH = swarm.horizontal_reach_m(MACHINE, LIMITS, MOUNT)

with (Path(__file__).parent / "data" / "pkm_poses.csv").open(encoding="utf-8") as _file:
    PLANNED = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(_file)]
# The plans park at x = 0.147 m.
WORKING = [row for row in PLANNED if row["x_m"] < 0.1]


class TestRule:
    def test_a_head_within_reach_is_feasible_and_names_its_legs(self):
        verdict = swarm.rule(MACHINE, LIMITS, MOUNT, (1.0, 1.0), (1.0, 1.4))
        assert verdict.is_feasible
        assert verdict.evidence["distance_m"] == pytest.approx(0.4)
        assert verdict.evidence["azimuth_rad"] == pytest.approx(math.pi / 2)
        expected = swarm.inverse(MACHINE, MOUNT.head_pose(0.4)).legs_m
        assert verdict.evidence["legs_m"] == pytest.approx(dict(zip("ABC", expected, strict=True)))

    def test_a_leg_too_long_is_named_with_the_amount(self):
        verdict = swarm.rule(MACHINE, LIMITS, MOUNT, (0.0, 0.0), (0.5, 0.0))
        assert verdict.is_infeasible
        assert verdict.reason == (
            "leg A must be 0.358 m long, 36 mm more than its limit of 0.322 m"
        )
        evidence = verdict.evidence
        assert (evidence["leg"], evidence["limit_m"]) == ("A", 0.322)
        assert evidence["excess_m"] == pytest.approx(evidence["length_m"] - 0.322)

    def test_a_leg_too_short_is_named_with_the_amount(self):
        verdict = swarm.rule(MACHINE, LIMITS, MOUNT, (0.0, 0.0), (0.27, 0.0))
        assert verdict.is_infeasible
        assert "less than its limit of 0.241 m" in verdict.reason
        assert verdict.evidence["excess_m"] == pytest.approx(0.241 - verdict.evidence["length_m"])

    def test_the_worst_leg_is_named(self):
        """With a short limit on leg B alone it is leg B."""
        limits = replace(LIMITS, leg_b_m=(0.241, 0.287))
        verdict = swarm.rule(MACHINE, limits, MOUNT, (0.0, 0.0), (0.38, 0.0))
        assert verdict.evidence["leg"] == "B"
        assert "more than its limit of 0.287 m" in verdict.reason

    def test_less_than_a_millimetre_is_not_rounded_away(self):
        verdict = swarm.rule(MACHINE, LIMITS, MOUNT, (0.0, 0.0), (REACH[1] + 2e-4, 0.0))
        assert re.search(r" 0\.1\d mm more than its limit", verdict.reason)

    def test_a_place_no_platform_leads_to_is_infeasible_too(self):
        """A sheet so low that the wrist centre would lie behind the PKM's base."""
        verdict = swarm.rule(
            MACHINE, LIMITS, replace(MOUNT, sheet_m=0.501), (0.0, 0.0), (0.05, 0.0)
        )
        assert verdict.is_infeasible
        assert verdict.reason.startswith("the head is 0.050 m from the base's centre: The wrist")
        assert "legs_m" not in verdict.evidence

    @given(
        st.floats(0.0, 1.0),
        st.floats(-math.pi, math.pi),
        st.floats(-math.pi, math.pi),
        st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
    )
    def test_only_the_distance_counts(self, distance_m, azimuth, yaw, base):
        """Neither the direction nor the head's yaw changes what the legs must do."""
        plain = swarm.rule(MACHINE, LIMITS, MOUNT, (0.0, 0.0), (distance_m, 0.0))
        head = (base[0] + distance_m * math.cos(azimuth), base[1] + distance_m * math.sin(azimuth))
        turned = swarm.rule(MACHINE, LIMITS, MOUNT, base, head, yaw)
        margin = min(abs(distance_m - edge) for edge in REACH)
        assert plain.status is turned.status or margin < 1e-9
        if "legs_m" in plain.evidence and "legs_m" in turned.evidence:
            assert turned.evidence["legs_m"] == pytest.approx(plain.evidence["legs_m"], abs=1e-9)

    @given(st.floats(0.0, 2.0), st.floats(-math.pi, math.pi))
    def test_evidence_is_json(self, distance_m, yaw):
        verdict = swarm.rule(MACHINE, swarm.SAFE_LIMITS, MOUNT, (0.0, 0.0), (0.0, distance_m), yaw)
        assert json.loads(json.dumps(verdict.evidence, allow_nan=False)) == verdict.evidence

    @pytest.mark.parametrize(
        ("base", "head", "yaw"),
        [
            ((math.nan, 0.0), (0.0, 0.0), 0.0),
            ((0.0, 0.0), (0.0, math.inf), 0.0),
            ((0.0, 0.0), (0.0, 0.0), math.nan),
        ],
    )
    def test_what_is_not_finite_is_refused(self, base, head, yaw):
        with pytest.raises(ValueError, match="must be finite"):
            swarm.rule(MACHINE, LIMITS, MOUNT, base, head, yaw)


class TestReach:
    @given(st.floats(0.0, 0.8))
    def test_the_rule_holds_within_it_and_only_there(self, distance_m):
        verdict = swarm.rule(MACHINE, LIMITS, MOUNT, (0.0, 0.0), (distance_m, 0.0))
        assert verdict.is_feasible == (REACH[0] <= distance_m <= REACH[1])

    @pytest.mark.parametrize("side", [0, 1])
    def test_at_its_ends_a_leg_is_at_its_limit(self, side):
        legs_m = swarm.inverse(MACHINE, MOUNT.head_pose(REACH[side])).legs_m
        gaps = [abs(leg - limit) for leg in legs_m for limit in LIMITS.leg_a_m]
        assert min(gaps) < 1e-9

    @pytest.mark.slow(reason="computes the reach anew; that of the machine in every run")
    @settings(max_examples=examples(15, fewest=3))
    @given(st.floats(0.0, 0.02))
    def test_tighter_limits_never_widen_it(self, cut_m):
        minimum, most = LIMITS.leg_a_m
        tight = swarm.PkmLimits(*[(minimum + cut_m / 2, most - cut_m / 2)] * 3)
        inner = swarm.horizontal_reach_m(MACHINE, tight, MOUNT)
        assert REACH[0] - 1e-9 <= inner[0] <= inner[1] <= REACH[1] + 1e-9

    def test_it_may_start_at_the_bases_centre(self):
        """An upright PKM with no offset reaches straight up."""
        mount = swarm.Mount(tilt_rad=0.0, offset_m=0.0, height_m=0.0, sheet_m=0.44)
        minimum, most = swarm.horizontal_reach_m(MACHINE, LIMITS, mount)
        assert minimum == 0.0 < most

    def test_none_is_said_in_words(self):
        with pytest.raises(ValueError, match=r"level head 0\.700 m above its base at any distance"):
            swarm.horizontal_reach_m(MACHINE, LIMITS, replace(MOUNT, sheet_m=1.2))


class TestCalibration:
    def test_the_plans_own_reach_is_covered_with_equal_room(self):
        """0.333 to 0.451 m between base centre and head in 18 plan items."""
        room = 0.333 - REACH[0], REACH[1] - 0.451
        assert all(0.002 < value < 0.003 for value in room)
        assert abs(room[0] - room[1]) < 3e-4

    def test_the_tilt_levels_the_head_in_half_of_the_plans_poses(self):
        level = [row for row in WORKING if abs(row["beta_rad"] - MOUNT.tilt_rad) < 2e-4]
        assert (len(level), len(WORKING)) == (5, 10)

    @pytest.mark.slow(reason="computes the reach twice more; the reach itself in every run")
    def test_the_sheet_lies_where_the_reach_is_widest(self):
        def width(sheet_m: float) -> float:
            minimum, most = swarm.horizontal_reach_m(
                MACHINE, LIMITS, replace(MOUNT, sheet_m=sheet_m)
            )
            return most - minimum

        assert width(MOUNT.sheet_m) > max(width(MOUNT.sheet_m + by) for by in (-0.004, 0.004))

    def test_the_plans_poses_lie_near_the_sheet(self):
        above = MOUNT.sheet_m - MOUNT.height_m
        for row in WORKING:
            if abs(row["beta_rad"] - MOUNT.tilt_rad) < 2e-4:
                s, c = math.sin(MOUNT.tilt_rad), math.cos(MOUNT.tilt_rad)
                assert above - 0.05 < row["z_m"] * c - row["x_m"] * s < above + 0.005

    def test_the_default_limits_hold_every_leg_of_the_plans(self):
        lengths = [row[key] for row in PLANNED for key in ("l1_m", "l2_m", "l3_m")]
        minimum, most = LIMITS.leg_a_m
        assert minimum <= min(lengths) < minimum + 1e-3
        assert most - 2e-3 < max(lengths) <= most

    def test_the_safe_limits_leave_a_narrower_reach_under_a_lower_sheet(self):
        minimum, most = swarm.horizontal_reach_m(
            MACHINE, swarm.SAFE_LIMITS, replace(MOUNT, sheet_m=0.826)
        )
        assert 0.05 < most - minimum < 0.06


class TestHeadPose:
    @given(st.floats(0.0, 0.6), st.floats(-math.pi, math.pi))
    def test_the_head_is_level_and_at_the_sheet(self, distance_m, turn):
        """Seen from the bench: z up, the sheet's height, the distance, the turn."""
        pose = MOUNT.head_pose(distance_m, turn)
        tilt = swarm.zyz_matrix(0.0, MOUNT.tilt_rad, 0.0)
        place = tilt @ pose.position_m + [MOUNT.offset_m, 0.0, MOUNT.height_m]
        assert place == pytest.approx(np.array([distance_m, 0.0, MOUNT.sheet_m]), abs=1e-12)
        assert tilt @ pose.rotation == pytest.approx(swarm.zyz_matrix(turn, 0.0, 0.0), abs=1e-12)


class TestReachChecks:
    @pytest.mark.parametrize("limits_m", [(0.0, 0.3), (0.3, 0.2), (0.2, math.inf), (math.nan, 0.3)])
    def test_limits_are_ranges(self, limits_m):
        with pytest.raises(ValueError, match="PkmLimits of leg B must be finite"):
            swarm.PkmLimits(leg_b_m=limits_m)

    @pytest.mark.parametrize("name", ["tilt_rad", "offset_m", "height_m", "sheet_m"])
    def test_a_mount_is_finite(self, name):
        with pytest.raises(ValueError, match=f"Mount {name} must be finite"):
            replace(MOUNT, **{name: math.nan})

    @pytest.mark.parametrize("tilt_rad", [-0.1, math.pi / 2])
    def test_a_pkm_leans_outward_and_not_down(self, tilt_rad):
        with pytest.raises(ValueError, match="tilt_rad must be >= 0 and < pi/2"):
            swarm.Mount(tilt_rad=tilt_rad)

    @pytest.mark.parametrize("height_m", [-0.1, 0.848])
    def test_a_pkm_stands_between_bench_and_sheet(self, height_m):
        with pytest.raises(ValueError, match=r"height_m must be >= 0 and below sheet_m = 0\.848"):
            swarm.Mount(height_m=height_m)
