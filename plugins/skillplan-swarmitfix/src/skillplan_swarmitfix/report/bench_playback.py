"""A base that walks along a sheet, with its parallel kinematic machine and its head.

The plan gives the places of base and head, inverse kinematics the legs of the machine. Heights
follow the five steps, from retract to support.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from skillplan.task.pose import Pose
from skillplan.views.figures.figure_style import PALETTE
from skillplan.views.playback.document import Playback, make_box, make_cylinder
from skillplan.views.playback.meshes import build_hull_mesh
from skillplan.views.playback.tracks import FRAMES_PER_S, Numbers, make_rows
from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.bench.swings import Direction
from skillplan_swarmitfix.pkm.kinematics import OutsideWorkspace, PkmGeometry, inverse, zyz_matrix
from skillplan_swarmitfix.pkm.reach import Mount

BASE_TOP_M = 0.2
"""Height of a base [m]; an assumption, as it is not published."""

_PIN_M, _LEG_M = 0.012, 0.03


@dataclass(frozen=True, slots=True)
class Turning:
    """A base that turns about a docked leg, from one time to another [s], by an angle [rad]."""

    begin_s: float
    end_s: float
    pivot_m: tuple[float, float]
    angle_rad: float


def make_turning(
    bench: Bench, start: int, action: int, begin_s: float, end_s: float
) -> Turning | None:
    """Return the swing that an action makes, spread over a time; None for staying."""
    swing = bench.swing(start, action)
    if swing is None:
        return None
    angle = math.radians(swing.turn.angle_deg)
    x, y = bench.pins_m[swing.pivot].tolist()
    signed = angle if swing.turn.direction is Direction.CCW else -angle
    return Turning(begin_s, end_s, (x, y), signed)


def compute_base_rows(
    bench: Bench, start: int, turnings: Sequence[Turning], times_s: Numbers
) -> tuple[Numbers, Numbers, Numbers]:
    """Return the centre x, y [m] and the rotation [rad] of a base at ascending times [s]."""
    x, y = bench.centroids_m[start].tolist()
    toward = bench.pins_m[bench.legs[start][0]] - bench.centroids_m[start]
    yaw = math.atan2(toward[1], toward[0])
    xs, ys, yaws = (np.full(len(times_s), value) for value in (x, y, yaw))
    for turn in turnings:
        share = np.clip((times_s - turn.begin_s) / max(turn.end_s - turn.begin_s, 1e-9), 0, 1)
        moving = times_s >= turn.begin_s
        # Smooth acceleration and deceleration.
        angles = turn.angle_rad * (3 * share**2 - 2 * share**3)
        px, py = turn.pivot_m
        dx, dy = x - px, y - py
        xs = np.where(moving, px + dx * np.cos(angles) - dy * np.sin(angles), xs)
        ys = np.where(moving, py + dx * np.sin(angles) + dy * np.cos(angles), ys)
        yaws = np.where(moving, yaw + angles, yaws)
        c, s = math.cos(turn.angle_rad), math.sin(turn.angle_rad)
        x, y = px + dx * c - dy * s, py + dx * s + dy * c
        yaw += turn.angle_rad
    return xs, ys, yaws


def make_upright_rows(xs: Numbers, ys: Numbers, yaws: Numbers, z_m: float = 0.0) -> Numbers:
    """Return upright poses, shape (n, 7)."""
    zero = np.zeros(len(xs))
    return np.stack([xs, ys, zero + z_m, zero, zero, np.sin(yaws / 2), np.cos(yaws / 2)], axis=1)


def add_bench(playback: Playback, bench: Bench) -> None:
    """Add the plate of the bench and its pins."""
    low, high = bench.pins_m.min(axis=0) - 0.15, bench.pins_m.max(axis=0) + 0.15
    middle = ((low + high) / 2).tolist()
    size = (*(high - low).tolist(), 0.03)
    plate = make_box(size, Pose((middle[0], middle[1], -0.015)))
    playback.add_body("bench", "environment", [plate])
    pins = [make_cylinder(_PIN_M, 0.012, Pose((x, y, 0.006))) for x, y in bench.pins_m.tolist()]
    playback.add_body("pins", "dock", pins)
    far = float(max(high - low))
    playback.view = (
        (middle[0], middle[1], 0.25),
        (middle[0] - 0.28 * far, middle[1] - 1.15 * far, 0.86 * far),
    )


def add_base(
    playback: Playback, bench: Bench, name: str, rows: Numbers, color: str | None = None
) -> None:
    """Add the body of a base: a plate on three legs."""
    radius_m = bench.pitch_m / math.sqrt(3)
    feet = [
        (radius_m * math.cos(2 * math.pi * k / 3), radius_m * math.sin(2 * math.pi * k / 3))
        for k in range(3)
    ]
    plate = []
    for x, y in feet:
        for turn in range(8):
            angle = 2 * math.pi * turn / 8
            corner = (x + 0.045 * math.cos(angle), y + 0.045 * math.sin(angle))
            plate += [(*corner, BASE_TOP_M - 0.08), (*corner, BASE_TOP_M)]
    shapes = [playback.mesh(*build_hull_mesh(plate))]
    shapes += [
        make_cylinder(_LEG_M, BASE_TOP_M - 0.06, Pose((x, y, (BASE_TOP_M - 0.06) / 2)))
        for x, y in feet
    ]
    playback.add_body(name, "base", shapes, rows=rows, label=True, color=color)


# Distance of computed poses; poses between them are interpolated [frames].
_EVERY = 6
# Distance of the parked head from the base, and below the sheet [m].
_PARKED_M, _DOWN_M = 0.39, 0.05
_HEAD_M = 0.02
_LEG_COLOUR, _ROD_COLOUR = "#8b929b", "#d5d9de"


def build_bench_playback(name: str, bench: Bench, known: Mapping[str, Any]) -> Playback:
    """Return the motion of a job on the bench.

    Parameters
    ----------
    known
        The domain's account of the solved file, with a timeline.
    """
    return _BenchPlayback(name, bench, known).build()


class _BenchPlayback:
    def __init__(self, name: str, bench: Bench, known: Mapping[str, Any]) -> None:
        self.bench, self.known = bench, known
        self.timeline: Sequence[Mapping[str, Any]] = known["timeline"]
        end_s = float(self.timeline[-1]["end_s"])
        frames = 1 + round(end_s * FRAMES_PER_S)
        self.frames = np.arange(frames)
        self.coarse = np.unique(np.append(np.arange(0, frames, _EVERY), frames - 1))
        self.times_s = self.coarse / FRAMES_PER_S
        words = "kinematic, by the times of the plan; not simulated"
        self.playback = Playback(name, frames, words)
        self.geometry, self.mount = PkmGeometry(), Mount()

    def build(self) -> Playback:
        """Return the playback."""
        add_bench(self.playback, self.bench)
        self._add_sheet()
        xs, ys, yaws = compute_base_rows(self.bench, self._start(), self._turnings(), self.times_s)
        add_base(self.playback, self.bench, "base", self._dense(make_upright_rows(xs, ys, yaws)))
        self._animate_machine(xs, ys)
        self._add_skills()
        return self.playback

    def _start(self) -> int:
        swings = [phase["swing"]["start"] for phase in self.timeline if phase.get("swing")]
        return self.bench.position(swings[0] if swings else self.timeline[0]["base"])

    def _turnings(self) -> list[Turning]:
        turnings = []
        for phase in self.timeline:
            swing = phase.get("swing")
            if swing:
                start = self.bench.position(swing["start"])
                times = float(phase["start_s"]), float(phase["end_s"])
                turn = make_turning(self.bench, start, int(swing["action"][1:]), *times)
                turnings += [turn] if turn is not None else []
        return turnings

    def _add_sheet(self) -> None:
        piece = self.known.get("workpiece")
        if not piece:
            return
        points = [(x, y, self.mount.sheet_m + 0.004) for x, y in piece["points_m"]]
        if piece["closed"]:
            points.append(points[0])
        path = {"name": "trajectory", "points_m": points, "kind": "trajectory"}
        self.playback.paths.append(path)
        xs, ys = [p[0] for p in points], [p[1] for p in points]
        size = (max(xs) - min(xs) + 0.16, max(ys) - min(ys) + 0.16, 0.003)
        middle = ((max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2, self.mount.sheet_m + 0.0015)
        self.playback.add_body("sheet", "sheet", [make_box(size)], Pose(middle))

    def _reaches(self) -> list[tuple[float, float, float, float]]:
        """Return keys of the head: time [s], place in the plane [m] and depth [m]."""
        keys: list[tuple[float, float, float, float]] = []
        spots = [phase.get("support_m") for phase in self.timeline]
        at = next((spot for spot in spots if spot), [0.0, 0.0])
        for phase in self.timeline:
            begin, end = float(phase["start_s"]), float(phase["end_s"])
            spot = phase.get("support_m")
            if phase["step"] == "support" and spot:
                at = spot
                keys += [(begin, *_find_centre(at), _DOWN_M), (end, *_find_centre(at), 0.0)]
            elif phase["step"] == "retract":
                keys += [(begin, *_find_centre(at), 0.0), (end, *_find_centre(at), _DOWN_M)]
        return keys

    def _animate_machine(self, xs: Numbers, ys: Numbers) -> None:
        """Add column, legs, platform and head, which turn with the machine on the base."""
        spots, downs = self._head_spots(xs, ys)
        azimuth = np.arctan2(spots[:, 1] - ys, spots[:, 0] - xs)
        far = np.hypot(spots[:, 0] - xs, spots[:, 1] - ys)
        count = len(self.times_s)
        head, platform, pillar = (np.tile(np.eye(4), (count, 1, 1)) for _ in range(3))
        joints = np.zeros((count, 3, 2, 3))
        known: tuple[Numbers, Numbers, Numbers] | None = None
        for k in range(count):
            frame = self._mounted(xs[k], ys[k], azimuth[k])
            pose = self._pose(float(far[k]), float(downs[k]))
            known = pose or known
            if known is None:
                continue
            plate, feet, tops = known
            platform[k] = frame @ plate
            head[k] = self._head_frame(xs[k], ys[k], azimuth[k], far[k], downs[k])
            joints[k, :, 0] = feet @ frame[:3, :3].T + frame[:3, 3]
            joints[k, :, 1] = tops @ frame[:3, :3].T + frame[:3, 3]
            pillar[k] = frame
        self._add_machine(pillar, platform, head, joints)

    def _head_spots(self, xs: Numbers, ys: Numbers) -> tuple[Numbers, Numbers]:
        """Return places of the head in the plane, shape (n, 2), and depths below the sheet."""
        keys = np.array(self._reaches() or [(0.0, xs[0] + _PARKED_M, ys[0], _DOWN_M)])
        spots = np.stack(
            [np.interp(self.times_s, keys[:, 0], keys[:, axis]) for axis in (1, 2)], axis=1
        )
        downs = np.interp(self.times_s, keys[:, 0], keys[:, 3])
        # The head stays within reach while the base walks under it.
        away = spots - np.stack([xs, ys], axis=1)
        far = np.maximum(np.hypot(*away.T), 1e-6)
        held = np.where(downs > _DOWN_M - 1e-9, np.clip(far, 0.34, 0.43), far)
        spots = np.stack([xs, ys], axis=1) + away * (held / far)[:, None]
        return spots, downs

    def _mounted(self, x: float, y: float, azimuth: float) -> Numbers:
        """Return the frame of the machine on the base, in the world."""
        frame = np.eye(4)
        frame[:3, :3] = zyz_matrix(azimuth, self.mount.tilt_rad, 0.0)
        frame[:3, 3] = (
            x + self.mount.offset_m * math.cos(azimuth),
            y + self.mount.offset_m * math.sin(azimuth),
            self.mount.height_m,
        )
        return frame

    def _pose(self, far_m: float, down_m: float) -> tuple[Numbers, Numbers, Numbers] | None:
        """Return platform, feet and tops of the legs in the machine's frame; None out of reach."""
        mount = Mount(sheet_m=self.mount.sheet_m - down_m)
        try:
            joints = inverse(self.geometry, mount.head_pose(far_m))
        except OutsideWorkspace:
            return None
        sin_a, cos_a = math.sin(joints.a_rad), math.cos(joints.a_rad)
        sin_b, cos_b = math.sin(joints.b_rad), math.cos(joints.b_rad)
        plate = np.eye(4)
        plate[:3, :3] = [
            [sin_a, -sin_b * cos_a, -cos_b * cos_a],
            [0.0, cos_b, -sin_b],
            [cos_a, sin_b * sin_a, cos_b * sin_a],
        ]
        slide_m = -self.geometry.base_arm_m * sin_b * cos_a
        plate[:3, 3] = joints.h_m * plate[:3, 2] + slide_m * plate[:3, 1]
        feet = self.geometry.base_points_m
        tops = plate[:3, 3] + self.geometry.platform_points_m @ plate[:3, :3].T
        return plate, feet, tops

    def _head_frame(self, x: float, y: float, azimuth: float, far: float, down: float) -> Numbers:
        frame = np.eye(4)
        frame[:3, :3] = zyz_matrix(azimuth, 0.0, 0.0)
        frame[:3, 3] = (
            x + far * math.cos(azimuth),
            y + far * math.sin(azimuth),
            self.mount.sheet_m - down,
        )
        return frame

    def _add_machine(
        self, pillar: Numbers, platform: Numbers, head: Numbers, joints: Numbers
    ) -> None:
        playback = self.playback
        foot = self.mount.height_m - BASE_TOP_M
        column = pillar.copy()
        # The column stands upright on the base and turns with the machine.
        column[:, :3, :3] = head[:, :3, :3]
        column[:, 2, 3] = BASE_TOP_M
        shapes = [
            make_cylinder(0.06, foot, Pose((-self.mount.offset_m, 0.0, foot / 2))),
            make_box((self.mount.offset_m + 0.12, 0.13, 0.04), Pose((-0.05, 0.0, foot - 0.03))),
        ]
        playback.add_body("column", "link", shapes, rows=self._dense(make_rows(column)))
        corners = [
            (*point[:2], z) for point in self.geometry.platform_points_m for z in (-0.012, 0.012)
        ]
        corners += [(-0.03, 0.0, -0.012), (-0.03, 0.0, 0.012)]
        wrist = make_cylinder(0.022, self.geometry.wrist_offset_m, Pose((0, 0, 0.045)))
        shapes = [playback.mesh(*build_hull_mesh(corners)), wrist]
        playback.add_body("platform", "link", shapes, rows=self._dense(make_rows(platform)))
        for number, name in enumerate("ABC"):
            self._add_leg(name, joints[:, number])
        side = 0.1
        points = [
            (
                side / math.sqrt(3) * math.cos(2 * math.pi * k / 3),
                side / math.sqrt(3) * math.sin(2 * math.pi * k / 3),
                z,
            )
            for k in range(3)
            for z in (-_HEAD_M, 0.0)
        ]
        stem = make_cylinder(0.018, 0.07, Pose((0.0, 0.0, -0.05)))
        shapes = [playback.mesh(*build_hull_mesh(points)), stem]
        rows = self._dense(make_rows(head))
        track = playback.add_body("head", "head", shapes, rows=rows, label=True)
        playback.arms.append({"name": "PKM", "tip_track": track})

    def _add_leg(self, name: str, ends: Numbers) -> None:
        """Add a leg: a tube from below and a rod from above, one within the other."""
        along = ends[:, 1] - ends[:, 0]
        lengths = np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        z = along / lengths
        x = np.cross(np.array([0.0, 1.0, 0.0]), z)
        x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
        frames = np.tile(np.eye(4), (len(ends), 1, 1))
        frames[:, :3, 0], frames[:, :3, 1], frames[:, :3, 2] = x, np.cross(z, x), z
        for part, start, sign, radius, colour in (
            ("tube", 0, 1, 0.016, _LEG_COLOUR),
            ("rod", 1, -1, 0.009, _ROD_COLOUR),
        ):
            own = frames.copy()
            own[:, :3, 3] = ends[:, start]
            shapes = [make_cylinder(radius, 0.18, Pose((0.0, 0.0, sign * 0.09)))]
            rows = self._dense(make_rows(own))
            self.playback.add_body(f"leg {name}, {part}", "link", shapes, rows=rows, color=colour)

    def _dense(self, rows: Numbers) -> Numbers:
        """Return poses of every frame, interpolated between the computed ones."""
        columns = [np.interp(self.frames, self.coarse, column) for column in rows.T]
        dense = np.stack(columns, axis=1)
        dense[:, 3:] /= np.linalg.norm(dense[:, 3:], axis=1, keepdims=True)
        return np.asarray(dense)

    def _add_skills(self) -> None:
        for phase in self.timeline:
            swing = phase.get("swing")
            words = f"{swing['action']}: {swing['start']} to {swing['end']}" if swing else None
            self.playback.skills.append(
                {
                    "name": f"{phase['step']} ({phase['sequence']})",
                    "start_s": float(phase["start_s"]),
                    "end_s": float(phase["end_s"]),
                    "arm": "base" if swing else "PKM",
                    "tool": None,
                    "subject": "base" if swing else "head",
                    "note": words,
                }
            )


