"""Hands and parts in any orientation: turned on the way, pushed in, screwed from the side."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from situations import assembly
from skillplan.checks import introduce
from skillplan.task import (
    AXES,
    DOWN,
    Box,
    Event,
    Grasp,
    GraspKind,
    Motion,
    Pose,
    Route,
    Task,
    Visit,
)
from skillplan_pybullet import PybulletEngine
from skillplan_simulation import ContactPairsDetector

ALONG_X = (1.0, 0.0, 0.0)
# Held where it lies from above, where it stands from the side: the hand is turned with the part.
BY_ITS_SIDE = Grasp(GraspKind.JAWS, (0.0, 0.0, 0.07), AXES["y"], 0.02, approach=ALONG_X)
LYING = Pose.turned((0.45, -0.2, 0.01), (0.0, math.pi / 2, 0.0))
STANDING = Pose((0.5, 0.15, 0.0))


def content(parts, screws=None):
    """Return a file's content with a gripper and a screwdriver."""
    results = {
        "kind": "assembly",
        "name": "in_space",
        "robot": {"home_m": [0.4, 0.0], "safe_height_m": 0.25},
        "tools": {
            "gripper": {"holder_m": [0.6, 0.4]},
            "driver": {"holder_m": [0.6, -0.4], "type": "screwdriver"},
        },
        "initial_tool": "gripper",
        "parts": parts,
    }
    return results | ({"screws": screws} if screws else {})


def block(size_m, start_m, goal_m, mass_kg=0.1, **more):
    """Return what a file says of a block."""
    keys = ("tool", "size_m", "start_m", "goal_m", "mass_kg")
    values = ("gripper", list(size_m), list(start_m), list(goal_m), mass_kg)
    return dict(zip(keys, values, strict=True)) | more


def in_space(
    task: Task, name: str, start: Pose, goal: Pose, along=DOWN, insert_m=None, **changes
) -> Task:
    """Return a task in which a part is picked and placed in other poses, and held otherwise."""
    places = {f"at_start({name})": start, f"placed({name})": goal}
    body = task.scene.body(name)
    placements = tuple(
        replace(placement, pose=places.get(placement.fact, placement.pose))
        for placement in body.placements
    )
    turned = replace(body, placements=placements, **changes)
    bodies = tuple(turned if item.name == name else item for item in task.scene.bodies)
    visits = {
        f"pick({name})": Visit(start, Event.GRASP, name),
        f"place({name})": Visit(goal, Event.RELEASE, name, along=along, insert_m=insert_m),
    }
    task = replace(task, scene=replace(task.scene, bodies=bodies))
    return visiting(task, visits)


def visiting(task: Task, visits: dict[str, Visit]) -> Task:
    """Return a task whose skills visit something else at last."""
    skills = []
    for skill in task.skills:
        if skill.name in visits:
            assert skill.motion is not None
            (route,) = skill.motion.routes
            last = Route(route.when, (*route.visits[:-1], visits[skill.name]))
            motion = Motion(skill.motion.robot, (last,), skill.motion.carries)
            skill = replace(skill, motion=motion)
        skills.append(skill)
    return replace(task, skills=tuple(skills))


def after(task: Task, *names: str):
    """Return the state after some skills."""
    state = task.initial
    for name in names:
        state = task.skill(name).prediction_in(state).apply(state)
    return state


def verdicts(task: Task, name: str, state):
    """Return what the engine and the detector of contacts say of a skill."""
    engine = PybulletEngine(task)
    detector = ContactPairsDetector(task)
    introduce([engine, detector])
    return engine.check(task.skill(name), state), detector.check(task.skill(name), state)


def plan(task: Task, *names: str):
    """Return a plan as it was executed."""
    engine = PybulletEngine(task)
    detector = ContactPairsDetector(task)
    introduce([engine, detector])
    return engine.perform([task.skill(name) for name in names])


def bar() -> Task:
    """Return the task of a bar that lies at first, and stands in the end."""
    task = assembly(content({"bar": block((0.02, 0.02, 0.1), (0.5, -0.2), (0.5, 0.15))}))
    return in_space(task, "bar", LYING, STANDING, grasps=(BY_ITS_SIDE,))


