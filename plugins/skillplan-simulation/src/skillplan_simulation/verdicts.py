"""Verdicts on the record of an execution: postconditions, and unexpected contacts."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from skillplan.task.motion import Event, Visit
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.verdict import Verdict
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_simulation.record import Pair, Record
from skillplan_simulation.simulator import TABLE

# Mean force of a collision [N], and number of frames that it is averaged over [-] (Moller et al.,
# section 4.3).
FORCE_N = 0.05
FRAMES = 6
# Displacement of a pushed body [m].
DISPLACEMENT_M = 0.001
# Sufficient clearance on each side of a hole, that of the shipped products [mm].
CLEARANCE_MM = 0.3


@dataclass(frozen=True, slots=True)
class Press:
    """A pair that should not touch and exceeds a threshold of the mean force.

    Parameters
    ----------
    frame
        First frame above the threshold.
    pair
        Names of the two.
    most_n
        Maximum of the mean force [N].
    """

    frame: int
    pair: Pair
    most_n: float


def compute_mean_forces(record: Record, frames: int = FRAMES) -> dict[Pair, NDArray[np.float64]]:
    """Return the mean forces of all pairs that touched unexpectedly [N], shape (frames,)."""
    means = {pair: average_frames(forces, frames) for pair, forces in record.pairs_n.items()}
    return {pair: mean for pair, mean in means.items() if len(mean)}


def find_presses(record: Record, force_n: float = FORCE_N, frames: int = FRAMES) -> list[Press]:
    """Return the pairs whose mean force exceeds a threshold, in the order of the record."""
    return [
        Press(int(np.argmax(mean > force_n)), pair, float(mean.max()))
        for pair, mean in compute_mean_forces(record, frames).items()
        if mean.max() > force_n
    ]


def find_pushes(record: Record, displacement_m: float = DISPLACEMENT_M) -> dict[str, int]:
    """Return the bodies that moved too far, with the first frame in which they had."""
    return {
        name: int(np.argmax(moved > displacement_m))
        for name, moved in record.moved_m.items()
        if len(moved) and moved.max() > displacement_m
    }


def average_frames(values: NDArray[np.float64], frames: int) -> NDArray[np.float64]:
    """Return the mean over each frame and the preceding ones.

    Parameters
    ----------
    values
        Values by frame, shape (n, ...).
    frames
        Number of averaged frames, >= 1; values before the first are zero.

    Returns
    -------
    numpy.ndarray
        Means of the same shape.
    """
    padding = np.zeros((frames - 1, *values.shape[1:]))
    padded = np.concatenate([padding, values])
    total = np.zeros(values.shape)
    for shift in range(frames):
        total += padded[shift : shift + len(values)]
    return total / frames


def round_reading(value: float) -> float:
    """Return a reading for evidence: rounded to a millionth, never minus zero."""
    return round(float(value), 6) + 0.0


# Allowed creep of bodies that are not handled [m].
_CREEP_M = 0.001
_LEAST_SHOWN_M = 5e-5


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Tolerances of predictions.

    Parameters
    ----------
    position_m, tilt_rad
        Tolerances of parts that were set down.
    held_m
        Tolerance of parts in the hand.
    fastening_n
        Minimum force that drives a screw.
    insertion_n
        Maximum force that pushes a part in.
    """

    position_m: float
    tilt_rad: float
    held_m: float
    fastening_n: float
    insertion_n: float


def check_postcondition(skill: Skill, record: Record, tolerances: Tolerances) -> Verdict:
    """Return the verdict on the postcondition of an execution."""
    present, absent = record.present, record.absent
    if record.upset is not None:
        return Verdict.unknown(record.upset, {"steps": record.steps})
    if record.unreachable is not None:
        return Verdict.infeasible(record.unreachable, present, absent, {"reachable": False})
    if record.unsettled is not None:
        return Verdict.infeasible(record.unsettled, present, absent, {"settled": False})
    visit = None if skill.motion is None else skill.motion.routes[0].visits[-1]
    evidence = _collect_evidence(record, visit)
    fault = _find_fault(skill, record, visit, tolerances)
    if fault is None:
        return Verdict.feasible(present, absent, evidence)
    return Verdict.infeasible(fault, present, absent, evidence)


