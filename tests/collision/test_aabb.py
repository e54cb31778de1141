"""The geometric detector on situations made for it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly, config_content, fetching_board
from skillplan.collision import AabbDetector, PrecedenceDetector
from skillplan.errors import OptionError
from skillplan.pipeline import Setup, make_model, registry, solve
from skillplan.testing import DetectorSuite, lid_content, lid_task, reachable_states


class TestAabbDetector(DetectorSuite):
    detector = "aabb"


def shelf(**changes):
    """Return the content of two blocks far apart and one that is put on the first."""
    content = {
        "kind": "assembly",
        "name": "shelf",
        "robot": {"home_m": [0.3, 0.0], "safe_height_m": 0.15},
        "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
        "initial_tool": "gripper",
        "parts": {
            "base": block([0.4, -0.2], [0.5, 0.0], [0.1, 0.1, 0.02]),
            "top": block([0.4, 0.2], [0.5, 0.0], [0.04, 0.04, 0.02], goal_on="base"),
        },
        "step_limit": 20,
    }
    for key, value in changes.items():
        content[key] = {**content[key], **value} if isinstance(value, dict) else value
    return content


def block(start_m, goal_m, size_m, **more):
    return {"tool": "gripper", "size_m": size_m, "start_m": start_m, "goal_m": goal_m, **more}


def verdict_of(content, skill, *facts, place="home", tool="gripper", **options):
    """Return the verdict on a skill where these facts hold, and its detector's task."""
    task = assembly(content)
    state = task.facts.of(f"at({place})", f"tool({tool})", *facts)
    return AabbDetector(task, AabbDetector.Options(**options)).check(task.skill(skill), state)


def test_what_is_placed_needs_something_beneath_it():
    """The verdict names what could bear it, and rests on its absence."""
    verdict = verdict_of(shelf(), "place(top)", "held(top)")
    assert verdict.is_infeasible
    assert verdict.reason == "top has nothing beneath it"
    assert verdict.evidence["possible_supports"] == ["base"]
    assert "not placed(base)" in verdict.facts
    assert verdict_of(shelf(), "place(top)", "held(top)", "placed(base)").is_feasible


def test_supports_are_not_looked_for_if_not_wanted():
    """An option."""
    assert verdict_of(shelf(), "place(top)", "held(top)").is_infeasible
    assert verdict_of(shelf(), "place(top)", "held(top)", check_support=False).is_feasible


@pytest.mark.parametrize(("overhang_m", "tips"), [(0.049, False), (0.051, True)])
def test_a_part_tips_once_its_centre_is_beyond_the_edge(overhang_m, tips):
    """The base ends 50 mm from its centre."""
    content = shelf()
    content["parts"]["top"]["goal_m"] = [0.5 + overhang_m, 0.0]
    verdict = verdict_of(content, "place(top)", "held(top)", "placed(base)")
    assert verdict.is_infeasible is tips
    if tips:
        assert verdict.reason == "top would tip off base"


def test_a_part_between_two_supports_does_not_tip():
    """Its centre lies over neither, but between them."""
    content = shelf()
    content["parts"]["base"]["size_m"] = [0.02, 0.02, 0.02]
    content["parts"]["base"]["goal_m"] = [0.45, 0.0]
    content["parts"]["other"] = block([0.4, -0.3], [0.55, 0.0], [0.02, 0.02, 0.02])
    content["parts"]["top"] = block([0.4, 0.2], [0.5, 0.0], [0.12, 0.04, 0.02], goal_on="base")
    facts = ("held(top)", "placed(base)")
    assert verdict_of(content, "place(top)", *facts, "placed(other)").is_feasible
    assert verdict_of(content, "place(top)", *facts).reason == "top would tip off base"


def test_a_screw_needs_the_part_it_goes_through():
    """It would be driven into the air."""
    content = {
        **shelf(),
        "screws": {"screw": {"tool": "gripper", "hole_m": [0.5, 0.0], "through": "top"}},
    }
    verdict = verdict_of(content, "fasten(screw)", "placed(base)", "hand_free")
    assert verdict.reason == "screw has nothing beneath it"
    assert verdict_of(content, "fasten(screw)", "placed(top)", "hand_free").is_feasible


