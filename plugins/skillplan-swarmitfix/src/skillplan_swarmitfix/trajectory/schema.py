"""The YAML schema of a trajectory, its elements, and the keys of its faults."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from skillplan.domains.domain import Strict
from skillplan.errors import Issue
from skillplan.files.schema_errors import Located, continue_sentence, list_schema_issues
from skillplan_swarmitfix.trajectory.path import TrajectoryPath, one_line
from skillplan_swarmitfix.trajectory.path_elements import Arc, Element, Line, Point2, Spline
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, UnitName, is_doubtful

Coordinate = Annotated[float, Field(ge=-1000, le=1000)]
Planar = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Through = Annotated[list[Planar], Field(min_length=1, max_length=10_000)]


class PathElementConfig(Strict):
    """One element of a trajectory: a line, an arc through a point, or a spline through points."""

    line_to_m: Planar | None = Field(
        None, description="end of a straight line, x y [m]; or one of arc_to_m and spline_through_m"
    )
    arc_to_m: Planar | None = Field(
        None, description="end of a circular arc, x y [m]; instead of line_to_m"
    )
    through_m: Planar | None = Field(
        None, description="a point that the arc passes, x y [m]; left out: no arc"
    )
    spline_through_m: Through | None = Field(
        None,
        description="points that a smooth curve passes, the last is its end [[x, y], ...] [m]; "
        "instead of line_to_m",
    )

    @model_validator(mode="after")
    def _one_shape(self) -> PathElementConfig:
        given = [self.line_to_m, self.arc_to_m, self.spline_through_m]
        if sum(value is not None for value in given) != 1:
            raise ValueError("give one of line_to_m, arc_to_m and spline_through_m.")
        if (self.arc_to_m is None) != (self.through_m is None):
            raise ValueError("an arc needs arc_to_m and through_m, a point on the arc.")
        return self


class NearConfig(Strict):
    """A contour of a file by a point near it."""

    at_m: Planar = Field(description="point on the bench to which the contour is nearest, x y [m]")


class DrawingConfig(Strict):
    """Unit and placement of a file's drawing on the bench, and which of its contours is meant.

    It is in the coordinates that are read from the file, and so not in the task's hash again.
    """

    contour: Literal["outer"] | Annotated[int, Field(ge=1, le=1_000_000)] | NearConfig | None = (
        Field(
            None,
            description="contour of the file that is the trajectory: outer, the one that encloses "
            "all others; its number; or at_m: [x, y], the nearest one to a point; left out: the "
            "only one, or outer unless it may be a frame on a layer of its own",
            exclude=True,
        )
    )
    layer: Annotated[str, Field(min_length=1, max_length=255)] | None = Field(
        None,
        description="layer of a drawing that holds the trajectory; left out: all that are on",
        exclude=True,
    )

    unit: UnitName | None = Field(
        None,
        description="unit of the file's lengths: for a drawing instead of its own unit, for a "
        "program until G20 or G21, for a table with the header x,y; left out: the unit of the file "
        "says, or else mm",
        exclude=True,
    )
    rotate_deg: Annotated[float, Field(ge=-360, le=360)] = Field(
        0.0,
        description="how far the file's drawing is turned about its own origin, anticlockwise, "
        "before it is moved by offset_m [deg]",
        exclude=True,
    )
    offset_m: Planar = Field(
        [0.0, 0.0],
        description="where on the bench the origin of the file's drawing is put, x y [m]",
        exclude=True,
    )


class TrajectoryConfig(DrawingConfig):
    """The path of the tool: vertices, or a start and elements, or a file."""

    closed: bool = Field(False, description="whether the tool returns to its start")
    vertices_m: Annotated[list[Planar], Field(min_length=2, max_length=10_000)] | None = Field(
        None,
        description="corners of a polygonal trajectory, [[x, y], ...] [m]; or one of path and file",
    )
    start_m: Planar | None = Field(None, description="start of path, x y [m]; left out: no path")
    path: Annotated[list[PathElementConfig], Field(min_length=1, max_length=10_000)] | None = Field(
        None, description="lines, arcs and splines from start_m on; instead of vertices_m"
    )
    file: Annotated[str, Field(min_length=1, max_length=4096)] | None = Field(
        None,
        description="a DXF, CSV or G-code file, relative to the task file; instead of the other "
        "forms",
    )
    chord_tolerance_m: Annotated[float, Field(ge=1e-6, le=1)] = Field(
        0.001, description="how far a curve may lie from its chords [m]"
    )

    # Content of the file, with the place of every element in it.
    _read: TrajectoryPath | None = PrivateAttr(None)

    @model_validator(mode="wrap")
    @classmethod
    def _read_file(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        """Replace the name of a file by its content."""
        if not isinstance(data, dict) or not isinstance(data.get("file"), str):
            return handler(data)
        placing = {key: data[key] for key in DrawingConfig.model_fields if key in data}
        try:
            drawing = DrawingConfig.model_validate(placing)
        except ValidationError:
            # The same keys are faulty here, and are reported with their places.
            return handler(data)
        others = [key for key in ("vertices_m", "start_m", "path", "closed") if key in data]
        if others:
            raise Located(f"a file is complete; leave {', '.join(others)} out.", "file")
        from skillplan_swarmitfix.trajectory.files import content_of

        folder = Path((info.context or {}).get("folder", Path()))
        read = _trajectory_in(folder, data["file"], drawing)
        content = content_of(read)
        try:
            cls.model_validate(content)
        except ValidationError as error:
            fault = list_schema_issues(error, cls)[0]
            place = read.place_of(fault.path[1:2] if fault.path[:1] == ("path",) else ("start",))
            raise Located(in_file(data["file"], place, fault.message), "file") from None
        config = handler({**data, **content})
        config._read = read
        return config

    def place_of(self, path: tuple[str | int, ...], message: str) -> str:
        """Return a message with the file, and the place in it, of a fault of the trajectory.

        Parameters
        ----------
        path
            As `trajectory_faults.faults` gives it.
        message
            The fault; unchanged if the trajectory is not read from a file.
        """
        if self.file is None or self._read is None:
            return continue_sentence(message)
        return in_file(self.file, self._read.place_of(path), message)

    @property
    def notes(self) -> tuple[str, ...]:
        """Everything that was assumed or left out of the file, a clause each."""
        return self._read.notes if self._read else ()

    @property
    def holes(self) -> tuple[Point2, ...]:
        """Centres of the holes that the file drills [m]."""
        return self._read.holes if self._read else ()

    @property
    def guessed_unit_extent_m(self) -> float | None:
        """The longer side of a file's drawing [m] if its unit is unknown; None otherwise."""
        return max(self._read.extent_m) if self._read and self._read.unit_assumed else None

    @model_validator(mode="after")
    def _one_form(self) -> TrajectoryConfig:
        if (self.vertices_m is None) == (self.path is None):
            raise ValueError("give either vertices_m, or start_m and path, or file.")
        if (self.path is None) != (self.start_m is None):
            raise ValueError("path and start_m belong together.")
        placing = sorted(self.model_fields_set & DrawingConfig.model_fields.keys())
        if self.file is None and placing:
            message = (
                "belongs to a file; coordinates given here are metres on the bench. Leave it out."
            )
            raise Located(message, placing[0])
        return self


