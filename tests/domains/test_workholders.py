"""Workholders and holders in a task file: facts, skills, poses by orientation, and faults."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import yaml

from skillplan import load_problem
from skillplan.errors import SkillplanError, TaskError
from skillplan.pipeline import Setup, solve
from skillplan.task import Facts

CELL = """
kind: assembly
name: cell
robot: {name: panda, home_m: [0.35, 0.0], safe_height_m: 0.35}
cost: time
tools:
  gripper: {type: gripper, opening_m: 0.08, holder_m: [0.25, 0.4]}
  driver: {type: screwdriver, holder_m: [0.33, 0.4]}
  ram: {type: press, force_n: 50, holder_m: [0.41, 0.4]}
initial_tool: gripper
fixtures:
  plate: {size_m: [0.10, 0.10, 0.01], at_m: [0.55, 0.0, 0.15]}
  jaws: {size_m: [0.01, 0.04, 0.02], at_m: [0.585, 0.0, 0.16]}
buffers: {bench: {at_m: [0.4, -0.3]}}
workholders:
  flip:
    pivot_m: [0.55, 0.0, 0.17]
    orientations: {up: {}, down: {rpy_rad: [3.14159265, 0, 0], shift_m: [0, 0, 0.1]}}
    carries: [block, lid]
    fixtures: plate
    takes_s: 4.0
    stand_m: [0.3, 0.1]
holders:
  vise: {kind: clamp, parts: [block, lid], takes_s: 2.0, fixtures: jaws}
  fork: {kind: hold, parts: [lid, arm]}
  stand: {kind: hold, parts: block, turns: false}
parts:
  block:
    {tool: gripper, size_m: [0.06, 0.05, 0.03], start_m: [0.5, 0.3], goal_m: [0.55, 0.0],
     goal_on: plate}
  lid:
    {tool: gripper, size_m: [0.04, 0.04, 0.01], start_m: [0.4, 0.3], goal_m: [0.56, 0.0],
     goal_on: block}
  arm:
    {tool: gripper, size_m: [0.04, 0.02, 0.02], start_m: [0.6, 0.3], goal_m: [0.4, -0.2, 0.1],
     buffers: bench}
screws:
  screw: {tool: driver, through: lid, hole_m: [0.56, 0.01]}
works:
  bond: {tool: ram, part: block, at_m: [0.55, 0.01], force_n: 20, orientation: down}