def test_what_stands_in_the_way_of_the_approach_is_hit():
    """A block over the place of another: the part that is put in later runs into it."""
    content = shelf()
    content["parts"]["roof"] = {
        "tool": "gripper",
        "boxes": [
            {"size_m": [0.1, 0.1, 0.01], "centre_m": [0.0, 0.0, 0.055]},
            {"size_m": [0.01, 0.1, 0.05], "centre_m": [0.045, 0.0, 0.025]},
        ],
        "start_m": [0.6, -0.2],
        "goal_m": [0.5, 0.0],
        "goal_on": "base",
    }
    verdict = verdict_of(content, "place(top)", "held(top)", "placed(base)", "placed(roof)")
    assert verdict.is_infeasible
    assert verdict.reason == "top runs into roof on the approach"
    assert verdict.evidence == {"moving": "top", "bodies": ["roof"], "during": "the approach"}
    assert "placed(roof)" in verdict.facts


TOWER = block([0.5, -0.1], [0.7, 0.3], [0.04, 0.04, 0.3])


@pytest.mark.parametrize(
    ("place", "hits"), [("base.start", True), ("tower.start", True), ("home", False)]
)
def test_a_part_taller_than_the_safe_height_is_hit_on_the_travel(place, hits):
    """Depending on where the arm comes from: that is one of the facts."""
    content = shelf()
    content["parts"]["tower"] = TOWER
    verdict = verdict_of(content, "place(base)", "held(base)", "at_start(tower)", place=place)
    assert verdict.is_infeasible is hits
    assert f"at({place})" in verdict.facts
    if hits:
        assert verdict.reason == "base runs into tower on the travel"


def test_where_nothing_is_tall_it_does_not_matter_where_the_arm_comes_from():
    """One verdict serves all places, so that few checks are made."""
    verdict = verdict_of(shelf(), "place(base)", "held(base)", "at_start(top)")
    assert not any(fact.startswith("at(") for fact in verdict.facts)


def test_a_tower_above_the_safe_height_is_passed_with_a_higher_one():
    """The safe height is the task's."""
    content = shelf(robot={"safe_height_m": 0.31})
    content["parts"]["tower"] = TOWER
    facts = ("held(base)", "at_start(tower)")
    assert verdict_of(content, "place(base)", *facts, place="tower.start").is_feasible
    content["robot"]["safe_height_m"] = 0.15
    assert verdict_of(content, "place(base)", *facts, place="tower.start").is_infeasible


def test_the_envelope_of_the_tool_runs_into_neighbours():
    """A wide hand does not fit beside a tall part that the carried part alone would pass."""
    content = shelf()
    content["parts"]["post"] = block([0.7, 0.2], [0.54, 0.0], [0.02, 0.02, 0.1], goal_on="base")
    facts = ("held(top)", "placed(base)", "placed(post)")
    assert verdict_of(content, "place(top)", *facts).is_feasible
    content["tools"]["gripper"]["envelope_m"] = [0.1, 0.04, 0.1]
    verdict = verdict_of(content, "place(top)", *facts)
    assert verdict.is_infeasible
    assert verdict.reason == "gripper runs into post on the approach"
    assert "tool(gripper)" in verdict.facts


def test_an_envelope_ends_at_the_tip():
    """A neighbour no higher than the gripped part is no obstacle to the hand above it."""
    content = shelf()
    content["tools"]["gripper"]["envelope_m"] = [0.1, 0.04, 0.1]
    content["parts"]["post"] = block([0.7, 0.2], [0.54, 0.0], [0.02, 0.02, 0.02], goal_on="base")
    facts = ("held(top)", "placed(base)", "placed(post)")
    assert verdict_of(content, "place(top)", *facts).is_feasible
    content["parts"]["post"]["size_m"] = [0.02, 0.02, 0.06]
    assert verdict_of(content, "place(top)", *facts).is_infeasible


def pressed(**ram):
    """Return the content of a press on a part beneath a bridge."""
    content = shelf()
    ram = {"type": "press", "bit_length_m": 0.08, "holder_m": [0.6, -0.3], **ram}
    content["tools"]["ram"] = ram
    content["fixtures"] = {"bridge": {"size_m": [0.1, 0.1, 0.01], "at_m": [0.5, 0.0, 0.05]}}
    content["works"] = {"push": {"tool": "ram", "part": "base", "force_n": 50, "at_m": [0.5, 0.0]}}
    return content


