"""YAML schema of parts (shape, start, goal) and fixtures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

from skillplan.domains.assembly.many_schema import ArrivalTime, Count, PatternConfig, ToolName
from skillplan.domains.assembly.schema_types import (
    Angle,
    Angles,
    Directions,
    Extent,
    Extents,
    GraspConfig,
    Grasps,
    Length,
    PartDurations,
    PlanarOrSpatial,
    ReleaseHeight,
    Spatial,
    is_absent,
    is_empty,
    make_point,
)
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located, continue_sentence, shown
from skillplan.task.pose import Point, Pose
from skillplan.task.shape import Box, Cylinder, Mesh, Shape, move_shape

Mass = Annotated[float, Field(ge=1e-6, le=1000)]
# Above this, 53 bits cannot tell the expected number of tries from infinity.
FailureProbability = Annotated[float, Field(ge=0, le=1 - 1e-9)]


def _make_list(value: Any) -> Any:
    """Return a name as a list of one."""
    return [value] if isinstance(value, str) else value


def _is_stopped_by_part(value: Any) -> bool:
    return bool(value == "part")


Names = Annotated[
    list[Name],
    Field(min_length=1, max_length=64),
    BeforeValidator(_make_list, json_schema_input_type=Name | list[Name]),
]


# Keys that say how a hand moves a part.
_MOVED_KEYS = (
    *("tool", "grasp", "grasp_failure", "start_m", "start_on", "feeder", "start_yaw_rad"),
    *("start_rpy_rad", "insert_along", "insert_m", "release_m", "durations_s", "buffers"),
    *("other_goals", "other_tools", "optional", "interchangeable", "made_of", "arrives_s"),
    "orientation",
)

# Keys that the members of a sub-assembly give.
_MEMBERS_GIVE = (
    *("size_m", "boxes", "cylinder", "meshes", "mass_kg", "start_m", "start_on", "feeder"),
    *("start_yaw_rad", "start_rpy_rad", "start_in", "start_pattern", "arrives_s"),
)

SHAPE_KEYS = ("size_m", "boxes", "cylinder", "meshes")
"""Keys for the shape of a part or a fixture, exactly one of which is given."""


# Stands for the shape of a sub-assembly whose members have faults.
_UNKNOWN: tuple[Shape, ...] = (Box((1e-3, 1e-3, 1e-3), (0.0, 0.0, 5e-4)),)


class BoxConfig(Strict):
    """One box of a part that is not a simple box."""

    size_m: Extents = Field(description="extents, x y z [m]")
    centre_m: Spatial = Field(description="centre, from the centre of the part's bottom [m]")


class CylinderConfig(Strict):
    """An upright cylinder."""

    diameter_m: Extent = Field(description="diameter [m]")
    height_m: Extent = Field(description="height [m]")


class MeshConfig(Strict):
    """A polyhedron from a file; a concave one moves as convex pieces."""

    file: Annotated[str, Field(min_length=1, max_length=4096)] = Field(
        description="an OBJ, STL, PLY, GLB, 3MF or STEP file in the task file's folder, or in a "
        "folder of it"
    )
    scale: Annotated[float, Field(ge=1e-9, le=1e9)] = Field(
        1.0,
        description="factor that converts the file's lengths to metres, 0.001 for mm; GLB, 3MF and "
        "STEP are in metres already",
    )
    centre_m: Spatial | None = Field(
        None,
        description="centre of the smallest box about it, from the centre of the part's bottom "
        "[m]; left out: it stands there, and check prints the value that keeps the file's origin",
    )

    # Excluded from the hash, which contains the content of the file instead.
    pieces: Annotated[str, Field(min_length=1, max_length=4096)] | None = Field(
        None,
        exclude=True,
        description="a file of its convex pieces, in its frame, each with corners of its own; left "
        "out: a plugin makes them",
    )

    # Content of the file, in the part's frame.
    _corners: tuple[Point, ...] = PrivateAttr(())
    _middle_m: Point = PrivateAttr((0.0, 0.0, 0.0))
    _size_m: Point = PrivateAttr((0.0, 0.0, 0.0))
    _faces: tuple[tuple[int, int, int], ...] = PrivateAttr(())
    _sha256: str = PrivateAttr("")
    _convex: bool = PrivateAttr(True)
    _pieces: tuple[Mesh, ...] = PrivateAttr(())
    _shape: Mesh | None = PrivateAttr(None)

    @model_validator(mode="wrap")
    @classmethod
    def _read_file(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        """Read the file, unless it was read before."""
        if isinstance(data, cls):
            return data
        mesh = handler(data)
        # Imports trimesh and numpy.
        from skillplan.domains.assembly.mesh_files import MeshFileError, read_mesh, read_pieces

        folder = Path((info.context or {}).get("folder", Path()))
        try:
            read = read_mesh(folder, mesh.file, mesh.scale)
            own, about = read_pieces(folder, mesh.pieces, mesh.scale, read)
        except MeshFileError as error:
            name = mesh.pieces if error.key == "pieces" else mesh.file
            raise Located(f"{shown(name)}: {continue_sentence(str(error))}", error.key) from None
        centre = mesh.centre_m or [0.0, 0.0, read.size[2] / 2]
        where = (centre[0], centre[1], centre[2])
        mesh._corners = read.about(where)
        mesh._middle_m, mesh._size_m = read.middle, read.size
        mesh._pieces = tuple(Mesh(piece.about(where), piece.faces) for piece in own)
        mesh._faces, mesh._convex = read.faces, read.convex
        mesh._sha256 = f"{read.sha256}{about}"
        return mesh

    @property
    def corners(self) -> tuple[Point, ...]:
        """Its corners in the part's frame [m]."""
        return self._corners

    @property
    def middle_m(self) -> Point:
        """Centre of the smallest box about it in the file's frame [m]."""
        return self._middle_m

    @property
    def size_m(self) -> Point:
        """Extents of that box [m]."""
        return self._size_m

    @property
    def faces(self) -> tuple[tuple[int, int, int], ...]:
        """Triangles as three indices of corners, anticlockwise from outside."""
        return self._faces

    @property
    def convex(self) -> bool:
        """True if it is convex."""
        return self._convex

    @property
    def shape(self) -> Mesh:
        """The mesh in the part's frame; cached, as checks of thousands of corners take long."""
        if self._shape is None:
            self._shape = Mesh(self._corners, self._faces, self._convex)
        return self._shape

    @property
    def given_pieces(self) -> tuple[Mesh, ...]:
        """Convex pieces in the part's frame, if a file gives them."""
        return self._pieces

    @computed_field  # type: ignore[prop-decorator]
    @property
    def sha256(self) -> str:
        """Hash of the file's content, which makes it part of the task's hash."""
        return self._sha256