"""


@pytest.fixture
def load(tmp_path):
    """Return the task of a text."""

    def read(text):
        path = tmp_path / "cell.yaml"
        path.write_text(text)
        return load_problem(path).tasks[0]

    return read


@pytest.fixture
def cell(load):
    return load(CELL.replace("[lid, arm]", "arm"))


def test_a_conjunction_holds_if_both_facts_do():
    facts = Facts(("placed(a)", "turned(f.up)", "turned(f.down)"))
    both = "placed(a) & turned(f.up)"
    state = facts.of(both)
    assert list(state) == ["placed(a)", "turned(f.up)"]
    assert both in state
    assert both not in facts.of("placed(a)")
    assert list(facts.of("turned(f.down)").find_missing(both)) == ["placed(a)"]
    assert not state.find_missing(both)


def test_skills_are_named_by_the_orientation_and_end_there(cell):
    names = {skill.name for skill in cell.skills}
    assert {"place(lid)", "place(lid.down)", "fasten(screw)", "fasten(screw.down)"} <= names
    assert {"turn(flip.up)", "turn(flip.down)", "place(arm)"} <= names
    assert "place(arm.down)" not in names
    assert {"clamp(block)", "release(block)", "clamp(lid)", "hold(arm)"} <= names
    assert {"hold(block:stand)", "release(block:stand)"} <= names
    down = cell.skill("place(lid.down)")
    assert {"turned(flip.down)", "held(lid)"} <= set(down.precondition.requires)
    assert {"placed(lid)", "at(lid.goal.down)"} <= set(down.prediction.add)
    (robot,) = cell.scene.robots
    # Half a turn about x through the pivot, then 0.1 m up.
    assert robot.places["at(lid.goal)"] == pytest.approx((0.56, 0.0, 0.19))
    assert robot.places["at(lid.goal.down)"] == pytest.approx((0.56, 0.0, 0.25))
    (visit,) = down.motion.routes[0].visits
    assert visit.position == robot.places["at(lid.goal.down)"]
    assert visit.along == pytest.approx((0.0, 0.0, 1.0))


def test_what_turns_has_a_place_for_each_orientation(cell):
    up = cell.initial | cell.facts.of("placed(block)", "fastened(screw)")
    up -= cell.facts.of("at_start(block)")
    down = (up | cell.facts.of("turned(flip.down)")) - cell.facts.of("turned(flip.up)")
    before, after = cell.scene.at(up), cell.scene.at(down)
    (flip,) = cell.scene.workholders
    moved = flip.turn("turned(flip.up)", "turned(flip.down)", 1.0)
    for name in ("block", "screw", "plate"):
        assert math.dist(moved.apply(before[name].position), after[name].position) < 1e-9
    assert "jaws" not in before
    held = cell.scene.at(down | cell.facts.of("holds(vise.block)"))
    assert held["jaws"].position == pytest.approx((0.585, 0.0, 0.28))
    # Half a turn is exact: level faces stay level.
    assert max(abs(v) for v in after["plate"].rotate((0.0, 0.0, 1.0))[:2]) < 1e-15


def test_a_turn_ends_at_its_stand_and_takes_its_time(cell):
    turn = cell.skill("turn(flip.down)")
    state = turn.prediction.apply(cell.initial)
    assert {"turned(flip.down)", "at(flip.stand)"} <= set(state)
    assert "turned(flip.up)" not in state
    way_m = math.dist((0.35, 0.0), (0.3, 0.1))
    assert turn.cost.at(cell.initial) == pytest.approx(4.0 + way_m / 0.25)
    clamp = cell.skill("clamp(block)")
    assert clamp.cost.at(cell.initial) == 2.0
    assert clamp.motion is None


def test_a_holder_holds_one_part_and_is_open_again_after_its_release(cell):
    placed = cell.initial | cell.facts.of("placed(block)", "placed(lid)")
    closed = cell.skill("clamp(block)").prediction.apply(placed)
    assert not cell.skill("clamp(lid)").applicable(closed)
    opened = cell.skill("release(block)").prediction.apply(closed)
    assert cell.skill("clamp(lid)").applicable(opened)
    assert {part: holder.name for part, holder in cell.scene.list_held(closed).items()} == {
        "block": "vise"
    }
    # A clamp needs its part, a passive holder may wait for it.
    assert not cell.skill("clamp(block)").applicable(cell.initial)
    assert cell.skill("hold(arm)").applicable(cell.initial)


def test_nothing_turns_that_something_in_the_world_holds(cell):
    held = cell.skill("hold(block:stand)").prediction.apply(cell.initial)
    why = cell.skill("turn(flip.down)").precondition.why_not(held)
    assert why == ["not holds(stand.block)"]


def test_a_work_waits_for_its_orientation(cell):
    press = cell.skill("press(bond)")
    assert "turned(flip.down)" in press.precondition.requires
    (visit,) = press.motion.routes[0].visits
    # The underside of the block, seen after half a turn and a shift.
    assert visit.position == pytest.approx((0.55, -0.01, 0.28))


def test_a_task_without_them_keeps_its_facts(load):
    text = CELL.partition("workholders:")[0] + "parts:" + CELL.partition("\nparts:")[2]
    task = load(text.partition("works:")[0].replace("-0.2, 0.1]", "-0.2]"))
    assert not any(fact.startswith(("turned", "holds", "open(")) for fact in task.facts.names)
    assert not task.scene.workholders


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("carries: [block, lid]", "carries: [block, ldi]", "unknown part 'ldi'. Did you mean"),
        ("carries: [block, lid]", "carries: [block, block]", "'block' stands twice. Keep one."),
        ("fixtures: plate", "fixtures: plat", "unknown fixture 'plat'. Did you mean 'plate'?"),
        ("fixtures: jaws", "fixtures: plate", "'plate' belongs to 'flip'. Name it in one"),
        ("rpy_rad: [3.14159265, 0, 0], shift_m: [0, 0, 0.1]", "", "is the same as 'up'. Turn it"),
        ("down: {rpy_rad: [3.14159265, 0, 0], shift_m: [0, 0, 0.1]}", "", "at least 2 entries"),
        (
            "pivot_m: [0.55, 0.0, 0.17]",
            "pivot_m: [0.55, 0.0, -0.06]",
            "'plate' would be 180.0 mm deep in the table in 'down'. Raise it, to a height of "
            "0.03 m at least.",
        ),
        (
            "goal_m: [0.4, -0.2, 0.1]",
            "goal_m: [0.55, 0.037], goal_on: plate",
            "flip.carries: 'arm' stands on 'plate', which turns: name it in 'carries'.",
        ),
        (
            "goal_on: block}",
            "goal_on: block, other_goals: [{goal_m: [0.54, 0.0], goal_on: block}]}",
            "'lid' may be at another goal, where the holder is not. Leave it out, or 'other_goals'",
        ),
        (
            "{up: {}",
            "{up: {shift_m: [0, 0, 0.1]}",
            "up.shift_m: 'up' is the one at the start, from",
        ),
        ("parts: block, turns", "parts: block, stays: true, takes_s: 1.0, turns", "takes no time"),
        ("[0.3, 0.1]", "[1.3, 0.1]", "workholders.flip.stand_m: out of reach"),
        ("parts: block, turns", "parts: blok, turns", "unknown part 'blok'. Did you mean 'block'?"),
        ("parts: [lid, arm]}", "parts: arm, turns: false}", "has no effect, as no workholder"),
        ("parts: [lid, arm]", "parts: [lid, arm]", "some of its parts turn with flip and others"),
        ("start_m: [0.4, 0.3]", "start_on: plate", "'plate' belongs to 'flip' and does not stay"),
        ("{at_m: [0.4, -0.3]}", "{at_m: [0.4, 0], stands_on: plate}", "does not stay. Name"),
        ("orientation: down", "orientation: dwn", "unknown orientation 'dwn'. Did you mean 'down'"),
        (
            "rpy_rad: [3.14159265, 0, 0]",
            "rpy_rad: [1.5708, 0, 0]",
            "in 'down' the place is at a side",
        ),
        ("lid:\n    {", "lid:\n    {orientation: dwn, ", "unknown orientation 'dwn'. Did you mean"),
        ("through: lid", "through: arm, orientation: up", "no workholder carries 'screw'"),
        ("takes_s: 4.0", "in_order: true", "flip.in_order: has no effect, as no part or screw"),
        ("vise: {", "flip: {", "the name 'flip' is taken in 'workholders'. Choose another."),
    ],
)
def test_faults_are_told_with_their_place(load, old, new, message):
    text = CELL if "arm" in new or "arm" in old else CELL.replace("[lid, arm]", "arm")
    assert old in text
    with pytest.raises(SkillplanError) as caught:
        load(text.replace(old, new, 1))
    assert message in str(caught.value)
    assert "cell.yaml:" in str(caught.value)


FOOT = """
kind: assembly
name: foot
cost: [turns, distance]
robot: {name: panda, home_m: [0.35, 0.0], safe_height_m: 0.3}
tools:
  gripper: {opening_m: 0.08, holder_m: [0.30, -0.40]}
  driver: {type: screwdriver, holder_m: [0.30, -0.50]}