def test_the_ram_of_a_press_is_hit_where_its_body_is_not():
    """The body stays above a bridge that the ram would pass through."""
    body = {"boxes": [{"size_m": [0.06, 0.06, 0.08], "centre_m": [0, 0, 0.04]}]}
    content = pressed(body=body)
    verdict = verdict_of(content, "press(push)", "fixed", "placed(base)", tool="ram")
    assert verdict.reason == "ram runs into bridge on the approach"
    assert not any("bits" in words for words in AabbDetector(assembly(content)).not_checked())
    del content["fixtures"]
    assert verdict_of(content, "press(push)", "placed(base)", tool="ram").is_feasible


def test_a_ram_without_a_body_is_listed_as_not_checked():
    """It has no boxes."""
    _, sentence = AabbDetector(assembly(pressed())).not_checked()
    assert sentence == "bits, cups and shanks of tools without envelope_m or body: ram"


def test_a_part_in_a_feeder_is_no_obstacle():
    """Two parts of one feeder do not touch each other."""
    content = shelf()
    content["feeders"] = {"chute": {"position_m": [0.4, 0.2]}}
    for part in ("top", "base"):
        content["parts"][part] = {**content["parts"][part], "feeder": "chute"}
        del content["parts"][part]["start_m"]
    facts = ("at_start(top)", "at_start(base)", "hand_free")
    assert verdict_of(content, "pick(top)", *facts).is_feasible


def test_a_screw_stands_free_on_what_bears_its_feeder():
    """Neither its head nor the tool above is in the tray."""
    facts = ("placed(plate)", "at_start(tray)", "hand_free")
    content = fetching_board(0.02, beneath_m=0.02, envelope_m=[0.03, 0.03, 0.1])
    assert verdict_of(content, "fasten(screw)", *facts, tool="screwdriver").is_feasible
    content["feeders"]["magazine"]["height_m"] = 0.01
    verdict = verdict_of(content, "fasten(screw)", *facts, tool="screwdriver")
    assert verdict.reason == "screwdriver runs into tray on the approach"


def test_a_turned_part_takes_its_turned_room():
    """A long block placed crosswise hits what it would pass lengthwise."""
    content = shelf()
    content["parts"]["post"] = block([0.7, 0.2], [0.5, 0.06], [0.02, 0.02, 0.1])
    content["parts"]["bar"] = block([0.4, 0.2], [0.5, 0.0], [0.12, 0.02, 0.02])
    facts = ("held(bar)", "placed(post)")
    assert verdict_of(content, "place(bar)", *facts).is_feasible
    content["parts"]["bar"]["goal_yaw_rad"] = 1.5707963
    assert verdict_of(content, "place(bar)", *facts).reason == "bar runs into post on the approach"


def test_a_part_that_is_not_turned_by_quarters_is_refused_in_words():
    """A box about it would take more room than it does."""
    content = shelf()
    content["parts"]["bar"] = block([0.4, 0.2], [0.5, 0.0], [0.12, 0.02, 0.02])
    for yaw_rad in (0.0, 1.5708, -3.14159):
        content["parts"]["bar"]["goal_yaw_rad"] = yaw_rad
        assert AabbDetector(assembly(content)).refuses() is None
    content["parts"]["bar"]["goal_yaw_rad"] = 0.5235988
    refusal = AabbDetector(assembly(content)).refuses()
    assert "'bar' is turned by 30 degrees where placed(bar) holds. Take swept" in refusal


@pytest.mark.parametrize("tolerance_m", [0.0, 0.003])
def test_a_slight_overlap_within_the_tolerance_is_a_touch(tolerance_m):
    """Blocks planned 1 mm into each other."""
    content = shelf()
    content["parts"]["left"] = block([0.7, 0.2], [0.5, 0.06], [0.02, 0.022, 0.02])
    content["parts"]["right"] = block([0.4, 0.2], [0.5, 0.04], [0.02, 0.02, 0.02])
    facts = ("held(right)", "placed(left)")
    verdict = verdict_of(content, "place(right)", *facts, tolerance_m=tolerance_m)
    assert verdict.is_infeasible == (tolerance_m == 0.0)


