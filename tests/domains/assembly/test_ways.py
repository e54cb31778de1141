"""What a file says of grasps and of directions of insertion, and the ways that follow."""

import math

import pytest

from situations import assembly
from skillplan.domains.assembly import AssemblyConfig, AssemblyDomain
from skillplan.task import Event, GraspKind

FLOOR = [{"size_m": [0.2, 0.2, 0.01], "centre_m": [0.0, 0.0, 0.005]}]
WALLS = [
    {"size_m": [0.2, 0.01, 0.05], "centre_m": [0.0, 0.095, 0.025]},
    {"size_m": [0.2, 0.01, 0.05], "centre_m": [0.0, -0.095, 0.025]},
]


def content_of(**drawer):
    """Return two walls on the table, and a drawer that belongs between them."""
    return {
        "kind": "assembly",
        "name": "drawer-in-case",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {
            "hand": {"holder_m": [0.5, 0.3], "opening_m": 0.08},
            "driver": {"holder_m": [0.6, 0.3], "type": "screwdriver"},
        },
        "initial_tool": "hand",
        "parts": {
            "case": {
                "tool": "hand",
                "boxes": WALLS,
                "grasp": {"type": "suction", "at_m": [0.0, 0.095]},
                "start_m": [0.3, 0.3],
                "goal_m": [0.5, 0.0],
            },
            "drawer": {
                "tool": "hand",
                "size_m": [0.1, 0.06, 0.03],
                "start_m": [0.3, -0.2],
                "goal_m": [0.5, 0.0],
                **drawer,
            },
        },
    }


def task_of(**drawer):
    """Return the task of the case and the drawer."""
    return assembly(content_of(**drawer))


def issues_of(content):
    """Return path and message of what is wrong with a content."""
    config = AssemblyConfig.model_validate(content)
    return [(issue.path, issue.message) for issue in AssemblyDomain().issues(config)]


def visit_of(motion):
    """Return the only visit of a motion."""
    (route,) = motion.routes
    (visit,) = route.visits
    return visit


def labels(task, skill):
    """Return the ways of a skill in words."""
    return [way.label for way in task.skill(skill).ways]


def test_a_file_that_says_nothing_has_one_way_straight_down():
    """As before there were any: no ways, no grasp named by the visit."""
    task = task_of()
    assert all(not skill.ways for skill in task.skills)
    visit = visit_of(task.skill("place(drawer)").motion)
    assert (visit.along, visit.insert_m, visit.grasp) == ((0.0, 0.0, -1.0), None, None)
    assert [grasp.name for grasp in task.scene.body("drawer").grasps] == [""]


def test_one_direction_is_no_choice():
    """The motion follows it; its length need not be 1 in the file."""
    task = task_of(insert_along=[0, -3, 4])
    assert labels(task, "place(drawer)") == []
    assert visit_of(task.skill("place(drawer)").motion).along == (0.0, -0.6, 0.8)


def test_of_several_directions_every_one_is_a_way_of_the_place():
    """In the order of the file; the skill moves as in the first, and the pick has no choice."""
    task = task_of(insert_along=[[-1, 0, 0], [0, 0, -1], [1, 0, 1]])
    place = task.skill("place(drawer)")
    assert labels(task, "place(drawer)") == ["along -x", "along -z", "along (0.707 0 0.707)"]
    assert place.motion == place.ways[0].motion
    assert labels(task, "pick(drawer)") == []
    assert place.by(place.ways[1]).name == "place(drawer) along -z"


def test_a_direction_may_be_given_in_the_frame_of_the_part_at_its_goal():
    """Turned with it."""
    turned = task_of(insert_along=[1, 0, 0], frame="goal", goal_yaw_rad=math.pi / 2)
    along = visit_of(turned.skill("place(drawer)").motion).along
    assert along == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    world = task_of(insert_along=[1, 0, 0], goal_yaw_rad=math.pi / 2)
    assert visit_of(world.skill("place(drawer)").motion).along == (1.0, 0.0, 0.0)


def test_the_stretch_begins_where_the_part_is_free_of_what_it_goes_into():
    """From 50 mm inside the far end of the walls, all 150 mm back, and 5 mm more."""
    visit = visit_of(task_of(insert_along=[-1, 0, 0]).skill("place(drawer)").motion)
    assert visit.insert_m == pytest.approx(0.05 + 0.1 + 0.005)
    given = visit_of(task_of(insert_along=[-1, 0, 0], insert_m=0.07).skill("place(drawer)").motion)
    assert given.insert_m == 0.07
    beside = task_of(insert_along=[-1, 0, 0], goal_m=[0.5, -0.25])
    assert visit_of(beside.skill("place(drawer)").motion).insert_m == pytest.approx(0.01)


def test_what_lies_beneath_a_part_is_nothing_it_goes_into():
    """A plate that it slides over would make the stretch as long as the plate."""
    content = content_of(insert_along=[-1, 0, 0], goal_on="case")
    content["parts"]["case"] |= {"boxes": FLOOR, "grasp": {"type": "suction"}}
    visit = visit_of(assembly(content).skill("place(drawer)").motion)
    assert visit.insert_m == pytest.approx(0.01)


def test_grasps_that_are_too_wide_are_faults_by_themselves():
    """Each at its own entry."""
    issues = issues_of(content_of(grasp=[{}, {"closing_axis": "x"}]))
    ((path, message),) = issues
    assert path == ("parts", "drawer", "grasp", 1)
    assert message.startswith("0.100 m wide where the jaws of 'hand' open 0.080 m")


