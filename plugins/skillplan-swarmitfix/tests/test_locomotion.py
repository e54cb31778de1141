"""From policies to ways of the base, and from ways to the timed five steps."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from skillplan.pipeline import solve
from swarm_situations import base_task, shortest_way

BENCH = swarm.Bench(rows=6, cols=13, pitch_m=0.34)
TIMINGS = swarm.Timings()
HOME = BENCH.position("C66")
positions = st.integers(0, BENCH.n_positions - 1)
tours = st.lists(positions, min_size=1, max_size=6)
# The goal positions of the paper's Table 3 and its makespans.
TABLE_3_GOALS = (42, 29, 17, 17, 17, 17, 37, 37, 37, 60, 60, 34, 18, 17, 15, 15)
TABLE_3_STEPS = (2, 1, 1, 0, 0, 0, 4, 0, 0, 3, 0, 2, 2, 1, 1, 0)


def swing_seconds(path: swarm.BasePath) -> float:
    return sum(TIMINGS.of_swing(int(BENCH.swing_deg[before, action])) for action, before, _ in path)


def tour_timeline(goals: list[int], start: int = HOME) -> tuple[swarm.Phase, ...]:
    """Return the timeline of the shortest ways from one goal position to the next."""
    ways = [shortest_way(BENCH, first, other) for first, other in pairwise([start, *goals])]
    supports = [(0.1 * index, 1.0) for index in range(len(goals))]
    return swarm.timeline(BENCH, ways, supports, home=start)


def action_between(start: str, end: str) -> int:
    successors = BENCH.successors[BENCH.position(start)].tolist()
    return int(successors.index(BENCH.position(end)))


class TestAlong:
    def test_a_plan_leads_from_position_to_position(self):
        c66, c54, c42 = (BENCH.position(name) for name in ("C66", "C54", "C42"))
        assert ((2, c66, c54), (2, c54, c42)) == swarm.along(BENCH, c66, ["B2", "B2"])

    def test_staying_adds_no_step(self):
        assert swarm.along(BENCH, HOME, ["B0", "B0"]) == ()

    def test_leaving_the_bench_is_named(self):
        with pytest.raises(ValueError, match="B5 leads off the bench from C66"):
            swarm.along(BENCH, HOME, ["B5"])


class TestWays:
    @given(positions, positions)
    def test_no_way_has_fewer_swings(self, start, goal):
        assert len(shortest_way(BENCH, start, goal)) == BENCH.distances(goal)[start]

    @pytest.mark.slow(reason="several solvers on a bench; the ways of one in every run")
    @settings(max_examples=examples(100))
    @given(positions, positions)
    def test_solvers_break_ties_in_swings_by_their_time(self, start, goal):
        """Exact search and value iteration find a fastest of the ways of fewest swings."""
        reference = swing_seconds(shortest_way(BENCH, start, goal))
        for solver in ("exact", "value-iteration"):
            result = solve(base_task(start + 1, goal + 1), solver)
            assert result.makespan_s == pytest.approx(reference)

    def test_the_papers_makespans_come_out(self):
        """Table 3: 2, 1, 1, 0, 0, 0, 4, 0, 0, 3, 0, 2, 2, 1, 1, 0."""
        stands = [HOME, *(BENCH.position(f"C{goal}") for goal in TABLE_3_GOALS)]
        steps = [len(shortest_way(BENCH, first, other)) for first, other in pairwise(stands)]
        assert list(TABLE_3_STEPS) == steps


class TestTimeline:
    @given(tours)
    def test_phases_follow_each_other_without_a_gap(self, goals):
        phases = tour_timeline(goals)
        assert phases[0].start_s == 0.0
        assert all(first.end_s == other.start_s for first, other in pairwise(phases))

    @given(tours)
    def test_each_way_is_the_five_steps_in_order(self, goals):
        """Retract, park, swing as often as it takes, approach, support; no park at rest."""
        phases = tour_timeline(goals)
        stands = [HOME, *goals]
        for index, (first, other) in enumerate(pairwise(stands)):
            swings = int(BENCH.distances(other)[first])
            middle = [swarm.FiveStep.PARK, *[swarm.FiveStep.SWING] * swings] if swings else []
            expected = [
                swarm.FiveStep.RETRACT,
                *middle,
                swarm.FiveStep.APPROACH,
                swarm.FiveStep.SUPPORT,
            ]
            mine = [phase for phase in phases if phase.sequence == index]
            assert expected == [phase.step for phase in mine]
            assert mine[-1].base == BENCH.name(other)

    @given(tours)
    def test_the_pkm_turns_against_every_swing(self, goals):
        """By as much as the base's own triangle turns about its pivot, measured on the pins."""
        for phase in tour_timeline(goals):
            if phase.swing is None:
                continue
            swing = phase.swing
            start, end = BENCH.position(swing.start), BENCH.position(swing.end)
            pivot = BENCH.pins_m[int(swing.pivot[1:]) - 1]
            before, after = BENCH.centroids_m[start] - pivot, BENCH.centroids_m[end] - pivot
            turned = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
            heading = math.degrees(turned) + swing.counter_rotation_deg
            assert math.remainder(heading, 360) == pytest.approx(0, abs=0.01)
            assert abs(swing.counter_rotation_deg) == swing.angle_deg

    @given(tours)
    def test_the_makespan_adds_up(self, goals):
        phases = tour_timeline(goals)
        total = swarm.makespan(phases)
        ways = [shortest_way(BENCH, first, other) for first, other in pairwise([HOME, *goals])]
        assert total.steps == sum(map(len, ways))
        assert total.swing_s == pytest.approx(sum(map(swing_seconds, ways)))
        assert total.duration_s == pytest.approx(sum(phase.duration_s for phase in phases))
        moved = sum(1 for way in ways if way)
        assert total.duration_s - total.swing_s == pytest.approx(1.05 * len(goals) + 0.45 * moved)

    def test_the_base_moves_in_swings_only_and_the_pkm_in_every_step(self):
        phases = tour_timeline([BENCH.position("C42"), BENCH.position("C42")])
        for phase in phases:
            assert (phase.step is swarm.FiveStep.SWING) == (swarm.Agent.BASE in phase.agents)
            assert swarm.Agent.PKM in phase.agents

    def test_the_first_swing_of_figure_2_is_told_by_names(self):
        """Leg, pin, direction and places as the bench has them; the times on top."""
        action = action_between("C66", "C54")
        way = ((action, HOME, BENCH.position("C54")),)
        phases = swarm.timeline(BENCH, [way], [(0.4, 0.6)], home=HOME)
        assert [p.step for p in phases] == ["retract", "park", "swing", "approach", "support"]
        swing = BENCH.swing(HOME, action)
        assert swing is not None
        document = phases[2].document()
        against = document["swing"].pop("counter_rotation_deg")
        assert abs(against) == swing.angle_deg
        assert document == {
            "sequence": 0,
            "step": "swing",
            "agents": ["base", "pkm"],
            "start_s": 0.75,
            "end_s": 0.75 + TIMINGS.of_swing(swing.angle_deg),
            "base": "C54",
            "swing": {
                "action": f"B{action}",
                "leg": swing.leg,
                "pivot": BENCH.pin_name(swing.pivot),
                "direction": str(swing.direction),
                "angle_deg": swing.angle_deg,
                "start": "C66",
                "end": "C54",
            },
        }
        assert phases[-1].document()["support_m"] == [0.4, 0.6]

    @given(tours)
    def test_a_document_is_json(self, goals):
        for phase in tour_timeline(goals):
            document = phase.document()
            assert json.loads(json.dumps(document, allow_nan=False)) == document

    def test_nothing_to_do_takes_no_time(self):
        assert swarm.timeline(BENCH, [], [], home=HOME) == ()
        assert swarm.makespan(()).duration_s == swarm.makespan(()).steps == 0

    def test_own_timings_count(self):
        timings = swarm.Timings(retract_s=1.0, park_s=2.0, approach_s=3.0, support_s=4.0)
        phases = swarm.timeline(BENCH, [()], [(0.0, 0.0)], timings, home=HOME)
        assert [phase.duration_s for phase in phases] == [1.0, 3.0, 4.0]

    def test_a_way_without_a_support_is_refused(self):
        with pytest.raises(ValueError, match="there are 2 paths and 1 supports"):
            swarm.timeline(BENCH, [(), ()], [(0.0, 0.0)], home=HOME)

    def test_a_way_from_elsewhere_is_refused(self):
        way = shortest_way(BENCH, 0, 5)
        with pytest.raises(ValueError, match="stands in C66, but its path goes on from C1"):
            swarm.timeline(BENCH, [way], [(0.0, 0.0)], home=HOME)

    def test_a_step_that_is_no_swing_is_refused(self):
        with pytest.raises(ValueError, match="B0 in C66 is no swing"):
            swarm.timeline(BENCH, [((0, HOME, HOME),)], [(0.0, 0.0)], home=HOME)

    def test_a_step_that_leads_elsewhere_is_refused(self):
        action = action_between("C66", "C54")
        with pytest.raises(ValueError, match="leads to C54; in the path it leads to C1"):
            swarm.timeline(BENCH, [((action, HOME, 0),)], [(0.0, 0.0)], home=HOME)