def test_a_brace_before_the_transformer_is_a_dead_end(board_task):
    """It closes over the place of the transformer, which then cannot be put beneath it."""
    boxes = Setup(collision=("aabb",), with_chart=False)
    model = make_model(board_task, boxes)
    state = model.initial
    for reference in (0, 1, 10, 11):
        skill = board_task.skills[reference]
        assert model.verdict(state, skill).is_feasible
        state = skill.prediction.apply(state)
    state = board_task.skill("pick(transformer)").prediction.apply(state)
    verdict = model.verdict(state, board_task.skill("place(transformer)"))
    assert verdict.reason == "transformer runs into brace on the approach"
    goals = [
        other
        for other in reachable_states(make_model(board_task.replace(initial=state), boxes))
        if model.is_goal(other)
    ]
    assert goals == []


def test_chart_and_geometry_give_the_board_the_same_optimum(board_task):
    """The chart was drawn after this geometry."""
    by_chart = solve(board_task, "exact", Setup(collision=("precedence",)))
    by_boxes = solve(board_task, "exact", Setup(collision=("aabb",), with_chart=False))
    assert by_chart.steps == by_boxes.steps
    assert by_chart.cost == by_boxes.cost


@given(st.sampled_from(["inverter_board", "motor_drive"]))
def test_moving_the_whole_layout_changes_no_verdict(name):
    """Only relative positions matter, away from the limits of reach."""
    content = config_content(name)
    moved = config_content(name)

    def shift(entry, *keys):
        for key in keys:
            if entry.get(key) is not None:
                entry[key] = [entry[key][0] + 0.125, entry[key][1] - 0.25]

    shift(moved["robot"], "home_m")
    for section, keys in (
        ("tools", ["holder_m"]),
        ("feeders", ["position_m"]),
        ("parts", ["start_m", "goal_m"]),
        ("screws", ["hole_m"]),
    ):
        for entry in moved.get(section, {}).values():
            shift(entry, *keys)
    left, other = assembly(content), assembly(moved)
    first, second = AabbDetector(left), AabbDetector(other)
    model = make_model(left, Setup(collision=("aabb",)))
    for state in reachable_states(model, 300):
        for skill in model.applicable(state):
            again = second.check(other.skill(skill.name), other.facts.state(state.bits))
            verdict = first.check(skill, state)
            assert (verdict.status, verdict.reason) == (again.status, again.reason)


def test_a_horizontal_screw_is_pressed_on_what_is_behind_its_head():
    """Beneath it, along its axis."""
    content = shelf()
    content["tools"] = {
        **content["tools"],
        "driver": {"type": "screwdriver", "holder_m": [0.6, -0.2]},
    }
    base = content["parts"]["base"]
    front_m = base["goal_m"][0] - base["size_m"][0] / 2
    hole = {"hole_m": [front_m, base["goal_m"][1], base["size_m"][2] / 2], "axis": [1, 0, 0]}
    content["screws"] = {"screw": {"tool": "driver", "through": "base", **hole}}
    placed = verdict_of(content, "fasten(screw)", "placed(base)", "hand_free", tool="driver")
    assert placed.is_feasible
    away = verdict_of(content, "fasten(screw)", "hand_free", tool="driver")
    assert away.reason == "screw has nothing beneath it"


def test_a_screw_is_not_driven_through_what_lies_above_its_hole():
    """The screw itself is swept, not just the tool that drives it."""
    content = lid_content()
    content["screws"]["screw"] = {"tool": "screwdriver", "hole_m": [0.5, 0.03], "through": "box"}
    del content["chart"]
    task = assembly(content)
    state = task.facts.of(
        "placed(box)", "placed(fuse)", "placed(lid)", "tool(screwdriver)", "hand_free", "at(home)"
    )
    verdict = AabbDetector(task).check(task.skill("fasten(screw)"), state)
    assert verdict.reason == "screw runs into lid on the approach"