def in_file(name: str, place: str, message: str) -> str:
    """Return a message with the place of the fault in the file."""
    return ": ".join(filter(None, (one_line(name, 200), place, continue_sentence(message))))


def _trajectory_in(folder: Path, name: str, drawing: DrawingConfig) -> TrajectoryPath:
    from skillplan_swarmitfix.trajectory.files import TrajectoryFileError, placed, read_contours

    if not name.strip():
        raise Located(f"must name a DXF, CSV or G-code file, not {name!r}.", "file")
    x_m, y_m = drawing.offset_m
    choice = drawing.contour
    try:
        contours = read_contours(folder / name, drawing.unit, layer=drawing.layer)
        on_bench = placed(contours, (x_m, y_m), drawing.rotate_deg)
        if isinstance(choice, NearConfig):
            return on_bench.choose((choice.at_m[0], choice.at_m[1]))
        return on_bench.choose(choice)
    except TrajectoryFileError as error:
        raise Located(in_file(name, error.place, error.message), "file") from None


def elements_of(config: TrajectoryConfig) -> tuple[Point2, tuple[Element, ...]]:
    """Return the start of a trajectory [m] and its elements.

    Raises
    ------
    ValueError
        If an arc or spline is none, such as one whose points coincide.
    """
    if config.vertices_m is not None:
        first, *rest = config.vertices_m
        return point(first), tuple(Line(point(end)) for end in rest)
    assert config.start_m is not None
    assert config.path is not None
    return point(config.start_m), tuple(_element(entry) for entry in config.path)


def _element(entry: PathElementConfig) -> Element:
    if entry.line_to_m is not None:
        return Line(point(entry.line_to_m))
    if entry.arc_to_m is not None and entry.through_m is not None:
        return Arc(point(entry.arc_to_m), point(entry.through_m))
    return Spline(tuple(point(value) for value in entry.spline_through_m or ()))


def point(values: Sequence[float]) -> Point2:
    """Return two coordinates as a point."""
    return values[0], values[1]


def element_key(config: TrajectoryConfig, path: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """Return the key path, under ``trajectory``, of a fault that names an element."""
    if config.file is not None:
        return ("file",)
    if path and path[0] == "chord_tolerance_m":
        return path
    if config.vertices_m is not None:
        # Element i leads to vertex i + 1.
        if path == ("start",):
            return ("vertices_m", 0)
        return ("vertices_m", path[0] + 1) if path and isinstance(path[0], int) else ("vertices_m",)
    if path == ("start",):
        return ("start_m",)
    return ("path", *path)


def unit_doubt(config: TrajectoryConfig) -> Issue | None:
    """Return why the unit that was guessed for a file is hardly meant, by its key; or None."""
    extent_m = config.guessed_unit_extent_m
    if config.file is None or extent_m is None or not is_doubtful(extent_m):
        return None
    message = (
        f"Its unit is not given, and read in {DEFAULT_UNIT} it is {extent_m:.3g} m long. Give "
        "trajectory.unit, such as m or in."
    )
    return Issue(in_file(config.file, "", message), ("file",))
