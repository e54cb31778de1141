"""Description of an arm alone, without a task: of the catalogue, or from a URDF or xacro file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.spatial import ConvexHull, QhullError

from skillplan.domains.assembly.arm_files import DESCRIPTION_FOLDERS, ArmFileError, read_tree
from skillplan.domains.assembly.robot_schema import RobotConfig
from skillplan.domains.load import apply_changes
from skillplan.errors import Issue, TaskError
from skillplan.files.schema_errors import list_schema_issues
from skillplan.files.yaml import Document
from skillplan.robots.arm_description import ArmDescription
from skillplan.robots.catalogue import ARMS
from skillplan.robots.home_posture import list_corners
from skillplan.robots.link_frames import Numbers, compute_link_frames, spread_postures

Triangles = NDArray[np.int64]

# Postures whose tips estimate the reach.
_SAMPLES: Final = 20_000


@dataclass(frozen=True)
class ArmSummary:
    """An arm as its file describes it.

    Parameters
    ----------
    source
        The file.
    arm
        Its description.
    tip
        Name of the link that holds hands.
    other_tips
        Further links that may hold them.
    payload_kg
        Greatest mass at the flange [kg], None if unknown.
    """

    source: str
    arm: ArmDescription
    tip: str
    other_tips: tuple[str, ...]
    payload_kg: float | None

    @property
    def joints(self) -> list[dict[str, Any]]:
        """The moving joints in order, as JSON values."""
        return [
            {
                "name": joint.name,
                "type": "prismatic" if joint.is_prismatic else "revolute",
                "range": [joint.low_rad, joint.high_rad],
                "speed": joint.speed_rad_per_s,
                "effort": joint.torque_nm,
                "mass_kg": None if joint.link is None else joint.link.mass_kg,
                "home": home,
                "pieces": len(self.arm.shapes[number]) if self.arm.shapes else 0,
            }
            for number, (joint, home) in enumerate(
                zip(self.arm.joints, self.arm.home_rad, strict=True), 1
            )
        ]

    @property
    def tip_at_zero_m(self) -> list[float]:
        """Position of the tip with all joints at 0, in the frame of the root [m]."""
        place = self._place(np.array([self.arm.follow([0.0] * len(self.arm.joints))]))[:3, 3]
        return [round(float(value), 9) for value in place]

    @property
    def tip_at_home_m(self) -> list[float]:
        """Position of the tip at home, in the frame of the root [m]."""
        place = self._place(np.array([self.arm.home_rad]))[:3, 3]
        return [round(float(value), 6) for value in place]

    @property
    def points_down(self) -> bool:
        """Whether some posture points the hand straight down."""
        return bool((self._samples[:, 2, 2] < -0.9).any())

    @property
    def reach_m(self) -> float:
        """Greatest distance of the tip from the first joint, of sampled postures [m]."""
        first = compute_link_frames(self.arm, np.array([self.arm.home_rad]))[1][0, :3, 3]
        return float(np.linalg.norm(self._samples[:, :3, 3] - first, axis=1).max())

    @property
    def mass_kg(self) -> float | None:
        """Mass of the moving links [kg], None if one is unknown."""
        masses = [joint.link.mass_kg for joint in self.arm.joints if joint.link is not None]
        return sum(masses) if len(masses) == len(self.arm.joints) else None

    @property
    def freedom(self) -> str:
        """Degrees of freedom in words."""
        count = self.arm.freedoms
        if count > 6:
            return f"{count}, {count - 6} redundant: the arm moves while the hand stands still"
        if count < 6:
            return f"{count}, {6 - count} missing: the hand takes only some orientations at a place"
        return "6"

    def document(self) -> dict[str, Any]:
        """Return the document ``skillplan.arm/1`` without its first key."""
        return {
            "file": self.source,
            "name": self.arm.name,
            "tip": self.tip,
            "other_tips": list(self.other_tips),
            "joints": self.joints,
            "tip_at_zero_m": self.tip_at_zero_m,
            "tip_at_home_m": self.tip_at_home_m,
            "reach_m": round(self.reach_m, 4),
            "mass_kg": self.mass_kg,
            "payload_kg": self.payload_kg,
            "assumptions": list(self.arm.assumptions),
            "not_checked": list(self.arm.not_checked),
        }

    def solids(self) -> list[tuple[int, Numbers, Triangles]]:
        """Return the shapes at home: number of the link, corners [m], triangles."""
        frames = compute_link_frames(self.arm, np.array([self.arm.home_rad]))
        solids = []
        for number, shapes in enumerate(self.arm.shapes):
            rotation, origin = frames[number][0, :3, :3], frames[number][0, :3, 3]
            for shape in shapes:
                corners = list_corners(shape)
                try:
                    hull = ConvexHull(corners)
                except QhullError:
                    continue
                solids.append((number, corners @ rotation.T + origin, turn_outward(hull)))
        return solids

    def chain_m(self) -> list[list[float]]:
        """Return the origins of base, joints and tip at home [m]."""
        frames = compute_link_frames(self.arm, np.array([self.arm.home_rad]))
        return [frame[0, :3, 3].tolist() for frame in frames]

    def tip_frame(self) -> Numbers:
        """Return the pose of the tip at home, shape (4, 4)."""
        return self._place(np.array([self.arm.home_rad]))

    def _place(self, joints_rad: Numbers) -> Numbers:
        return np.asarray(compute_link_frames(self.arm, joints_rad)[-1][0])

    @cached_property
    def _samples(self) -> Numbers:
        return compute_link_frames(self.arm, spread_postures(self.arm, _SAMPLES))[-1]


def turn_outward(hull: Any) -> Triangles:
    """Return the triangles of a hull, anticlockwise from outside."""
    triangles = hull.simplices.copy()
    a, b, c = (hull.points[triangles[:, number]] for number in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return np.asarray(triangles, dtype=np.int64)


def summarize_arm(path: str, changes: Mapping[str, str]) -> ArmSummary:
    """Return the description of an arm.

    Parameters
    ----------
    path
        Name of an arm of the catalogue, or URDF or xacro file. The folder of the file's package
        takes the place of a task's folder.
    changes
        Values of keys ``robot.*`` of a task file, such as ``robot.tip``.

    Raises
    ------
    TaskError
        If the file describes no arm, or a key is at fault.
    """
    folder, name = Path(), path
    if path not in ARMS:
        file = Path(os.path.abspath(path))
        folder = file.parent
        if folder.name.lower() in DESCRIPTION_FOLDERS:
            folder = folder.parent
        name = file.relative_to(folder).as_posix()
    start = Document(path, {"robot": {"model": name, "home_m": [0.0, 0.0]}}, {}, {}, ())
    data = apply_changes(start, changes).data
    others = sorted(set(data) - {"robot"})
    if others:
        words = f"--set {others[0]}: a robot alone has keys under 'robot' only, such as robot.tip."
        raise TaskError(path, [Issue(words)])
    robot = data["robot"]
    tips = [] if path in ARMS else _list_tips(path, folder, name, robot)
    tip = robot.get("tip") or next(iter(tips), None)
    try:
        config = RobotConfig.model_validate({**robot, "tip": tip}, context={"folder": folder})
    except ValidationError as error:
        issues = list_schema_issues(error, RobotConfig)
        raise TaskError(path, [Issue(issue.message) for issue in issues]) from None
    payload_kg = config.payload_kg if config.payload_kg is not None else config.arm.payload_kg
    rest = tuple(other for other in tips if other != tip)
    return ArmSummary(path, config.arm, tip or "flange", rest, payload_kg)


def _list_tips(path: str, folder: Path, name: str, robot: Mapping[str, Any]) -> list[str]:
    """Return the links of a file that may hold a hand, the most likely first."""
    try:
        tree, _ = read_tree(folder, name, robot.get("packages", []), robot.get("xacro_args"))
    except ArmFileError as error:
        raise TaskError(path, [Issue(str(error))]) from None
    tips = [tip for tip, _ in tree.list_tips()]
    if not tips and not robot.get("tip"):
        most = max(map(tree.count_joints, tree.links), default=0)
        words = (
            f"it has no chain of 4 to 8 moving joints: {most} {'is' if most == 1 else 'are'} the "
            "most. Give a file of an arm."
        )
        raise TaskError(path, [Issue(words)])
    return tips


def format_angle(value: float, *, is_prismatic: bool) -> str:
    """Return an angle in degrees or a stroke in millimetres, with its unit."""
    return f"{1e3 * value:.0f} mm" if is_prismatic else f"{math.degrees(value):.0f} deg"
