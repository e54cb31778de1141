"""What is said of a bench job beyond its plans: supports, goals, limits of the machine, steps."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from skillplan.files import find_json_fault
from skillplan.pipeline import load_problem, solve, solve_chain
from skillplan_swarmitfix import Job, SwarmitfixConfig, account

CONFIGS = Path(__file__).parents[3] / "configs"
STEPS = ("retract", "park", "swing", "approach", "support")
FLEET = {"one": {"home": "C1", "goal": "C27"}, "two": {"home": "C13", "goal": "C39"}}


def job_of(plans: dict[str, tuple[str, ...]] | None = None, **keys: Any) -> Job:
    config = SwarmitfixConfig.model_validate({"kind": "swarmitfix", "name": "job", **keys})
    return Job(config, plans)


@pytest.fixture(scope="module")
def goals_job():
    """C66 to C42 in two swings, then a stay, then to C29 in one."""
    plans = {"base-1": ("B2", "B2"), "base-2": (), "base-3": ("B1",)}
    return job_of(plans, base={"home": "C66", "goals": ["C42", "C42", "C29"]})


@pytest.fixture(scope="module")
def pentagon():
    """A trajectory on which some paths between supports are split, as in the paper."""
    as_in_paper = {"base.reachable": "ignored"}
    problem = load_problem(CONFIGS / "swarmitfix_pentagonal.yaml", {}, as_in_paper)
    return solve_chain(problem, "exact").account


class TestFiveSteps:
    def test_a_way_is_retract_park_swings_approach_support(self, goals_job):
        """Where the base stays there is nothing to park for."""
        timeline = account(goals_job).document["timeline"]
        results: dict[int, list[str]] = {}
        for phase in timeline:
            results.setdefault(phase["sequence"], []).append(phase["step"])
        assert list(results.values()) == [
            ["retract", "park", "swing", "swing", "approach", "support"],
            ["retract", "approach", "support"],
            ["retract", "park", "swing", "approach", "support"],
        ]

    def test_the_makespan_is_the_end_of_the_last_step(self, goals_job):
        """Swings of 120, 120 and 60 degrees, and the machine's steps in between."""
        summary = account(goals_job)
        swings_s = 2 * 11.63 + 7.47
        assert swings_s == pytest.approx(summary.document["makespan_swings_s"])
        assert summary.makespan_s == summary.document["timeline"][-1]["end_s"]
        assert swings_s + 3 * (0.3 + 0.45 + 0.3) + 2 * 0.45 == pytest.approx(summary.makespan_s)

    def test_staying_actions_take_no_swing(self):
        """B0 is an action, but the base does not move."""
        stays = job_of({"base-1": ("B0", "B2", "B0", "B2")}, base={"home": "C66", "goals": ["C42"]})
        steps = [phase["step"] for phase in account(stays).document["timeline"]]
        assert steps.count("swing") == 2

    def test_without_the_ways_there_is_no_timeline(self):
        """Nor one of a plan that ends elsewhere, which the referee has refuted."""
        for plans in ({}, {"base-1": ("B1",)}):
            summary = account(job_of(plans, base={"home": "C66", "goals": ["C42"]}))
            assert summary.makespan_s is None
            assert "timeline" not in summary.document
            assert summary.appendix == {}

    def test_the_appendix_has_a_row_for_every_step(self, goals_job):
        summary = account(goals_job)
        listing = summary.appendix["timeline.csv"]
        timeline = summary.document["timeline"]
        assert len(timeline) == len(listing.rows)
        assert {row[1] for row in listing.rows} == set(STEPS)
        swing = next(row for row in listing.rows if row[1] == "swing")
        assert "B2 C66 to C54: leg" in swing[-1]


class TestSupports:
    @pytest.mark.slow(reason="a curve; goals of the paper in every run")
    def test_every_goal_is_one_of_its_candidates(self, pentagon):
        for number, goal in enumerate(pentagon.document["goals"], start=1):
            assert number == goal["sequence"]
            assert goal["goal"] in goal["candidates"]

    def test_supports_follow_one_another(self, pentagon):
        """Each begins where the one before ends; the last leads back to the first."""
        supports = [goal["support_m"] for goal in pentagon.document["goals"]]
        for (_, end), (begin, _) in zip(supports, [*supports[1:], supports[0]], strict=True):
            assert end == pytest.approx(begin)

    def test_a_split_puts_a_head_in_between(self, pentagon):
        """On the way, marked as inserted; every support has a head."""
        heads, goals = pentagon.document["heads"], pentagon.document["goals"]
        assert len(goals) == len(heads)
        for head, goal in zip(heads, goals, strict=True):
            assert head["position_m"] == pytest.approx(goal["support_m"][0])
        inserted = [head for head in heads if head["inserted"]]
        assert len(inserted) == sum(goal["how"] == "split" for goal in goals) - _split_pairs(goals)
        assert all(0 <= head["yaw_rad"] < 2 * math.pi / 3 for head in heads)

    def test_what_was_split_is_said_below_the_table(self, pentagon):
        """Each by its number, and how many there are."""
        (listing,) = pentagon.listings
        split = [goal for goal in pentagon.document["goals"] if goal["how"] == "split"]
        message = "\n".join(listing.notes)
        assert (
            f"{len(split)} of {len(listing.rows)} supports have no position by Eqs 1-4" in message
        )
        for goal in split:
            assert f"support {goal['sequence']}: {goal['note']}" in listing.notes

    def test_the_workpiece_is_described(self, pentagon):
        """Five vertices, and as many straight segments, of which the lengths add up."""
        workpiece = pentagon.document["workpiece"]
        assert (workpiece["closed"], len(workpiece["vertices"]), len(workpiece["segments"])) == (
            True,
            5,
            5,
        )
        total_m = sum(segment["length_m"] for segment in workpiece["segments"])
        assert workpiece["length_m"] == pytest.approx(total_m)
        assert workpiece["points_m"][0] == pytest.approx(workpiece["points_m"][-1])

    def test_it_is_json(self, pentagon):
        assert find_json_fault(pentagon.document) is None


