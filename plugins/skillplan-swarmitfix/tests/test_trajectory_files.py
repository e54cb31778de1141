"""Trajectories from DXF, CSV and G-code files, good and bad."""

from __future__ import annotations

import io
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
from ezdxf.layouts import Modelspace
from ezdxf.math import BSpline
from hypothesis import given
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from skillplan_swarmitfix import SUFFIXES
from skillplan_swarmitfix.trajectory.workpiece import faults

DATA = Path(__file__).parent / "data"
SLOT_M = 2 * 1.0 + math.pi * 0.5


def read(folder: Path, name: str, content: str | bytes) -> swarm.TrajectoryPath:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return swarm.read_trajectory(path)


def refused(folder: Path, name: str, content: str | bytes) -> str:
    """Return what is said of a bad file, without its name."""
    with pytest.raises(swarm.TrajectoryFileError) as caught:
        read(folder, name, content)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(folder / name))
    return message.removeprefix(f"{folder / name}: ")


def drawing(draw: Callable[[Modelspace], Any], units: int = 4) -> str:
    """Return a DXF drawing."""
    document = ezdxf.new("R2000", units=units)
    draw(document.modelspace())
    stream = io.StringIO()
    document.write(stream)
    return stream.getvalue()


def length_m(path: swarm.TrajectoryPath) -> float:
    return swarm.Workpiece.from_elements(
        path.start, path.elements, closed=path.closed, chord_tolerance_m=1e-6
    ).length_m