initial_tool: gripper
workholders:
  flip: {pivot_m: [0.5, 0, 0.1], orientations: {up: {}, down: {rpy_rad: [3.14159265, 0, 0]}}}
holders: {vise: {kind: hold, parts: base, stays: true}}
parts:
  base: {tool: gripper, size_m: [0.06, 0.06, 0.02], start_m: [0.4, 0.3], goal_m: [0.5, 0.0, 0.09]}
  lid:
    {tool: gripper, size_m: [0.04, 0.04, 0.01], start_m: [0.5, 0.3], goal_m: [0.5, 0.0],
     goal_on: base}
  foot:
    {tool: gripper, size_m: [0.04, 0.04, 0.01], start_m: [0.6, 0.3], goal_m: [0.5, 0.0, 0.09],
     goal_rpy_rad: [3.14159265, 0, 0], insert_along: [0, 0, 1], goal_on: base}
screws:
  top: {tool: driver, through: lid, into: base, hole_m: [0.5, 0.0]}
"""
_ORIENTATIONS = {"base": "up", "lid": "up", "foot": "down", "top": "up"}


def test_in_order_each_component_has_one_skill_and_a_turn_waits_for_all_before_it(load):
    """Solvers that order jobs take the turn between them, and prove what exact search proves."""
    document = yaml.safe_load(FOOT)
    document["workholders"]["flip"]["in_order"] = True
    for name, orientation in _ORIENTATIONS.items():
        kind = "screws" if name == "top" else "parts"
        document[kind][name]["orientation"] = orientation
    task = load(yaml.safe_dump(document, sort_keys=False))
    names = {skill.name for skill in task.skills}
    assert {"place(base)", "place(lid)", "place(foot.down)", "turn(flip.down)"} <= names
    assert not {"place(foot)", "place(lid.down)", "turn(flip.up)", "fasten(top.down)"} & names
    needed = set(task.skill("turn(flip.down)").precondition.requires)
    assert needed >= {"placed(base)", "placed(lid)", "fastened(top)", "turned(flip.up)"}
    assert "placed(foot)" not in needed
    setup = Setup(collision=("aabb",))
    by_jobs, proved = solve(task, "subset-dp", setup), solve(task, "exact", setup)
    assert (by_jobs.status, proved.status) == ("optimal", "optimal")
    assert by_jobs.cost == pytest.approx(proved.cost, abs=1e-9)


TABLE = """
kind: assembly
name: table
robot: {{name: panda, home_m: [0.35, 0.0], safe_height_m: 0.3}}
tools: {{gripper: {{opening_m: 0.08, holder_m: [0.30, -0.40]}}}}
initial_tool: gripper
fixtures: {{plate: {{size_m: [{length_m}, 0.1, 0.02], at_m: [{x_m}, 0.0, 0.06]}}}}
workholders:
  t:
    pivot_m: [{x_m}, 0.0, 0.1]
    orientations: {{a: {{}}, b: {{rpy_rad: {turn}}}}}
    fixtures: plate