class TestSampling:
    def test_the_deviation_of_sampled_curves_is_stated(self):
        """A half circle of 0.3 m radius to 1 mm: a chord of angle w is off by 0.3 (1 - cos w/2)."""
        path = [{"arc_to_m": [1.5, 0.8], "through_m": [1.2, 1.1]}]
        trajectory = {"start_m": [0.9, 0.8], "path": path}
        summary = account(job_of(trajectory=trajectory))
        chords = summary.document["sampling"]["chords"]
        off_m = 0.3 * (1 - math.cos(math.pi / chords / 2))
        assert off_m == pytest.approx(summary.document["sampling"]["deviation_m"])
        message = f"curves sampled to {chords} chords, at most {off_m * 1e3:.2g} mm off"
        assert message in "\n".join(summary.listings[0].notes)

    def test_of_straight_lines_nothing_is_said(self):
        summary = account(job_of(trajectory={"vertices_m": [[0.7, 0.5], [1.4, 0.9]]}))
        assert summary.document["sampling"] == {"chords": 0, "deviation_m": 0.0}
        assert "sampled" not in "\n".join(summary.listings[0].notes)


class TestMachine:
    def test_a_reach_beyond_the_legs_is_told_with_the_leg(self):
        """Legs of hardly any stroke reach nothing, and the table says so if that is ignored."""
        content = {
            "trajectory": {"vertices_m": [[0.7, 0.5], [1.4, 0.9]]},
            "base": {"side": "left", "reachable": "ignored"},
            "pkm": {"leg_limits_m": {"A": [0.300, 0.301]}},
        }
        summary = account(job_of(**content))
        rulings = [goal["pkm"] for goal in summary.document["goals"]]
        assert {"infeasible"} == {ruling["status"] for ruling in rulings}
        assert all("leg A" in ruling["reason"] for ruling in rulings)
        message = "\n".join(summary.listings[0].notes)
        assert f"{len(rulings)} of {len(rulings)} supports are beyond its legs' limits" in message

    def test_the_bound_is_that_of_the_best_rule(self):
        """Whatever rule the file asks for."""
        content = {"trajectory": {"vertices_m": [[0.7, 0.5], [1.4, 0.9]]}}
        bounds = {
            account(job_of(**content, base={"side": "left", "goal_choice": rule})).lower_bound
            for rule in ("whole-trajectory", "fewest-steps", "nearest-centroid")
        }
        assert len(bounds) == 1


class TestFleet:
    def test_before_it_is_solved_only_bounds_are_known(self):
        summary = account(job_of(robots=FLEET))
        assert (
            summary.document["independent_bound_sum"],
            summary.document["independent_bound_max"],
        ) == (4, 2)
        assert summary.listings == ()
        assert summary.makespan_s is None

    def test_swings_run_side_by_side_where_no_pin_is_shared(self):
        """Both bases go two rows down, each on its own side of the bench."""
        chain = solve_chain_of_fleet(FLEET)
        document = account(chain).document
        assert (document["parallel_makespan"], document["simulated"]) == (2, "valid")
        assert [len(step) for step in document["schedule"]] == [2, 2]
        assert [[robot["path"][0], robot["path"][-1]] for robot in document["robots"]] == [
            ["C1", "C27"],
            ["C13", "C39"],
        ]
        assert account(chain).makespan_s == pytest.approx(longest_swings_s(chain, document))

    def test_a_plan_that_collides_is_found_out_by_the_simulator(self):
        """One base swings through the pins on which the other stands."""
        robots = {"one": {"home": "C1", "goal": "C5"}, "two": {"home": "C3", "goal": "C3"}}
        summary = account(job_of({"job": ("one.B10", "one.B10")}, robots=robots))
        assert summary.document["simulated"] != "valid"
        assert "two" in summary.document["simulated"]
        assert summary.listings[0].notes[-1].endswith(summary.document["simulated"])


def _split_pairs(goals: list[dict[str, Any]]) -> int:
    """Return how many pairs of supports were split, by the pairs that their notes name."""
    return len({goal["note"].partition("way between ")[2].split(";")[0] for goal in goals} - {""})


def solve_chain_of_fleet(robots: dict[str, dict[str, str]]) -> Job:
    """Return the job of a fleet with the plan that the solver `fleet` finds."""
    (task,) = job_of(robots=robots).tasks("")
    plan = tuple(step.skill for step in solve(task, "fleet").steps)
    return job_of({"job": plan}, robots=robots)


def longest_swings_s(job: Job, document: dict[str, Any]) -> float:
    """Return the time of the schedule, every step as long as its longest swing [s]."""
    bench = job.bench
    return sum(
        max(
            job.timings.swing_s[int(bench.swing_deg[bench.position(before), int(action[1:])])]
            for _, action, before, _ in step
        )
        for step in document["schedule"]
    )