class TestAnyFile:
    @pytest.mark.parametrize("name", ["slot.dxf", "slot.nc"])
    def test_a_slot_is_the_same_from_a_drawing_and_a_program(self, name):
        slot = swarm.read_trajectory(DATA / name)
        assert slot.closed
        assert slot.start == pytest.approx((0.5, 0.3))
        assert [type(element) for element in slot.elements] == [
            swarm.Line,
            swarm.Arc,
            swarm.Line,
            swarm.Arc,
        ]
        assert [element.end for element in slot.elements] == [
            pytest.approx(end) for end in ((1.5, 0.3), (1.5, 0.8), (0.5, 0.8), (0.5, 0.3))
        ]
        assert slot.elements[-1].end == slot.start
        assert length_m(slot) == pytest.approx(SLOT_M, rel=1e-5)
        assert faults(slot.start, slot.elements, True, 1e-3, (0, 0, 2, 1)) == []

    def test_each_element_has_its_place_in_the_file(self):
        assert swarm.read_trajectory(DATA / "slot.dxf").places == (
            "LINE #1A",
            "ARC #1D",
            "LINE #1B",
            "ARC #1C",
        )
        slot = swarm.read_trajectory(DATA / "slot.nc")
        assert slot.places == ("line 8", "line 9", "line 10", "line 11")
        assert slot.place_of((2,)) == "line 10"
        assert slot.place_of(("start",)) == "line 8"
        assert slot.place_of(()) == ""

    def test_a_file_that_is_not_there(self, tmp_path):
        with pytest.raises(swarm.TrajectoryFileError, match="no such file; give the path of one"):
            swarm.read_trajectory(tmp_path / "none.dxf")

    def test_a_folder(self, tmp_path):
        (tmp_path / "folder.csv").mkdir()
        with pytest.raises(swarm.TrajectoryFileError, match="This is a folder"):
            swarm.read_trajectory(tmp_path / "folder.csv")

    def test_a_pipe_is_not_waited_for(self, tmp_path):
        os.mkfifo(tmp_path / "pipe.csv")
        with pytest.raises(swarm.TrajectoryFileError, match="no regular file"):
            swarm.read_trajectory(tmp_path / "pipe.csv")

    def test_a_file_that_may_not_be_read(self, tmp_path, monkeypatch):
        def forbidden(*_: Any, **__: Any) -> None:
            raise PermissionError(13, "Permission denied")

        (tmp_path / "mine.csv").touch()
        monkeypatch.setattr("skillplan.files.regular_file.open_regular", forbidden)
        with pytest.raises(swarm.TrajectoryFileError, match="may not be read"):
            swarm.read_trajectory(tmp_path / "mine.csv")

    def test_a_name_that_no_system_takes(self, tmp_path):
        for name in ("a\0b.csv", "n" * 999 + ".csv"):
            with pytest.raises(swarm.TrajectoryFileError, match=r"cannot be read|no such file"):
                swarm.read_trajectory(tmp_path / name)

    def test_an_unknown_suffix(self, tmp_path):
        message = refused(tmp_path, "path.step", "x")
        assert message.endswith(f"use one of {', '.join(SUFFIXES)}.")

    @pytest.mark.parametrize("suffix", SUFFIXES)
    def test_an_empty_or_a_huge_file(self, tmp_path, suffix):
        assert "The file is empty" in refused(tmp_path, f"a{suffix}", b" \n")
        assert "larger than 8 MiB" in refused(tmp_path, f"a{suffix}", b"0" * (swarm.MAX_BYTES + 1))

    def test_what_is_no_text(self, tmp_path):
        message = refused(tmp_path, "a.csv", b"x_m,y_m\n0,0\n\xff,1\n")
        assert message == "line 3: The byte 0xff is not UTF-8 text; save it as UTF-8."

    @given(st.sampled_from(SUFFIXES), st.binary(max_size=200))
    def test_random_bytes_are_read_or_refused_in_one_line(self, suffix, content):
        read_or_refuse(suffix, content)

    @given(st.sampled_from(["slot.dxf", "slot.nc", "pentagon.csv"]), st.data())
    def test_damaged_files_are_read_or_refused_in_one_line(self, name, data):
        lines = (DATA / name).read_bytes().split(b"\n")
        odd = st.sampled_from([b"nan", b"1e308", b"-1e-300", b"0", b"", b"99999999", b"X1Y1", b'"'])
        for _ in range(data.draw(st.integers(1, 4))):
            at = data.draw(st.integers(0, len(lines) - 1))
            match data.draw(st.sampled_from(["replace", "cut", "repeat", "spoil"])):
                case "replace":
                    lines[at] = data.draw(odd)
                case "cut":
                    del lines[at : at + data.draw(st.integers(1, 3))]
                    lines = lines or [b""]
                case "repeat":
                    lines[at:at] = lines[: data.draw(st.integers(1, 30))]
                case _:
                    lines[at] = data.draw(st.binary(max_size=6))
        read_or_refuse(Path(name).suffix, b"\n".join(lines))