def test_pick_and_place_have_a_way_for_every_grasp():
    """The place one for every grasp and direction, the grasps outside."""
    grasps = [{"type": "suction"}, {}, {"approach": [-1, 0, 0], "closing_axis": "y"}]
    task = task_of(grasp=grasps, insert_along=[[-1, 0, 0], [0, 0, -1]])
    assert labels(task, "pick(drawer)") == [
        "grasp top closing along y by suction",
        "grasp top closing along y by jaws",
        "grasp +x",
    ]
    assert labels(task, "place(drawer)") == [
        "along -x, grasp top closing along y by suction",
        "along -z, grasp top closing along y by suction",
        "along -x, grasp top closing along y by jaws",
        "along -z, grasp top closing along y by jaws",
        "along -x, grasp +x",
        "along -z, grasp +x",
    ]
    way = task.skill("place(drawer)").ways[4]
    visit = visit_of(way.motion)
    assert (visit.event, visit.grasp.name) == (Event.RELEASE, "+x")
    assert visit.grasp in task.scene.body("drawer").grasps


def test_a_hand_at_a_side_holds_as_one_at_the_top_does():
    """Twelve millimetres deep, in the middle of what it holds."""
    task = task_of(grasp={"approach": [-1, 0, 0], "closing_axis": "y"})
    (grasp,) = task.scene.body("drawer").grasps
    assert grasp.kind is GraspKind.JAWS
    assert grasp.tip == pytest.approx((0.05 - 0.012, 0.0, 0.015))
    assert (grasp.width_m, grasp.closing_axis) == (pytest.approx(0.06), "y")
    (upright,) = task_of(grasp={"approach": [-1, 0, 0]}).scene.body("drawer").grasps
    assert (upright.width_m, upright.closing_axis) == (pytest.approx(0.03), "z")


def test_a_cup_lands_on_the_first_surface_on_its_axis():
    """Of a cylinder from the side on its mantle."""
    cylinder = {"diameter_m": 0.03, "height_m": 0.02}
    task = task_of(
        size_m=None, cylinder=cylinder, grasp={"type": "suction", "approach": [0, -1, 0]}
    )
    (grasp,) = task.scene.body("drawer").grasps
    assert grasp.tip == pytest.approx((0.0, 0.015, 0.01))
    off = {"type": "suction", "approach": [0, -1, 0], "at_m": [0.009, 0, 0.01]}
    task = task_of(size_m=None, cylinder=cylinder, grasp=off)
    assert task.scene.body("drawer").grasps[0].tip == pytest.approx((0.009, 0.012, 0.01))


def test_automatic_grasps_are_those_that_a_hand_can_take():
    """Of six sides and two axes: not too wide, and not from within the table."""
    task = task_of(grasp="auto")
    names = [grasp.name for grasp in task.scene.body("drawer").grasps]
    assert names[0] == "top"
    assert "bottom" not in names
    assert set(names) == {
        "top",
        "-x closing along y",
        "-x closing along z",
        "+x closing along y",
        "+x closing along z",
        "-y",
        "+y",
    }


def test_a_part_that_no_hand_can_hold_is_one_fault():
    """At the word."""
    ((path, message),) = issues_of(content_of(grasp="auto", size_m=[0.1, 0.1, 0.1]))
    assert path == ("parts", "drawer", "grasp")
    assert message.startswith("no hand can hold it from any of its six sides: top closing along x")


def test_a_screw_goes_along_its_axis():
    """Into the side of the drawer: its head is outside."""
    content = content_of()
    content["screws"] = {
        "bolt": {
            "tool": "driver",
            "hole_m": [0.55, 0.0, 0.015],
            "axis": [-2, 0, 0],
            "through": "drawer",
        }
    }
    task = assembly(content)
    visit = visit_of(task.skill("fasten(bolt)").motion)
    assert visit.along == (-1.0, 0.0, 0.0)
    assert visit.position == (0.55, 0.0, 0.015)
    head = task.scene.body("bolt").placements[0].pose
    assert head.rotate((0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    content["screws"]["bolt"]["hole_m"] = [0.56, 0.0, 0.015]
    ((path, _),) = issues_of(content)
    assert path == ("screws", "bolt", "hole_m")


def test_a_hole_with_a_height_need_not_be_at_the_highest_place():
    """Straight down it must still be at the top of something of its part."""
    content = content_of()
    content["screws"] = {
        "bolt": {"tool": "driver", "hole_m": [0.45, -0.09, 0.01], "through": "case"}
    }
    step = {"size_m": [0.2, 0.03, 0.01], "centre_m": [0.0, -0.085, 0.005]}
    content["parts"]["case"]["boxes"] = [step, WALLS[0]]
    assert issues_of(content) == []
    assert visit_of(assembly(content).skill("fasten(bolt)").motion).position[2] == 0.01
    content["screws"]["bolt"]["hole_m"] = [0.45, 0.09, 0.01]
    ((path, _),) = issues_of(content)
    assert path == ("screws", "bolt", "hole_m")


def test_check_shows_how_parts_go_in_and_are_held():
    """With the length of each stretch; nothing of parts that have no choice and say nothing."""
    config = AssemblyConfig.model_validate(content_of())
    assert "ways" not in AssemblyDomain().overview(config).document
    grasps = [{"type": "suction"}, {"approach": [-1, 0, 0]}]
    content = content_of(insert_along=[[-1, 0, 0], [0, 0, -1]], grasp=grasps)
    shown = AssemblyDomain().overview(AssemblyConfig.model_validate(content))
    line = "ways       drawer goes in along -x over 155.0 mm or along -z, is held at top or +x"
    assert shown.lines[-1] == line
    (entry,) = shown.document["ways"]
    assert [direction["insert_m"] for direction in entry["directions"]] == [
        pytest.approx(0.155),
        None,
    ]
