"""The playback of an arm's plan, performed or planned: links, tools, parts and contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skillplan.physics.linear_motions import build_tool_shapes
from skillplan.physics.performance import Contact, PerformedSkill, Sample
from skillplan.robots.arm_description import Hand
from skillplan.robots.link_frames import make_matrix
from skillplan.task.pose import Pose
from skillplan.task.scene import Robot, Scene, Tool, ToolKind
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.views.figures.picture import COLOURS, SERIES
from skillplan.views.playback.document import Playback, make_box
from skillplan.views.playback.meshes import build_hull_mesh, build_prism_mesh, coarsen, read_obj
from skillplan.views.playback.tracks import FRAMES_PER_S, Numbers, compute_link_frames, make_rows

# Smallest force that is shown [N].
_LEAST_N = 1.0
# Largest differences of forces and places within an entry [N, share, m].
_OFF_N, _OFF_SHARE, _OFF_M = 2.0, 0.3, 0.02
# Largest gap within a contact, in frames.
_GAP_FRAMES = 3
_MOST = 600

_Frames = list[tuple[int, Contact]]


def list_contacts(samples: Sequence[Sample], most: int = _MOST) -> list[dict[str, Any]]:
    """Return the contacts of a trace by time, merged until there are at most `most` entries.

    Each entry lasts for a while and has the force of its peak. A sample is one frame.
    """
    pairs: dict[tuple[str, str], _Frames] = {}
    for frame, sample in enumerate(samples):
        for contact in sample.contacts:
            if math.hypot(*contact.force_n) >= _LEAST_N:
                pairs.setdefault(contact.bodies, []).append((frame, contact))
    coarse = 1.0
    while True:
        runs = [run for frames in pairs.values() for run in _group_contacts(frames, coarse)]
        if len(runs) <= most or coarse > 64:
            break
        coarse *= 1.5
    # If there are still too many, the strongest ones are kept.
    runs = sorted(runs, key=lambda run: -_measure_force_n(_find_peak(run)))[:most]
    return sorted(map(_make_entry, runs), key=lambda entry: float(entry["time_s"]))


def _group_contacts(frames: _Frames, coarse: float) -> list[_Frames]:
    """Return groups of successive frames with similar contacts."""
    runs: list[_Frames] = []
    for frame, contact in frames:
        if runs:
            run = runs[-1]
            last, first = run[-1][0], run[0][1]
            off_n = max(_OFF_N, _OFF_SHARE * _measure_force_n(first)) * coarse
            if (
                frame - last <= _GAP_FRAMES * coarse
                and math.dist(contact.force_n, first.force_n) <= off_n
                and math.dist(contact.position, first.position) <= _OFF_M * coarse
            ):
                run.append((frame, contact))
                continue
        runs.append([(frame, contact)])
    return runs


def _find_peak(run: _Frames) -> Contact:
    return max((contact for _, contact in run), key=_measure_force_n)


def _measure_force_n(contact: Contact) -> float:
    return math.hypot(*contact.force_n)


def _make_entry(run: _Frames) -> dict[str, Any]:
    peak = _find_peak(run)
    return {
        "time_s": round(run[0][0] / FRAMES_PER_S, 4),
        "until_s": round(run[-1][0] / FRAMES_PER_S, 4),
        "position_m": [round(value, 4) + 0.0 for value in peak.position],
        "force_n": [round(value, 1) + 0.0 for value in peak.force_n],
        "bodies": list(peak.bodies),
    }


SIMULATED = "simulated, with contacts"
PLANNED = "planned, not simulated: no contact forces"

_ARM, _JAWS = "#d5d9de", "#8b929b"
# Height above the safe height to which zones are drawn [m].
_ABOVE_M = 0.4
# Height of the bottom of a zone above the table, whose colours would mix [m].
_ON_TABLE_M = 0.001
# Cell size of coarse meshes of links, and largest error of their playback [m].
_CELL_M, _LINK_OFF_M = 0.009, 2e-4
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def build_arm_playback(
    task: Task,
    skills: Sequence[PerformedSkill],
    samples: Sequence[Sample],
    looks: Sequence[Path | None] = (),
    note: str = SIMULATED,
) -> Playback:
    """Return the playback of a plan.

    Parameters
    ----------
    task
        Task with one robot.
    samples
        Rows of the trace, 60 a second, at least one.
    looks
        Mesh files of base and links, or None for links without one; empty for no meshes.
    note
        Source of the motion.
    """
    return _ArmPlayback(task, skills, samples, looks, note).build()


class _ArmPlayback:
    def __init__(
        self,
        task: Task,
        skills: Sequence[PerformedSkill],
        samples: Sequence[Sample],
        looks: Sequence[Path | None],
        note: str,
    ) -> None:
        self.task, self.scene = task, task.scene
        self.robot: Robot = task.scene.robots[0]
        self.skills = skills
        # The first row is recorded one frame after the start.
        self.samples = [samples[0], *samples]
        self.looks = looks
        self.playback = Playback(task.name, len(self.samples), note)

    def build(self) -> Playback:
        """Return the playback."""
        joints = np.array([sample.joints_rad for sample in self.samples])
        frames = compute_link_frames(self.robot.model, self.robot.mount, joints)
        self._add_environment()
        self._add_zones()
        self._add_links(frames)
        self._add_hand(frames[-1])
        self._add_parts()
        self._add_skills()
        self.playback.contacts.extend(list_contacts(self.samples))
        self._set_view()
        return self.playback

    def _add_links(self, frames: Sequence[Numbers]) -> None:
        model = self.robot.model
        names = ["base", *(joint.name for joint in model.joints)]
        for number, name in enumerate(names):
            path = self.looks[number] if number < len(self.looks) else None
            shapes = []
            if path is not None:
                shapes = [self.playback.mesh(*coarsen(*read_obj(path), _CELL_M))]
            elif model.shapes:
                shapes = [self.playback.link(shape) for shape in model.shapes[number]]
            if not shapes:
                continue
            full_name = f"{self.robot.name} {name}"
            if number == 0:
                self.playback.add_body(full_name, "link", shapes, self.robot.mount, color=_ARM)
                continue
            rows = make_rows(frames[number])
            self.playback.add_body(
                full_name, "link", shapes, rows=rows, color=_ARM, off_m=_LINK_OFF_M
            )

    def _add_hand(self, flange: Numbers) -> None:
        """Add hand, jaws and tools; tools that are not attached lie in their holders."""
        hand = self.robot.hand
        hand_frames = flange @ make_matrix(hand.on_flange)
        tip = flange @ make_matrix(hand.tip_on_flange)
        attached = self._attached()
        grips = np.array([tool is None or tool.kind is ToolKind.GRIPPER for tool in attached])
        facts = [None if tool is None else tool.fact for tool in attached]
        hands = [self.robot.hand_of(tool) for tool in attached]
        for order, worn in enumerate(dict.fromkeys([hand, *hands])):
            worn_now = np.array([other == worn for other in hands]) & grips
            self._add_gripper(worn, hand_frames, worn_now, f" {order + 1}" if order else "")
        for tool in self.robot.tools:
            shapes = [self.playback.solid(shape) for shape in build_tool_shapes(tool, hand)]
            if not shapes:
                continue
            on = np.array([fact == tool.fact for fact in facts])
            place = _make_pose_matrix(tool.tip_on_arm)
            ends_at = tip @ place
            rows = make_rows(ends_at @ _FLIP)
            rows[~on] = [*tool.holder, 0.0, 0.0, 0.0, 1.0]
            if tool.mount is not None:
                # In the holder it is where the hand has it, pointing down there.
                carrier = next(item for item in self.robot.tools if item.fact == tool.fact)
                behind = _make_pose_matrix(Pose((0.0, 0.0, -carrier.beyond_m)))
                dock = _FLIP.copy()
                dock[:3, 3] = tool.holder
                rows[~on] = make_rows((dock @ behind @ place @ _FLIP)[None])[0]
            self.playback.add_body(tool.name, "tool", shapes, rows=rows, label=True)
        number = self.playback.add_body(f"{self.robot.name} tip", "link", [], rows=make_rows(tip))
        self.playback.arms.append({"name": self.robot.name, "tip_track": number})

    def _add_gripper(self, hand: Hand, frames: Numbers, shown: np.ndarray, suffix: str) -> None:
        if not shown.any():
            return
        bodies = [
            [(across, along, deep) for along, across, deep in piece]
            for piece in hand.body_as_described
        ]
        rows = make_rows(frames)
        rows[~shown] = np.nan
        shapes = [self.playback.mesh(*build_hull_mesh(body)) for body in bodies]
        name = f"{self.robot.name} hand{suffix}"
        self.playback.add_body(name, "link", shapes, rows=rows, color=_ARM)
        opening = np.array([sample.opening_m for sample in self.samples])
        for side, word in ((1, "left"), (-1, "right")):
            jaws = [
                [(a, side * behind, hand.tip_m - up) for behind, a, up in piece]
                for piece in hand.jaw
            ]
            moved = frames.copy()
            moved[:, :3, 3] += (side * opening / 2)[:, None] * frames[:, :3, 1]
            rows = make_rows(moved)
            rows[~shown] = np.nan
            shapes = [self.playback.mesh(*build_hull_mesh(jaw)) for jaw in jaws]
            name = f"{self.robot.name} {word} jaw{suffix}"
            self.playback.add_body(name, "link", shapes, rows=rows, color=_JAWS)

    def _attached(self) -> list[Tool | None]:
        """Return the tool of every frame; it changes at the lowest point of a tool change."""
        state = self.task.initial
        tool = self.robot.tool(state)
        tools: list[Tool | None] = [tool] * len(self.samples)
        for done in self.skills:
            skill = _get_skill(self.task, done.skill)
            if not done.verdict.is_feasible:
                break
            state = skill.prediction_in(state).apply(state)
            after = self.robot.tool(state)
            if after is tool:
                continue
            begin, end = (round(t * FRAMES_PER_S) for t in (done.begin_s, done.end_s))
            heights = [sample.tip[2] for sample in self.samples[begin : end + 1]]
            if heights:
                last = max(k for k, z in enumerate(heights) if z <= min(heights) + 1e-4)
                begin += last
            tools[begin:] = [after] * (len(tools) - begin)
            tool = after
        return tools

    def _add_parts(self) -> None:
        goals = self.scene.at(self.task.find_finished_state())
        screws = {skill.parameters.get("screw") for skill in self.task.skills}
        arrives_s = {
            skill.parameters.get("part"): skill.supply.arrives_s
            for skill in self.task.skills
            if skill.supply is not None
        }
        for number, body in enumerate(self.scene.bodies):
            rows: Numbers | None = np.full((len(self.samples), 7), np.nan)
            assert rows is not None
            for index, sample in enumerate(self.samples):
                pose = sample.bodies.get(body.name)
                if pose is not None and sample.time_s >= arrives_s.get(body.name, 0.0):
                    rows[index] = (*pose.position, *pose.orientation)
            shapes = [self.playback.solid(shape) for shape in body.drawn_shapes]
            goal = goals.get(body.name)
            kind = "screw" if body.name in screws else "part"
            # The same colour as in the pictures.
            colour = COLOURS["muted" if body.fixed else SERIES[number % len(SERIES)]]
            if np.isnan(rows).any(axis=1).all():
                if goal is None:
                    continue
                rows = None
            self.playback.add_body(
                body.name,
                kind,
                shapes,
                goal or Pose((0, 0, 0)),
                rows=rows,
                goal=goal,
                label=True,
                color=colour,
            )

    def _add_skills(self) -> None:
        for done in self.skills:
            skill = _get_skill(self.task, done.skill)
            subject = skill.parameters.get("part") or skill.parameters.get("screw")
            words = None if done.verdict.is_feasible else done.verdict.reason
            self.playback.skills.append(
                {
                    "name": done.skill,
                    "start_s": done.begin_s,
                    "end_s": done.end_s,
                    "arm": self.robot.name,
                    "tool": skill.parameters.get("tool"),
                    "subject": skill.parameters.get("screw") or subject,
                    "note": words,
                }
            )

    def _add_environment(self) -> None:
        low, high = find_extent(self.scene)
        middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, -0.01)
        size = (high[0] - low[0] + 0.2, high[1] - low[1] + 0.2, 0.02)
        self.playback.add_body("table", "environment", [make_box(size)], Pose(middle))
        holders: dict[tuple[float, ...], list[str]] = {}
        for tool in self.robot.tools:
            holders.setdefault(tuple(tool.holder), []).append(tool.name)
        for (x, y, z), names in holders.items():
            pose = Pose((x, y, z + 0.001))
            shapes = [make_box((0.07, 0.07, 0.004))]
            self.playback.add_body(f"holder of {', '.join(names)}", "dock", shapes, pose)
        for name, place in self.scene.stations.items():
            if tuple(place) not in holders:
                x, y, z = place
                shapes = [make_box((0.05, 0.05, 0.02))]
                self.playback.add_body(name, "feeder", shapes, Pose((x, y, z - 0.01)), label=True)

    def _add_zones(self) -> None:
        """Add zones up to a little above the safe height, because most are open above."""
        top_m = self.robot.safe_height_m + _ABOVE_M
        for zone in self.scene.zones:
            colour = COLOURS["red" if zone.keeps_out else "orange"]
            low_m = max(zone.low_m, _ON_TABLE_M)
            high_m = min(zone.high_m, max(top_m, low_m + _ABOVE_M))
            if low_m < high_m:
                mesh = self.playback.mesh(*build_prism_mesh(zone, low_m, high_m))
                self.playback.add_body(zone.name, "zone", [mesh], label=True, color=colour)

    def _set_view(self) -> None:
        low, high = find_extent(self.scene)
        middle = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
        far = max(0.6, 1.25 * max(b - a for a, b in zip(low, high, strict=True)))
        eye = (middle[0] + 0.96 * far, middle[1] - 1.17 * far, 0.9 * far)
        self.playback.view = ((middle[0], middle[1], 0.18), eye)
        points = [[round(v, 5) for v in sample.tip] for sample in self.samples[::6]]
        self.playback.paths.append({"name": "path of the tip", "points_m": points, "kind": "tip"})


def _make_pose_matrix(pose: Pose) -> Numbers:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.position
    return matrix


def find_extent(scene: Scene) -> tuple[list[float], list[float]]:
    """Return the corners of the table of a scene, including its robots [m]."""
    points = [
        p.pose.position for body in scene.bodies for p in body.placements if p.frame == "world"
    ]
    points += [robot.base for robot in scene.robots]
    points += list(scene.stations.values())
    low = [min(point[axis] for point in points) - 0.1 for axis in (0, 1)]
    high = [max(point[axis] for point in points) + 0.1 for axis in (0, 1)]
    return low, high


def _get_skill(task: Task, name: str) -> Skill:
    """Return a performed skill; the name may end with the name of a path."""
    known = {skill.name for skill in task.skills}
    if name not in known:
        name = max((prefix for prefix in known if name.startswith(prefix)), key=len)
    return task.skill(name)