class TestTimings:
    def test_a_reposition_of_the_pkm_takes_what_the_plans_give(self):
        """0.75 to 1.62 s, with parking and without."""
        bare = TIMINGS.retract_s + TIMINGS.approach_s + TIMINGS.support_s
        assert 0.75 <= bare <= bare + TIMINGS.park_s <= 1.62

    @pytest.mark.parametrize("angle_deg", [60, 120, 180, 240, 300])
    def test_swings_take_a_start_and_an_even_pace(self, angle_deg):
        """About 3.30 s and 4.165 s for every 60 degrees."""
        expected = 3.30 + 4.165 * angle_deg / 60
        assert TIMINGS.of_swing(angle_deg) == pytest.approx(expected, abs=0.02)

    @pytest.mark.parametrize("name", ["retract_s", "park_s", "approach_s", "support_s"])
    @pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
    def test_durations_are_finite_and_not_negative(self, name, value):
        with pytest.raises(ValueError, match=f"Timings {name} must be finite and >= 0"):
            replace(TIMINGS, **{name: value})

    @pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
    def test_a_swing_takes_time(self, value):
        with pytest.raises(ValueError, match="swing_s of 60 degrees must be finite and > 0"):
            swarm.Timings(swing_s={60: value})

    def test_there_is_a_swing(self):
        with pytest.raises(ValueError, match="at least one angle"):
            swarm.Timings(swing_s={})


class TestPhase:
    def test_it_does_not_end_before_it_starts(self):
        with pytest.raises(ValueError, match=r"cannot run from 2\.0 s to 1\.0 s"):
            swarm.Phase(0, swarm.FiveStep.PARK, 2.0, 1.0, "C1")

    def test_only_a_swing_names_one(self):
        with pytest.raises(ValueError, match="names its swing if it is one; this is: swing"):
            swarm.Phase(0, swarm.FiveStep.SWING, 0.0, 1.0, "C1")

    def test_only_approach_and_support_name_a_support(self):
        with pytest.raises(ValueError, match="Only approach and support name a support"):
            swarm.Phase(0, swarm.FiveStep.PARK, 0.0, 1.0, "C1", support_m=(0.0, 0.0))
        with pytest.raises(ValueError, match="this is: approach"):
            swarm.Phase(0, swarm.FiveStep.APPROACH, 0.0, 1.0, "C1")