# Kinds of fits that overlap, that hold the part afterwards, and that need a force.
_TIGHT = ("press", "snap", "compliant")
_ADVICE = {
    "press": "a press fit is tighter than its hole",
    "snap": "hooks give way by that much",
    "compliant": "a seal is squeezed by that much",
}


class FitConfig(Strict):
    """A fit of a part in another: its clearance, and how it goes in and stays."""

    kind: Literal["clearance", "press", "snap", "compliant", "glued"] | None = Field(
        None,
        exclude_if=is_absent,
        description="clearance: it slides in; press: it is pushed in and stays; snap: hooks give "
        "way and hold it; compliant: a seal that yields; glued: it is held until the glue holds; "
        "left out: convex pieces that leave the play 'play_m'",
    )
    drawn_m: Annotated[float, Field(ge=-0.1, le=0.1)] = Field(
        description="clearance of the drawing, on each side [m]; negative for interference"
    )
    play_m: Annotated[float, Field(ge=0, le=0.1)] | None = Field(
        None,
        exclude_if=is_absent,
        description="clearance that the pieces leave, on each side, without their excess [m]; "
        "needed without 'kind', which excludes it; left out: as drawn",
    )
    outside_m: Annotated[float, Field(ge=0, le=0.1)] = Field(
        0.0,
        description="greatest depth to which the pieces of both are in the way of parts [m], "
        "without 'kind' only; outputs state it",
    )
    force_n: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="force that pushes it in [N], needed for press, snap and compliant: arm and "
        "grip must bear it; of the others the most that engines allow; left out: 20 N",
    )
    lead_in_m: Annotated[float, Field(ge=0, le=0.05)] | None = Field(
        None,
        exclude_if=is_absent,
        description="width of the chamfer at the mouth [m]: engines lead the part in if the hand "
        "is no farther aside; left out: none, and only contact leads it",
    )
    wait_s: Annotated[float, Field(gt=0, le=86_400)] | None = Field(
        None,
        exclude_if=is_absent,
        description="time that the hand holds a glued part at its goal [s], on top of its dwell, "
        "needed for glue alone; left out: none",
    )
    stop: Literal["part", "arm"] = Field(
        "part",
        exclude_if=_is_stopped_by_part,
        description="part: a face of another part or fixture ends the insertion at the goal; arm: "
        "the arm ends it, and press, snap or glue holds the part there",
    )

    @model_validator(mode="after")
    def _check_kind(self) -> Self:
        if self.kind is None:
            given = self.model_fields_set & {"force_n", "lead_in_m", "wait_s", "stop"}
            if given:
                raise Located("needs 'kind' of the fit. Give one.", min(given))
            if self.play_m is None:
                raise Located("give 'kind', or 'play_m' that convex pieces leave.")
            return self
        for key in ("play_m", "outside_m"):
            if key in self.model_fields_set:
                words = "is of convex pieces without a kind, and 'kind' has 'drawn_m'."
                raise Located(f"{words} Leave it out.", key)
        if self.kind in _TIGHT:
            if self.drawn_m >= 0:
                message = f"must be below 0, as {_ADVICE[self.kind]}."
                raise Located(message, "drawn_m")
            if self.force_n is None:
                raise Located(f"key 'force_n' is missing: a {self.kind} fit takes a force.")
        elif self.drawn_m < 0:
            message = f"must not be below 0 for kind {self.kind}. Give press, snap or compliant."
            raise Located(message, "drawn_m")
        if (self.wait_s is not None) != (self.kind == "glued"):
            if self.wait_s is None:
                raise Located("key 'wait_s' is missing: a glued part is held until it stays.")
            raise Located(f"is for glue, not for kind {self.kind}. Leave it out.", "wait_s")
        if self.stop == "arm" and self.kind in ("clearance", "compliant"):
            message = f"nothing would hold the part, as kind {self.kind} lets it slide. Give part."
            raise Located(message, "stop")
        return self

    @property
    def overlap_m(self) -> float:
        """Stated overlap of the shapes, >= 0 [m]; 0 without a kind."""
        return 0.0 if self.kind is None else max(0.0, -self.drawn_m)

    @property
    def holds(self) -> bool:
        """True if the part stays in place by this fit alone."""
        return self.kind in ("press", "snap", "glued")


