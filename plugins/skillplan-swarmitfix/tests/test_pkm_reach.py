"""Where the PKM reaches from a base position, and what it says where it does not."""

import csv
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples

GEOMETRY, LIMITS, MOUNT = swarm.PkmGeometry(), swarm.PkmLimits(), swarm.Mount()
REACH = swarm.horizontal_reach_m(GEOMETRY, LIMITS, MOUNT)

with (Path(__file__).parent / "data" / "pkm_poses.csv").open(encoding="utf-8") as _file:
    PLANNED = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(_file)]
# The plans park at x = 0.147 m.
WORKING = [row for row in PLANNED if row["x_m"] < 0.1]


class TestRule:
    def test_a_head_within_reach_is_feasible_and_names_its_legs(self):
        verdict = swarm.rule(GEOMETRY, LIMITS, MOUNT, (1.0, 1.0), (1.0, 1.4))
        assert verdict.is_feasible
        assert verdict.evidence["distance_m"] == pytest.approx(0.4)
        assert verdict.evidence["azimuth_rad"] == pytest.approx(math.pi / 2)
        expected = swarm.inverse(GEOMETRY, MOUNT.head_pose(0.4)).legs_m
        assert verdict.evidence["legs_m"] == pytest.approx(dict(zip("ABC", expected, strict=True)))

    def test_a_leg_too_long_is_named_with_the_amount(self):
        verdict = swarm.rule(GEOMETRY, LIMITS, MOUNT, (0.0, 0.0), (0.5, 0.0))
        assert verdict.is_infeasible
        assert verdict.reason == (
            "leg A must be 0.358 m long, 36 mm more than its limit of 0.322 m"
        )
        evidence = verdict.evidence
        assert (evidence["leg"], evidence["limit_m"]) == ("A", 0.322)
        assert evidence["excess_m"] == pytest.approx(evidence["length_m"] - 0.322)

    def test_a_leg_too_short_is_named_with_the_amount(self):
        verdict = swarm.rule(GEOMETRY, LIMITS, MOUNT, (0.0, 0.0), (0.27, 0.0))
        assert verdict.is_infeasible
        assert "less than its limit of 0.241 m" in verdict.reason
        assert verdict.evidence["excess_m"] == pytest.approx(0.241 - verdict.evidence["length_m"])

    def test_the_worst_leg_is_named(self):
        """With a short limit on leg B alone it is leg B."""
        limits = replace(LIMITS, leg_b_m=(0.241, 0.287))
        verdict = swarm.rule(GEOMETRY, limits, MOUNT, (0.0, 0.0), (0.38, 0.0))
        assert verdict.evidence["leg"] == "B"
        assert "more than its limit of 0.287 m" in verdict.reason

    def test_less_than_a_millimetre_is_not_rounded_away(self):
        verdict = swarm.rule(GEOMETRY, LIMITS, MOUNT, (0.0, 0.0), (REACH[1] + 2e-4, 0.0))
        assert re.search(r" 0\.1\d mm more than its limit", verdict.reason)

    def test_a_place_no_platform_leads_to_is_infeasible_too(self):
        """A sheet so low that the wrist centre would lie behind the PKM's base."""
        verdict = swarm.rule(
            GEOMETRY, LIMITS, replace(MOUNT, sheet_m=0.501), (0.0, 0.0), (0.05, 0.0)
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
        plain = swarm.rule(GEOMETRY, LIMITS, MOUNT, (0.0, 0.0), (distance_m, 0.0))
        head = (base[0] + distance_m * math.cos(azimuth), base[1] + distance_m * math.sin(azimuth))
        turned = swarm.rule(GEOMETRY, LIMITS, MOUNT, base, head, yaw)
        margin = min(abs(distance_m - edge) for edge in REACH)
        assert plain.status is turned.status or margin < 1e-9
        if "legs_m" in plain.evidence and "legs_m" in turned.evidence:
            assert turned.evidence["legs_m"] == pytest.approx(plain.evidence["legs_m"], abs=1e-9)

    @given(st.floats(0.0, 2.0), st.floats(-math.pi, math.pi))
    def test_evidence_is_json(self, distance_m, yaw):
        verdict = swarm.rule(GEOMETRY, swarm.SAFE_LIMITS, MOUNT, (0.0, 0.0), (0.0, distance_m), yaw)
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
            swarm.rule(GEOMETRY, LIMITS, MOUNT, base, head, yaw)


class TestReach:
    @given(st.floats(0.0, 0.8))
    def test_the_rule_holds_within_it_and_only_there(self, distance_m):
        verdict = swarm.rule(GEOMETRY, LIMITS, MOUNT, (0.0, 0.0), (distance_m, 0.0))
        assert verdict.is_feasible == (REACH[0] <= distance_m <= REACH[1])

    @pytest.mark.parametrize("side", [0, 1])
    def test_at_its_ends_a_leg_is_at_its_limit(self, side):
        legs_m = swarm.inverse(GEOMETRY, MOUNT.head_pose(REACH[side])).legs_m
        gaps = [abs(leg - limit) for leg in legs_m for limit in LIMITS.leg_a_m]
        assert min(gaps) < 1e-9

    @pytest.mark.slow(reason="computes the reach anew; that of the machine in every run")
    @settings(max_examples=examples(15, fewest=3))
    @given(st.floats(0.0, 0.02))
    def test_tighter_limits_never_widen_it(self, cut_m):
        minimum, most = LIMITS.leg_a_m
        tight = swarm.PkmLimits(*[(minimum + cut_m / 2, most - cut_m / 2)] * 3)
        inner = swarm.horizontal_reach_m(GEOMETRY, tight, MOUNT)
        assert REACH[0] - 1e-9 <= inner[0] <= inner[1] <= REACH[1] + 1e-9

    def test_it_may_start_at_the_bases_centre(self):
        """An upright PKM with no offset reaches straight up."""
        mount = swarm.Mount(tilt_rad=0.0, offset_m=0.0, height_m=0.0, sheet_m=0.44)
        minimum, most = swarm.horizontal_reach_m(GEOMETRY, LIMITS, mount)
        assert minimum == 0.0 < most

    def test_none_is_said_in_words(self):
        with pytest.raises(ValueError, match=r"level head 0\.700 m above its base at any distance"):
            swarm.horizontal_reach_m(GEOMETRY, LIMITS, replace(MOUNT, sheet_m=1.2))


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
                GEOMETRY, LIMITS, replace(MOUNT, sheet_m=sheet_m)
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
            GEOMETRY, swarm.SAFE_LIMITS, replace(MOUNT, sheet_m=0.826)
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


class TestChecks:
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
