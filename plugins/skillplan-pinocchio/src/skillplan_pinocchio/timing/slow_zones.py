"""Speed limits of the tool's tip in zones, as limits on the rate of a path's parameter."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.task.pose import Point
from skillplan.task.scene import Robot, Scene, Tool
from skillplan.task.zone import Zone, list_slow_zones
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.kinematics.joint_path import Array, JointPath

RateLimits = Callable[[Array], Array]
"""Returns the greatest rates at places of a path, infinite outside of zones, shape (places,)."""

# Intervals between two nodes at which a path is searched for zones.
_INTERVALS: Final = 64


class SlowZones:
    """The zones of a scene with a speed limit, for one arm.

    The limit holds for the tip of the attached tool, or of the bare arm: links behind it move more
    slowly where they are nearer to the base.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`, with a frame ``tip``.
    beyond_m
        Position of the tool's tip in the frame of the arm's [m]; see `Tool.tip_on_arm`.
    """

    def __init__(self, model: Any, zones: list[Zone], beyond_m: Point = (0.0, 0.0, 0.0)) -> None:
        self._model, self._data = model, model.createData()
        self._tip = model.getFrameId("tip")
        self._zones = zones
        self.beyond_m = beyond_m

    @classmethod
    def of(cls, scene: Scene, robot: Robot) -> SlowZones | None:
        """Return the zones of a scene, or None if it has none."""
        zones = list_slow_zones(scene)
        return cls(ArmModel.of(robot).model, zones) if zones else None

    def with_tool(self, tool: Tool | None) -> SlowZones:
        """Return the zones for an attached tool; None for the bare arm."""
        beyond_m = (0.0, 0.0, 0.0) if tool is None else tool.tip_on_arm.position
        if beyond_m == self.beyond_m:
            return self
        return SlowZones(self._model, self._zones, beyond_m)

    def away(self, rotation: Array) -> Array:
        """Return the vector from the arm's tip to the tool's in the world [m], for a rotation."""
        return np.asarray(rotation @ np.array(self.beyond_m))

    def limit(self, path: JointPath) -> RateLimits | None:
        """Return the limits on a path, or None if its tip stays outside of all zones."""
        count = (len(path.nodes) - 1) * _INTERVALS
        limits = partial(self._limit_rates, path)
        return limits if np.isfinite(limits(np.linspace(0.0, 1.0, count + 1))).any() else None

    def find_speed_m_per_s(self, begin: Array, end: Array) -> float:
        """Return the least limit on a straight line of the tool's tip [m/s]; infinite if none.

        Parameters
        ----------
        begin, end
            Positions [m], shape (3,).
        """
        points = np.array([begin, end], dtype=float)
        return min(
            (
                zone.speed_m_per_s
                for zone in self._zones
                if zone.speed_m_per_s is not None and bool(_find_inside(zone, points)[0])
            ),
            default=float("inf"),
        )

    def _limit_rates(self, path: JointPath, places: Array) -> Array:
        """Return the greatest rates at places, so that both ends of an interval keep its limit."""
        slopes, _ = path.derivatives(places)
        tips, speeds = self._move_tip(path.along(places), slopes)
        rates = np.full(len(places), np.inf)
        steepest = np.maximum(speeds[:-1], speeds[1:])
        for zone in self._zones:
            inside = np.logical_and(_find_inside(zone, tips), steepest > 0)
            limits = np.full(len(steepest), np.inf)
            np.divide(zone.speed_m_per_s or np.inf, steepest, out=limits, where=inside)
            rates[:-1] = np.minimum(rates[:-1], limits)
            rates[1:] = np.minimum(rates[1:], limits)
        return rates

    def _move_tip(self, postures_rad: Array, slopes: Array) -> tuple[Array, Array]:
        """Return positions of the tool's tip [m], and its motion per unit of the parameter [m]."""
        tips, speeds = np.empty((len(slopes), 3)), np.empty(len(slopes))
        for number, (posture_rad, slope) in enumerate(zip(postures_rad, slopes, strict=True)):
            jacobian = pin.computeFrameJacobian(
                self._model, self._data, posture_rad, self._tip, pin.LOCAL_WORLD_ALIGNED
            )
            frame = self._data.oMf[self._tip]
            tool = self.away(frame.rotation)
            tips[number] = frame.translation + tool
            turn = jacobian[3:] @ slope
            speeds[number] = np.linalg.norm(jacobian[:3] @ slope + np.cross(turn, tool))
        return tips, speeds


def _find_inside(zone: Zone, tips: Array) -> Array:
    """Return whether the chords between neighbouring points meet a zone, shape (points - 1,)."""
    # Tasks without such zones do not import it.
    import shapely

    chords = shapely.linestrings(np.stack([tips[:-1, :2], tips[1:, :2]], axis=1))
    low, high = np.minimum(tips[:-1, 2], tips[1:, 2]), np.maximum(tips[:-1, 2], tips[1:, 2])
    inside = shapely.intersects(chords, zone.polygon) & (low < zone.high_m) & (high > zone.low_m)
    return np.asarray(inside)