class Shaped(Strict):
    """A body whose shape is given by one of several keys."""

    size_m: Extents | None = Field(
        None, description="extents of a simple box, x y z [m]; or one of boxes, cylinder and meshes"
    )
    boxes: Annotated[list[BoxConfig], Field(min_length=1, max_length=64)] | None = Field(
        None, description="the boxes of a compound part; instead of size_m"
    )
    cylinder: CylinderConfig | None = Field(
        None, description="an upright cylinder; instead of size_m"
    )
    meshes: Annotated[list[MeshConfig], Field(min_length=1, max_length=256)] | None = Field(
        None, description="polyhedra from files, convex or not; instead of size_m"
    )

    # Members of a sub-assembly in its frame, and its shapes with the heads of its screws.
    _members: tuple[tuple[Shaped, Pose], ...] = PrivateAttr(())
    _heads: tuple[Shape, ...] = PrivateAttr(())
    _joined: tuple[Shape, ...] = PrivateAttr(())

    @property
    def is_joined(self) -> bool:
        """True for a sub-assembly, whose shape its members give."""
        return False

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if self.is_joined:
            return self
        if sum(getattr(self, key) is not None for key in SHAPE_KEYS) != 1:
            raise Located("give one of 'size_m', 'boxes', 'cylinder' and 'meshes'.")
        return self

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Shapes in the body's own frame, whose origin is at the centre of its bottom."""
        if self.is_joined:
            return self._joined or _UNKNOWN
        if self.size_m is not None:
            x_m, y_m, z_m = self.size_m
            return (Box((x_m, y_m, z_m), (0.0, 0.0, z_m / 2)),)
        if self.cylinder is not None:
            height_m = self.cylinder.height_m
            return (Cylinder(self.cylinder.diameter_m, height_m, (0.0, 0.0, height_m / 2)),)
        if self.meshes is not None:
            return tuple(mesh.shape for mesh in self.meshes)
        return tuple(
            Box(make_point(box.size_m), make_point(box.centre_m)) for box in self.boxes or ()
        )

    @property
    def convex_shapes(self) -> tuple[Shape, ...]:
        """Convex shapes of the body: pieces replace a concave mesh.

        Raises
        ------
        NoPieces
            If no installed plugin decomposes such a mesh.
        """
        if self.is_joined:
            pieces = [
                move_shape(shape, pose)
                for member, pose in self._members
                for shape in member.convex_shapes
            ]
            return (*pieces, *self._heads) or _UNKNOWN
        meshes = self.meshes or ()
        if not any(map(self.moves_as_pieces, meshes)):
            return self.shapes
        # Imports numpy, which most boards do not need.
        from skillplan.collision.decomposition import decompose

        shapes: list[Shape] = []
        for mesh in meshes:
            if self.moves_as_pieces(mesh):
                shapes += mesh.given_pieces or decompose(mesh.shape).pieces
            else:
                shapes.append(mesh.shape)
        return tuple(shapes)

    def moves_as_pieces(self, mesh: MeshConfig) -> bool:
        """Return True if a mesh of the body is concave."""
        return not mesh.convex

    @property
    def bounding_boxes(self) -> tuple[Box, ...]:
        """Smallest upright boxes about the shapes, in the body's frame."""
        return tuple(shape.box for shape in self.shapes)

    @property
    def height_m(self) -> float:
        """Height of the top above the bottom [m]."""
        return max(box.centre[2] + box.size[2] / 2 for box in self.bounding_boxes)

    @property
    def shape_key(self) -> str:
        """The key that gives its shape."""
        if self.is_joined:
            return "made_of"
        return next(key for key in SHAPE_KEYS if getattr(self, key) is not None)

    def join(self, members: Mapping[str, tuple[Shaped, Pose]], heads: Sequence[Shape]) -> None:
        """Set the shape of a sub-assembly.

        Parameters
        ----------
        members
            Its parts with their poses in its frame, by name.
        heads
            Heads of its screws in its frame.
        """
        self._members = tuple(members.values())
        self._heads = tuple(heads)
        shapes = [
            move_shape(shape, pose) for member, pose in self._members for shape in member.shapes
        ]
        self._joined = (*shapes, *heads)


