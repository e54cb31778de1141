"""Random travels among the bodies of shipped boards and pillars, and a check of their own for them.

The check shares no code with the planner: transforms are multiplied here, from the description of
the robot, and coal is asked at places so dense that no point goes farther than a fraction of a
millimetre in between.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import coal
import numpy as np

from skillplan import load_problem
from skillplan.physics import LinearMotion
from skillplan.robots import PANDA, Transform
from skillplan.task import Body, Box, Event, GraspKind, Pose, Scene, ToolKind, Visit
from skillplan_pinocchio import (
    ArmModel,
    ConvexPiece,
    HandSweeps,
    JointPath,
    Obstacle,
    Travel,
    TravelPlanner,
    Unfound,
    collect_obstacles,
    compute_box_corners,
)

CONFIGS = Path(__file__).parents[2] / "configs"
BOARDS = ("inverter_board", "battery_module", "motor_drive", "relay_rail", "sensor_stack")
# About home, so much is drawn for every joint [rad].
_SPREAD_RAD = np.array([1.6, 0.7, 0.5, 0.6, 0.5, 0.6, 1.2])
_PILLARS = 26
_CLEARANCE_M = 0.004


@dataclass(frozen=True)
class CrampedTravel:
    """A question to a planner.

    Parameters
    ----------
    board
        Name of the file that the bodies are of.
    planner
        With all that there may be.
    start_rad, goal_rad
        Where it begins and ends, shape (7,); nothing is touched there.
    motion
        What follows.
    there
        Facts that hold.
    """

    board: str
    planner: TravelPlanner
    start_rad: np.ndarray
    goal_rad: np.ndarray
    motion: LinearMotion
    there: frozenset[str]

    def answer(self, planner: TravelPlanner | None = None) -> Travel | Unfound:
        """Return what a planner answers, its own by default."""
        return (planner or self.planner).travel(
            self.start_rad, self.goal_rad, self.motion, self.there.__contains__
        )

    @property
    def standing(self) -> list[Obstacle]:
        """What stands there, but for what is carried."""
        return [
            obstacle
            for obstacle in self.planner.obstacles
            if (obstacle.fact is None or obstacle.fact in self.there)
            and obstacle.body != self.motion.carries
        ]

    def fresh_planner(self) -> TravelPlanner:
        """Return a planner that was asked nothing yet; it knows the hulls of what stands."""
        assert all(piece.hull for obstacle in self.planner.obstacles for piece in obstacle.pieces)
        return TravelPlanner(self.planner.arm, self.planner.sweeps, self.planner.obstacles)


def cramped_travels(count: int, seed: int = 1) -> Iterator[CrampedTravel]:
    """Yield travels whose ends are free, in turn among the bodies of each board."""
    rng = np.random.default_rng(seed)
    scenes = [load_problem(str(CONFIGS / f"{name}.yaml")).task.scene for name in BOARDS]
    for number in range(count):
        yield _drawn(rng, BOARDS[number % len(BOARDS)], scenes[number % len(BOARDS)])


def _drawn(rng: np.random.Generator, board: str, scene: Scene) -> CrampedTravel:
    arm = ArmModel()
    robot = scene.robots[0]
    while True:
        pillars = [_pillar(rng, number) for number in range(_PILLARS)]
        sweeps = HandSweeps(scene, robot, _CLEARANCE_M)
        planner = TravelPlanner(arm, sweeps, [*collect_obstacles(scene), *pillars])
        there = {
            pillar.fact for pillar in pillars if pillar.fact is not None and rng.random() < 0.8
        }
        there |= {
            body.placements[rng.integers(len(body.placements))].fact
            for body in scene.bodies
            if body.placements and rng.random() < 0.9
        }
        graspable = [body for body in scene.bodies if body.grasps]
        body = graspable[rng.integers(len(graspable))] if rng.random() < 0.5 else None
        for _ in range(20):
            start_rad, goal_rad = (
                np.clip(
                    arm.home_rad + rng.uniform(-1, 1, len(arm.home_rad)) * _SPREAD_RAD,
                    arm.low_rad,
                    arm.high_rad,
                )
                for _ in range(2)
            )
            motion = _motion(arm, goal_rad, scene, body)
            cramped_travel = CrampedTravel(
                board, planner, start_rad, goal_rad, motion, frozenset(there)
            )
            ends = (JointPath([start_rad, start_rad]), JointPath([goal_rad, goal_rad]))
            if all(deepest_m(cramped_travel, end) > 0.001 for end in ends):
                return cramped_travel


def _pillar(rng: np.random.Generator, number: int) -> Obstacle:
    away_m, bearing = rng.uniform(0.3, 0.75), rng.uniform(-1.9, 1.9)
    width_m, depth_m = rng.uniform(0.02, 0.12, 2)
    height_m = rng.uniform(0.2, 1.0)
    centre = (away_m * math.cos(bearing), away_m * math.sin(bearing), height_m / 2)
    box = Box((float(width_m), float(depth_m), float(height_m)), centre)
    return Obstacle(
        f"pillar {number}", f"stands({number})", (ConvexPiece(compute_box_corners(box)),)
    )


def _motion(arm: ArmModel, goal_rad: np.ndarray, scene: Scene, body: Body | None) -> LinearMotion:
    """Return a motion that begins where the tip is at the goal, with a body in the hand or none."""
    position, rotation = arm.tip(goal_rad)
    tip = tuple(position.tolist())
    hand = Pose.of_axes(tip, tuple(rotation[:, 1].tolist()), tuple(rotation[:, 2].tolist()))
    tools = {tool.kind: tool for tool in scene.robots[0].tools}
    tool = tools.get(ToolKind.GRIPPER)
    if body is None:
        visit = Visit(Pose(tip), Event.LOAD, "gripper")
    else:
        grasp = body.grasps[0]
        held = hand.then(Pose.of_axes(grasp.tip, grasp.closing, grasp.approach).inverse())
        visit = Visit(held, Event.RELEASE, body.name)
        if grasp.kind is GraspKind.SUCTION:
            tool = tools.get(ToolKind.SUCTION)
    name = None if body is None else body.name
    return LinearMotion(visit, tip, 0.0, hand.orientation, (tip, tip), (tip, tip), name, tool, None)


def deepest_m(travel: CrampedTravel, path: JointPath, spacing_m: float = 1e-3) -> float:
    """Return the smallest distance on a path [m], below 0 how deep something is touched.

    No corner of what moves goes farther than `spacing_m` between two places that are looked at:
    from one of them it is no farther than half of it. What is farther apart than 2 mm counts as
    2 mm. Pairs of the arm's own solids count that are apart in the description's home.
    """
    movers = _movers(travel)
    rough = [_frames(path.at(place)) for place in np.linspace(0, 1, _ROUGH + 1)]
    farthest_m = max(
        float(np.linalg.norm(np.diff(_corners(mover, rough), axis=0), axis=2).max())
        for mover in movers
    )
    count = max(math.ceil(_ROUGH * farthest_m / spacing_m), 1)
    frames = [_frames(path.at(number / count)) for number in range(count + 1)]
    boxes = [_boxes(mover, frames) for mover in movers]
    worst_m = _FAR_M
    for mover, (low, high) in zip(movers, boxes, strict=True):
        # The base stands on the table.
        if mover[0] == 0:
            continue
        for piece in (piece for body in travel.standing for piece in body.pieces):
            close = (low < piece.high).all(axis=1) & (high > piece.low).all(axis=1)
            for number in np.flatnonzero(close).tolist():
                worst_m = min(worst_m, _to_piece_m(mover, frames[number], piece))
    home = [_frames(np.array(PANDA.home_rad))]
    for first, other in itertools.combinations(range(len(movers)), 2):
        pair = (movers[first], movers[other])
        if abs(pair[0][0] - pair[1][0]) < 2 or _apart_m(pair, home[0]) < 0.001:
            continue
        close = (boxes[first][0] < boxes[other][1]).all(axis=1)
        close &= (boxes[first][1] > boxes[other][0]).all(axis=1)
        for number in np.flatnonzero(close).tolist():
            worst_m = min(worst_m, _apart_m(pair, frames[number]))
    return worst_m


_FAR_M = 0.002
_ROUGH = 64


def _corners(mover: Mover, frames: Sequence[np.ndarray]) -> np.ndarray:
    """Return the corners of a mover in the world, shape (places, corners, 3)."""
    joint, _, corners = mover
    at = np.array([frame[joint] for frame in frames])
    return np.einsum("nij,cj->nci", at[:, :3, :3], corners) + at[:, np.newaxis, :3, 3]


def _boxes(mover: Mover, frames: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of boxes that are 2 mm larger than a mover, each of shape (places, 3)."""
    placed = _corners(mover, frames)
    return placed.min(axis=1) - _FAR_M, placed.max(axis=1) + _FAR_M


