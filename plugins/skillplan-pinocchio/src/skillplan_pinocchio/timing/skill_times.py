"""How long skills take: transfer motions, linear motions down and up, and the task's dwells."""

from __future__ import annotations

from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion
from skillplan_pinocchio.stands import Stand
from skillplan_pinocchio.timing.trajectory import JointLimits, fastest_trajectory


class SkillTimes:
    """Times of linear motions and of the transfer motions between them.

    Parameters
    ----------
    limits
        Of the joints.
    """

    def __init__(self, limits: JointLimits) -> None:
        self.limits = limits
        self._transfers: dict[tuple[bytes, bytes], JointPath] = {}
        self._paths_s: dict[bytes, float] = {}

    def duration_s(self, planned: tuple[ArmMotion, ...], stand: Stand) -> float | None:
        """Return how long some motions take in turn [s]; None where the arm cannot make them.

        Parameters
        ----------
        planned
            One at least.
        stand
            Where the arm stands before.
        """
        here = stand.joints_rad
        total_s = 0.0
        if stand.came_from_rad is not None and here is not None:
            total_s = self._path_s(self.transfer(stand.came_from_rad, here))
        for one in planned:
            if not one.elbows or here is None:
                return None
            strokes = one.elbows[0].strokes
            total_s += self._path_s(self.transfer(here, strokes.begin))
            stretches_s = sum(self._path_s(path) for path in strokes.distinct)
            if strokes.mirrored:
                # Up as down: the same speeds, and the opposite accelerations.
                stretches_s *= 2
            total_s += stretches_s + one.motion.visit.dwell_s
            here = strokes.end
        # A nanosecond is beyond what the limits mean, and the same on every machine.
        return round(total_s, 9)

    def _path_s(self, path: JointPath) -> float:
        """Return how long a path takes from rest to rest [s]."""
        key = path.nodes.tobytes()
        if key not in self._paths_s:
            self._paths_s[key] = fastest_trajectory(path, self.limits).duration_s
        return self._paths_s[key]

    def transfer(self, start: Vector, end: Vector) -> JointPath:
        """Return the straight travel in joint space between two postures above targets.

        Also where something stands in it: how long a skill takes depends on places, not on that.
        """
        key = (start.tobytes(), end.tobytes())
        if key not in self._transfers:
            self._transfers[key] = JointPath([start, end])
        return self._transfers[key]