class OtherGoal(Strict):
    """Another place where a part may go instead of its goal."""

    goal_m: PlanarOrSpatial = Field(description="place, x y or x y z [m]; as of the part")
    goal_on: Names | None = Field(
        None, description="the part it stands on there, or a list of them; left out: the table"
    )
    goal_yaw_rad: Angle = Field(0.0, description="yaw there [rad]")
    goal_rpy_rad: Angles | None = Field(
        None, description="rotation there [rad]; instead of goal_yaw_rad"
    )


class PartConfig(Shaped):
    """A part: shape, start and goal."""

    tool: ToolName = Field(
        "",
        description="the tool that grasps it, or a list of tools of which the search takes one; a "
        "fixed part has none",
    )
    fixed: bool = Field(
        False,
        exclude_if=is_empty,
        description="it stands at its goal from the start, and no hand moves it: a heavy base",
    )
    mass_kg: Mass = Field(0.1, description="mass [kg]")
    grasp: Grasps = Field(
        default_factory=GraspConfig,
        description="its grasp; a list of grasps to choose from, the preferred first; auto: "
        "from any of its six sides, closing along either axis there",
    )
    grasp_failure: FailureProbability = Field(
        0.0, description="probability that a pick leaves it where it lies, at most 1 - 1e-9 [-]"
    )
    start_m: PlanarOrSpatial | None = Field(
        None,
        description="place at the start, x y or x y z [m]; or one of start_on and feeder; "
        "without z it rests on start_on, or on the table",
    )
    start_on: Name | None = Field(
        None,
        description="the part it lies on at the start (a stack), at start_m or over that part's "
        "origin; instead of start_m alone",
    )
    feeder: Name | None = Field(None, description="the feeder it comes from; instead of start_m")
    arrives_s: ArrivalTime | None = Field(
        None,
        exclude_if=is_absent,
        description="earliest begin of its pick after the begin of the plan; the arm waits where "
        "it is, and its place is kept free before; with 'count', also a list of times, one for "
        "each [s]; left out: it is there from the start",
    )
    start_yaw_rad: Angle = Field(0.0, description="yaw at the start [rad]")
    start_rpy_rad: Angles | None = Field(
        None,
        description="rotation at the start, about the fixed axes x, y and z in "
        "this order [rad]; instead of start_yaw_rad",
    )
    goal_m: PlanarOrSpatial = Field(
        description="place at the goal, x y or x y z [m]; without z it rests on goal_on"
    )
    goal_on: Names | None = Field(
        None, description="the part it stands on, or a list of them; left out: the table"
    )
    goal_yaw_rad: Angle = Field(0.0, description="yaw at the goal [rad]")
    goal_rpy_rad: Angles | None = Field(
        None,
        description="rotation at the goal, about the fixed axes x, y and z in "
        "this order [rad]; instead of goal_yaw_rad",
    )
    insert_along: Directions | None = Field(
        None,
        description="direction of its insertion, x y z, or several to choose "
        "from, the preferred first; left out: straight down",
    )
    insert_m: Length | None = Field(
        None,
        description="length of the insertion [m]; left out: the length that clears its neighbours",
    )
    release_m: ReleaseHeight | None = Field(
        None,
        exclude_if=is_absent,
        description="height above its goal at which it is let go, to slide down by its weight in "
        "what encloses it, where fingers have no room [m]; left out: that at which the detector or "
        "the engine lets go of all parts",
    )
    frame: Literal["world", "goal"] = Field(
        "world",
        description="the frame of insert_along: the world's, or that of the part at its goal",
    )
    buffers: Names | None = Field(
        None,
        exclude_if=is_absent,
        description="buffers where it may be put down and taken again, perhaps by another of its "
        "grasps, a name or a list; the state then has where it is and by which grasp it is held; "
        "left out: none",
    )
    fits: dict[Name, FitConfig] | None = Field(
        None,
        exclude_if=is_absent,
        description="fits in other parts that are there before it, by name, as "
        "{housing: {kind: press, drawn_m: -2.0e-5, force_n: 40}}; without kind, swept and engines "
        "use its pieces even if its meshes are convex, and state the play that they assume; left "
        "out: none",
    )
    durations_s: PartDurations | None = Field(
        None,
        exclude_if=is_absent,
        description="dwell times of this part [s]; left out: dwell of its tool, or of the task",
    )
    count: Count | None = Field(
        None,
        exclude_if=is_absent,
        description="number of such parts, NAME_1, NAME_2 and so on; left out: one, NAME",
    )
    start_in: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="the tray it lies in at the start, in the next free pocket; instead of start_m",
    )
    start_pattern: PatternConfig | None = Field(
        None,
        exclude_if=is_absent,
        description="with 'count', places at the start, the first at start_m; left out: all come "
        "from a tray, a feeder, or lie on the parts of another count",
    )
    goal_pattern: PatternConfig | None = Field(
        None,
        exclude_if=is_absent,
        description="with 'count', places at the goal, the first at goal_m; left out: one place",
    )
    interchangeable: bool | Name | None = Field(
        None,
        exclude_if=is_absent,
        description="parts with the same name here may take each other's goals, and the search "
        "assigns them; left out: parts of one count may if they start at places; false: each part "
        "has its own goal",
    )

    other_goals: Annotated[list[OtherGoal], Field(min_length=1, max_length=16)] | None = Field(
        None,
        exclude_if=is_absent,
        description="places where it may go instead, of which the search takes one; left out: none",
    )
    other_tools: Annotated[list[Name], Field(min_length=1, max_length=8)] | None = Field(
        None,
        exclude_if=is_absent,
        description="tools that may grasp it instead of 'tool', of which the search takes one; "
        "left out: none",
    )
    optional: bool = Field(
        False,
        exclude_if=is_empty,
        description="it need not be placed, unless 'goal' names it; left out: it must",
    )

    orientation: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="orientation of its workholder in which it is put in; left out: any",
    )
    made_of: Names | None = Field(
        None,
        exclude_if=is_absent,
        description="the parts and screws that it is put together from, each at its own goal, the "
        "part that gives its origin first; then it is one part, which a hand takes from there; its "
        "shape, mass and start follow; left out: it is a single part",
    )

    @property
    def is_joined(self) -> bool:
        """True for a sub-assembly, whose shape its members give."""
        return self.made_of is not None

    @model_validator(mode="after")
    def _one_start(self) -> PartConfig:
        if self.made_of is not None:
            for key in (*_MEMBERS_GIVE, "fixed", "count", "interchangeable"):
                if key in self.model_fields_set:
                    words = "its members give it" if key in _MEMBERS_GIVE else "it is put together"
                    raise Located(f"a sub-assembly has none: {words}. Leave it out.", key)
        if self.fixed:
            for key in _MOVED_KEYS:
                if key in self.model_fields_set:
                    raise Located("no hand moves a fixed part. Leave it out.", key)
            return self
        if "tool" not in self.model_fields_set:
            raise Located("key 'tool' is missing; only a fixed part has none.")
        lies = self.start_m is not None or self.start_on is not None
        if self.made_of is None and lies == (self.feeder is not None):
            raise Located("give one of 'start_m', 'start_on' and 'feeder'.")
        for when in ("start", "goal"):
            keys = (f"{when}_yaw_rad", f"{when}_rpy_rad")
            if self.model_fields_set.issuperset(keys) and getattr(self, keys[1]) is not None:
                raise Located(f"give one of {keys[0]!r} and {keys[1]!r}, not both.", keys[1])
        if self.buffers and self.grasp == "auto":
            message = (
                "give a list of grasps, as the state has by which of them the part is held; "
                "check lists what auto keeps of a part without buffers."
            )
            raise Located(message, "grasp")
        if self.release_m is not None and self.other_goals:
            message = "says how far above one place it is let go. Leave out 'other_goals' or this."
            raise Located(message, "release_m")
        if "frame" in self.model_fields_set and self.insert_along is None:
            raise Located("says in which frame insert_along is, and there is none.", "frame")
        return self

    @property
    def tools(self) -> tuple[str, ...]:
        """The tools that may act on it, the preferred one first."""
        return (self.tool, *(self.other_tools or ()))

    @property
    def start_turn_rad(self) -> Point:
        """Roll, pitch and yaw at the start [rad]."""
        return _make_turn(self.start_rpy_rad, self.start_yaw_rad)

    @property
    def goal_turn_rad(self) -> Point:
        """Roll, pitch and yaw at the goal [rad]."""
        return _make_turn(self.goal_rpy_rad, self.goal_yaw_rad)

    def moves_as_pieces(self, mesh: MeshConfig) -> bool:
        """Return True if a mesh is concave, or if its given pieces leave room in fits."""
        as_pieces = any(fit.kind is None for fit in (self.fits or {}).values())
        return super().moves_as_pieces(mesh) or bool(as_pieces and mesh.given_pieces)


