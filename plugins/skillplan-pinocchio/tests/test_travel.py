"""Travels of the arm: straight where that is free, else planned round what stands there."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cluttered_travels import cramped_travels, deepest_m
from example_count import examples
from skillplan.robots import UR5E
from skillplan.task import Box
from skillplan_pinocchio import (
    ITSELF,
    ArmBodies,
    ArmModel,
    ContinuousCheck,
    ConvexPiece,
    JointPath,
    Obstacle,
    SweptDetector,
    Travel,
    TravelHeights,
    TravelPlanner,
    Unfound,
    Unreachable,
    build_arm_solids,
    compute_box_corners,
    iterate_elbows,
)
from thinned import slow_case

ROOT = Path(__file__).parents[3]
# How far anything goes between two places that the check of its own looks at [m].
COARSE_M = 0.01


@pytest.fixture(scope="module")
def travels():
    """Return travels among bodies and pillars; half of them are blocked where they are straight."""
    return list(cramped_travels(6))


@pytest.fixture(scope="module")
def blocked(travels):
    """Return those that need a planned way."""
    results = [travel for travel in travels if not getattr(travel.answer(), "is_straight", False)]
    assert len(results) >= 2
    return results


def wall(name, size_m, centre_m, fact=None):
    """Return a box that stands somewhere."""
    return Obstacle(name, fact, (ConvexPiece(compute_box_corners(Box(size_m, centre_m))),))


@pytest.fixture(scope="module")
def arm():
    return ArmModel()


@pytest.fixture(scope="module")
def bodies(arm):
    return ArmBodies(arm.model, build_arm_solids(arm), arm.home_rad)


class TestTravels:
    @pytest.mark.slow(reason="plans; a way round in every run")
    def test_what_is_free_straight_in_joint_space_is_taken(self, travels):
        """All joints go straight, from end to end."""
        travel = next(item for item in travels if getattr(item.answer(), "is_straight", False))
        path = travel.answer().path
        assert path.nodes.tolist() == [travel.start_rad.tolist(), travel.goal_rad.tolist()]

    def test_else_a_way_round_is_planned_that_touches_nothing(self, blocked):
        """By a check that shares no code with the planner, from the same start to the same end."""
        for travel in blocked[:1]:
            answer = travel.answer()
            assert isinstance(answer, Travel)
            assert answer.around
            assert answer.path.nodes[0].tolist() == travel.start_rad.tolist()
            assert answer.path.nodes[-1].tolist() == travel.goal_rad.tolist()
            assert deepest_m(travel, answer.path, COARSE_M) > 0
            assert deepest_m(travel, JointPath([travel.start_rad, travel.goal_rad]), COARSE_M) < 0

    def test_inner_nodes_are_what_the_evidence_prints(self, blocked):
        """To the microradian: the path can be made again from it."""
        inner = blocked[0].answer().path.nodes[1:-1]
        assert inner.tolist() == inner.round(6).tolist()

    def test_a_spent_budget_is_no_proof(self, blocked):
        """Counted in postures checked."""
        travel = blocked[0]
        planner = travel.planner
        poor = TravelPlanner(planner.arm, planner.sweeps, planner.obstacles, most_checks=5)
        answer = travel.answer(poor)
        assert isinstance(answer, Unfound)
        assert not answer.is_proof
        assert answer.checks >= 5
        assert "no way round was found" in answer.reason

    def test_what_runs_into_something_at_an_end_is_a_proof(self, travels):
        """However the arm gets there: hand and load are where they are."""
        travel = travels[0]
        planner = travel.planner
        tip, _ = planner.arm.tip(travel.goal_rad)
        post = wall("post", (0.02, 0.02, 0.02), tuple(tip.tolist()), "post stands")
        walled = TravelPlanner(planner.arm, planner.sweeps, [*planner.obstacles, post])
        there = replace(travel, there=travel.there | {"post stands"})
        answer = there.answer(walled)
        assert isinstance(answer, Unfound)
        assert answer.is_proof
        assert answer.reason.endswith("runs into post where the travel ends")
        assert isinstance(travel.answer(walled), Travel)

    @pytest.mark.release(reason="500 travels, each at thousands of places; two in every run")
    def test_five_hundred_travels_penetrate_nothing(self):
        """Anything is within half a millimetre of a place looked at; most of them are found."""
        results = [
            (cramped_travel, cramped_travel.answer()) for cramped_travel in cramped_travels(500)
        ]
        paths = [(result, answer.path) for result, answer in results if isinstance(answer, Travel)]
        assert len(paths) >= 480
        assert min(deepest_m(item, path) for item, path in paths) > 0


class TestFacts:
    @settings(max_examples=examples(12))
    @given(data=st.data())
    def test_a_travel_is_the_same_wherever_the_facts_asked_for_are(self, data, travels):
        """In any state that agrees about them, by a planner that was asked nothing before."""
        travel = data.draw(st.sampled_from(travels))
        queries = {}

        def holds(fact):
            queries[fact] = fact in travel.there
            return queries[fact]

        first = travel.planner.travel(travel.start_rad, travel.goal_rad, travel.motion, holds)
        facts = sorted(
            {obstacle.fact for obstacle in travel.planner.obstacles if obstacle.fact is not None}
        )
        others = data.draw(st.sets(st.sampled_from(facts)))
        there = {fact for fact in others if queries.get(fact, True)}
        there |= {fact for fact, held in queries.items() if held}
        again = replace(travel, there=frozenset(there)).answer(travel.fresh_planner())
        assert words_of(again) == words_of(first)

    def test_bodies_that_no_way_meets_are_not_asked_for(self, travels):
        """So that a verdict serves many states."""
        travel = next(item for item in travels if getattr(item.answer(), "is_straight", False))
        queries = []
        travel.planner.travel(
            travel.start_rad, travel.goal_rad, travel.motion, lambda fact: queries.append(fact)
        )
        facts = {obstacle.fact for obstacle in travel.planner.obstacles}
        assert len(set(queries)) < len(facts) / 2


def words_of(answer):
    """Return an answer as text, paths to the bit."""
    if isinstance(answer, Unfound):
        return f"{answer.reason} {answer.is_proof}"
    return f"{answer.around} {answer.path.nodes.tobytes().hex()}"


class TestDeterminism:
    @pytest.mark.slow(reason="plans twice; one order in every run")
    def test_the_order_of_questions_changes_nothing(self, blocked):
        """To the bit, for a planner each."""
        first = [words_of(item.answer(item.fresh_planner())) for item in blocked]
        other = [words_of(entry.answer(entry.fresh_planner())) for entry in reversed(blocked)]
        assert other[::-1] == first

    @pytest.mark.slow(reason="plans three times; planners that were asked nothing in every run")
    def test_a_planner_answers_the_same_first_and_last(self, blocked):
        """To the bit, whatever it was asked in between; and again when it is asked again."""
        travel = blocked[0]
        other = replace(travel, start_rad=travel.start_rad + 0.01)
        item, two = travel.fresh_planner(), travel.fresh_planner()
        first, between, again = (words_of(each.answer(item)) for each in (travel, other, travel))
        before, last = (words_of(each.answer(two)) for each in (other, travel))
        assert first == again == last
        assert before == between

    @pytest.mark.slow(reason="another process; another order of questions in every run")
    def test_another_process_finds_the_same_and_prints_nothing(self, travels):
        """To the bit; the bindings' complaints at the end of a process are not seen.

        Not even where the collector no longer looks at what is there, as at the end of a command.
        """
        code = (
            "from cluttered_travels import cramped_travels\n"
            "from test_travel import words_of\n"
            "print([words_of(one.answer()) for one in cramped_travels(6)])\n"
            "import gc\n"
            "gc.freeze()\n"
        )
        folders = [str(ROOT / "tests" / "support"), str(Path(__file__).parent)]
        done = subprocess.run(
            [sys.executable, "-c", f"import sys; sys.path[:0] = {folders}\n{code}"],
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.strip() == str([words_of(travel.answer()) for travel in travels])
        assert done.stderr == ""


class TestContinuousCheck:
    def test_a_foil_across_the_way_is_not_passed_between_two_postures(self, arm, bodies):
        """A tenth of a millimetre thick."""
        start = arm.home_rad.copy()
        end = start + np.array([1.4, 0, 0, 0, 0, 0, 0])
        foil = wall("foil", (1.0, 1e-4, 1.0), (0.7, 0.25, 0.5))
        check = ContinuousCheck(bodies, [foil])
        hits = check.hits(JointPath([start, end]))
        assert [hit.body for hit in hits] == ["foil"]
        assert 0 < hits[0].place < 1
        assert hits[0].mover.startswith("link ")
        assert check.touched(start) == check.touched(end) == ()

    def test_everything_on_the_way_is_named_in_its_order(self, arm, bodies):
        """With the fact that it is there, also beyond the first."""
        start = arm.home_rad.copy()
        end = start + np.array([1.6, 0, 0, 0, 0, 0, 0])
        posts = [
            wall(f"post {number}", (0.03, 0.03, 1.0), centre, f"stands {number}")
            for number, centre in enumerate(
                [(0.08, 0.29, 0.5), (0.23, 0.19, 0.5), (-0.5, 0.0, 0.5)]
            )
        ]
        hits = ContinuousCheck(bodies, posts).hits(JointPath([start, end]))
        assert [(hit.body, hit.fact) for hit in hits] == [
            ("post 1", "stands 1"),
            ("post 0", "stands 0"),
        ]

    def test_the_arm_does_not_pass_through_itself(self, arm, bodies):
        """Folded until the hand's end of the forearm is in the upper arm."""
        folded = arm.home_rad.copy()
        folded[3], folded[5] = arm.low_rad[3], -0.0175
        check = ContinuousCheck(bodies, [])
        assert {hit.body for hit in check.hits(JointPath([arm.home_rad, folded]))} == {ITSELF}
        assert check.touched(folded)
        assert not check.touched(arm.home_rad)

    @settings(max_examples=examples(100))
    @given(seed=st.integers(0, 2**32 - 1))
    def test_no_point_moves_farther_than_its_bound(self, seed, arm, bodies):
        """Of any link, on any straight path of the joints."""
        rng = np.random.default_rng(seed)
        start, end = (rng.uniform(arm.low_rad, arm.high_rad) for _ in range(2))
        bound_m = bodies.reach_m @ np.abs(end - start)
        data = arm.model.createData()
        for solid, most_m in zip(bodies.solids, bound_m.tolist(), strict=True):
            way = rng.normal(size=3)
            centres, radius_m = solid.balls
            point = rng.choice(centres) + radius_m * way / np.linalg.norm(way)
            places = []
            for share in np.linspace(0, 1, 6).tolist():
                pin.forwardKinematics(arm.model, data, start + share * (end - start))
                places.append(data.oMi[solid.joint].act(point))
            away_m = np.linalg.norm(np.array(places) - places[0], axis=1)
            assert away_m.max() <= most_m + 1e-9