def _find_centre(spot: Any) -> tuple[float, float]:
    """Return the centre of one or several supports [m]."""
    points = np.atleast_2d(np.array(spot, dtype=np.float64))
    x, y = points.mean(axis=0).tolist()
    return x, y


def build_fleet_playback(name: str, bench: Bench, known: Mapping[str, Any]) -> Playback:
    """Return the motion of a fleet, in which each swing takes its own time.

    Parameters
    ----------
    known
        The domain's account of the solved file, with a schedule.
    """
    whole_s = float(known["parallel_s"])
    frames = 1 + round(whole_s * FRAMES_PER_S)
    playback = Playback(name, frames, "kinematic, by the times of the schedule; not simulated")
    add_bench(playback, bench)
    times_s = np.arange(frames) / FRAMES_PER_S
    for number, entry in enumerate(known["robots"]):
        robot, start = entry["robot"], bench.position(entry["start"])
        moves: list[Turning] = []
        for _, who, action, (begin, end), times in list_swings(known):
            if who != robot:
                continue
            turn = make_turning(bench, bench.position(begin), int(action[1:]), *times)
            if turn is not None:
                moves.append(turn)
            playback.skills.append(
                {
                    "name": f"{robot}: {action}",
                    "start_s": times[0],
                    "end_s": times[1],
                    "arm": robot,
                    "tool": None,
                    "subject": robot,
                    "note": f"{begin} to {end}",
                }
            )
        rows = make_upright_rows(*compute_base_rows(bench, start, moves, times_s))
        add_base(playback, bench, robot, rows, PALETTE[number % len(PALETTE)])
    playback.skills.sort(key=itemgetter("start_s"))
    return playback


def list_swings(
    known: Mapping[str, Any],
) -> Iterator[tuple[int, str, str, tuple[str, str], tuple[float, float]]]:
    """Yield step from 1, robot, action, positions and times [s] of every swing of a schedule.

    A step begins when the longest swing of the previous step has ended.
    """
    begin_s = 0.0
    steps = zip(known["schedule"], known["swings_s"], known["steps_s"], strict=True)
    for number, (moves, swings_s, step_s) in enumerate(steps, start=1):
        for (robot, action, start, end), swing_s in zip(moves, swings_s, strict=True):
            yield number, robot, action, (start, end), (begin_s, begin_s + swing_s)
        begin_s += step_s