class TestAPartThatIsTurned:
    @pytest.mark.slow(reason="an execution; a screw from the side in every run")
    def test_it_is_picked_where_it_lies(self):
        task = bar()
        for verdict in verdicts(task, "pick(bar)", task.initial):
            assert verdict.is_feasible, verdict.reason

    @pytest.mark.slow(reason="executes; an insertion and a screw in every run")
    def test_it_stands_where_the_hand_has_turned_it(self):
        task = bar()
        for verdict in verdicts(task, "place(bar)", after(task, "pick(bar)")):
            assert verdict.is_feasible, verdict.reason
        assert "at(bar.start)" in verdict.facts

    @pytest.mark.slow(reason="two skills and the travels between them; one skill in every run")
    def test_a_whole_plan_turns_it(self):
        performance = plan(bar(), "pick(bar)", "place(bar)")
        assert performance.failed is None, performance.failed.verdict.reason
        (arrival,) = performance.arrivals
        assert arrival.offset_m < 0.0005
        assert arrival.tilt_rad < math.radians(1)


BY_A_CUP = Grasp(GraspKind.SUCTION, (-0.015, 0.0, 0.06), AXES["y"], 0.0, approach=ALONG_X)


class TestSuctionFromTheSide:
    @pytest.mark.slow(reason="an execution; jaws from the side in every run")
    @pytest.mark.parametrize("control", ["osc", "position"])
    def test_a_plate_is_stood_up_by_a_cup(self, control):
        parts = {"plate": block((0.03, 0.05, 0.09), (0.5, -0.2), (0.5, 0.15), tool="cup")}
        results = content(parts)
        results["tools"] = {"cup": {"holder_m": [0.6, 0.4], "type": "suction"}}
        results["initial_tool"] = "cup"
        start = Pose.turned((0.45, -0.2, 0.015), (0.0, math.pi / 2, 0.0))
        task = in_space(assembly(results), "plate", start, STANDING, grasps=(BY_A_CUP,))
        engine = PybulletEngine(task, PybulletEngine.Options(control=control))
        introduce([engine, ContactPairsDetector(task)])
        performance = engine.perform([task.skill(name) for name in ("pick(plate)", "place(plate)")])
        assert performance.failed is None, performance.failed.verdict.reason
        (arrival,) = performance.arrivals
        assert arrival.offset_m < 0.0005
        assert arrival.tilt_rad < math.radians(1)


FLOOR_M, WALL_M, INSIDE_M = 0.06, 0.01, 0.031
# A drawer that stands on its front at first, and lies in its housing in the end.
UPENDED = Pose.turned((0.4, -0.2, 0.035), (0.0, math.pi / 2, 0.0))
PUSHED_IN = Pose((0.55, 0.1, FLOOR_M))
BY_ITS_END = Grasp(GraspKind.JAWS, (-0.022, 0.0, 0.015), AXES["y"], 0.03, approach=ALONG_X)


def housing_of(slack_m: float) -> tuple[Box, ...]:
    """Return a box that is open towards the robot, so much wider than a drawer of 30 mm."""
    inside_m = 0.03 + slack_m
    length_m, outside_m = 0.06, inside_m + 2 * WALL_M
    walls = [
        Box(
            (length_m, WALL_M, inside_m),
            (0.0, side * (inside_m + WALL_M) / 2, FLOOR_M + inside_m / 2),
        )
        for side in (-1, 1)
    ]
    return (
        Box((length_m, outside_m, FLOOR_M), (0.0, 0.0, FLOOR_M / 2)),
        *walls,
        Box((length_m, outside_m, WALL_M), (0.0, 0.0, FLOOR_M + inside_m + WALL_M / 2)),
    )


def drawer(slack_m: float = 0.001, goal: Pose = PUSHED_IN) -> Task:
    """Return the task of a drawer that is pushed into a housing."""
    parts = {
        "housing": block((0.06, 0.06, 0.1), (0.5, 0.35), (0.575, 0.1), 2.0),
        "drawer": block((0.07, 0.03, 0.03), (0.4, -0.2), (0.55, 0.3)),
    }
    task = assembly(content(parts))
    shapes = housing_of(slack_m)
    bodies = tuple(
        replace(body, shapes=shapes) if body.name == "housing" else body
        for body in task.scene.bodies
    )
    task = replace(task, scene=replace(task.scene, bodies=bodies))
    return in_space(task, "drawer", UPENDED, goal, ALONG_X, 0.09, grasps=(BY_ITS_END,))