# How low straight travels lead.


SAFE_M = 0.2
BOARDS = ["inverter_board", "battery_module", "motor_drive", "relay_rail", "sensor_stack"]


@pytest.mark.parametrize("arm", [ArmModel(), ArmModel(description=UR5E)], ids=["panda", "ur5e"])
@settings(max_examples=examples(30), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_is_ever_lower(arm, seed):
    """Links, and points about the hand's axis, at 200 places of travels between hands down."""
    rng = np.random.default_rng(seed)
    ends = []
    while len(ends) < 2:
        away_m, bearing = rng.uniform(0.3, 0.6), rng.uniform(-1.5, 1.5)
        place = (float(away_m * np.cos(bearing)), float(away_m * np.sin(bearing)), SAFE_M)
        result = next(iter(iterate_elbows(arm, place, float(rng.uniform(-3, 3)))))
        if not isinstance(result, Unreachable):
            ends.append(result)
    width_m = 0.1
    lowest_m = TravelHeights(arm, width_m).lowest_m(*ends, SAFE_M)
    joints, centres, halves = arm.boxes
    for share in np.linspace(0, 1, 200):
        posture = ends[0] + share * (ends[1] - ends[0])
        tip, turned = arm.tip(posture)
        sideways = width_m * float(np.hypot(turned[2, 0], turned[2, 1]))
        assert tip[2] - sideways >= lowest_m - 1e-9
        rotations, origins = arm.frames([posture])
        for joint, centre, half in zip(joints, centres, halves, strict=True):
            row = rotations[0, joint][2]
            low_m = origins[0, joint, 2] + row @ centre - np.abs(row) @ half
            assert low_m >= lowest_m - 1e-9


@pytest.mark.parametrize(
    "name",
    [
        BOARDS[0],
        *(slow_case(name, reason="plans a board; one in every run") for name in BOARDS[1:]),
    ],
)
def test_no_travel_of_a_shipped_board_needs_a_check(product_task, name):
    """All of them are above everything, so that no verdict asks where the arm comes from."""
    task = product_task(name)
    detector = SweptDetector(task)
    for skill in task.skills:
        state = task.facts.state(
            skill.motion.routes[0].when.bits | skill.precondition.requires.bits
        )
        places = detector.check(skill, _standing(task, state)).facts
        assert not any(fact.removeprefix("not ").startswith("at(") for fact in places)


def _standing(task, state):
    """Return a state in which it is known where the arm stands, and with which tool."""
    bits = state.bits
    for group in task.facts.exclusive:
        if not any(bits & task.facts.bit(fact) for fact in group):
            bits |= task.facts.bit(next(iter(group)))
    return task.facts.state(bits)