def measure_offset_m(final: Pose, expected: Pose) -> float:
    """Return the distance between two poses [m]."""
    return math.dist(final.position, expected.position)


def measure_tilt_rad(final: Pose, expected: Pose) -> float:
    """Return the angle of the rotation between two poses [rad], in [0, pi]."""
    aligned = abs(sum(a * b for a, b in zip(final.orientation, expected.orientation, strict=True)))
    # The arc cosine is inaccurate near one.
    axis = length(_compute_relative_axis(final, expected))
    return 2 * math.atan2(axis, aligned)


def _compute_relative_axis(final: Pose, expected: Pose) -> Any:
    x, y, z, w = final.orientation
    a, b, c, d = expected.orientation
    axis, other = np.array([x, y, z]), np.array([a, b, c])
    return d * axis - w * other - np.cross(other, axis)


# Least share of the force of a press.
_PRESSED = 0.9


def _find_fault(
    skill: Skill, record: Record, visit: Visit | None, tolerances: Tolerances
) -> str | None:
    sensed = record.sensed
    if "in_zone" in sensed:
        return str(sensed["in_zone"])
    if "stuck_on" in sensed:
        return f"the arm was stopped on {sensed['stuck_on']}"
    if visit is None or visit.event is Event.TURN:
        return _find_moved(record, visit, tolerances)
    if visit.event is Event.LOAD and sensed.get("tool_attached") != visit.subject:
        return f"{visit.subject} is not attached"
    force_n = sensed.get("fastening_force_n")
    if force_n is not None and force_n < tolerances.fastening_n:
        return (
            f"{visit.subject} was pressed with {force_n:.1f} N, "
            f"where {tolerances.fastening_n:.1f} N are needed"
        )
    pressed_n = sensed.get("pressing_force_n")
    if pressed_n is not None and pressed_n < _PRESSED * visit.press_n:
        return f"{visit.subject} pressed with {pressed_n:.1f} N instead of {visit.press_n:g} N"
    if "missed" in sensed:
        return str(sensed["missed"])
    inserted_n = sensed.get("insertion_force_n", 0.0)
    stated_n = sensed.get("insertion_limit_n")
    limit_n = tolerances.insertion_n if stated_n is None else stated_n
    if inserted_n > limit_n:
        advice = "" if stated_n is not None else f"; leave it {CLEARANCE_MM:g} mm on each side"
        return (
            f"{visit.subject} was pushed in with {inserted_n:.1f} N, where {limit_n:.1f} N are "
            f"{'allowed' if stated_n is None else 'stated by its fit'}{advice}"
        )
    for name, expected in record.expected.items():
        final = record.final[name]
        if name != visit.subject:
            if measure_offset_m(final, expected) > _CREEP_M:
                return f"{name} {_describe_offset(final, expected, 'where it was')}"
        elif visit.event is Event.GRASP:
            if measure_offset_m(final, expected) > tolerances.held_m:
                return f"{name} is not in the hand: it {_describe_offset(final, expected, 'there')}"
            if measure_tilt_rad(final, expected) > tolerances.tilt_rad:
                degrees = math.degrees(measure_tilt_rad(final, expected))
                return f"{name} is turned by {degrees:.1f} degrees in the hand"
        elif not any(
            measure_offset_m(final, goal) <= tolerances.position_m
            and measure_tilt_rad(final, goal) <= tolerances.tilt_rad
            for goal in (expected, *record.carried)
        ):
            if measure_offset_m(final, expected) > tolerances.position_m:
                return f"{name} {_describe_offset(final, expected, 'its goal')}"
            degrees = math.degrees(measure_tilt_rad(final, expected))
            return f"{name} came to rest turned by {degrees:.1f} degrees from its goal"
    return None