class TestInsertionFromTheSide:
    STATE = ("pick(housing)", "place(housing)", "pick(drawer)")

    @pytest.mark.slow(reason="an execution; a screw from the side in every run")
    def test_a_drawer_is_pushed_into_its_housing(self):
        task = drawer()
        engine, detector = verdicts(task, "place(drawer)", after(task, *self.STATE))
        assert engine.is_feasible, engine.reason
        assert detector.is_feasible, detector.reason
        assert engine.evidence["sensed"]["insertion_force_n"] < 5.0
        assert "placed(housing)" in engine.facts

    @pytest.mark.slow(reason="executes; an insertion and a screw in every run")
    def test_a_drawer_that_misses_the_opening_is_stopped(self):
        goal = Pose((0.55, 0.11, FLOOR_M))
        task = drawer(goal=goal)
        engine, detector = verdicts(task, "place(drawer)", after(task, *self.STATE))
        assert engine.is_infeasible or detector.is_infeasible

    @pytest.mark.slow(reason="two skills and the travels between them; one skill in every run")
    def test_a_whole_plan_leaves_it_there(self):
        task = drawer()
        task = replace(task, initial=after(task, "pick(housing)", "place(housing)"))
        performance = plan(task, "pick(drawer)", "place(drawer)")
        assert performance.failed is None, performance.failed.verdict.reason
        for arrival in performance.arrivals:
            assert arrival.offset_m < 0.0005
            assert arrival.tilt_rad < math.radians(1)


INTO_THE_SIDE = Pose.turned((0.5, 0.1, 0.1), (0.0, -math.pi / 2, 0.0))


def bracket(mass_kg: float = 3.0) -> Task:
    """Return the task of a heavy block with a screw in its side."""
    parts = {"block": block((0.08, 0.08, 0.16), (0.5, -0.25), (0.54, 0.1), mass_kg)}
    screws = {"screw": {"through": "block", "hole_m": [0.54, 0.1], "tool": "driver"}}
    task = assembly(content(parts, screws))
    body = task.scene.body("screw")
    placements = tuple(
        replace(placement, pose=INTO_THE_SIDE) if placement.fact == "fastened(screw)" else placement
        for placement in body.placements
    )
    bodies = tuple(
        replace(body, placements=placements) if item.name == "screw" else item
        for item in task.scene.bodies
    )
    task = replace(task, scene=replace(task.scene, bodies=bodies))
    visit = Visit(INTO_THE_SIDE, Event.DRIVE, "screw", along=ALONG_X)
    return visiting(task, {"fasten(screw)": visit})


class TestHorizontalScrews:
    STATE = ("pick(block)", "place(block)", "load(driver)")

    def test_it_is_pressed_into_the_side(self):
        task = bracket()
        engine, detector = verdicts(task, "fasten(screw)", after(task, *self.STATE))
        assert engine.is_feasible, engine.reason
        assert detector.is_feasible, detector.reason
        assert engine.evidence["sensed"]["fastening_force_n"] >= 3.0

    @pytest.mark.slow(reason="two skills of a plan; the screw by itself in every run")
    def test_it_holds_where_gravity_would_have_it_fall(self):
        task = bracket()
        task = replace(task, initial=after(task, "pick(block)", "place(block)"))
        performance = plan(task, "load(driver)", "fasten(screw)")
        assert performance.failed is None, performance.failed.verdict.reason
        arrivals = {arrival.body: arrival for arrival in performance.arrivals}
        assert arrivals["screw"].offset_m < 0.0005
        assert arrivals["screw"].tilt_rad < math.radians(1)

    @pytest.mark.slow(reason="executes; an insertion and a screw in every run")
    def test_a_light_block_yields(self):
        task = bracket(0.2)
        for verdict in verdicts(task, "fasten(screw)", after(task, *self.STATE)):
            if verdict.is_infeasible:
                return
        raise AssertionError("a block of 0.2 kg cannot withstand 5 N on a table")
