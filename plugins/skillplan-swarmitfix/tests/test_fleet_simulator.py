"""The judge of schedules: pins, and nothing but pins."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from fleet_instances import random_robots

BENCH = swarm.Bench(6, 13, 0.34, actions=13)
SMALL = swarm.Bench(3, 7, 0.34)
Swing = tuple[str, int, int, int]


def swing(robot: str, action: int, name: str) -> Swing:
    start = BENCH.position(name)
    return robot, action, start, int(BENCH.successors[start, action])


def place(name: str) -> int:
    return BENCH.position(name)


def test_the_pins_of_a_swing_follow_from_where_they_are():
    """Angles and distances say the same as the lattice's whole numbers."""
    for start in range(BENCH.n_positions):
        for action in range(1, BENCH.actions):
            if BENCH.successors[start, action] >= 0:
                assert BENCH.swept_pins(start, action) == swarm.passed_pins(BENCH, start, action)


def test_what_is_no_swing_passes_no_pins():
    with pytest.raises(ValueError, match="B5 is not a swing at C66"):
        swarm.passed_pins(BENCH, place("C66"), 5)


@pytest.mark.parametrize(("action", "angle_deg"), [(3, 60), (2, 120), (5, 180)])
def test_a_swing_keeps_its_pivot_and_passes_a_pin_more_every_60_degrees(action, angle_deg):
    assert angle_deg == BENCH.swing_deg[place("C42"), action]
    assert 3 + angle_deg // 60 == len(swarm.passed_pins(BENCH, place("C42"), action))


class TestSteps:
    def test_swings_far_apart_run_at_once(self):
        robots = {"a": (place("C66"), place("C54")), "b": (place("C78"), place("C65"))}
        assert swarm.simulate(BENCH, robots, [[swing("a", 2, "C66"), swing("b", 1, "C78")]]) is None

    def test_a_pin_that_another_docks_is_not_swept(self):
        robots = {"a": (place("C66"), place("C68")), "b": (place("C69"), place("C69"))}
        fault = swarm.simulate(BENCH, robots, [[swing("a", 10, "C66")]])
        assert fault is not None
        assert (fault.pin, fault.robots) == ("P2", ("a", "b"))
        assert str(fault) == "step 1: a by B10 sweeps P2, which b docks"

    def test_a_pin_is_not_swept_by_two_at_once(self):
        """Each could swing if the other waited: what is left in a step is not free in it."""
        robots = {"a": (place("C66"), place("C68")), "b": (place("C69"), place("C71"))}
        first, second = swing("a", 10, "C66"), swing("b", 10, "C69")
        assert swarm.simulate(BENCH, robots, [[second], [first]]) is None
        fault = swarm.simulate(BENCH, robots, [[second, first]])
        assert fault is not None
        assert fault.pin is not None
        assert "sweeps" in fault.reason.split("which")[1] or "docks" in fault.reason

    def test_overlapping_starts_are_found(self):
        fault = swarm.simulate(BENCH, {"a": (0, 0), "b": (1, 1)}, [])
        assert fault is not None
        assert str(fault) == "step 1: b docks P39, which a docks"

    def test_a_goal_that_is_not_reached_is_found(self):
        robots = {"a": (place("C66"), place("C42")), "b": (place("C78"), place("C78"))}
        fault = swarm.simulate(BENCH, robots, [[swing("a", 2, "C66")]])
        assert fault is not None
        assert str(fault) == "step 2: a ends at C54, not at its goal C42"

    @pytest.mark.parametrize(
        ("step", "reason"),
        [
            (("c", 2, 65, 53), "robot c does not exist"),
            (("a", 2, 64, 52), "a starts B2 at position 65, but is at C66"),
            (("a", 0, 65, 65), "a cannot make B0 at C66"),
            (("a", 5, 65, 78), "a cannot make B5 at C66"),
            (("a", 13, 65, 66), "a cannot make B13 at C66"),
            (("a", 2, 65, 54), "B2 at C66 leads to C54, not elsewhere"),
        ],
    )
    def test_what_is_no_swing_is_found(self, step, reason):
        fault = swarm.simulate(BENCH, {"a": (65, 53)}, [[step]])
        assert swarm.FleetViolation(0.0, (step[0],), None, reason, in_steps=True) == fault

    def test_one_robot_swings_once_in_a_step(self):
        step = [swing("a", 2, "C66"), swing("a", 2, "C54")]
        fault = swarm.simulate(BENCH, {"a": (place("C66"), place("C42"))}, [step])
        assert fault is not None
        assert fault.reason == "a starts B2 before its last swing has ended"

    @given(st.integers(0, 10_000), st.integers(2, 3))
    def test_a_step_is_legal_if_and_only_if_no_pin_is_used_twice(self, seed, count):
        """Random schedules: the first step in which the sets of pins meet is the one named."""
        rng = random.Random(seed)
        places = {robot: ends[0] for robot, ends in random_robots(SMALL, count, seed).items()}
        homes = dict(places)
        steps: list[list[Swing]] = []
        meets_at = None
        while len(steps) < 6 and meets_at is None:
            step: list[Swing] = []
            used: set[int] = set()
            total = 0
            for robot, here in places.items():
                action = rng.choice([a for a in range(11) if SMALL.successors[here, a] >= 0])
                end = int(SMALL.successors[here, action])
                pins = SMALL.swept_pins(here, action)
                used |= pins
                total += len(pins)
                if action:
                    step.append((robot, action, here, end))
                    places[robot] = end
            if len(used) < total:
                meets_at = len(steps)
            steps.append(step)
        robots = {robot: (homes[robot], places[robot]) for robot in homes}
        fault = swarm.simulate(SMALL, robots, steps)
        if meets_at is None:
            assert fault is None
        else:
            assert fault is not None
            assert fault.pin is not None
            assert meets_at == fault.time_s


class TestTime:
    def timed(self, start_s: float, *what: str | int) -> swarm.FleetSwing:
        robot, action, start, end = swing(*what)  # type: ignore[arg-type]
        return swarm.FleetSwing(robot, action, start, end, start_s, start_s + 10.0)

    def robots(self) -> dict[str, tuple[int, int]]:
        return {"a": (place("C66"), place("C68")), "b": (place("C69"), place("C71"))}

    def test_what_ends_at_a_moment_is_over_before_what_starts_then(self):
        swings = [self.timed(10.0, "a", 10, "C66"), self.timed(0.0, "b", 10, "C69")]
        assert swarm.simulate_timed(BENCH, self.robots(), swings) is None

    def test_a_swing_keeps_its_pins_until_it_ends(self):
        swings = [self.timed(9.9, "a", 10, "C66"), self.timed(0.0, "b", 10, "C69")]
        fault = swarm.simulate_timed(BENCH, self.robots(), swings)
        assert fault is not None
        assert str(fault).startswith("9.900 s: a by B10 sweeps P2, which b sweeps")

    @pytest.mark.parametrize("times_s", [(1.0, 1.0), (2.0, 1.0), (-1.0, 1.0), (0.0, float("inf"))])
    def test_a_swing_ends_after_it_starts(self, times_s):
        with pytest.raises(ValueError, match="A swing cannot run"):
            swarm.FleetSwing("a", 2, 65, 53, *times_s)
