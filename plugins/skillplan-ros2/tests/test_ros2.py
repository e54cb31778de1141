"""Plans as joint trajectories of ROS 2: what a reader of bags finds in them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from handovers import best, solved
from skillplan.errors import OptionError
from skillplan.exporters import Handover
from skillplan.model import SkillModel, replay
from skillplan.pipeline import (
    Setup,
    export_files,
    list_notes,
    load_problem,
    make_exporter,
    make_handover,
    make_model,
)
from skillplan.task import Pose, Skill
from skillplan.testing import ExporterSuite, lid_task, shut_box_task, solved_lid
from skillplan_pinocchio import SweptDetector
from skillplan_ros2 import TEXT_TYPE, TRAJECTORY_TYPE, TURN_TYPE, list_message_types
from thinned import slow_case

CONFIGS = Path(__file__).parents[3] / "configs"
TOPIC = "/joint_trajectory_controller/joint_trajectory"


class TestRos2(ExporterSuite):
    exporter = "ros2"


@pytest.mark.slow(reason="a trajectory a test; bags, and one text beside a bag, in every run")
class TestRos2AsText(ExporterSuite):
    exporter = "ros2"
    options: ClassVar[dict[str, Any]] = {"format": "yaml"}


@pytest.mark.parametrize("name", [TEXT_TYPE, TRAJECTORY_TYPE, TURN_TYPE])
def test_messages_are_defined_as_ros_has_them(name):
    """By text and by the hash that tells a reader of another definition."""
    own, known = list_message_types(), get_typestore(Stores.ROS2_HUMBLE)
    assert known.generate_msgdef(name) == own.generate_msgdef(name)
    assert known.hash_rihs01(name) == own.hash_rihs01(name)


@dataclass(frozen=True)
class Message:
    """A message of a bag, or of a text, as it was read."""

    time_ns: int
    joints: list[str]
    times_ns: np.ndarray
    positions: np.ndarray
    speeds: np.ndarray


def read(folder: Path, topic: str = TOPIC) -> list[tuple[int, Any]]:
    """Return time and message of all of a topic."""
    with AnyReader([folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connections = [item for item in reader.connections if item.topic == topic]
        return [
            (time_ns, reader.deserialize(content, connection.msgtype))
            for connection, time_ns, content in reader.messages(connections)
        ]


def trajectories(folder: Path, topic: str = TOPIC) -> list[Message]:
    """Return the trajectories of a bag."""
    return [
        Message(
            time_ns,
            item.joint_names,
            np.array(
                [p.time_from_start.sec * 10**9 + p.time_from_start.nanosec for p in item.points]
            ),
            np.array([point.positions for point in item.points]),
            np.array([point.velocities for point in item.points]),
        )
        for time_ns, item in read(folder, topic)
    ]


@cache
def by_swept(speed_fraction: float, config: str = "inverter_board") -> Handover:
    """Return a board with its optimum, judged by `swept` at a share of the limits."""
    options = {"swept": {"speed_fraction": speed_fraction}}
    task = load_problem(CONFIGS / f"{config}.yaml").task
    return solved(task, Setup(collision=("swept",), options=options))


def written(folder: Path, handover: Handover, **options: Any) -> Path:
    """Write what the exporter makes, as the command line does."""
    for name, content in export_files(make_exporter("ros2", options), handover).items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
    return folder


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """The inverter board's optimum as a bag."""
    return written(tmp_path_factory.mktemp("bag"), best("inverter_board"))


@pytest.mark.parametrize(
    "config",
    [
        "inverter_board",
        slow_case("inverter_ur5e", reason="another arm in every run"),
        slow_case(
            "drawer_module",
            reason="searches a board with ways by swept; boards without are in every run",
        ),
    ],
)
def test_the_cubics_through_the_points_keep_half_the_limits(config, tmp_path):
    """Times rise; speeds and accelerations of what a controller interpolates are in the limits.

    Accelerations within 1 %: between two points of a bent path the run is a cubic up to that.
    """
    handover = by_swept(0.5, config) if config == "drawer_module" else best(config)
    model = handover.task.scene.robots[0].model
    messages = trajectories(written(tmp_path, handover))
    assert len(handover.skills) == len(messages)
    for message in messages:
        assert [joint.name for joint in model.joints] == message.joints
        assert message.times_ns[0] == 0
        steps_s = np.diff(message.times_ns)[:, np.newaxis] / 1e9
        assert (steps_s > 0).all()
        for speed in (message.speeds[0], message.speeds[-1]):
            assert not speed.any()
        mean = np.diff(message.positions, axis=0) / steps_s
        before, after = message.speeds[:-1], message.speeds[1:]
        middle = 1.5 * mean - (before + after) / 4
        for speed in (message.speeds, middle):
            assert (np.abs(speed) <= 0.5 * np.array(model.speed_rad_per_s) * 1.0001).all()
        gains = (6 * mean - 4 * before - 2 * after) / steps_s
        losses = (2 * before + 4 * after - 6 * mean) / steps_s
        for gain in (gains, losses):
            assert (np.abs(gain) <= 0.5 * np.array(model.acceleration_rad_per_s2) * 1.01).all()