def test_a_part_turned_in_place_is_swept_as_it_is_turned():
    """Start and goal at one point, a quarter turn apart: into the neighbour."""
    content = lid_content()
    content["parts"] = {
        "bar": {
            "tool": "gripper",
            "size_m": [0.1, 0.01, 0.02],
            "start_m": [0.5, 0.0],
            "goal_m": [0.5, 0.0],
            "goal_yaw_rad": 1.5708,
        },
        "wall": {
            "tool": "gripper",
            "size_m": [0.02, 0.02, 0.04],
            "start_m": [0.5, 0.04],
            "goal_m": [0.3, -0.2],
        },
    }
    del content["screws"], content["chart"]
    task = assembly(content)
    state = task.facts.of("held(bar)", "at_start(wall)", "tool(gripper)", "at(bar.start)")
    verdict = AabbDetector(task).check(task.skill("place(bar)"), state)
    assert verdict.reason == "bar runs into wall on the approach"


def garage(**drawer):
    """Return a shelf with a roof and a drawer that belongs between them."""
    frame = {
        "tool": "gripper",
        "boxes": [
            {"size_m": [0.10, 0.10, 0.01], "centre_m": [0.0, 0.0, 0.005]},
            {"size_m": [0.10, 0.10, 0.01], "centre_m": [0.0, 0.0, 0.055]},
            {"size_m": [0.01, 0.10, 0.04], "centre_m": [0.045, 0.0, 0.03]},
        ],
        "start_m": [0.4, -0.2],
        "goal_m": [0.5, 0.0],
    }
    part = block([0.4, 0.2], [0.49, 0.0, 0.01], [0.08, 0.06, 0.02], goal_on="frame", **drawer)
    return shelf(parts={"base": frame, "top": part}) | {"parts": {"frame": frame, "drawer": part}}


def test_what_belongs_under_a_roof_goes_in_from_the_side():
    """Straight down it would run into the roof, from the closed side into the wall."""
    for along, feasible in (([0, 0, -1], False), ([1, 0, 0], True), ([-1, 0, 0], False)):
        content = garage(insert_along=along, insert_m=0.15)
        verdict = verdict_of(content, "place(drawer)", "held(drawer)", "placed(frame)")
        assert verdict.is_feasible == feasible
        verdict = verdict_of(content, "place(drawer)", "held(drawer)")
        assert "nothing beneath it" in verdict.reason


def test_a_part_turned_by_quarters_in_space_is_ruled_on():
    """A plate on its edge stands where its edge does, and is in the way up to its height."""
    content = shelf()
    upright = {"goal_rpy_rad": [0.0, 1.5708, 0.0], "goal_m": [0.49, 0.0], "goal_on": "base"}
    content["parts"]["top"] = block([0.4, 0.2], [0, 0], [0.04, 0.04, 0.02]) | upright
    content["parts"]["low"] = block([0.4, 0.3], [0.5, 0.0, 0.06], [0.02, 0.02, 0.01])
    task = assembly(content)
    assert AabbDetector(task).refuses() is None
    position = task.scene.body("top").placements[2].pose.position
    assert position == pytest.approx((0.49, 0.0, 0.04), abs=1e-6)
    assert verdict_of(content, "place(top)", "held(top)", "placed(base)").is_feasible
    assert verdict_of(content, "place(top)", "held(top)").is_infeasible
    verdict = verdict_of(content, "place(low)", "held(low)", "placed(base)")
    assert verdict.reason == "low has nothing beneath it"
    assert verdict_of(content, "place(low)", "held(low)", "placed(base)", "placed(top)").is_feasible


def test_directions_that_no_axis_has_are_refused_in_words():
    """Of a part that leans, and of one that goes in at 45 degrees."""
    content = garage(insert_along=[0.7071, 0.7071, 0], insert_m=0.15)
    assert (
        "goes along [0.7071, 0.7071, 0] in place(drawer)"
        in AabbDetector(assembly(content)).refuses()
    )
    content = shelf()
    content["parts"]["top"] |= {"goal_rpy_rad": [0.0, 0.5, 0.0], "goal_on": "base"}
    refusal = AabbDetector(assembly(content)).refuses()
    assert "'top' is turned by 28.65 degrees in space where placed(top) holds" in refusal


