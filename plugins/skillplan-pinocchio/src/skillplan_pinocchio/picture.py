"""The hulls that ``swept`` compares, for whoever draws them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from skillplan.collision.hulls import Hull, HullRole, HullScene
from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.motion import Point
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.arm_paths import ArmPaths
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion
from skillplan_pinocchio.obstacles import TABLE
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.shapes import ConvexPiece

# A travel is drawn through so many postures.
_PICTURES = 13


def hull_scene(paths: ArmPaths, skill: Skill, state: State, verdict: Verdict) -> HullScene:
    """Return what a skill sweeps with hand and load, and the bodies that stand there.

    Parameters
    ----------
    paths
        Of the joints. They know all obstacles that there may be; the table is left out.
    skill, state
        What is done, and where it starts.
    verdict
        The detector's on the skill in that state: it says what is met, and where.

    Raises
    ------
    ValueError
        If nothing is swept.
    """
    met = set(verdict.evidence.get("bodies", ()))
    motions = paths.motions(skill, state)
    hulls = [
        *_moving(motions, paths.sweeps),
        *_travelling(paths, skill, state),
        *_links(motions, paths.planner.arm, verdict),
    ]
    if not hulls:
        raise ValueError("nothing is swept")
    moved = {hull.name for hull in hulls}
    for obstacle in paths.planner.obstacles:
        there = obstacle.fact is None or obstacle.fact in state
        if there and obstacle.body != TABLE and obstacle.body not in moved:
            role = HullRole.MET if obstacle.body in met else HullRole.STANDING
            hulls += [_hull(obstacle.body, role, piece) for piece in obstacle.pieces]
    reason = "" if verdict.is_feasible else verdict.reason
    return HullScene(hulls, list(_touches(verdict)), reason, frozenset(_subjects(verdict)))


def _subjects(verdict: Verdict) -> Iterator[str]:
    """Yield the names of the bodies in the reason of a verdict."""
    evidence = verdict.evidence
    yield from (str(evidence[key]) for key in ("moving", "body") if key in evidence)
    for key in ("bodies", "links"):
        yield from evidence.get(key, ())


def _travelling(paths: ArmPaths, skill: Skill, state: State) -> Iterator[Hull]:
    """Yield what hand and load sweep on travels on which something may be met.

    A travel that was not found is shown as the straight one, which is blocked.
    """
    found = paths.paths(skill, state)
    if isinstance(found, Unreachable):
        return
    here = found.begin_rad
    for one in found.motions:
        goal = one.strokes.begin
        if one.is_checked:
            straight = JointPath([here, goal])
            path = straight if isinstance(one.travel, Unfound) else one.travel.path
            yield from _along(paths, one.motion, path)
        here = one.strokes.end


def _along(paths: ArmPaths, motion: LinearMotion, path: JointPath) -> Iterator[Hull]:
    serial = paths.planner.arm.serial
    back = serial.tip(path.at(1.0)).inverse()
    places = np.linspace(0.0, 1.0, _PICTURES).tolist()
    moved = [serial.tip(path.at(place)) * back for place in places]
    for name, pieces in paths.sweeps.held(motion, motion.above):
        for piece in pieces:
            placed = [piece.corners @ one.rotation.T + one.translation for one in moved]
            for begin, end in pairwise(placed):
                yield _hull(name, HullRole.MOVING, ConvexPiece(np.concatenate([begin, end])))


def _moving(motions: Sequence[ArmMotion], sweeps: HandSweeps) -> Iterator[Hull]:
    for one in motions:
        stretches = [*sweeps.approach(one.motion), *sweeps.retreat(one.motion)]
        found = [sweep for stretch in stretches for sweep in stretch]
        for sweep in found:
            for piece in sweep.pieces:
                yield _hull(sweep.mover, HullRole.MOVING, piece.swept(sweep.by))


def _links(motions: Sequence[ArmMotion], arm: ArmModel, verdict: Verdict) -> Iterator[Hull]:
    """Yield the arm where one of its links first runs into something; nothing otherwise."""
    evidence = verdict.evidence
    if not str(evidence.get("moving", "")).startswith("link"):
        return
    met = set(evidence["bodies"])
    for one in motions:
        for elbow in one.elbows[:1]:
            if met & {obstacle.body for obstacle, _ in elbow.meets}:
                joints_rad = elbow.at(float(evidence["fraction"]))
                rotations, origins = arm.frames([joints_rad])
                for one_piece in arm.pieces:
                    rotation = rotations[0, one_piece.link - 1]
                    corners = one_piece.corners @ rotation.T + origins[0, one_piece.link - 1]
                    name = f"link {one_piece.link} of the arm"
                    yield _hull(name, HullRole.MOVING, ConvexPiece(corners))
                return


def _touches(verdict: Verdict) -> Iterator[Point]:
    position = verdict.evidence.get("position_m")
    if position is not None and "bodies" in verdict.evidence:
        x, y, z = position
        yield (x, y, z)


def _hull(name: str, role: HullRole, piece: ConvexPiece) -> Hull:
    """Return a piece with its surface in triangles, as coal has worked it out."""
    corners, faces = piece.surface
    return Hull(
        name,
        role,
        [(float(x), float(y), float(z)) for x, y, z in corners.tolist()],
        [(int(a), int(b), int(c)) for a, b, c in faces.tolist()],
    )