@pytest.mark.slow(reason="a bag more; limits and times in every run")
def test_each_skill_begins_where_and_when_the_one_before_ends(bag):
    """To the bit, and to the nanosecond; the whole takes as long as `swept` says."""
    messages = trajectories(bag)
    for before, after in pairwise(messages):
        assert np.array_equal(before.positions[-1], after.positions[0])
        assert before.time_ns + before.times_ns[-1] == after.time_ns
    handover = best("inverter_board")
    detector = SweptDetector(handover.task)
    expected_s = [detector.duration_s(skill.skill, skill.before) for skill in handover.skills]
    assert expected_s == pytest.approx(
        [message.times_ns[-1] / 1e9 for message in messages], abs=1e-6
    )


def test_names_of_skills_and_what_the_hand_does_stand_beside_them(bag):
    """A name at the time of each trajectory; the hand acts while the arm stands still."""
    messages = trajectories(bag)
    handover = best("inverter_board")
    names = [(time_ns, message.data) for time_ns, message in read(bag, "/skillplan/skill")]
    expected = [skill.skill.name for skill in handover.skills]
    assert list(zip([entry.time_ns for entry in messages], expected, strict=True)) == names
    acts = [(time_ns, message.data) for time_ns, message in read(bag, "/skillplan/hand")]
    assert [text for _, text in acts[:2]] == ["grasp pcb", "release pcb"]
    for time_ns, text in acts:
        (item,) = (m for m in messages if 0 <= time_ns - m.time_ns < m.times_ns[-1])
        (begin,) = np.flatnonzero(item.times_ns == time_ns - item.time_ns)
        assert np.array_equal(item.positions[begin], item.positions[begin + 1]), text
        assert not item.speeds[begin : begin + 2].any(), text


@pytest.mark.slow(reason="a plan of 20 skills; trajectories without waits in every run")
def test_skills_begin_after_the_waits_and_screws_have_their_torque(tmp_path):
    task = load_problem(CONFIGS / "cell_arrivals.yaml").task
    setup = Setup(collision=("swept",))
    model = make_model(task, setup)
    plan = task.parse_sequence("0,1,10,11,8,9,2,3,12,13,19,20,21,18,4,5,15,16,6,7")
    handover = make_handover(model, setup, replay(model, plan))
    bag = written(tmp_path, handover)
    ends_s = [item.time_ns / 1e9 + item.times_ns[-1] / 1e9 for item in trajectories(bag)]
    durations_s = [step.duration_s for step in handover.plan.steps]
    # With a feeder's cycle, no long travel counts as faster than by the task's speed.
    assert ends_s[:14] == pytest.approx(list(np.cumsum(durations_s[:14])), abs=1e-6)
    texts = [message.data for _, message in read(bag, "/skillplan/hand")]
    assert "drive screw_1 with 0.9 N m" in texts


def test_as_text_it_says_the_same_in_nine_digits(tmp_path):
    """A document a message, with the fields of ROS 2 in their order; both may be asked for."""
    folder = written(tmp_path, solved_lid(lid_task()), format="both", topic="/arm/go")
    assert {"metadata.yaml", "trajectories.mcap", "trajectories.yaml"} == {
        path.name for path in folder.iterdir()
    }
    documents = list(
        yaml.load_all((folder / "trajectories.yaml").read_text("utf-8"), yaml.CSafeLoader)
    )
    messages = trajectories(folder, "/arm/go")
    assert len(documents) == len(messages)
    for document, item in zip(documents, messages, strict=True):
        assert list(document) == ["header", "joint_names", "points"]
        assert item.joints == document["joint_names"]
        points = document["points"]
        assert item.times_ns.tolist() == [
            p["time_from_start"]["sec"] * 10**9 + p["time_from_start"]["nanosec"] for p in points
        ]
        for key, values in (("positions", item.positions), ("velocities", item.speeds)):
            assert np.allclose([p[key] for p in points], values, rtol=0, atol=6e-10)