def _make_turn(rpy_rad: list[float] | None, yaw_rad: float) -> Point:
    roll, pitch, yaw = rpy_rad or (0.0, 0.0, yaw_rad)
    return (roll, pitch, yaw)


class FixtureConfig(Shaped):
    """A body that stays where it is: a jig, a rack, a wall, a camera above the table."""

    at_m: PlanarOrSpatial = Field(
        description="place of the centre of its bottom, x y or x y z [m]; without z it stands on "
        "stands_on, or on the table; with z it may be in the air or let into the table"
    )
    stands_on: Name | None = Field(
        None, description="the fixture that it stands on; left out: the table, or what at_m says"
    )
    yaw_rad: Angle = Field(0.0, description="yaw [rad]")
    rpy_rad: Angles | None = Field(
        None,
        description="rotation about the fixed axes x, y and z in this order [rad]; instead of "
        "yaw_rad",
    )

    @model_validator(mode="after")
    def _one_turn(self) -> FixtureConfig:
        if {"yaw_rad", "rpy_rad"} <= self.model_fields_set and self.rpy_rad is not None:
            raise Located("give one of 'yaw_rad' and 'rpy_rad', not both.", "rpy_rad")
        if self.stands_on is not None and len(self.at_m) == 3:
            raise Located("give x y only, as it stands on another fixture.", "at_m")
        return self

    @property
    def turn_rad(self) -> Point:
        """Roll, pitch and yaw [rad]."""
        return _make_turn(self.rpy_rad, self.yaw_rad)
