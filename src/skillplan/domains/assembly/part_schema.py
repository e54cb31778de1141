"""The YAML schema of parts: their shapes, how they are held, where they are; and of screws."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationInfo,
    computed_field,
    model_validator,
)

from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located, continued, shown
from skillplan.task.motion import Point

Coordinate = Annotated[float, Field(ge=-10, le=10)]
Planar = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Spatial = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
# Thinner than a micrometre, a box has no volume worth the name.
Extent = Annotated[float, Field(ge=1e-6, le=10)]
Place = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]
Extents = Annotated[list[Extent], Field(min_length=3, max_length=3)]
Mass = Annotated[float, Field(ge=1e-6, le=1000)]
Angle = Annotated[float, Field(ge=-6.2832, le=6.2832)]
Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]
FailureProbability = Annotated[float, Field(ge=0, lt=1)]


def _listed(value: Any) -> Any:
    """Return a name as a list of one."""
    return [value] if isinstance(value, str) else value


Names = Annotated[
    list[Name],
    Field(min_length=1, max_length=64),
    BeforeValidator(_listed, json_schema_input_type=Name | list[Name]),
]

SHAPE_KEYS = ("size_m", "boxes", "cylinder", "meshes")
"""Keys of a part of which exactly one gives its shape."""


class BoxConfig(Strict):
    """One box of a part that is not a simple box."""

    size_m: Extents = Field(description="extents, x y z [m]")
    centre_m: Spatial = Field(description="centre, from the centre of the part's bottom [m]")


class CylinderConfig(Strict):
    """An upright cylinder."""

    diameter_m: Extent = Field(description="diameter [m]")
    height_m: Extent = Field(description="height [m]")


class MeshConfig(Strict):
    """A convex polyhedron from a file; what is not convex takes several of them."""

    file: Annotated[str, Field(min_length=1, max_length=4096)] = Field(
        description="an OBJ, STL or PLY file in the task file's folder, or in a folder of it"
    )
    scale: Annotated[float, Field(ge=1e-9, le=1e9)] = Field(
        1.0, description="what the file's lengths are multiplied by to be metres, 0.001 for mm"
    )
    centre_m: Spatial | None = Field(
        None,
        description="centre of the smallest box about it, from the centre of the part's bottom "
        "[m]; left out: it stands there",
    )

    # What the file holds, in the part's frame.
    _corners: tuple[Point, ...] = PrivateAttr(())
    _faces: tuple[tuple[int, int, int], ...] = PrivateAttr(())
    _sha256: str = PrivateAttr("")

    @model_validator(mode="wrap")
    @classmethod
    def _read_file(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        """Read the polyhedron that the file holds."""
        made = handler(data)
        # Takes trimesh, and numpy with it.
        from skillplan.domains.assembly.mesh_files import MeshFileError, read_mesh

        folder = Path((info.context or {}).get("folder", Path()))
        try:
            read = read_mesh(folder, made.file, made.scale)
        except MeshFileError as error:
            raise Located(f"{shown(made.file)}: {continued(str(error))}", error.key) from None
        centre = made.centre_m or [0.0, 0.0, read.size[2] / 2]
        made._corners = read.about((centre[0], centre[1], centre[2]))
        made._faces, made._sha256 = read.faces, read.sha256
        return made

    @property
    def corners(self) -> tuple[Point, ...]:
        """Its corners in the part's frame [m]."""
        return self._corners

    @property
    def faces(self) -> tuple[tuple[int, int, int], ...]:
        """Its triangles, by three indices of corners each, seen from outside anticlockwise."""
        return self._faces

    @computed_field  # type: ignore[prop-decorator]
    @property
    def sha256(self) -> str:
        """Hash of the file's content, so that the task's hash is that of its meshes, too."""
        return self._sha256


class GraspConfig(Strict):
    """How a part is held."""

    type: Literal["jaws", "suction"] | None = Field(
        None, description="between jaws, or by suction from above; left out: as its tool does"
    )
    closing_axis: Literal["x", "y", "auto"] = Field(
        "auto", description="axis of the part along which jaws close; auto: where it is narrower"
    )
    depth_m: Extent | None = Field(
        None,
        description="how far below the part's top the fingers reach [m]; left out: half of what "
        "they hold, 0.012 at most",
    )
    at_m: Planar | None = Field(
        None,
        description="where the tip of the hand is, x y from the centre of the part's bottom [m]; "
        "left out: over that centre for suction, in the middle of what jaws hold",
    )