@pytest.mark.slow(reason="a search and two bags; limits in every run")
def test_speed_is_that_of_swept_unless_it_is_set(tmp_path):
    """Where `swept` judges the plan, it moves with the options that it was judged by."""
    (slow := tmp_path / "slow").mkdir()
    (fast := tmp_path / "fast").mkdir()

    def fastest(folder: Path) -> float:
        return max(float(np.abs(trajectory.speeds).max()) for trajectory in trajectories(folder))

    top = 2.61  # of the three joints at the hand
    assert fastest(written(slow, by_swept(0.2))) == pytest.approx(0.2 * top, rel=0.01)
    assert fastest(written(fast, by_swept(0.2), speed_fraction=1)) == pytest.approx(top, rel=0.01)


def refusal(handover: Handover) -> str:
    with pytest.raises(OptionError, match="cannot be exported to ros2") as caught:
        export_files(make_exporter("ros2", {}), handover)
    return str(caught.value)


@pytest.mark.parametrize(
    ("config", "part", "plan"),
    [("br17.10.sop", None, None), ("swarmitfix_polygonal.yaml", "base-1", ("B2", "B2"))],
)
def test_a_task_without_an_arm_is_refused_in_words(config, part, plan):
    """An order of TSPLIB has none, nor has a bench on which bases walk."""
    task = load_problem(CONFIGS / config).part(part)
    model = make_model(task, Setup())
    skills = any_order(model) if plan is None else [task.skill(name) for name in plan]
    message = refusal(make_handover(model, Setup(), replay(model, skills)))
    assert "a joint trajectory is of one arm, and the task has none: export to csv" in message


def any_order(model: SkillModel) -> list[Skill]:
    """Return the jobs of an order, the first feasible one each time."""
    state, skills = model.initial, []
    while not model.is_goal(state):
        step = next(iter(model.transitions(state)))
        skills.append(step.skill)
        state = step.outcomes[0][1]
    return skills


def test_a_skill_that_swept_does_not_grant_is_refused_with_its_reason():
    """The chart of this task has the fuse put into a box that is shut."""
    message = refusal(solved(shut_box_task()))
    assert "swept does not grant place(fuse): " in message
    assert "runs into lid" in message


def test_the_topic_is_one_of_ros():
    """And none that texts have."""
    for topic in ("no slash", "/2", "/a//b", "/skillplan/hand"):
        with pytest.raises(OptionError, match="topic"):
            make_exporter("ros2", {"topic": topic})


def test_that_the_hand_is_left_out_is_noted():
    """And where it stands."""
    (bag_note,) = list_notes(make_exporter("ros2", {}), best("inverter_board"))
    (text_note,) = list_notes(make_exporter("ros2", {"format": "yaml"}), best("inverter_board"))
    assert ("/skillplan/hand" in bag_note, "comments" in text_note) == (True, True)


@pytest.mark.slow(reason="swept plans a turn")
def test_a_turn_has_the_poses_of_the_playback_and_holders_act_while_the_arm_rests(tmp_path):
    cell = yaml.safe_load((CONFIGS / "cell_turn.yaml").read_text())
    for section, name in (("parts", "foot"), ("parts", "cover"), ("tools", "driver")):
        del cell[section][name]
    del cell["screws"], cell["expect"]
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(cell, sort_keys=False))
    task = load_problem(path, {"physics": (), "collision": ()}).task
    known = ("at(home)", "fixed", "hand_free", "tool(gripper)", "turned(flip.up)")
    task = task.replace(initial=task.facts.of(*known, "placed(chassis)", "open(vise)"))
    skills = [task.skill(name) for name in ("clamp(chassis)", "turn(flip.down)")]
    setup = Setup(collision=("swept",))
    model = make_model(task, setup)
    handover = make_handover(model, setup, replay(model, skills))
    bag = written(tmp_path, handover, format="both")
    acts = [(time_ns, message.data) for time_ns, message in read(bag, "/skillplan/hand")]
    ((begin_ns, turn),) = read(bag, "/skillplan/workholder")
    assert acts == [(0, "clamp(chassis)"), (begin_ns, "turn flip.down")]
    assert '# turn of "flip" from' in (bag / "trajectories.yaml").read_text()
    played = SweptDetector(task).planned_motion(skills, 20).samples
    start = played[0].bodies["chassis"]
    for point in turn.points[10::20]:
        after_ns = point.time_from_start.sec * 10**9 + point.time_from_start.nanosec
        place, rotation = point.transforms[0].translation, point.transforms[0].rotation
        turned = Pose((place.x, place.y, place.z), (rotation.x, rotation.y, rotation.z, rotation.w))
        shown = played[round((begin_ns + after_ns) / 1e9 * 20) - 1].bodies["chassis"]
        assert turned.then(start).position == pytest.approx(shown.position, abs=1e-4)
    assert played[-1].bodies["chassis"].rotate((0.0, 0.0, 1.0)) == pytest.approx((0, 0, -1))