Mover = tuple[int, object, np.ndarray]


def _movers(travel: CrampedTravel) -> list[Mover]:
    """Return joints, geometries and corners, in the frames of the joints, of all that moves."""
    results: list[Mover] = []
    for joint, shapes in enumerate(PANDA.shapes):
        for shape in shapes:
            corners = np.array(shape.corners_m)
            results.append((joint, _hull(corners), corners))
    goal = _frames(travel.goal_rad)
    back = np.linalg.inv(goal[len(goal) - 1])
    motion = travel.motion
    for _, held in travel.planner.sweeps.held(motion, motion.above):
        for piece in held:
            corners = piece.corners @ back[:3, :3].T + back[:3, 3]
            results.append((len(goal) - 1, _hull(corners), corners))
    return results


def _hull(corners: np.ndarray) -> object:
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    return coal.Convex.convexHull(points, True, "Qt")


def _frames(joints_rad: np.ndarray) -> list[np.ndarray]:
    """Return where the base and the joints are, as matrices of shape (4, 4)."""
    results = [np.eye(4)]
    for joint, angle in zip(PANDA.joints, joints_rad, strict=True):
        fixed = _fixed(joint.placement)
        results.append(results[-1] @ fixed @ _turn("z", float(angle)))
    return results


@cache
def _fixed(placement: Transform) -> np.ndarray:
    roll, pitch, yaw = placement.rpy_rad
    result = _turn("z", yaw) @ _turn("y", pitch) @ _turn("x", roll)
    result[:3, 3] = placement.xyz_m
    return result


def _turn(axis: str, angle_rad: float) -> np.ndarray:
    matrix = np.eye(4)
    first, other = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    matrix[first, first] = matrix[other, other] = math.cos(angle_rad)
    matrix[other, first] = math.sin(angle_rad)
    matrix[first, other] = -math.sin(angle_rad)
    return matrix


def _placed(mover: Mover, frames: Sequence[np.ndarray]) -> object:
    frame = frames[mover[0]]
    return coal.Transform3s(frame[:3, :3], frame[:3, 3])


def _to_piece_m(mover: Mover, frames: Sequence[np.ndarray], piece: ConvexPiece) -> float:
    still = coal.Transform3s()
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    at = _placed(mover, frames)
    return float(coal.distance(mover[1], at, piece.hull, still, request, result))


def _apart_m(pair: tuple[Mover, Mover], frames: Sequence[np.ndarray]) -> float:
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    (first, one_at), (other, other_at) = ((mover[1], _placed(mover, frames)) for mover in pair)
    return float(coal.distance(first, one_at, other, other_at, request, result))
