"""Zones: places that arm or load stay out of, and areas of people in which the tip is slow."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skillplan import Setup, load_problem, solve
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.errors import TaskError

BOXES = Setup(collision=("aabb",))
PART = {"tool": "cup", "size_m": [0.04, 0.04, 0.02], "start_m": [0.5, 0.3], "goal_m": [0.5, -0.3]}
AISLE = {"min_m": [0.4, -0.1], "max_m": [0.6, 0.1]}


def config_of(zones, **other):
    """Return a cell in which a part travels 0.6 m along y, with some zones."""
    return AssemblyConfig.model_validate(
        {
            "kind": "assembly",
            "name": "cell",
            "robot": {"home_m": [0.5, 0.3], "safe_height_m": 0.2, "travel_speed_m_per_s": 0.5},
            "tools": {"cup": {"holder_m": [0.3, 0.4], "type": "suction"}},
            "initial_tool": "cup",
            "zones": zones,
            "parts": {"part": PART},
            **other,
        }
    )


def messages(config):
    return [str(issue) for issue in AssemblyDomain().issues(config)]


def task_of(config):
    assert messages(config) == []
    (task,) = AssemblyDomain().ground(config, "")
    return task


def solved(zones, **other):
    return solve(task_of(config_of(zones, **other)), setup=BOXES)


def test_a_load_does_not_cross_a_zone_that_keeps_it_out():
    result = solved({"aisle": AISLE})
    assert result.status == "infeasible"
    assert "aabb: part runs into the zone aisle on the travel" in result.reason


@pytest.mark.parametrize(
    "zone",
    [
        {**AISLE, "height_m": [0.3, 1.0]},
        {**AISLE, "height_m": [0.0, 0.19]},
        {"polygon_m": [[0.53, -0.1], [0.7, -0.1], [0.7, 0.1]]},
        # Its bounding box is in the way, the triangle is not.
        {"polygon_m": [[0.4, 0.25], [0.6, 0.05], [0.6, 0.25]], "height_m": [0.4]},
        {"polygon_m": [[0.4, -0.1], [0.47, -0.1], [0.4, 0.1]]},
        {**AISLE, "keeps_out": "arm"},
    ],
)
def test_a_load_passes_above_below_and_beside_a_zone_and_where_only_the_arm_is_kept_out(zone):
    assert solved({"aisle": zone}).status == "optimal"


def test_boxes_state_that_they_miss_the_arm_in_a_zone():
    sentence, _ = solved({"aisle": {**AISLE, "keeps_out": "arm"}}).not_checked
    assert "in aisle it misses all else of the arm" in sentence


def test_a_concave_zone_keeps_out_what_enters_it_only():
    """A U about the path of the part, which is 20 mm wide on either side."""
    corners = [[0.3, -0.1], [0.7, -0.1], [0.7, 0.1], [0.53, 0.1], [0.53, -0.05]]
    corners += [[0.47, -0.05], [0.47, 0.1], [0.3, 0.1]]
    assert solved({"u": {"polygon_m": corners}}).status == "infeasible"
    legs = {
        "left": {"polygon_m": [[0.3, -0.1], [0.47, -0.1], [0.47, 0.1], [0.3, 0.1]]},
        "right": {"polygon_m": [[0.53, -0.1], [0.7, -0.1], [0.7, 0.1], [0.53, 0.1]]},
    }
    assert solved(legs).status == "optimal"


def test_a_travel_is_slow_inside_an_area_of_people_only():
    """0.2 m at 0.1 instead of 0.5 m/s are 1.6 s; where areas overlap the slowest counts."""
    slow = {**AISLE, "speed_m_per_s": 0.1}
    free_s, slow_s = (solved(zones, cost="time").cost for zones in ({}, {"aisle": slow}))
    assert slow_s == pytest.approx(free_s + 0.2 / 0.1 - 0.2 / 0.5)
    inner = {"min_m": [0.4, -0.05], "max_m": [0.6, 0.3], "speed_m_per_s": 0.25}
    both_s = solved({"inner": inner, "aisle": slow}, cost="time").cost
    assert both_s == pytest.approx(slow_s + 0.2 / 0.25 - 0.2 / 0.5)
    quick = {**AISLE, "speed_m_per_s": 0.6}
    assert solved({"aisle": quick}, cost="time").cost == pytest.approx(free_s)
    assert solved({"aisle": slow}).cost == pytest.approx(solved({}).cost)
    above = {**slow, "height_m": [0.3, 2.0]}
    assert solved({"aisle": above}, cost="time").cost == pytest.approx(free_s)


def test_a_failed_grasp_crosses_an_area_of_people_slowly_as_well():
    """The next skill pays for the way from the part to where the arm looks."""
    robot = {"home_m": [0.5, 0.3], "safe_height_m": 0.2, "travel_speed_m_per_s": 0.5}
    cell = {
        "robot": {**robot, "look_m": [0.5, -0.2]},
        "parts": {"part": {**PART, "grasp_failure": 0.5}},
        "cost": "time",
    }
    slow = task_of(config_of({"aisle": {**AISLE, "speed_m_per_s": 0.1}}, **cell))
    free = task_of(config_of({}, **cell))
    costs = []
    for task in (free, slow):
        pick = task.skill("pick(part)")
        (missed,) = (outcome for outcome in pick.outcomes if outcome is not pick.prediction)
        costs.append(pick.cost.at(missed.apply(task.initial)))
    # There and back again, 0.2 m each.
    assert costs[1] == pytest.approx(costs[0] + 2 * (0.2 / 0.1 - 0.2 / 0.5))


@settings(max_examples=40)
@given(
    low=st.tuples(st.floats(0.0, 0.6), st.floats(-0.5, 0.4)),
    size=st.tuples(st.floats(0.01, 0.6), st.floats(0.01, 0.6)),
    speed=st.floats(0.01, 1.0),
    known=st.integers(min_value=0),
)
def test_a_bound_on_a_time_with_slow_areas_is_never_above_it(low, size, speed, known):
    """For any known facts, and never below the time without areas."""
    high = [low[0] + size[0], low[1] + size[1]]
    zones = {"area": {"min_m": list(low), "max_m": high, "speed_m_per_s": speed}}
    slow, free = (task_of(config_of(zones, cost="time")) for zones in (zones, {}))
    state, every = slow.initial, slow.facts.all_bits
    for skill in (slow.skill("pick(part)"), slow.skill("place(part)")):
        value = skill.cost.at(state)
        assert value >= free.skill(skill.name).cost.at(state) - 1e-12
        facts = known & every
        assert skill.cost.least(state.bits & facts, ~state.bits & facts & every) <= value
        assert skill.cost.least(state.bits, every & ~state.bits) == pytest.approx(value)
        state = skill.prediction_in(state).apply(state)


@pytest.mark.parametrize(
    ("zone", "words"),
    [
        ({"min_m": [0.45, 0.25], "max_m": [0.55, 0.35]}, "home, at (0.500, 0.300, 0.200) m, is in"),
        ({"min_m": [-0.1, -0.1], "max_m": [0.1, 0.1]}, "the base of the arm, at"),
        ({"min_m": [0.25, 0.35], "max_m": [0.35, 0.45]}, "the holder of 'cup', at (0.300, 0.400"),
        (
            {"min_m": [0.45, -0.4], "max_m": [0.6, -0.25], "keeps_out": "arm"},
            "the grasp of 'part' at its goal, at (0.500, -0.300, 0.020) m, is in the zone z, which "
            "keeps the arm out (from the table up)",
        ),
        (
            {"min_m": [0.51, -0.4], "max_m": [0.6, -0.2], "height_m": [0, 0.1]},
            "the goal of 'part' is in the zone z, which keeps the load out (0 to 0.1 m high)",
        ),
        (
            {"min_m": [0.4, 0.31], "max_m": [0.6, 0.5], "keeps_out": "load"},
            "the start of 'part' is in the zone z, which keeps the load out",
        ),
    ],
)
def test_a_place_in_a_zone_that_nothing_may_enter_is_a_fault(zone, words):
    assert any(words in message for message in messages(config_of({"z": zone})))


def test_buffers_and_other_goals_are_places_as_well():
    zone = {"min_m": [0.55, -0.1], "max_m": [0.75, 0.1], "keeps_out": "load"}
    buffers = {"buffers": {"shelf": {"at_m": [0.6, 0.0]}}}
    cell = config_of({"z": zone}, **buffers, parts={"part": {**PART, "buffers": ["shelf"]}})
    assert any("'part' in 'shelf' is in the zone z" in message for message in messages(cell))
    goals = {"part": {**PART, "other_goals": [{"goal_m": [0.6, 0.0]}]}}
    assert not messages(config_of({"z": zone}, parts=goals))
    both = {**zone, "min_m": [0.45, -0.4]}
    (message,) = messages(config_of({"z": both}, parts=goals))
    assert "the goal of 'part' is in the zone z, which keeps the load out" in message


def test_a_place_in_an_area_of_people_is_none():
    everywhere = {"min_m": [-1, -1], "max_m": [1, 1], "speed_m_per_s": 0.25}
    assert messages(config_of({"z": everywhere})) == []


@pytest.mark.parametrize(
    ("zone", "cost", "words"),
    [
        ({"min_m": [2, 2], "max_m": [3, 3]}, "time", "has no effect: it is 2.828 m from the base"),
        ({**AISLE, "height_m": [-0.5, 0.0]}, "time", "has no effect: its top, 0 m, is not above"),
        ({**AISLE, "speed_m_per_s": 0.1}, "distance", "costs time, and the objective is the dist"),
    ],
)
def test_a_zone_without_effect_is_named(zone, cost, words):
    hints = AssemblyDomain().hints(config_of({"z": zone}, cost=cost))
    assert any(words in str(hint) for hint in hints)


def test_faults_of_zones_come_with_their_keys(tmp_path):
    path = tmp_path / "cell.yaml"
    path.write_text(
        "kind: assembly\nname: c\nrobot: {home_m: [0.3, 0.0]}\n"
        "tools: {cup: {holder_m: [0.3, 0.4], type: suction}}\n"
        "zones:\n  none: {height_m: [0, 1]}\n  both: {min_m: [0, 0], polygon_m: [[1, 0], [0, 1], "
        "[1, 1]]}\n  line: {polygon_m: [[0, 0], [1, 1], [2, 2]]}\n"
        "  bow: {polygon_m: [[0, 0], [1, 1], [1, 0], [0, 1]]}\n"
        "  flat: {min_m: [0, 0], max_m: [0, 1]}\n"
        "  top: {min_m: [0, 0], max_m: [1, 1], height_m: [1, 0.5]}\n"
        "  slow: {min_m: [0, 0], max_m: [1, 1], keeps_out: all, speed_m_per_s: 0.1}\n"
        "parts:\n"
        "  p: {tool: cup, size_m: [0.04, 0.04, 0.02], start_m: [0.4, 0.3], goal_m: [0.5, 0]}\n"
    )
    with pytest.raises(TaskError) as error:
        load_problem(path)
    for words in (
        "zones.none: give 'polygon_m', or 'min_m' and 'max_m'.",
        "zones.both.min_m: give polygon_m, or min_m and max_m, not both.",
        "zones.line.polygon_m: has no area.",
        "zones.bow.polygon_m: its sides cross at (0.5, 0.5) m. Give the corners in order.",
        "zones.flat.max_m: must be above min_m in x and in y.",
        "zones.top.height_m: the top, 0.5 m, must be above the bottom, 1 m.",
        "zones.slow.speed_m_per_s: has no effect, as the arm stays out.",
    ):
        assert words in str(error.value)


def test_check_lists_zones_and_files_without_them_keep_their_hash(tmp_path):
    config = config_of(
        {
            "a": {**AISLE, "height_m": [0.5, 1.2]},
            "b": {**AISLE, "height_m": [0.5], "keeps_out": "load", "speed_m_per_s": 0.25},
        }
    )
    view = AssemblyDomain().overview(config)
    assert "zone       a keeps out the arm and the load, 0.5 to 1.2 m high" in view.lines
    assert (
        "zone       b keeps out the load and slows the tip to 0.25 m/s, from 0.5 m up" in view.lines
    )
    assert [zone["area_m2"] for zone in view.document["zones"]] == [0.04, 0.04]
    text = (
        "kind: assembly\nname: c\nrobot: {home_m: [0.3, 0.0]}\n"
        "tools: {cup: {holder_m: [0.3, 0.4], type: suction}}\nparts:\n"
        "  p: {tool: cup, size_m: [0.04, 0.04, 0.02], start_m: [0.4, 0.3], goal_m: [0.5, 0]}\n"
    )
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    before = load_problem(path).sha256
    path.write_text(text + "zones: {}\n")
    assert load_problem(path).sha256 == before