def list_moved(record: Record) -> tuple[str, ...]:
    """Return the bodies that are farther from where they must be than bodies creep."""
    return tuple(
        name
        for name, expected in record.expected.items()
        if measure_offset_m(record.final[name], expected) > _CREEP_M
    )


def _find_moved(record: Record, turn: Visit | None, tolerances: Tolerances) -> str | None:
    """Return the first body that is not where a turn, or no motion at all, must leave it."""
    place = "where it stood" if turn is None else f"where the turn to {turn.subject} takes it"
    for name, expected in record.expected.items():
        final = record.final[name]
        if measure_offset_m(final, expected) > _CREEP_M:
            return f"{name} {_describe_offset(final, expected, place)}"
        tilt_rad = measure_tilt_rad(final, expected)
        if tilt_rad > tolerances.tilt_rad:
            return (
                f"{name} came to rest turned by {math.degrees(tilt_rad):.1f} degrees from {place}"
            )
    return None


def _describe_offset(final: Pose, expected: Pose, place: str) -> str:
    """Return the offset of a part from its target, in words."""
    x_m, y_m, z_m = (a - b for a, b in zip(final.position, expected.position, strict=True))
    aside_m = math.hypot(x_m, y_m)
    parts = []
    if abs(z_m) >= _LEAST_SHOWN_M:
        parts.append(f"{1000 * abs(z_m):.1f} mm {'above' if z_m > 0 else 'below'}")
    if aside_m >= _LEAST_SHOWN_M:
        parts.append(f"{1000 * aside_m:.1f} mm beside")
    if not parts:
        return f"came to rest {1e6 * measure_offset_m(final, expected):.1f} um off {place}"
    return f"came to rest {' and '.join(parts)} {place}"


def _collect_evidence(record: Record, visit: Visit | None) -> dict[str, Any]:
    """Return rounded measurements."""
    evidence: dict[str, Any] = {} if visit is None else {"body": visit.subject}
    if visit is not None and visit.subject in record.final and visit.subject in record.expected:
        final, expected = record.final[visit.subject], record.expected[visit.subject]
        evidence["offset_mm"] = [
            round(1000 * (a - b), 4) + 0.0
            for a, b in zip(final.position, expected.position, strict=True)
        ]
        evidence["tilt_deg"] = round(math.degrees(measure_tilt_rad(final, expected)), 4)
        evidence["pose_m"] = [round(value, 7) + 0.0 for value in final.position]
    evidence["sensed"] = _round_values(record.sensed)
    evidence["steps"] = record.steps
    if record.travels:
        evidence["travels"] = list(record.travels)
    return evidence


def _round_values(sensed: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: round(value, 6) + 0.0 if isinstance(value, float) else value
        for key, value in sorted(sensed.items())
    }


@dataclass(frozen=True, slots=True)
class PairLimits:
    """Limits above which an unexpected contact is a collision.

    Parameters
    ----------
    force_n
        Mean normal force of an unexpected pair [N].
    displacement_m
        Displacement of a body that is not handled [m].
    frames
        Number of frames of 1/60 s that the force is averaged over [-].
    """

    force_n: float = FORCE_N
    displacement_m: float = DISPLACEMENT_M
    frames: int = FRAMES


