"""A motion of the hand with how the arm follows it, and how it gets there."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.physics.linear_motions import LinearMotion
from skillplan_simulation.arm.joint_motion import JointMotion
from skillplan_simulation.arm.kinematics import Vector
from skillplan_simulation.arm.rotations import points_down
from skillplan_simulation.arm.straight_motion import PosturePath


@dataclass(frozen=True, slots=True)
class ArmMotion:
    """A motion of the hand with how the arm follows it.

    Parameters
    ----------
    motion
        Of the task.
    rotation
        How the hand is turned in it, shape (3, 3).
    down
        The paths of the joints along the stretches of the approach.
    up
        The same of the retreat.
    travel
        From where the arm was before to the first of them.
    matters
        Whether something may be met on the travel, or the hand is turned in space on it.
    around
        Bodies that the travel goes round; none where it is straight.
    """

    motion: LinearMotion
    rotation: Vector
    down: tuple[PosturePath, ...]
    up: tuple[PosturePath, ...]
    travel: JointMotion
    matters: bool
    around: tuple[str, ...] = ()

    @property
    def approach(self) -> tuple[Vector, ...]:
        """Postures at the points of the approach [rad], shape (joints,) each."""
        return _ends(self.down)

    @property
    def retreat(self) -> tuple[Vector, ...]:
        """The same of the retreat."""
        return _ends(self.up)

    @property
    def points_down(self) -> bool:
        """Whether the hand points straight down."""
        return points_down(self.rotation)


def _ends(paths: tuple[PosturePath, ...]) -> tuple[Vector, ...]:
    return (paths[0].at(0.0), *(path.at(1.0) for path in paths))
