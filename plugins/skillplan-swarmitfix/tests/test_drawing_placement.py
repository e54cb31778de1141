"""A drawing is read in its unit, turned, and put on the bench; a doubtful unit is told."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import ezdxf
import pytest

from skillplan.domains import Problem
from skillplan.errors import Issue, TaskError
from skillplan.pipeline import load_problem

# A triangle in the middle of the bench, in metres.
TRIANGLE = ((0.75, 0.60), (1.75, 0.60), (1.25, 1.20))
UNITLESS, INCHES, MILLIMETRES, METRES = 0, 1, 4, 6
MM, INCH = 1e-3, 0.0254

FILE = """kind: swarmitfix
name: drawn
heads: {max_gap_m: 0.2, step_m: 0.04}
trajectory:
  file: FILE
"""


def drawn(
    folder: Path, corners: Sequence[tuple[float, float]], insunits: int, unit_m: float
) -> str:
    """Write a DXF of a closed polyline, in units of `unit_m`; return its name."""
    document = ezdxf.new("R2000", units=insunits)
    points = [(x / unit_m, y / unit_m) for x, y in corners]
    document.modelspace().add_lwpolyline(points, close=True)
    document.saveas(folder / "drawing.dxf")
    return "drawing.dxf"


def loaded(folder: Path, file: str, *keys: str) -> Problem:
    path = folder / "task.yaml"
    path.write_text(FILE.replace("FILE", file) + "".join(f"  {key}\n" for key in keys), "utf-8")
    return load_problem(path)


def refused(folder: Path, file: str, *keys: str) -> str:
    with pytest.raises(TaskError) as caught:
        loaded(folder, file, *keys)
    return str(caught.value)


def corners_of(problem: Problem) -> list[list[float]]:
    trajectory: Any = problem.config
    trajectory = trajectory.trajectory
    return [trajectory.start_m, *(entry.line_to_m for entry in trajectory.path)][:-1]


def told(problem: Problem) -> list[Issue]:
    return list(problem.domain.warnings(problem.config))


def near(corners: Sequence[Sequence[float]]) -> list[Any]:
    return [pytest.approx(corner, abs=1e-9) for corner in corners]


@pytest.mark.slow(reason="drawings more; where one is placed in every run")
class TestTheUnit:
    @pytest.mark.parametrize(
        ("insunits", "unit_m", "name"),
        [(UNITLESS, 1.0, "m"), (UNITLESS, INCH, "in"), (MILLIMETRES, 1.0, "m")],
    )
    def test_of_the_task_file_goes_before_that_of_a_drawing(self, tmp_path, insunits, unit_m, name):
        """Whether the drawing says none, or another."""
        problem = loaded(tmp_path, drawn(tmp_path, TRIANGLE, insunits, unit_m), f"unit: {name}")
        assert near(TRIANGLE) == corners_of(problem)
        assert told(problem) == []

    def test_of_the_drawing_counts_where_the_task_file_says_none(self, tmp_path):
        """Inches by $INSUNITS."""
        problem = loaded(tmp_path, drawn(tmp_path, TRIANGLE, INCHES, INCH))
        assert near(TRIANGLE) == corners_of(problem)

    def test_is_millimetres_where_nothing_says_it_and_the_size_fits(self, tmp_path):
        """Without a word of warning, as most drawings are so."""
        problem = loaded(tmp_path, drawn(tmp_path, TRIANGLE, UNITLESS, MM))
        assert near(TRIANGLE) == corners_of(problem)
        assert told(problem) == []

    def test_holds_in_a_program_until_it_says_another(self, tmp_path):
        """`unit` before G20 and G21."""
        code = "G0 X1.0 Y0.6\nG1 X1.5\nG21 G1 Y1100\nG1 X1000 Y600\n"
        (tmp_path / "path.nc").write_text(code, "ascii")
        problem = loaded(tmp_path, "path.nc", "unit: m")
        assert near([(1.0, 0.6), (1.5, 0.6), (1.5, 1.1)]) == corners_of(problem)

    def test_makes_a_table_without_one_readable(self, tmp_path):
        """With the header x,y."""
        rows = "".join(f"{x * 100},{y * 100}\n" for x, y in (*TRIANGLE, TRIANGLE[0]))
        (tmp_path / "path.csv").write_text("x,y\n" + rows, "ascii")
        assert near(TRIANGLE) == corners_of(loaded(tmp_path, "path.csv", "unit: cm"))
        assert "has no unit; write x_m,y_m or x_mm,y_mm, or give 'unit'" in refused(
            tmp_path, "path.csv"
        )

    def test_may_not_contradict_the_header_of_a_table(self, tmp_path):
        """One of the two is wrong, and nobody knows which."""
        (tmp_path / "path.csv").write_text("x_mm,y_mm\n600,600\n900,600\n", "ascii")
        message = refused(tmp_path, "path.csv", "unit: m")
        assert "line 1: the header 'x_mm,y_mm' has a unit; leave 'unit' out" in message

    def test_is_one_of_those_known(self, tmp_path):
        """The message lists them."""
        message = refused(tmp_path, drawn(tmp_path, TRIANGLE, UNITLESS, MM), "unit: metres")
        assert "task.yaml:6:9: trajectory.unit: must be 'um', 'mm'" in message


class TestADoubtfulUnit:
    def test_is_told_of_a_drawing_that_becomes_a_few_millimetres(self, tmp_path):
        """A triangle drawn in metres, read in millimetres: 1 mm long."""
        problem = loaded(tmp_path, drawn(tmp_path, TRIANGLE, UNITLESS, 1.0), "offset_m: [1.0, 0.6]")
        (warning,) = told(problem)
        assert warning.path == ("trajectory", "file")
        assert warning.message == (
            "drawing.dxf: its unit is not given, and read in mm it is 0.001 m long. Give "
            "trajectory.unit, such as m or in."
        )

    def test_is_told_beside_the_faults_of_a_drawing_that_becomes_huge(self, tmp_path):
        """Drawn in micrometres it is off the bench, and why is told with it."""
        message = refused(tmp_path, drawn(tmp_path, TRIANGLE, UNITLESS, 1e-5))
        assert "is off the bench" in message
        assert "read in mm it is 100 m long. Give trajectory.unit" in message

    def test_is_no_matter_where_the_drawing_says_it(self, tmp_path):
        """A jewel of 1 mm is what its author says it is."""
        small = [(x * MM, y * MM) for x, y in TRIANGLE]
        file = drawn(tmp_path, small, MILLIMETRES, MM)
        assert told(loaded(tmp_path, file, "offset_m: [1.0, 0.6]")) == []

    def test_is_told_of_a_program_that_says_none(self, tmp_path):
        """Neither G20 nor G21, and 1 mm long."""
        (tmp_path / "path.nc").write_text("G0 X0 Y0\nG1 X1\nG1 Y1\n", "ascii")
        problem = loaded(tmp_path, "path.nc", "offset_m: [1.0, 0.6]")
        assert ["read in mm it is 0.001 m long" in warning.message for warning in told(problem)]
        (tmp_path / "path.nc").write_text("G21\nG0 X0 Y0\nG1 X1\nG1 Y1\n", "ascii")
        assert told(loaded(tmp_path, "path.nc", "offset_m: [1.0, 0.6]")) == []


class TestPlacingADrawing:
    def test_turns_it_about_its_origin_and_then_moves_it(self, tmp_path):
        """A quarter turn anticlockwise: (x, y) goes to (-y, x), and on by the offset."""
        file = drawn(tmp_path, [(0.0, 0.0), (0.5, 0.0), (0.5, 0.6)], MILLIMETRES, MM)
        problem = loaded(tmp_path, file, "rotate_deg: 90", "offset_m: [1.5, 0.6]")
        assert near([(1.5, 0.6), (1.5, 1.1), (0.9, 1.1)]) == corners_of(problem)

    @pytest.mark.parametrize("angle_deg", [-360, -37.5, 0, 12, 270])
    def test_keeps_lengths(self, tmp_path, angle_deg):
        """Of every side, whatever the angle."""
        file = drawn(tmp_path, [(0.0, 0.0), (0.4, 0.0), (0.4, 0.3)], MILLIMETRES, MM)
        problem = loaded(tmp_path, file, f"rotate_deg: {angle_deg}", "offset_m: [1.0, 0.8]")
        item, two, three = corners_of(problem)
        sides = [math.dist(item, two), math.dist(two, three), math.dist(three, item)]
        assert near([[0.4, 0.3, 0.5]]) == [sides]

    def test_moves_arcs_and_curves_with_it(self, tmp_path):
        """A circle stays one: the same length about another middle."""
        document = ezdxf.new("R2000", units=MILLIMETRES)
        document.modelspace().add_circle((0, 0), 300)
        document.saveas(tmp_path / "drawing.dxf")
        problem = loaded(tmp_path, "drawing.dxf", "rotate_deg: 30", "offset_m: [1.2, 0.85]")
        shown = problem.domain.overview(problem.config).document["trajectory"]
        assert pytest.approx(math.tau * 0.3, rel=2e-3) == shown["length_m"]
        rounded = [[round(value, 2) for value in corner] for corner in shown["extent_m"]]
        assert rounded == [[0.9, 0.55], [1.5, 1.15]]

    def test_makes_another_task(self, tmp_path):
        """The hash is that of where the trajectory lies on the bench."""
        file = drawn(tmp_path, TRIANGLE, MILLIMETRES, MM)
        here = loaded(tmp_path, file)
        assert here.sha256 == loaded(tmp_path, file, "offset_m: [0, 0]", "rotate_deg: 0").sha256
        assert here.sha256 != loaded(tmp_path, file, "offset_m: [0.01, 0]").sha256

    @pytest.mark.parametrize("key", ["unit: mm", "offset_m: [0, 0]", "rotate_deg: 90"])
    def test_is_for_files_only(self, tmp_path, key):
        """Vertices in the task file are on the bench already."""
        path = tmp_path / "task.yaml"
        text = FILE.replace("file: FILE", "vertices_m: [[0.75, 0.6], [1.75, 0.6]]")
        path.write_text(f"{text}  {key}\n", "utf-8")
        with pytest.raises(TaskError, match=f"trajectory.{key.split(':')[0]}: belongs to a file"):
            load_problem(path)


class TestTheOverview:
    def test_tells_extent_and_length_of_the_trajectory(self, tmp_path):
        """In words and as JSON values."""
        problem = loaded(tmp_path, drawn(tmp_path, TRIANGLE, MILLIMETRES, MM))
        shown = problem.domain.overview(problem.config)
        length_m = 1.0 + 2 * math.hypot(0.5, 0.6)
        assert {
            "closed": True,
            "segments": 3,
            "length_m": pytest.approx(length_m),
            "extent_m": near([(0.75, 0.60), (1.75, 1.20)]),
            "chords": 0,
            "deviation_m": 0.0,
            "notes": [],
            "crossings_m": [],
            "holes_m": [],
        } == shown.document["trajectory"]
        assert shown.lines == (
            "trajectory closed, 2.5620 m long, 3 segments, x 0.750 to 1.750 m, y 0.600 to 1.200 m",
        )


def test_a_drawing_in_coordinates_of_a_map_is_put_at_the_origin(tmp_path):
    """Beyond the reach of offset_m; told with the corner."""
    far = [(x + 4512345.678, y - 398765.432) for x, y in TRIANGLE]
    problem = loaded(tmp_path, drawn(tmp_path, far, METRES, 1.0), "offset_m: [0.75, 0.6]")
    assert corners_of(problem) == [pytest.approx(corner, abs=1e-8) for corner in TRIANGLE]
    config: Any = problem.config
    assert config.trajectory.notes == (
        "the origin lies over 1000 m away; instead the lower left corner is taken, "
        "[4512346.428, -398764.832] m",
    )