parts:
  base: {{tool: gripper, size_m: [0.05, 0.05, 0.02], start_m: [0.4, -0.3], goal_on: plate, {goal}}}
zones: {{z: {{min_m: [0.55, -0.05], max_m: [0.65, 0.05], keeps_out: {mover}}}}}
"""
HALF, FLIP = [0, 0, 3.14159265], [3.14159265, 0, 0]


@pytest.mark.parametrize(
    ("changes", "turn", "useless", "message"),
    [
        ({"x_m": 0.7, "length_m": 0.6, "goal": "goal_m: [0.92, 0.0]"}, HALF, FLIP, "out of reach"),
        ({"mover": "arm"}, HALF, FLIP, "the grasp of 'base' at its goal, at (0.600, "),
        ({"mover": "load"}, HALF, FLIP, "the goal of 'base' is in the zone z"),
        (
            {
                "length_m": 0.1,
                "goal": "goal_m: [0.5, 0.0, 0.06], goal_rpy_rad: [3.14159265, 0, 0], "
                "insert_along: [0, 0, 1]}\nholders: {c: {kind: hold, parts: base}",
            },
            FLIP,
            HALF,
            "no hand can hold it from the top at its goal, where the hand would be in the table",
        ),
    ],
    ids=["reach", "arm", "load", "hand"],
)
def test_a_goal_is_at_fault_only_if_it_is_in_every_orientation(
    load, changes, turn, useless, message
):
    values = {"x_m": 0.5, "length_m": 0.3, "goal": "goal_m: [0.6, 0.0]", "mover": "arm", **changes}
    load(TABLE.format(turn=turn, **values))
    with pytest.raises(SkillplanError) as caught:
        load(TABLE.format(turn=useless, **values))
    assert message in str(caught.value)


# What the messages on places out of reach name: the safe height, or the place.


CONFIG = Path(__file__).parents[2] / "configs" / "inverter_board.yaml"


def faults(changes: dict[str, str]) -> list[str]:
    with pytest.raises(TaskError) as caught:
        load_problem(CONFIG, changes=changes)
    return str(caught.value).splitlines()


def test_a_safe_height_out_of_reach_over_most_places_is_one_message_with_the_limit():
    (message,) = faults({"robot.safe_height_m": "0.9"})
    assert "robot.safe_height_m: 0.9 m is too high" in message
    limit_m = float(message.split("At ")[1].split(" m or less")[0])
    load_problem(CONFIG, changes={"robot.safe_height_m": str(limit_m)})
    assert faults({"robot.safe_height_m": str(limit_m + 0.002)})


def test_a_place_out_of_reach_at_the_safe_height_alone_names_both():
    (message,) = faults({"tools.screwdriver.holder_m": "[0.85, 0.0]"})
    assert "tools.screwdriver.holder_m: out of reach at robot.safe_height_m" in message


def test_a_place_out_of_reach_at_any_height_does_not_blame_the_safe_height():
    (message,) = faults({"tools.screwdriver.holder_m": "[0.9, 0.0]"})
    assert "safe_height_m" not in message
