"""Postconditions: what is sensed after an execution, compared with what the skill predicts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillplan.task.motion import Event, Visit
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_simulation.record import Record
from skillplan_simulation.verdicts.contact_threshold import CLEARANCE_MM

# Bodies that nobody handled may creep by this much [m].
_CREEP_M = 0.001
_LEAST_SHOWN_M = 5e-5


@dataclass(frozen=True, slots=True)
class Tolerances:
    """How exactly a prediction has to come true.

    Parameters
    ----------
    position_m, tilt_rad
        Of parts that were set down.
    held_m
        Of parts in the hand.
    fastening_n
        Least force with which a screw is driven.
    insertion_n
        Greatest force with which a part is pushed in.
    """

    position_m: float
    tilt_rad: float
    held_m: float
    fastening_n: float
    insertion_n: float


def postcondition_verdict(skill: Skill, record: Record, tolerances: Tolerances) -> Verdict:
    """Return the verdict on the postcondition of an execution."""
    present, absent = record.present, record.absent
    if record.upset is not None:
        return Verdict.unknown(record.upset, {"steps": record.steps})
    if record.unreachable is not None:
        return Verdict.infeasible(record.unreachable, present, absent, {"reachable": False})
    if record.unsettled is not None:
        return Verdict.infeasible(record.unsettled, present, absent, {"settled": False})
    assert skill.motion is not None
    visit = skill.motion.routes[0].visits[-1]
    evidence = _evidence(record, visit)
    fault = _fault(skill, record, visit, tolerances)
    if fault is None:
        return Verdict.feasible(present, absent, evidence)
    return Verdict.infeasible(fault, present, absent, evidence)


def offset_m(final: Pose, expected: Pose) -> float:
    """Return how far a pose is from another [m]."""
    return math.dist(final.position, expected.position)


def tilt_rad(final: Pose, expected: Pose) -> float:
    """Return the angle of the rotation between two poses [rad], in [0, pi]."""
    aligned = abs(sum(a * b for a, b in zip(final.orientation, expected.orientation, strict=True)))
    # The arc cosine is blind near one.
    axis = length(_relative_axis(final, expected))
    return 2 * math.atan2(axis, aligned)


def _relative_axis(final: Pose, expected: Pose) -> Any:
    x, y, z, w = final.orientation
    a, b, c, d = expected.orientation
    one, other = np.array([x, y, z]), np.array([a, b, c])
    return d * one - w * other - np.cross(other, one)


def _fault(skill: Skill, record: Record, visit: Visit, tolerances: Tolerances) -> str | None:
    sensed = record.sensed
    if "stuck_on" in sensed:
        return f"the arm was stopped on {sensed['stuck_on']}"
    if visit.event is Event.LOAD and sensed.get("tool_attached") != visit.subject:
        return f"{visit.subject} is not attached"
    force_n = sensed.get("fastening_force_n")
    if force_n is not None and force_n < tolerances.fastening_n:
        return (
            f"{visit.subject} was pressed with {force_n:.1f} N, "
            f"where {tolerances.fastening_n:.1f} N are needed"
        )
    inserted_n = sensed.get("insertion_force_n", 0.0)
    if inserted_n > tolerances.insertion_n:
        return (
            f"{visit.subject} was pushed in with {inserted_n:.1f} N, "
            f"where {tolerances.insertion_n:.1f} N are allowed; leave it {CLEARANCE_MM:g} mm on "
            "each side"
        )
    for name, expected in record.expected.items():
        final = record.final[name]
        if name != visit.subject:
            if offset_m(final, expected) > _CREEP_M:
                return f"{name} {_elsewhere(final, expected, 'where it was')}"
        elif visit.event is Event.GRASP:
            if offset_m(final, expected) > tolerances.held_m:
                return f"{name} is not in the hand: it {_elsewhere(final, expected, 'there')}"
            if tilt_rad(final, expected) > tolerances.tilt_rad:
                degrees = math.degrees(tilt_rad(final, expected))
                return f"{name} is turned by {degrees:.1f} degrees in the hand"
        elif offset_m(final, expected) > tolerances.position_m:
            return f"{name} {_elsewhere(final, expected, 'its goal')}"
        elif tilt_rad(final, expected) > tolerances.tilt_rad:
            degrees = math.degrees(tilt_rad(final, expected))
            return f"{name} came to rest turned by {degrees:.1f} degrees from its goal"
    return None


def _elsewhere(final: Pose, expected: Pose, place: str) -> str:
    """Return how far something is from where it was to be, in words."""
    x_m, y_m, z_m = (a - b for a, b in zip(final.position, expected.position, strict=True))
    aside_m = math.hypot(x_m, y_m)
    parts = []
    if abs(z_m) >= _LEAST_SHOWN_M:
        parts.append(f"{1000 * abs(z_m):.1f} mm {'above' if z_m > 0 else 'below'}")
    if aside_m >= _LEAST_SHOWN_M:
        parts.append(f"{1000 * aside_m:.1f} mm beside")
    if not parts:
        return f"came to rest {1e6 * offset_m(final, expected):.1f} um off {place}"
    return f"came to rest {' and '.join(parts)} {place}"


def _evidence(record: Record, visit: Visit) -> dict[str, Any]:
    """Return what was measured, rounded to what it is good for."""
    evidence: dict[str, Any] = {"body": visit.subject}
    if visit.subject in record.final and visit.subject in record.expected:
        final, expected = record.final[visit.subject], record.expected[visit.subject]
        evidence["offset_mm"] = [
            round(1000 * (a - b), 4) + 0.0
            for a, b in zip(final.position, expected.position, strict=True)
        ]
        evidence["tilt_deg"] = round(math.degrees(tilt_rad(final, expected)), 4)
        evidence["pose_m"] = [round(value, 7) + 0.0 for value in final.position]
    evidence["sensed"] = _rounded(record.sensed)
    evidence["steps"] = record.steps
    if record.travels:
        evidence["travels"] = list(record.travels)
    return evidence


def _rounded(sensed: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: round(value, 6) + 0.0 if isinstance(value, float) else value
        for key, value in sorted(sensed.items())
    }
