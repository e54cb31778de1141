"""The document ``skillplan.playback/1``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from skillplan.records import schemas
from skillplan.robots.arm_description import Capsule, LinkShape, Rod
from skillplan.task.pose import Pose
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan.views.playback.meshes import Triangles, build_hull_mesh, encode_mesh
from skillplan.views.playback.tracks import FRAMES_PER_S, Numbers, Tracks

_NOWHERE = Pose((0.0, 0.0, 0.0))


def make_row(pose: Pose) -> list[float]:
    """Return a pose as seven numbers."""
    return [round(value, 6) for value in (*pose.position, *pose.orientation)]


@dataclass
class Playback:
    """The playback of a plan.

    Parameters
    ----------
    frames
        Number of frames, >= 1.
    note
        Source of the motion.
    """

    title: str
    frames: int
    note: str = ""
    tracks: Tracks = field(init=False)
    bodies: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    skills: list[dict[str, Any]] = field(default_factory=list)
    contacts: list[dict[str, Any]] = field(default_factory=list)
    paths: list[dict[str, Any]] = field(default_factory=list)
    arms: list[dict[str, Any]] = field(default_factory=list)
    view: tuple[Sequence[float], Sequence[float]] = ((0.0, 0.0, 0.0), (1.0, -1.0, 1.0))

    def __post_init__(self) -> None:
        self.tracks = Tracks(self.frames)

    def add_body(
        self,
        name: str,
        kind: str,
        shapes: Sequence[dict[str, Any]],
        pose: Pose = _NOWHERE,
        *,
        rows: Numbers | None = None,
        goal: Pose | None = None,
        label: bool = False,
        color: str | None = None,
        off_m: float | None = None,
    ) -> int | None:
        """Add a body and return the number of its track, or None if it does not move.

        Parameters
        ----------
        shapes
            Shapes from `make_box`, `solid`, `mesh` or `link`.
        pose
            Pose of a body that does not move.
        rows
            Pose in every frame, shape (frames, 7); NaN in frames without the body.
        goal
            Pose of its ghost.
        color
            Colour #rrggbb; None for the colour of its kind.
        off_m
            Largest error of the playback [m]; None for the default.
        """
        track = None
        if rows is not None:
            track = self.tracks.add(rows) if off_m is None else self.tracks.add(rows, off_m)
        self.bodies.append(
            {
                "name": name,
                "kind": kind,
                "color": color,
                "label": label,
                "shapes": list(shapes),
                "pose": make_row(pose),
                "track": track,
                "goal": None if goal is None else make_row(goal),
            }
        )
        return track

    def mesh(self, points: Numbers, triangles: Triangles, pose: Pose = _NOWHERE) -> dict[str, Any]:
        """Store a mesh and return its shape."""
        self.meshes.append(encode_mesh(points, triangles))
        return {"type": "mesh", "mesh": len(self.meshes) - 1, "pose": make_row(pose)}

    def solid(self, shape: Shape) -> dict[str, Any]:
        """Return the shape of a task's body."""
        if isinstance(shape, Box):
            return make_box(shape.size, Pose(shape.centre))
        if isinstance(shape, Cylinder):
            return make_cylinder(shape.diameter_m / 2, shape.height_m, Pose(shape.centre))
        if shape.faces:
            return self.mesh(np.array(shape.corners), np.array(shape.faces, dtype=np.int64))
        return self.mesh(*build_hull_mesh(shape.corners))

    def link(self, shape: LinkShape) -> dict[str, Any]:
        """Return the shape of an arm's link."""
        if not isinstance(shape, Capsule | Rod):
            return self.mesh(*build_hull_mesh(shape.corners_m))
        start, end = np.array(shape.start_m), np.array(shape.end_m)
        length_m = float(np.linalg.norm(end - start))
        x, y, z = ((start + end) / 2).tolist()
        kind = "capsule" if isinstance(shape, Capsule) else "cylinder"
        if length_m < 1e-9:
            return {"type": "sphere", "radius_m": shape.radius_m, "pose": make_row(Pose((x, y, z)))}
        turned = turn_along((x, y, z), ((end - start) / length_m).tolist())
        return {
            "type": kind,
            "radius_m": shape.radius_m,
            "length_m": length_m,
            "pose": make_row(turned),
        }

    def document(self) -> dict[str, Any]:
        """Return the document."""
        target, eye = self.view
        return {
            "schema": schemas.PLAYBACK,
            "title": self.title,
            "note": self.note,
            "duration_s": (self.frames - 1) / FRAMES_PER_S,
            "frames_per_s": FRAMES_PER_S,
            "frames": self.frames,
            "bodies": self.bodies,
            "meshes": self.meshes,
            "tracks": self.tracks.document(),
            "skills": self.skills,
            "contacts": self.contacts,
            "paths": self.paths,
            "arms": self.arms,
            "view": {
                "target_m": [round(float(value), 4) for value in target],
                "eye_m": [round(float(value), 4) for value in eye],
            },
        }


def make_box(size_m: Sequence[float], pose: Pose = _NOWHERE) -> dict[str, Any]:
    """Return a box around its centre."""
    return {"type": "box", "size_m": [round(v, 6) for v in size_m], "pose": make_row(pose)}


def make_cylinder(radius_m: float, length_m: float, pose: Pose = _NOWHERE) -> dict[str, Any]:
    """Return a cylinder around its centre, along z."""
    return {
        "type": "cylinder",
        "radius_m": round(radius_m, 6),
        "length_m": round(length_m, 6),
        "pose": make_row(pose),
    }


def turn_along(position: tuple[float, float, float], along: Sequence[float]) -> Pose:
    """Return a pose whose z axis is a unit vector."""
    x, y, z = along
    if z < -1 + 1e-9:
        return Pose(position, (1.0, 0.0, 0.0, 0.0))
    # The shortest turn from the vertical.
    q = np.array([-y, x, 0.0, 1.0 + z])
    a, b, c, d = (q / np.linalg.norm(q)).tolist()
    return Pose(position, (a, b, c, d))