def test_boxes_refuse_to_judge_what_holds_a_round_part():
    """A pin in a bore cannot tip, whatever its box stands on; a box in it is judged as ever."""
    wall = [
        {"size_m": [0.10, 0.01, 0.03], "centre_m": [0, 0, 0.015]},
        {"size_m": [0.10, 0.01, 0.02], "centre_m": [0, 0, 0.0602]},
    ]
    pin = {
        "tool": "gripper",
        "cylinder": {"diameter_m": 0.02, "height_m": 0.08},
        "start_m": [0.4, 0.2],
        "goal_m": [0.5, 0.08, 0.04],
        "goal_rpy_rad": [1.570796, 0, 0],
        "goal_on": "wall",
        "insert_along": [0, 1, 0],
    }
    content = shelf()
    content["parts"] = {
        "wall": {"tool": "gripper", "boxes": wall, "start_m": [0.4, -0.2], "goal_m": [0.5, 0.06]},
        "pin": pin,
    }
    content["parts"]["wall"]["grasp"] = {"closing_axis": "y"}
    task = assembly(content)
    refusal = AabbDetector(task).refuses()
    assert "about 'pin' in place(pin), and boxes cannot tell what holds a round" in refusal
    assert AabbDetector(task, AabbDetector.Options(check_support=False)).refuses() is None


def test_boxes_list_the_arm_as_not_checked_unless_another_detector_checks_it(board_task):
    """A chart does not; convex hulls of the links do."""

    def not_checked(*names):
        return solve(board_task, "exact", Setup(collision=(*names, "precedence"))).not_checked

    sentence, tools = not_checked("aabb")
    assert tools.startswith("bits, cups and shanks of tools without envelope_m or body: ")
    assert sentence == "the arm's links, fingers and postures: aabb checks boxes of parts and tools"
    if "swept" in registry.names("collision"):
        assert sentence not in not_checked("aabb", "swept")


# The hand-made chart as a detector.


class TestPrecedenceDetector(DetectorSuite):
    detector = "precedence"


class TestPrecedenceDetectorThatHoldsBackPicks(DetectorSuite):
    detector = "precedence"

    def make(self, task):
        return PrecedenceDetector(task, PrecedenceDetector.Options(hold_back_picks=True))


def test_what_comes_later_waits():
    """The brace may not be placed before the transformer; the message says so."""
    task = lid_task()
    facts = task.facts
    verdict = PrecedenceDetector(task).check(
        task.skill("place(lid)"), facts.of("placed(box)", "held(lid)", "tool(gripper)")
    )
    assert verdict.is_infeasible
    assert verdict.reason == "the chart puts fuse before lid, and placed(fuse) does not hold"
    assert verdict.facts == ["placed(box)", "not placed(fuse)"]
    assert verdict.evidence == {"before": "fuse", "after": "lid"}


def test_what_should_have_come_earlier_comes_no_more():
    """Once a later one is done."""
    task = lid_task()
    verdict = PrecedenceDetector(task).check(
        task.skill("place(fuse)"), task.facts.of("placed(box)", "placed(lid)", "held(fuse)")
    )
    assert verdict.is_infeasible
    assert verdict.reason == "the chart puts fuse before lid, and placed(lid) holds already"


def test_picks_and_tool_changes_are_free_unless_held_back():
    """The chart is about operations; picking is held back on demand."""
    task = lid_task()
    pick, state = task.skill("pick(lid)"), task.initial
    assert PrecedenceDetector(task).check(pick, state).facts == []
    options = PrecedenceDetector.Options(hold_back_picks=True)
    assert PrecedenceDetector(task, options).check(pick, state).is_infeasible
    assert (
        PrecedenceDetector(task, options).check(task.skill("load(screwdriver)"), state).facts == []
    )


def test_a_task_without_a_chart_is_refused_in_words():
    """With what to do instead."""
    task = lid_task().replace(chart=())
    with pytest.raises(OptionError, match=r"no 'chart:'\. Add one, or use --collision aabb"):
        make_model(task, Setup(collision=("precedence",)))


@pytest.mark.parametrize(("hold_back", "states", "observations"), [(0, 320, 268), (1, 307, 255)])
def test_the_board_has_the_states_that_were_computed_independently(
    board_task, hold_back, states, observations
):
    """320 of them, 307 if picks are held back; 268 and 255 distinct observations."""
    setup = Setup(
        collision=("precedence",), options={"precedence": {"hold_back_picks": bool(hold_back)}}
    )
    result = reachable_states(make_model(board_task, setup))
    assert states == len(result)
    assert observations == len({board_task.observe(state) for state in result})