def check_pairs(record: Record, limits: PairLimits, parts: Collection[str]) -> Verdict:
    """Return the verdict on contacts; its reason is the first pair or displacement.

    Parameters
    ----------
    record
        Record of an execution that ran to its end.
    parts
        Names of the task's bodies; other names get an article.
    """
    pressing = find_presses(record, limits.force_n, limits.frames)
    pushed = find_pushes(record, limits.displacement_m)
    evidence = _collect_readings(record, limits)
    if not pressing and not pushed:
        return Verdict.feasible(record.present, record.absent, evidence)
    press = min(
        pressing,
        key=lambda candidate: (candidate.frame, -candidate.most_n, candidate.pair),
        default=None,
    )
    moved = min(pushed, key=lambda name: (pushed[name], name), default=None)
    if press is not None and (moved is None or press.frame <= pushed[moved]):
        frame, bodies = press.frame, _sort_by_motion(press.pair, record, parts)
        mover, other = (name if name in parts else f"the {name}" for name in bodies)
        event = f"{mover} pressed on {other} with {_format_force(press.most_n)} N"
        limit = f"{limits.force_n:g} N"
        if press.pair in record.beside:
            limit += f"; leave {CLEARANCE_MM:g} mm between them"
        details: dict[str, Any] = {"bodies": list(bodies), "force_n": round_reading(press.most_n)}
    else:
        assert moved is not None
        frame, furthest_m = pushed[moved], float(record.moved_m[moved].max())
        event = f"{moved} was pushed {1000 * furthest_m:.1f} mm aside"
        limit = f"{1000 * limits.displacement_m:g} mm"
        details = {"bodies": [moved]}
    phase, at_s = record.phase(frame), record.time_s(frame)
    details |= {"during": phase, "at_s": round_reading(at_s)}
    details["moved_mm"] = {
        name: round_reading(1000 * record.moved_m[name].max()) for name in sorted(pushed)
    }
    when = f"on {phase} at {at_s:.2f} s" if phase else f"at {at_s:.2f} s"
    reason = f"{event} {when}; the limit is {limit}"
    return Verdict.infeasible(reason, record.present, record.absent, {**details, **evidence})


def _collect_readings(record: Record, limits: PairLimits) -> dict[str, Any]:
    """Return the largest readings with their limits."""
    means = compute_mean_forces(record, limits.frames)
    most_n = max((mean.max() for mean in means.values()), default=0.0)
    peak_n = max((forces.max() for forces in record.pairs_n.values() if len(forces)), default=0.0)
    most_m = max((moved.max() for moved in record.moved_m.values() if len(moved)), default=0.0)
    return {
        "peak_n": round_reading(peak_n),
        "readings": {"force_n": round_reading(most_n), "moved_mm": round_reading(1000 * most_m)},
        "limits": {
            "force_n": limits.force_n,
            "moved_mm": round_reading(1000 * limits.displacement_m),
        },
    }


def _sort_by_motion(pair: Pair, record: Record, parts: Collection[str]) -> Pair:
    """Return a pair with the moving body first: the robot, else the part it handles."""

    def rank(name: str) -> int:
        if name in record.moved_m:
            return 3
        if name == TABLE:
            return 2
        return 1 if name in parts else 0

    first, second = sorted(pair, key=rank)
    return first, second


def _format_force(force_n: float) -> str:
    """Return a force with three figures, without an exponent."""
    return f"{force_n:.0f}" if force_n >= 100 else f"{force_n:.3g}"


Judge = Callable[[Record], Verdict]


@runtime_checkable
class ContactJudge(Protocol):
    """A detector that decides about contacts from the record of an execution."""

    def contact_verdict(self, record: Record) -> Verdict:
        """Return the verdict on the contacts of an execution that ran to its end."""


def select_judges(back_ends: Sequence[object], parts: Collection[str]) -> tuple[Judge, ...]:
    """Return the judges among some back ends, or else one with the default `PairLimits`.

    Parameters
    ----------
    back_ends
        Back ends in use with an engine.
    """
    judges = [
        back_end.contact_verdict for back_end in back_ends if isinstance(back_end, ContactJudge)
    ]
    return tuple(judges) or (partial(check_pairs, limits=PairLimits(), parts=frozenset(parts)),)


def find_collision(record: Record, judges: Sequence[Judge]) -> Verdict | None:
    """Return the first judge's verdict of a collision in an execution, or None."""
    verdicts = (judge(record) for judge in judges)
    return next((verdict for verdict in verdicts if verdict.is_infeasible), None)