def read_or_refuse(suffix: str, content: bytes) -> None:
    """Read a file that may be bad; what comes of it is usable, or is one line."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"fuzz{suffix}"
        path.write_bytes(content)
        try:
            read = swarm.read_trajectory(path)
        except swarm.TrajectoryFileError as error:
            text = str(error)
        else:
            issues = faults(read.start, read.elements, read.closed, 1e-3, (0, 0, 2, 2))
            text = " ".join(message + read.place_of(place) for message, place in issues)
    assert text.isprintable() or not text


class TestCsv:
    def test_a_last_row_equal_to_the_first_closes_it(self):
        pentagon = swarm.read_trajectory(DATA / "pentagon.csv")
        assert pentagon.closed
        assert pentagon.start == pentagon.elements[-1].end == pytest.approx((0.5, 0.3))
        assert pentagon.places == ("line 3", "line 4", "line 5", "line 7", "line 8")

    def test_without_it_is_open(self, tmp_path):
        read_back = read(tmp_path, "a.csv", "\ufeffx_m , y_m\r\n0,0\r\n1e0,.5\r\n")
        line = swarm.Line((1, 0.5))
        assert read_back == swarm.TrajectoryPath((0, 0), (line,), False, ("line 3",), "line 2")
        assert read_back.place_of(("start",)) == "line 2"

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("0,0\n1,1\n", "line 1: The header is '0,0'; write x_m,y_m or x_mm,y_mm."),
            ("x_m,y_m\n0,0\n0;1\n", "line 3: The row has 1 cells instead of 2; write x,y"),
            ("x_m,y_m\n0,0\n0,5,1,2\n", "line 3: The row has 4 cells instead of 2; write x,y"),
            (
                "x_m,y_m\n0,0\n\n1,a\x1bb\n",
                "line 4: 'a?b' is not a coordinate; write a number such",
            ),
            ("x_m,y_m\n0,0\n1,nan\n", "line 3: 'nan' is not a coordinate"),
            ("x_m,y_m\n0,0\n1,1e9\n", "line 3: '1e9' is not a coordinate; write a number such as"),
            ("x_m,y_m\n0,0\n1_0,1\n", "line 3: '1_0' is not a coordinate"),
            ('x_m,y_m\n0,0\n"1"2,1\n', "line 3: The table is damaged ("),
            ("x_m,y_m\n0,0\n", "The table has 1 vertices; give the header"),
        ],
    )
    def test_a_bad_table_is_told_by_its_line(self, tmp_path, text, message):
        assert refused(tmp_path, "a.csv", text).startswith(message)

    def test_equal_rows_are_one_point(self, tmp_path):
        twice = read(tmp_path, "a.csv", "x_m,y_m\n0,0\n1,1\n1,1\n2,0\n")
        assert twice.elements == (swarm.Line((1, 1)), swarm.Line((2, 0)))
        assert twice.places == ("line 3", "line 5")
        assert twice.notes == ("1 point that repeats the one before is merged",)
        message = refused(tmp_path, "b.csv", "x_m,y_m\n1,1\n1,1\n")
        assert message == "All vertices of the table are one point; give others."


class TestGcode:
    def test_inches_and_steps_are_followed(self, tmp_path):
        text = "g20 g90 g0 x1 y1\ng91 g1 x1\n(a ; b) y-.5 ; (c\nG90 X0 Y0"
        steps = read(tmp_path, "a.ngc", text)
        ends = [(2, 1), (2, 0.5), (0, 0)]
        assert [element.end for element in steps.elements] == [
            pytest.approx((x * 0.0254, y * 0.0254)) for x, y in ends
        ]
        assert not steps.closed

    @pytest.mark.parametrize(
        ("arc", "through"),
        [
            ("G2 X10 Y10 I10 J0", (10 - 10 * math.sqrt(0.5), 10 * math.sqrt(0.5))),
            ("G2 X10 Y10 R10", (10 - 10 * math.sqrt(0.5), 10 * math.sqrt(0.5))),
            ("G3 X10 Y10 R10", (10 * math.sqrt(0.5), 10 - 10 * math.sqrt(0.5))),
            ("G2 X10 Y10 R-10", (-10 * math.sqrt(0.5), 10 + 10 * math.sqrt(0.5))),
            ("G3 X10 Y10 R-10", (10 + 10 * math.sqrt(0.5), -10 * math.sqrt(0.5))),
        ],
    )
    def test_an_arc_has_its_side_and_its_sense(self, tmp_path, arc, through):
        (result,) = read(tmp_path, "a.nc", f"G0 X0 Y0\n{arc}").elements
        assert isinstance(result, swarm.Arc)
        assert result.through == pytest.approx((through[0] / 1e3, through[1] / 1e3))

    @pytest.mark.parametrize("code", ["G2 I5", "G3 X0 Y0 I5 J0"])
    def test_a_full_circle_is_two_arcs(self, tmp_path, code):
        circle = read(tmp_path, "a.nc", f"G0 X0 Y0\n{code}")
        assert (circle.closed, circle.places) == (True, ("line 2", "line 2"))
        assert length_m(circle) == pytest.approx(math.tau * 0.005, rel=1e-3)
        whole = swarm.Workpiece.from_elements(
            circle.start, circle.elements, closed=True, chord_tolerance_m=1e-6
        )
        assert whole.clockwise is code.startswith("G2")

    def test_rapid_moves_are_no_part_of_it(self, tmp_path):
        text = "G0 X9 Y9\nG0 X0\nY0\nG1 X0 Y0 Z-1\nX10\nG0 Z5\nG0 X50\nX10\nG1 Z-1\nY10\nG0 X0 Y0"
        content = read(tmp_path, "a.tap", text)
        assert content.start == (0, 0)
        assert content.places == ("line 5", "line 10")

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("G0 X0 Y0\nG1 X1..5", "line 2: Cannot read '.5'; write words of a letter and a"),
            (
                "G0 X0 Y0\nM98 P1",
                "line 2: It calls O1, which is not in this file; put it after the",
            ),
            ("G0 X0 Y0\nM98 P1\nM30\nO1\nM98 P1", "line 5, called in line 5: Subprograms are"),
            ("G0 X0\nM98 P1 L1000000\nM30\nO1\nM99", "line 5, called in line 2: It runs more than"),
            ("G0 X0 Y0\nG4 X1", "line 2: G4 with a position; give a dwell as P"),
            ("G0 X0 Y0\nG0 G1 X1", "line 2: G0 and G1 in one line; write two lines."),
            ("G0 X0 Y0\nG1 X1 X2", "line 2: X twice in one line; write two lines."),
            ("X0 Y0", "line 1: A position before any of G0, G1, G2, G3; give the"),
            ("G0 X0 Y0\nG1 X1 I1", "line 2: I, J and R belong to an arc, but the motion is G1."),
            ("G0 X0 Y0\nG2 X1", "line 2: An arc without a centre; give it as I and J"),
            ("G0 X0 Y0\nG2 X1 I1 R1", "line 2: An arc with a centre and a radius"),
            ("G0 X0 Y0\nG2 X9 I1", "line 2: The arc's centre is 0.001 m from its start but 0.008"),
            ("G0 X0 Y0\nG2 X9 I0 J0", "line 2: An arc of radius 0 m; give its centre as I and J."),
            ("G0 X0 Y0\nG2 X9 R1", "line 2: No arc of radius 0.001 m joins points 0.009 m apart"),
            ("G0 X0 Y0\nG2 R1", "line 2: No arc of radius 0.001 m joins points 0 m apart"),
            ("G0 X0 Y0\nG1 X9999999999", "line 2: X is beyond 1e+06 m, which no bench is."),
            ("G0 X0 Y0\nG68 R30", "line 2: G68 is not read here, for it may lead the tool"),
            ("G0 X0 Y0\nG1 X#1", "line 2: 'G1X#1' is computed by the controller; write the moves"),
            (
                "G0 X0\no100 if [#1]",
                "line 2: 'O100IF[#1]' is computed by the controller; write the",
            ),
            ("G0 X0 Y0\nG1 X1 A45", "line 2: The word A45 moves another axis; only X, Y and Z"),
            ("G0 X0 Y0\nG2 X1 I.5 K1", "line 2: The word K1 belongs to no arc in the XY plane"),
            ("G0 X0 Y0\nG2 X1 I.5 P9999", "line 2: An arc of 9999 turns; give 1 to 1,000."),
            ("G0 X0 Y0\nG90.1 G2 X1 I.5", "line 2: An arc with G90.1 needs both I and J."),
            ("G0 X0 Y0\nG28 X0\nG2 X1 R1", "line 3: A feed move from an unknown position, after"),
            ("G0 X0 Y0\nG53 G1 X1", "line 2: A feed move in the machine's coordinates (G53)"),
            ("G0 X0 Y0\nG1 X1\nG55 X2", "line 3: G55 in line 3 has moved the origin; keep one"),
            ("G0 X0 Y0\nG52 X5", "line 2: G52 moves the origin; give the coordinates without it."),
            ("G0 X0 Y0\nG91 G81 X1 Z-1 R1 L5000", "line 2: A cycle repeated 5000 times; at most"),
            ("G0 X1 Y1\nG81 Z-1 R1", "The program drills 1 hole and has no feed move in X or Y"),
            (
                "G0 X0 Y0\nG1 X1\nG0 Y5\nG1 X0",
                "There are 2 contours, and none encloses all others; choose by trajectory.contour "
                "(a number, or at_m: [x, y]). 1: open 1.000 mm from [0, 0]; 2: open 1.000 mm from "
                "[0.001, 0.005].",
            ),
            ("G0 X0 Y0\nM30", "The program has no feed move in X or Y; give the trajectory by"),
        ],
    )
    def test_what_cannot_be_placed_is_refused_by_its_line(self, tmp_path, text, message):
        assert refused(tmp_path, "a.nc", text).startswith(message)


class TestDxf:
    @pytest.mark.parametrize("add", ["add_lwpolyline", "add_polyline2d"])
    @pytest.mark.parametrize("up", [1, -1])
    def test_bulges_are_arcs_as_seen_from_above(self, tmp_path, add, up):
        """An entity that is drawn from below is mirrored."""

        def draw(space: Modelspace) -> None:
            corners = [(0, 0, 0), (1000, 0, 1), (1000, 500, 0), (0, 500, -0.5)]
            attributes = {"extrusion": (0, 0, up)}
            getattr(space, add)(corners, format="xyb", close=True, dxfattribs=attributes)

        d = read(tmp_path, "a.dxf", drawing(draw))
        line, arc, _, dent = d.elements
        assert d.closed
        assert line.end == pytest.approx((up * 1.0, 0))
        assert isinstance(arc, swarm.Arc)
        assert arc.through == pytest.approx((up * 1.25, 0.25))
        assert isinstance(dent, swarm.Arc)
        assert dent.through == pytest.approx((up * 0.125, 0.25))
        assert [place.split(", ")[1] for place in d.places] == [f"vertex {i}" for i in (2, 3, 4, 1)]

    def test_a_bulge_turns_by_four_times_its_arctangent(self, tmp_path):
        corners = [(0, 0, 0.3), (100, 0, 0)]
        d = read(
            tmp_path, "a.dxf", drawing(lambda space: space.add_lwpolyline(corners, format="xyb"))
        )
        (arc,) = d.elements
        assert isinstance(arc, swarm.Arc)
        assert swarm.circle_of(d.start, arc).sweep_rad == pytest.approx(4 * math.atan(0.3))

    @pytest.mark.parametrize(("units", "metre"), [(0, 1e-3), (1, 0.0254), (4, 1e-3), (6, 1.0)])
    def test_the_unit_is_that_of_the_header(self, tmp_path, units, metre):
        text = drawing(lambda space: space.add_line((0, 0), (2, 1)), units)
        assert read(tmp_path, "a.dxf", text).elements[0].end == pytest.approx((2 * metre, metre))

    def test_without_a_header_it_is_millimetres(self, tmp_path):
        text = (DATA / "slot.dxf").read_text("utf-8")
        bare = "  0\nSECTION\n  2\nENTITIES" + text.partition("ENTITIES")[2]
        slot = swarm.read_trajectory(DATA / "slot.dxf")
        assert read(tmp_path, "a.dxf", bare) == replace(slot, unit_assumed=True)

    def test_a_chain_runs_in_the_sense_of_its_first_entity(self, tmp_path):
        def draw(space: Modelspace) -> None:
            space.add_line((2, 0), (3, 0))
            space.add_line((3, 1), (3, 0))
            space.add_lwpolyline([(2, 0), (1, 0), (0, 1)])

        d = read(tmp_path, "a.dxf", drawing(draw, 6))
        assert d.start == (0, 1)
        assert [element.end for element in d.elements] == [(1, 0), (2, 0), (3, 0), (3, 1)]

    @pytest.mark.parametrize("degrees", [(0, 360), (30, 30)])
    def test_a_circle_is_two_arcs(self, tmp_path, degrees):
        text = drawing(lambda space: space.add_arc((1, 1), 0.5, *degrees), 6)
        d = read(tmp_path, "a.dxf", text)
        assert (d.closed, len(d.elements)) == (True, 2)
        assert length_m(d) == pytest.approx(math.pi, rel=1e-3)
        circle = read(tmp_path, "a.dxf", drawing(lambda space: space.add_circle((1, 1), 0.5), 6))
        assert (circle.closed, len(circle.elements)) == (True, 2)

    def test_splines_and_ellipses_are_followed_closely(self, tmp_path):
        corners = [(0, 0), (1, 2), (2, -1), (3, 1), (4, 0)]
        d = read(tmp_path, "a.dxf", drawing(lambda space: space.add_open_spline(corners), 6))
        (element,) = d.elements
        assert isinstance(element, swarm.Spline)
        on_curve = np.array([(p.x, p.y) for p in BSpline(corners).approximate(20_000)])
        for point in swarm.sample(d.start, element, 1e-6)[::20]:
            near = int(np.hypot(*(on_curve - point).T).argmin())
            a, b = on_curve[max(near - 1, 0)], on_curve[min(near + 1, len(on_curve) - 1)]
            off = np.cross(np.append(b - a, 0), np.append(point - a, 0))[2] / np.hypot(*(b - a))
            assert abs(off) < swarm.CURVE_TOLERANCE_M
        text = drawing(lambda space: space.add_ellipse((1, 1), (0.5, 0), 0.4), 6)
        d = read(tmp_path, "a.dxf", text)
        assert d.closed
        for x, y in swarm.sample(d.start, d.elements[0], 1e-6):
            assert ((x - 1) / 0.5) ** 2 + ((y - 1) / 0.2) ** 2 == pytest.approx(1, abs=1e-4)

    def test_a_spline_is_cut_at_its_corners(self, tmp_path):
        corners = [(0, 0), (1, 0), (1, 1), (2, 1)]
        text = drawing(lambda space: space.add_open_spline(corners, degree=1), 6)
        ends = [element.end for element in read(tmp_path, "a.dxf", text).elements]
        assert ends == [pytest.approx(corner) for corner in corners[1:]]

    def test_texts_and_what_is_switched_off_are_passed_over(self, tmp_path):
        document = ezdxf.new("R2000", units=6)
        document.layers.add("notes").off()
        space = document.modelspace()
        space.add_line((0, 0), (1, 0))
        space.add_text("cut here")
        space.add_line((5, 5), (6, 6), dxfattribs={"layer": "notes"})
        stream = io.StringIO()
        document.write(stream)
        assert read(tmp_path, "a.dxf", stream.getvalue()).elements == (swarm.Line((1, 0)),)

    @pytest.mark.parametrize(
        ("draw", "message"),
        [
            (
                lambda space: (space.add_line((0, 0), (1, 0)), space.add_line((0, 5), (1, 5))),
                "There are 2 contours, and none encloses all others; choose by trajectory.contour "
                "(a number, or at_m: [x, y]). 1: open 1000.000 mm from [0, 0]; 2: open",
            ),
            (
                lambda space: [space.add_line((0, 0), end) for end in ((1, 0), (0, 1), (-1, 0))],
                "There are 2 contours, and none encloses all others; ",
            ),
            (
                lambda space: [
                    space.add_line((0, 0), (1, i), dxfattribs={"layer": f"L{i}"}) for i in (0, 1)
                ],
                "There are contours on 2 layers; choose by trajectory.layer or trajectory.contour",
            ),
            (
                lambda space: space.add_blockref("B", (0, 0)),
                "The model space holds no path on a layer that is on (passed over: 1 INSERT "
                "without its block); draw one polyline",
            ),
            (
                lambda space: space.add_line((0, 0, 0), (1, 0, 1)),
                "The model space holds no path on a layer that is on (passed over: 1 LINE that "
                "leaves its plane); draw",
            ),
            (
                lambda space: space.add_circle((0, 0), 1, dxfattribs={"extrusion": (0, 1, 1)}),
                "The model space holds no path on a layer that is on (passed over: 1 tilted CIRCLE",
            ),
            (
                lambda space: space.add_circle((0, 0), 0),
                "The model space holds no path on a layer that is on (passed over: 1 CIRCLE of "
                "radius 0)",
            ),
            (lambda space: space.add_line((0, 0), (1e9, 0)), "LINE #2F: It leaves every bench"),
            (
                lambda space: space.add_lwpolyline([(0, 0)]),
                "The model space holds no path on a layer that is on (passed over: 1 polyline of "
                "1 vertex)",
            ),
            (
                lambda space: space.add_lwpolyline([(0, 0, 1e9), (1, 0, 0)], format="xyb"),
                "LWPOLYLINE #2F: It has a bulge of 1e+09; give an arc",
            ),
            (lambda space: space.add_spline(), "SPLINE #2F: It has 0 control points; give 2 to"),
            pytest.param(
                lambda space: space.add_open_spline([(0, 0), (9e5, 9e5), (0, 9e5), (9e5, 0)]),
                "SPLINE #2F: It needs more than 100000 points; draw it simpler, or smaller.",
                marks=pytest.mark.slow(reason="100,000 points; other entities in every run"),
            ),
            (lambda space: space.add_text("hi"), "The model space holds no path on a layer"),
        ],
    )
    def test_what_is_no_single_path_is_refused_by_its_entity(self, tmp_path, draw, message):
        assert refused(tmp_path, "a.dxf", drawing(draw, 6)).startswith(message)

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            (b"garbage", 'The drawing is damaged (Invalid group code "garbage" at line 1); save'),
            (b"\x00\x01\xfe" * 50, "The drawing is damaged ("),
            (b"AutoCAD Binary DXF\r\n\x1a\x00", "The drawing is damaged ("),
            (b"AC1032\x00\x00", "This is a DWG file despite its name; save it as ASCII DXF."),
            (b"  0\nEOF\n", "The model space holds no path on a layer that is on"),
        ],
    )
    def test_what_is_no_drawing(self, tmp_path, content, message):
        assert refused(tmp_path, "a.dxf", content).startswith(message)

    def test_a_drawing_cut_short(self, tmp_path):
        whole = (DATA / "slot.dxf").read_bytes()
        assert "damaged" in refused(tmp_path, "a.dxf", whole[: len(whole) // 2])

    def test_an_entity_without_its_measures(self, tmp_path):
        text = (DATA / "slot.dxf").read_text("utf-8").replace(" 11\n1500.0\n 21\n300.0\n", "")
        assert refused(tmp_path, "a.dxf", text) == "LINE #1A: It lacks its end; draw it again."

    def test_a_unit_that_no_bench_has(self, tmp_path):
        text = drawing(lambda space: space.add_line((0, 0), (1, 0)), 19)
        assert refused(tmp_path, "a.dxf", text).startswith("$INSUNITS: The unit 19 is not read")

    @pytest.mark.slow(reason="a process; other starts that load less in every run")
    def test_ezdxf_is_loaded_for_drawings_only(self):
        code = (
            "import sys; from pathlib import Path; "
            "from skillplan_swarmitfix.trajectory.files import read_trajectory as r; "
            f"r(Path({str(DATA / 'slot.nc')!r})); r(Path({str(DATA / 'pentagon.csv')!r})); "
            "print('ezdxf' in sys.modules)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert (done.stdout, done.stderr) == ("False\n", "")


class TestTrajectoryPath:
    def test_it_has_an_element(self):
        with pytest.raises(ValueError, match="needs an element"):
            swarm.TrajectoryPath((0, 0), (), False, ())

    def test_each_element_has_a_place(self):
        with pytest.raises(ValueError, match="0 places for 1 elements"):
            swarm.TrajectoryPath((0, 0), (swarm.Line((1, 0)),), False, ())
