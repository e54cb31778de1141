"""The hulls that ``swept`` compares, for whoever draws them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skillplan.collision.hulls import Hull, HullRole, HullScene
from skillplan.task.motion import Point
from skillplan.task.state import State
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.motion_plan import ArmMotion, MotionPlanner
from skillplan_pinocchio.obstacles import TABLE
from skillplan_pinocchio.shapes import ConvexPiece


def hull_scene(
    motions: Sequence[ArmMotion],
    sweeps: HandSweeps,
    planner: MotionPlanner,
    state: State,
    verdict: Verdict,
) -> HullScene:
    """Return what a skill sweeps with hand and load, and the bodies that stand there.

    Parameters
    ----------
    motions
        As the arm makes them.
    sweeps
        Of what the arm holds.
    planner
        Knows the arm, and all obstacles that there may be; the table is left out.
    state
        Which of them are there.
    verdict
        The detector's on the skill in that state: it says what is met, and where.

    Raises
    ------
    ValueError
        If nothing is swept.
    """
    met = set(verdict.evidence.get("bodies", ()))
    hulls = [*_moving(motions, sweeps), *_links(motions, planner.arm, verdict)]
    if not hulls:
        raise ValueError("nothing is swept")
    moved = {hull.name for hull in hulls}
    for obstacle in planner.obstacles:
        there = obstacle.fact is None or obstacle.fact in state
        if there and obstacle.body != TABLE and obstacle.body not in moved:
            role = HullRole.MET if obstacle.body in met else HullRole.STANDING
            hulls += [_hull(obstacle.body, role, piece) for piece in obstacle.pieces]
    return HullScene(hulls, list(_touches(verdict)))


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