class PartConfig(Strict):
    """A part: where it is, where it belongs, its shape."""

    tool: Name = Field(description="the tool that grasps it")
    mass_kg: Mass = Field(0.1, description="mass [kg]")
    size_m: Extents | None = Field(
        None, description="extents of a simple box, x y z [m]; or one of boxes, cylinder and meshes"
    )
    boxes: Annotated[list[BoxConfig], Field(min_length=1, max_length=64)] | None = Field(
        None, description="the boxes of a compound part; instead of size_m"
    )
    cylinder: CylinderConfig | None = Field(
        None, description="an upright cylinder; instead of size_m"
    )
    meshes: Annotated[list[MeshConfig], Field(min_length=1, max_length=16)] | None = Field(
        None, description="convex polyhedra from files; instead of size_m"
    )
    grasp: GraspConfig = Field(default_factory=GraspConfig, description="how it is held")
    grasp_failure: FailureProbability = Field(
        0.0, description="probability that a pick leaves it where it lies, below 1 [-]"
    )
    start_m: Place | None = Field(
        None,
        description="where it lies at the start, x y or x y z [m]; or start_on, or feeder; without "
        "z it rests on the table, or on start_on",
    )
    start_on: Name | None = Field(
        None,
        description="the part it lies on at the start (a stack); over its centre unless start_m "
        "is given, too",
    )
    feeder: Name | None = Field(None, description="the feeder it comes from; instead of start_m")
    start_yaw_rad: Angle = Field(0.0, description="how it is turned at the start [rad]")
    start_rpy_rad: Angles | None = Field(
        None,
        description="how it is turned in space at the start, about the fixed axes x, y and z in "
        "this order [rad]; instead of start_yaw_rad",
    )
    goal_m: Place = Field(
        description="where it belongs, x y or x y z [m]; without z it rests on goal_on"
    )
    goal_on: Names | None = Field(
        None, description="the part it stands on, or a list of them; left out: the table"
    )
    goal_yaw_rad: Angle = Field(0.0, description="how it is turned at its goal [rad]")
    goal_rpy_rad: Angles | None = Field(
        None,
        description="how it is turned in space at its goal, about the fixed axes x, y and z in "
        "this order [rad]; instead of goal_yaw_rad",
    )

    @model_validator(mode="after")
    def _one_shape_one_start(self) -> PartConfig:
        if sum(getattr(self, key) is not None for key in SHAPE_KEYS) != 1:
            raise Located("give one of 'size_m', 'boxes', 'cylinder' and 'meshes'.")
        lies = self.start_m is not None or self.start_on is not None
        if lies == (self.feeder is not None):
            raise Located("give one of 'start_m', 'start_on' and 'feeder'.")
        for when in ("start", "goal"):
            keys = (f"{when}_yaw_rad", f"{when}_rpy_rad")
            if self.model_fields_set.issuperset(keys) and getattr(self, keys[1]) is not None:
                raise Located(f"give one of {keys[0]!r} and {keys[1]!r}, not both.", keys[1])
        return self

    @property
    def start_turn_rad(self) -> Point:
        """How it is turned at the start: roll, pitch and yaw [rad]."""
        return _turn(self.start_rpy_rad, self.start_yaw_rad)

    @property
    def goal_turn_rad(self) -> Point:
        """How it is turned at its goal: roll, pitch and yaw [rad]."""
        return _turn(self.goal_rpy_rad, self.goal_yaw_rad)

    @property
    def shape_key(self) -> str:
        """The key that gives its shape."""
        return next(key for key in SHAPE_KEYS if getattr(self, key) is not None)


def _turn(rpy_rad: list[float] | None, yaw_rad: float) -> Point:
    roll, pitch, yaw = rpy_rad or (0.0, 0.0, yaw_rad)
    return (roll, pitch, yaw)


class ScrewConfig(Strict):
    """A screw: its hole and the part that it fastens."""

    tool: Name = Field(description="the tool that drives it")
    hole_m: Planar = Field(description="its hole, x y [m]")
    through: Name = Field(description="the part whose top its head rests on")
    feeder: Name | None = Field(
        None,
        description="the feeder where the tool fetches it; left out: the tool brings it along",
    )
    head_diameter_m: Extent = Field(0.006, description="diameter of the head [m]")
    head_height_m: Extent = Field(0.002, description="height of the head [m]")
    mass_kg: Mass = Field(0.001, description="mass [kg]")
