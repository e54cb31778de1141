"""Several bases on one bench as a task: facts, swings, pins, and what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fleet_instances import SWING_S, fewest, pins_are_disjoint, random_robots, task_of
from skillplan.pipeline import make_model, solve
from skillplan.testing import reachable_states
from skillplan_swarmitfix import Bench, fleet_faults, fleet_task, robot_at

BENCH = Bench(6, 13, 0.34)
SMALL = Bench(3, 5, 0.34)


def position(name: str) -> int:
    return BENCH.position(name)


def two(first: tuple[str, str], second: tuple[str, str]) -> dict[str, tuple[int, int]]:
    names = {"left": first, "right": second}
    return {robot: (position(a), position(b)) for robot, (a, b) in names.items()}


@pytest.fixture
def pair():
    return task_of(BENCH, two(("C66", "C54"), ("C78", "C62")))


class TestTask:
    def test_each_robot_stands_at_one_of_all_positions(self, pair):
        assert [len(group) for group in pair.facts.exclusive] == [78, 78]
        assert {"at(left,C66)", "at(right,C78)"} == set(pair.initial)
        assert {"at(left,C54)", "at(right,C62)"} == set(pair.goal.requires)

    def test_waiting_is_no_skill(self, pair):
        names = [skill.name for skill in pair.skills]
        assert [f"{r}.B{a}" for r in ("left", "right") for a in range(1, 11)] == names

    def test_a_swing_costs_one_and_takes_the_time_of_its_angle(self, pair):
        skill = pair.skill("left.B2")
        assert skill.cost.at(pair.initial) == 1.0
        angle_deg = int(BENCH.swing_deg[position("C66"), 2])
        assert SWING_S[angle_deg] == skill.duration_s.at(pair.initial)
        assert skill.agents == ("left",)

    def test_a_swing_occupies_the_pins_it_sweeps(self, pair):
        case = pair.skill("left.B2").case(pair.initial)
        assert case is not None
        swept = {BENCH.pin_name(pin) for pin in BENCH.swept_pins(position("C66"), 2)}
        assert swept == case.occupies

    def test_a_swing_is_forbidden_where_another_docks_a_swept_pin(self, pair):
        case = pair.skill("left.B2").case(pair.initial)
        assert case is not None
        swept = BENCH.swept_pins(position("C66"), 2)
        for place in range(BENCH.n_positions):
            docks = bool(swept & set(BENCH.legs[place].tolist()))
            assert docks == (robot_at("right", BENCH.name(place)) in case.forbids)
            assert robot_at("left", BENCH.name(place)) not in case.forbids

    def test_each_fact_has_its_place_on_the_bench(self, pair):
        places = pair.places_in(pair.initial)
        assert [place.name for place in places] == ["C66", "C78"]
        x_m, y_m, z_m = places[0].position
        assert (x_m, y_m) == tuple(BENCH.centroids_m[position("C66")])
        assert z_m == 0.0

    def test_it_is_a_base_task_counted_in_swings(self, pair):
        assert (pair.kind, pair.stage, pair.cost_text(4.0)) == ("swarmitfix", "base", "4 swings")

    def test_an_exact_search_that_knows_no_robots_solves_it(self):
        robots = random_robots(SMALL, 2, 0)
        result = solve(task_of(SMALL, robots), "exact")
        assert result.status == "optimal"
        assert result.cost == fewest(SMALL, robots, at_once=False)

    def test_the_step_limit_can_be_given(self):
        robots = random_robots(BENCH, 3, 0)
        assert task_of(BENCH, robots).step_limit == 750
        assert task_of(BENCH, robots, step_limit=9).step_limit == 9

    def test_thirteen_actions_are_grounded_as_well(self):
        bench = Bench(6, 13, 0.34, actions=13)
        assert "r1.B12" in [
            skill.name for skill in task_of(bench, random_robots(bench, 2, 0)).skills
        ]

    @given(st.integers(0, 1_000))
    def test_no_two_robots_ever_share_a_pin(self, seed):
        task = task_of(SMALL, random_robots(SMALL, 2, seed))
        for state in reachable_states(make_model(task), 60):
            names = [place.name for place in task.places_in(state)]
            assert len(names) == 2
            assert pins_are_disjoint(SMALL, tuple(map(SMALL.position, names)))


class TestFaults:
    def test_a_sound_fleet_has_none(self):
        assert fleet_faults(BENCH, random_robots(BENCH, 8, 1)) == []

    def test_robots_at_one_start_are_named(self):
        faults = fleet_faults(BENCH, two(("C66", "C54"), ("C66", "C62")))
        message = "left and right both start at C66. Choose positions without a common pin."
        assert [(message, ("robots", "right", "home"))] == faults

    def test_overlapping_start_pins_are_named(self):
        ((message, path),) = fleet_faults(BENCH, two(("C66", "C54"), ("C68", "C62")))
        assert "left and right start at C66 and C68, which share pin P9." in message
        assert path == ("robots", "right", "home")

    def test_overlapping_goal_pins_are_named(self):
        ((message, path),) = fleet_faults(BENCH, two(("C66", "C54"), ("C78", "C55")))
        assert "end at C54 and C55, which share pins P9, P17." in message
        assert path == ("robots", "right", "goal")

    @pytest.mark.parametrize("count", [0, 1, 9])
    def test_a_fleet_has_two_to_eight_robots(self, count):
        robots = {f"r{i}": (i, i) for i in range(0, 6 * count, 6)}
        message, path = fleet_faults(BENCH, robots)[0]
        assert f"2 to 8 robots, not {count}" in message
        assert path == ("robots",)

    def test_a_position_off_the_bench_is_named(self):
        ((message, path),) = fleet_faults(BENCH, {"a": (78, 0), "b": (40, 50)})
        assert message == "a cannot start at position 79: the bench has C1 to C78."
        assert path == ("robots", "a", "home")

    def test_no_task_is_made_of_a_faulty_fleet(self):
        with pytest.raises(ValueError, match=r"Task 'x': a and b both start at C1\."):
            fleet_task(BENCH, {"a": (0, 20), "b": (0, 40)}, SWING_S, name="x")
