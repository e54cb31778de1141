"""Contours of programs and drawings as users have them: leads, passes, layers, blocks, gaps."""

from __future__ import annotations

import io
import itertools
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import pytest
from ezdxf.document import Drawing
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_swarmitfix as swarm
from example_count import examples
from skillplan.errors import TaskError
from skillplan.pipeline import load_problem

SQUARE = "G1 X100\nG1 Y100\nG1 X0\nG1 Y0\n"
START = "G21 G90\nG0 X0 Y0\nG1 Z-1\n"


def program(text: str, name: str = "a.nc", unit: Any = "mm") -> swarm.FileContours:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text, "utf-8")
        return swarm.read_contours(path, unit)


def drawing(
    draw: Callable[[Drawing], Any], units: int = 4, edit: Callable[[str], str] = str, **keys: Any
) -> swarm.FileContours:
    document = ezdxf.new("R2000", units=units)
    draw(document)
    stream = io.StringIO()
    document.write(stream)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.dxf"
        path.write_text(edit(stream.getvalue()), "utf-8")
        return swarm.read_contours(path, **keys)


def only(contours: swarm.FileContours) -> swarm.TrajectoryPath:
    assert len(contours.contours) == 1
    return contours.choose()


def lengths(contours: swarm.FileContours) -> list[float]:
    """Return the length of every contour, in millimetres."""
    return [round(contour.length_m * 1e3, 3) for contour in contours.contours]


class TestMovesAroundAContour:
    def test_lead_in_overcut_and_lead_out_are_told_with_their_lengths(self):
        path = only(
            program(
                "G21 G90\nG0 X50 Y-20\nG1 Z-1\nG1 Y0\nX100\nY100\nX0\nY0\nX50\nX53\n"
                "G2 X63 Y-10 I0 J-10\n"
            )
        )
        assert path.closed
        assert path.length_m == pytest.approx(0.4)
        out = 5 * math.pi
        assert path.notes == (
            f"left out: lead-in 20.000, overcut 3.000, lead-out {out:.3f} mm; "
            f"{423 + out:.3f} mm with them",
        )

    def test_a_hole_cut_from_its_middle_is_the_circle(self):
        path = only(program("G0 X0 Y0\nG1 Z-1\nG1 X10\nG3 X10 Y0 I-10 J0\nG1 X0\n"))
        assert path.closed
        assert path.length_m == pytest.approx(math.tau * 0.01)

    def test_passes_at_several_depths_are_one_contour(self):
        deeper = "".join(f"G1 Z-{depth}\n{SQUARE}" for depth in (1, 2, 3))
        path = only(program(f"G0 X0 Y0\n{deeper}"))
        assert path.length_m == pytest.approx(0.4)
        assert path.notes == (
            "3 passes at Z -1.000, -2.000, -3.000 mm are one contour; 1200.000 mm in all",
        )

    def test_a_slot_cut_to_and_fro_is_one_line(self):
        path = only(program("G0 X0 Y0\nG1 Z-1\nX50\nG1 Z-2\nX0\nG1 Z-3\nX50\n"))
        assert not path.closed
        assert path.length_m == pytest.approx(0.05)
        assert "3 passes" in path.notes[0]

    def test_a_slot_cut_to_and_fro_an_even_number_of_times_is_one_line_too(self):
        path = only(program("G0 X0 Y0\nG1 Z-1\n" + "X50\nX0\n" * 4))
        assert not path.closed
        assert path.length_m == pytest.approx(0.05)
        assert path.notes == ("8 passes at Z -1.000 mm are one contour; 400.000 mm in all",)

    def test_a_pass_may_begin_elsewhere_and_run_the_other_way_round(self):
        other = "G0 Z5\nG0 X100 Y0\nG1 Z-2\nX0\nY100\nX100\nY0\n"
        assert "2 passes" in only(program(START + SQUARE + other)).notes[0]

    def test_turns_of_a_helix_lead_to_the_circle_at_its_depth(self):
        turn = "G3 X10 Y0 I-10 J0"
        path = only(program(f"G0 X10 Y0 Z0\n{turn} Z-1\n{turn} Z-2\n{turn}\n"))
        assert path.length_m == pytest.approx(math.tau * 0.01)
        assert path.notes[0].startswith("left out: 2 turns down from Z 0.000 to -2.000 mm;")

    def test_holding_tabs_do_not_split_a_pass(self):
        tabs = "G1 X40\nG1 Z-0.5\nG1 X60\nG1 Z-2\nG1 X100\nY100\nX0\nY0\n"
        path = only(program(f"{START}{SQUARE}G1 Z-2\n{tabs}"))
        assert path.length_m == pytest.approx(0.4)
        assert "2 passes" in path.notes[0]

    @pytest.mark.parametrize(
        ("first", "last", "leads"),
        [
            ("X-20 Y0", "Y0", "lead-in 20.000 mm; 420.000"),
            ("X0 Y0", "Y-10", "lead-out 10.000 mm; 410.000"),
            ("X-20 Y0", "Y-10", "lead-in 20.000, lead-out 10.000 mm; 430.000"),
        ],
    )
    def test_a_lead_in_line_with_an_edge_is_no_part_of_it(self, first, last, leads):
        """Also in two passes, one below the other."""
        around = f"G1 X100\nY100\nX0\n{last}\n"
        one = only(program(f"G0 {first}\nG1 Z-1\n{around}"))
        assert one.closed
        assert one.length_m == pytest.approx(0.4)
        assert one.notes == (f"left out: {leads} mm with them",)
        two = only(program(f"G0 {first}\nG1 Z-1\n{around}G0 Z5\nG0 {first}\nG1 Z-2\n{around}"))
        assert two.length_m == pytest.approx(0.4)
        assert "2 passes" in two.notes[-1]

    def test_an_eight_with_a_point_at_its_crossing_is_one_contour(self):
        eight = "X10 Y10\nX20 Y0\nX20 Y20\nX10 Y10\nX0 Y20\nX0 Y0\n"
        path = only(program(f"{START}G1 {eight}"))
        assert path.closed
        assert path.length_m == pytest.approx(0.04 + 4 * math.hypot(0.01, 0.01))

    def test_an_open_path_that_touches_itself_stays_whole(self):
        letter = "G0 X0 Y0\nG1 Z-1\nG1 Y50\nY60\nX10\nY50\nX0\n"
        path = only(program(letter))
        assert not path.closed
        assert path.length_m == pytest.approx(0.09)


class TestMovesThatDoNotCut:
    AIR = "G1 Z5\nG1 X0 Y0\nG1 Z-1\nG1 X50\nG1 Z5\nG1 X50 Y40\nG1 Z-1\nG1 X0\nG1 Z5\nG1 X0 Y0\n"

    def test_feed_moves_above_the_cut_are_told_with_both_heights(self):
        cuts = program(self.AIR)
        assert lengths(cuts) == [50, 50]
        assert cuts.notes == (
            "left out: 80.000 mm fed above the cut, at Z 5.000 mm; the cut is at Z -1.000 mm",
        )

    def test_on_a_plate_whose_bottom_is_zero_passes_above_zero_cut(self):
        text = "G0 Z20\nG0 X-50 Y0\nG0 X0 Y0\n" + "".join(
            f"G1 Z{height}\n{SQUARE}" for height in (4, 2, 0)
        )
        assert "3 passes at Z 4.000, 2.000, 0.000 mm" in only(program(text)).notes[0]

    def test_a_laser_that_is_off_does_not_cut(self):
        path = only(program("G0 X0 Y0\nM3 S0\nG1 X10 S0\nX60 S500\nX70 S0\n"))
        assert path.length_m == pytest.approx(0.05)
        assert path.notes == ("left out: 20.000 mm fed with the tool off (M5 or S0)",)

    def test_motion_after_the_last_cut_does_not_matter(self):
        footer = "G0 Z50\nG91 G28 Z0\nG91 G28 X0 Y0\nG90 G53 G0 X0 Y0\nM30\nG1 X900 Y900\n"
        assert only(program(START + SQUARE + footer)).length_m == pytest.approx(0.4)

    def test_drilled_holes_are_points(self):
        drilled = "G99 G81 X10 Y10 Z-4 R2\nX90\nY90\nG80\nG0 X0 Y0\nG1 Z-1\n"
        path = only(program(f"G21 G90\nG0 X10 Y10\n{drilled}{SQUARE}"))
        assert path.holes == ((0.01, 0.01), (0.09, 0.01), (0.09, 0.09))
        assert path.notes == ("3 holes drilled at (10, 10), (90, 10), (90, 90) mm",)
        rows = program(f"G21 G90\nG0 X0 Y0\nG91 G81 X5 Z-1 R1 L3\nG80 G90 G0 X0 Y0\n{SQUARE}")
        assert rows.holes == ((0.005, 0), (0.01, 0), (0.015, 0))


class TestSubprograms:
    """A square, in a subprogram of the same file."""

    @pytest.mark.parametrize(
        "text",
        [
            f"{START}M98 P2000\nM30\nO2000\n{SQUARE}M99\n",
            f"{START}M97 P50\nM30\nN50 {SQUARE}M99\n",
            f"o100 sub\n{SQUARE}o100 endsub\n{START}o100 call\nM2\n",
        ],
    )
    def test_a_call_is_followed(self, text):
        path = only(program(text))
        assert path.length_m == pytest.approx(0.4)
        assert path.notes == ()
        assert ", called in line " in path.places[0]

    @pytest.mark.parametrize("call", ["P2000 L3", "P0032000"])
    def test_a_call_may_repeat(self, call):
        deeper = f"G91 G1 Z-1\nG90\n{SQUARE}M99\n"
        path = only(program(f"G90\nG0 X0 Y0 Z0\nM98 {call}\nM30\nO2000\n{deeper}"))
        assert "3 passes at Z -1.000, -2.000, -3.000 mm" in path.notes[0]

    def test_a_program_that_nothing_calls_is_told(self):
        assert only(program(f"{START}{SQUARE}M30\nO7\nG1 X5\nM99\n")).notes == (
            "passed over: O7 (line 9), which nothing calls",
        )


# A plate of 400 x 240 mm with corners of 30 mm, and a hole drilled beside it.
PLATE_MM = 2 * (340 + 180) + math.tau * 30
SIEMENS = """\
N10 G71 G90 G17 G54 G64 SOFT
N20 T="MILL 8" D1
N30 MSG("plate (outside)") ; AR=3
N40 MCALL CYCLE81(10,0,2,-20)
N50 G0 X-40 Y-40
N60 MCALL
N70 G0 X200 Y0 Z10
N80 CONTOUR P2
N90 M30
%_N_CONTOUR_SPF
G91 G1 Z-6 F=200
G90
X=370
G3 X400 Y30 CR=30
G1 Y=IC(180)
G3 X370 Y240 I=AC(370) J=AC(210)
G1 X30
G3 X0 Y210 I0 J-30
G1 Y30
G3 X30 Y0 CR=30
G1 X200
M17
"""
HEIDENHAIN = """\
0 BEGIN PGM PLATE MM
1 BLK FORM 0.1 Z X+0 Y+0 Z-20
2 TOOL CALL 5 Z S3000
3 CYCL DEF 200 DRILLING ~
    Q200=+2 ;SET-UP CLEARANCE ~
    Q201=-20 ;DEPTH
4 L X-40 Y-40 R0 FMAX M99
5 L X+200 Y-20 Z+10 FMAX
6 CALL LBL 1
7 CALL LBL 1
8 M30
9 LBL 1
10 L Z-5 F200
11 APPR LT X+200 Y+0 LEN20 R0
12 L X+370
13 CC X+370 Y+30
14 C X+400 Y+30 DR+
15 L IY+180
16 CT X+370 Y+240
17 L X+30
18 CR X+0 Y+210 R+30 DR+
19 L Y+30
20 CC X+30 Y+30
21 CP PA+270 DR+
22 L X+200
23 DEP LT LEN20
24 LBL 0
25 END PGM PLATE MM
"""


class TestOtherControllers:
    @pytest.mark.parametrize(
        ("name", "text", "told"),
        [
            ("plate.mpf", SIEMENS, "2 passes at Z 4.000, -2.000 mm"),
            ("plate.h", HEIDENHAIN, "passed over: APPR LT, DEP LT; 2 passes at Z -5.000 mm"),
        ],
    )
    def test_a_plate_with_rounded_corners(self, name, text, told):
        """Subprogram, steps from the last point, arcs by radius, tangent and angle; a hole."""
        path = only(program(text, name, unit=None))
        assert path.closed
        assert path.length_m * 1e3 == pytest.approx(PLATE_MM)
        assert path.holes == ((-0.04, -0.04),)
        assert told in "; ".join(path.notes)
        assert not path.unit_assumed
        in_inches = text.replace("G71", "G70").replace("PLATE MM", "PLATE INCH")
        assert lengths(program(in_inches, name, unit=None)) == [
            pytest.approx(PLATE_MM * 25.4, abs=1e-3)
        ]

    @pytest.mark.parametrize(
        ("name", "text"),
        [
            ("a.nc", "G21\nG0X50Y0\nG1Z-1\nX100,R10\nY100,C10\nX0,R10\nY0,R10\nX50\n"),
            (
                "a.mpf",
                "G71\nG0 X50 Y0\nG1 Z-1\nX100 RND=10\nY100 CHR=10\nX0 RND=10\nY0 RND=10\nX50\n",
            ),
            (
                "a.h",
                "N1 BEGIN PGM A MM\nN2 FN 0: Q2=75\nL X50 Y0 FMAX\nL Z-1 F Q2\nL X100\nRND R10\n"
                "L Y100\nCHF 10\nL X0\nRND R10\nL Y0\nRND R10\nL X50\nM30\n",
            ),
        ],
    )
    def test_corners_are_rounded_and_cut_off(self, name, text):
        (length_mm,) = lengths(program(text, name, unit=None))
        assert length_mm == pytest.approx(400 - 80 + 15 * math.pi + 10 * math.sqrt(2), abs=1e-3)

    def test_an_origin_that_moves_before_the_cut_is_told(self):
        line = "G71\nTRANS X=10 Y=0\nG0 X=0 Y=0\nG1 X=50\n"
        assert only(program(line, "a.mpf")).notes == ("passed over: TRANS X=10 Y=0",)

    @pytest.mark.parametrize(
        ("name", "line", "message"),
        [
            ("a.mpf", "ROT Z=30", "line 3: 'ROT Z=30' turns the plane; write the moves out."),
            ("a.mpf", "G1 X=R1", "line 3: 'G1 X=R1' is computed by the controller"),
            ("a.mpf", "R1=5", "line 3: 'R1=5' is computed by the controller"),
            ("a.mpf", "G1 X10 RNDM=5", "line 3: RNDM is not read here; give corners and arcs by"),
            (
                "a.mpf",
                "G1 Y5 RND=9\nX0",
                "line 4: A corner of 9 mm is larger than its sides of 5 and",
            ),
            ("a.mpf", "POCKET3(1,2)", "line 3: It calls POCKET3, which is not in this file."),
            ("a.mpf", "TRANS X=5\nX20", "line 4: TRANS X=5 in line 3 has moved the origin"),
            ("a.h", "L X+Q1", "line 4: Cannot read 'X+Q1'; write a letter and a number."),
            ("a.h", "FN 9: IF Q1 EQU 5 GOTO LBL 1", "line 4: 'FN 9: IF Q1 EQU 5 GOTO LBL 1' is"),
            ("a.h", "C X+5 Y+5 DR+", "line 4: An arc before any CC; give its centre."),
            ("a.h", "CALL LBL 7", "line 4: It calls LBL 7, which is not in this file"),
            ("a.h", "CYCL DEF 10.1 ROT+30", "line 4: 'CYCL DEF 10.1 ROT+30' turns the plane"),
            ("a.h", "CYCL DEF 251 POCKET\nCYCL CALL", "line 5: Cycle 251 mills what the"),
        ],
    )
    def test_lines_that_only_the_controller_can_compute_are_refused(self, name, line, message):
        start = (
            "G0 X0 Y0\nG1 X5\n" if name == "a.mpf" else "BEGIN PGM A MM\nL X+0 Y+0 FMAX\nL X+5 F9\n"
        )
        with pytest.raises(swarm.TrajectoryFileError) as refusal:
            program(f"{start}{line}\n", name)
        assert f"{refusal.value.place}: {refusal.value.message}".startswith(message)


class TestWords:
    def test_without_a_unit_millimetres_are_assumed_and_told_once(self):
        line = "G0 X0 Y0\nG1 X10\n"
        assert only(program(line, unit=None)).notes == (
            "lengths are read in mm, as there is no G20 or G21",
        )
        assert only(program(f"G21 {line}", unit=None)).notes == ()

    def test_words_without_motion_are_passed_over_and_listed_once(self):
        idle = "G15 G69 G97 M48\nG0 A0\n/M8\nG5.1 Q1\nM107\nM107\n$H\nM117 done at 100%\n"
        path = only(program(idle + START + SQUARE))
        assert path.notes == ("passed over: G15, G69, G97, M48, A0, /M8, G5.1 Q1, M107",)

    def test_tool_radius_compensation_is_told(self):
        (note,) = only(program(f"{START}G41 D1\n{SQUARE}G40\n")).notes
        assert note.startswith("line 4: G41 D1: the path is the edge as programmed")

    def test_comments_may_be_nested_or_open(self):
        text = "(cut (plate); M98)\nG0 X0 Y0 (start\nG1 (to) X10 (the (right)) ; end\n"
        assert lengths(program(text)) == [10]

    def test_a_feed_move_from_the_reference_leads_the_tool_to_a_known_position(self):
        """Homed in X, as Marlin writes it; only X is given then."""
        cut = "G1 Z-1\nG1 X50 Y0\nG1 Z5\n"
        text = f"G21 G90\nG0 X0 Y0\n{cut}G28 X\nG1 X0\n{cut}"
        assert "2 passes" in only(program(text)).notes[0]

    def test_zero_k_belongs_to_no_arc_and_does_no_harm(self):
        assert lengths(program("G0 X0 Y0\nG2 X10 I5 K0\n")) == [round(5 * math.pi, 3)]

    def test_a_long_program_reports_its_progress(self, monkeypatch, capsys):
        monkeypatch.setattr("skillplan_swarmitfix.trajectory.path.PROGRESS_S", 0.0)
        program(START + SQUARE * 300)
        assert "skillplan: reading a.nc: line 1,000 of 1,204\n" in capsys.readouterr().err

    def test_g92_sets_coordinates(self):
        moved = program("G0 X10 Y10\nG92 X0 Y0\nG1 X30\nG92.1\nG1 Y40\n")
        assert [e.end for e in only(moved).elements] == [
            pytest.approx((0.04, 0.01)),
            pytest.approx((0.04, 0.04)),
        ]

    def test_a_program_without_a_first_position_starts_at_zero_and_says_so(self):
        path = only(program("G91\nG1 X10\nG1 Y10\n"))
        assert path.start == (0, 0)
        assert path.notes == ("line 2: the start is taken to be X0 Y0",)

    def test_an_upright_arc_is_a_line_in_plan(self):
        path = only(program("G0 X0 Y0 Z1\nG18 G3 X1 Z0 I0 K1\nG17 G1 X50\n"))
        assert path.length_m == pytest.approx(0.05)
        assert "upright arcs (G18, G19) read as lines in plan: 1" in path.notes

    def test_a_p_word_repeats_the_turn(self):
        path = only(program("G0 X10 Y0\nG1 Z-1\nG3 X10 Y0 I-10 J0 P3\n"))
        assert path.length_m == pytest.approx(math.tau * 0.01)

    @given(
        st.floats(5, 400),
        st.floats(0.1, 3.0),
        st.floats(0, math.tau),
        st.sampled_from(["G2", "G3"]),
    )
    def test_an_arc_by_its_radius_is_that_by_its_centre(self, radius, sweep, first, code):
        """By G91.1 and by G90.1."""
        sense = 1 if code == "G3" else -1
        (ax, ay), (bx, by) = (
            (radius * math.cos(w), radius * math.sin(w)) for w in (first, first + sense * sweep)
        )
        lines = [
            f"{code} X{bx:.6f} Y{by:.6f} R{radius:.6f}",
            f"{code} X{bx:.6f} Y{by:.6f} I{-ax:.6f} J{-ay:.6f}",
            f"G90.1 {code} X{bx:.6f} Y{by:.6f} I0 J0",
        ]
        for line in lines:
            (length_mm,) = lengths(program(f"G21 G90\nG0 X{ax:.6f} Y{ay:.6f}\n{line}\n"))
            assert length_mm == pytest.approx(radius * sweep, rel=1e-4, abs=2e-3)


corners = st.lists(st.tuples(st.integers(1, 40), st.floats(0.1, 0.9)), min_size=3, max_size=8)


class TestWhatALengthDoesNotDependOn:
    """A star-shaped polygon about the origin, so that it never crosses itself."""

    @staticmethod
    def points(shape: list[tuple[int, float]]) -> list[tuple[float, float]]:
        angles = [math.tau * (i + share) / len(shape) for i, (_, share) in enumerate(shape)]
        return [
            (radius * 10 * math.cos(w), radius * 10 * math.sin(w))
            for (radius, _), w in zip(shape, angles, strict=True)
        ]

    @staticmethod
    def perimeter(points: list[tuple[float, float]]) -> float:
        return sum(map(math.dist, points, [*points[1:], points[0]]))

    @settings(max_examples=examples(20))
    @given(corners, st.integers(1, 4), st.floats(0, math.tau), st.booleans(), st.integers(0, 7))
    def test_a_program(self, shape, parts, turn, in_inches, first):
        """Rotation, unit, how often sides are split, where the tool begins."""
        points = [
            (x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn))
            for x, y in self.points(shape)
        ]
        first %= len(points)
        points = points[first:] + points[:first]
        unit = 25.4 if in_inches else 1.0
        lines = ["G20" if in_inches else "G21", "G90"]
        for i, (x, y) in enumerate(points):
            bx, by = points[(i + 1) % len(points)]
            if i == 0:
                lines.append(f"G0 X{x / unit:.7f} Y{y / unit:.7f}\nG1 Z-1")
            for k in range(1, parts + 1):
                px, py = x + (bx - x) * k / parts, y + (by - y) * k / parts
                lines.append(f"G1 X{px / unit:.7f} Y{py / unit:.7f}")
        path = only(program("\n".join(lines)))
        assert path.closed
        assert path.length_m * 1e3 == pytest.approx(self.perimeter(points), abs=1e-2)

    @settings(max_examples=examples(15))
    @given(corners, st.randoms(use_true_random=False), st.lists(st.booleans(), min_size=8))
    def test_a_drawing(self, shape, random, flips):
        """The order of its lines, and the sense of each."""
        points = self.points(shape)
        sides = list(zip(points, [*points[1:], points[0]], strict=True))
        random.shuffle(sides)

        def draw(document: Drawing) -> None:
            for (a, b), flip in zip(sides, flips * 2, strict=False):
                document.modelspace().add_line(b if flip else a, a if flip else b)

        path = only(drawing(draw))
        assert path.closed
        assert path.length_m * 1e3 == pytest.approx(self.perimeter(points), abs=1e-3)


class TestDrawings:
    def test_damaged_entities_are_passed_over_and_named(self):
        """A scale of 0 across the plane is no damage."""

        def draw(document: Drawing) -> None:
            square = [(0, 0), (30, 0), (30, 10), (0, 10)]
            document.blocks.new("B").add_lwpolyline(square, close=True)
            space = document.modelspace()
            for key in ("xscale", "zscale"):
                space.add_blockref("B", (0, 0), dxfattribs={key: 7.25})
            spline = space.add_open_spline([(0, 0), (5, 5), (9, 0), (20, 0)])
            spline.knots = [0, 1]
            spline.dxf.handle = "7A"

        path = only(drawing(draw, edit=lambda text: text.replace("\n7.25\n", "\n0.0\n")))
        assert path.length_m == pytest.approx(0.08)
        assert "passed over: 1 damaged SPLINE #7A, 1 INSERT of scale 0" in path.notes

    def test_a_width_and_a_curve_by_fit_points_are_told(self):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            wide = [(0, 0, 3, 5), (50, 0, 0, 0), (50, 40, 0, 0)]
            space.add_lwpolyline(wide, format="xyse")
            space.add_spline(fit_points=[(50, 40), (20, 60), (0, 0)])

        assert only(drawing(draw)).notes == (
            "1 polyline up to 5.000 mm wide: its centre line is read",
            "1 spline without control points: a cubic through the fit points is read, from which "
            "the CAD's own curve may differ",
        )

    def test_blocks_are_exploded_with_their_bulges(self):
        """Turned, scaled, nested and mirrored; the entities of layer 0 take the block's layer."""

        def draw(document: Drawing) -> None:
            half = document.blocks.new("HALF")
            half.add_lwpolyline([(0, 0, 0), (50, 0, 0.5), (50, 40, 0), (0, 40, 0)], format="xyb")
            both = document.blocks.new("BOTH")
            both.add_blockref("HALF", (0, 0))
            both.add_blockref("HALF", (0, 0), dxfattribs={"xscale": -1})
            document.modelspace().add_blockref(
                "BOTH",
                (300, 100),
                dxfattribs={"rotation": 30, "xscale": 2, "yscale": 2, "layer": "CUT"},
            )

        path = only(drawing(draw))
        angle = 4 * math.atan(0.5)
        arc = angle * 20 / math.sin(angle / 2)
        assert path.closed
        assert path.layer == "CUT"
        assert path.length_m * 1e3 == pytest.approx(2 * (200 + 2 * arc))
        assert path.extent_m[0] > 0.2

    def test_blocks_that_nest_or_repeat_without_end_are_refused(self, monkeypatch):
        def nest(document: Drawing) -> None:
            for depth in range(20):
                block = document.blocks.new(f"B{depth}")
                block.add_line((0, 0), (1, 0))
                if depth:
                    block.add_blockref(f"B{depth - 1}", (0, 0))
            document.modelspace().add_blockref("B19", (0, 0))

        def repeat(document: Drawing) -> None:
            document.blocks.new("B").add_line((0, 0), (1, 0))
            document.modelspace().add_blockref(
                "B",
                (0, 0),
                dxfattribs={
                    "column_count": 9_999,
                    "row_count": 9_999,
                    "column_spacing": 1,
                    "row_spacing": 1,
                },
            )

        def laugh(document: Drawing) -> None:
            for depth in range(8):
                block = document.blocks.new(f"B{depth}")
                for _ in range(10):
                    if depth:
                        block.add_blockref(f"B{depth - 1}", (0, 0))
            document.modelspace().add_blockref("B7", (0, 0))

        with pytest.raises(swarm.TrajectoryFileError, match=r"INSERT .*nested more than 16 deep"):
            drawing(nest)
        with pytest.raises(swarm.TrajectoryFileError, match="repeats its block 99,980,001 times"):
            drawing(repeat)
        # Of a million; the limit of 100,000 takes seconds.
        monkeypatch.setattr("skillplan_swarmitfix.trajectory.dxf_entities.MOST_ENTITIES", 5_000)
        with pytest.raises(swarm.TrajectoryFileError, match="more than 5,000 entities"):
            drawing(laugh)

    def test_gaps_of_hundredths_are_shut_and_told(self):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            space.add_line((0, 0), (100, 0))
            space.add_line((100.03, 0), (100, 50))
            space.add_line((100, 50), (0.02, 0.02))

        path = only(drawing(draw))
        assert path.closed
        assert path.notes == ("2 gaps of up to 0.030 mm shut",)

    def test_elements_drawn_twice_are_dropped_and_counted(self):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            space.add_line((0, 0), (100, 0))
            space.add_line((100, 0), (50, 0))
            space.add_arc((50, 0), 50, 0, 180)
            space.add_arc((50, 0), 50, 30, 120)
            space.add_circle((50, 20), 5)
            space.add_circle((50, 20), 5)

        contours = drawing(draw)
        assert lengths(contours) == [round(100 + 50 * math.pi, 3), round(10 * math.pi, 3)]
        assert contours.notes == ("dropped: 4 elements on top of others",)

    def test_lines_as_short_as_the_tolerance_are_no_doubles(self):
        """A circle of 0.1 mm in 100 lines, as maps in degrees hold them."""
        ring = [
            (0.05 * math.cos(w), 0.05 * math.sin(w))
            for w in (math.tau * i / 100 for i in range(101))
        ]

        def draw(document: Drawing) -> None:
            for a, b in itertools.pairwise(ring):
                document.modelspace().add_line(a, b)

        contours = drawing(draw)
        assert not any("dropped" in note for note in contours.notes)

    def test_a_periodic_spline_is_drawn_over_its_domain_only(self):
        ring = [
            (50 * math.cos(w), 50 * math.sin(w)) for w in (math.tau * i / 12 for i in range(12))
        ]

        def draw(document: Drawing) -> None:
            spline = document.modelspace().add_spline()
            spline.set_uniform([*ring, *ring[:3]], degree=3)

        path = only(drawing(draw))
        assert path.closed
        # The curve lies a little within its control points.
        assert path.extent_m == pytest.approx((0.0955, 0.0955), abs=1e-3)
        assert path.length_m == pytest.approx(math.pi * 0.0955, rel=1e-3)

    def test_entities_that_draw_no_path_are_passed_over_and_counted(self):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            space.add_circle((0, 0), 10)
            space.add_hatch()
            space.add_text("cut")
            space.add_line((0, 0, 0), (0, 0, 50))
            space.add_line((90, 90), (91, 91), dxfattribs={"layer": "DEFPOINTS"})

        note, hidden = only(drawing(draw)).notes
        assert note.startswith("passed over: 1 ")
        assert hidden == "passed over: 1 entity on layers that are off, frozen or not plotted"
        for kind in ("1 HATCH", "1 TEXT", "1 LINE that leaves its plane"):
            assert kind in note

    def test_the_path_goes_straight_on_at_a_fork(self):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            space.add_line((0, 50), (50, 50))
            space.add_lwpolyline([(50, 0), (50, 100), (100, 100), (100, 0)], close=True)
            space.add_line((50, 50), (50, 50.00001))

        contours = drawing(draw)
        assert contours.contours[1].closed

    def test_feet_and_inches_in_the_header_mean_inches(self):
        def draw(document: Drawing, linear: int) -> None:
            document.header["$MEASUREMENT"] = 0
            document.header["$LUNITS"] = linear
            document.modelspace().add_line((0, 0), (10, 0))

        inches = only(drawing(lambda document: draw(document, 4), units=0))
        assert inches.length_m == pytest.approx(0.254)
        assert "inches" in inches.notes[0]
        doubted = only(drawing(lambda document: draw(document, 2), units=0))
        assert doubted.length_m == pytest.approx(0.010)
        assert "English settings" in doubted.notes[0]

    def test_a_binary_drawing_is_that_of_its_text(self, tmp_path):
        document = ezdxf.new("R2000", units=4)
        document.modelspace().add_circle((0, 0), 10)
        document.saveas(tmp_path / "a.dxf", fmt="bin")
        assert (tmp_path / "a.dxf").read_bytes().startswith(b"AutoCAD Binary DXF")
        assert swarm.read_trajectory(tmp_path / "a.dxf").length_m == pytest.approx(math.tau * 0.01)


PLATE = (
    "G21 G90\nG0 X30 Y30\nG1 Z-1\nG3 X30 Y30 I10 J0\nG0 Z5\nG0 X200 Y100\nG1 Z-1\n"
    "G3 X200 Y100 I-15 J0\nG0 Z5\nG0 X0 Y0\nG1 Z-1\nX300\nY200\nX0\nY0\n"
)
TASK = """kind: swarmitfix
name: chosen
heads: {max_gap_m: 0.2, step_m: 0.04}
trajectory: {file: plate.nc, offset_m: [1.0, 0.8], rotate_deg: 90ROTATED}
"""


class TestTheChoice:
    def load(self, folder: Path, keys: str = "") -> swarm.Job:
        (folder / "plate.nc").write_text(PLATE, "ascii")
        (folder / "task.yaml").write_text(TASK.replace("ROTATED", keys), "utf-8")
        config: Any = load_problem(folder / "task.yaml").config
        return swarm.Job(config)

    def test_is_the_outermost_contour_if_nothing_is_said(self, tmp_path):
        job = self.load(tmp_path)
        assert job.workpiece.length_m == pytest.approx(1.0)
        assert job.trajectory_notes == [
            "contour 3 of 3, which encloses the others: 1: closed 62.832 mm from [0.97, 0.83]; "
            "2: closed 94.248 mm from [0.9, 1]"
        ]
        assert self.load(tmp_path, ", contour: outer").workpiece.length_m == pytest.approx(1.0)

    def test_is_a_number_or_the_nearest_one_to_a_point_of_the_bench(self, tmp_path):
        second = self.load(tmp_path, ", contour: 2")
        assert second.workpiece.length_m == pytest.approx(math.tau * 0.015)
        near = self.load(tmp_path, ", contour: {at_m: [0.9, 0.99]}")
        assert near.workpiece.length_m == second.workpiece.length_m
        assert near.trajectory_notes == ["contour 2 of 3"]

    @pytest.mark.parametrize(
        ("keys", "message"),
        [
            (", contour: 4", "there is no contour 4; choose by trajectory.contour"),
            (", contour: inner", "trajectory.contour"),
            (", layer: CUT", "only drawings have layers; leave trajectory.layer out."),
        ],
    )
    def test_of_what_is_not_there_is_refused(self, tmp_path, keys, message):
        with pytest.raises(TaskError) as caught:
            self.load(tmp_path, keys)
        assert message in str(caught.value)

    @pytest.mark.parametrize(
        ("outline", "inner", "is_plain"),
        [
            ([(0, 0), (90, 0), (90, 60), (40, 80), (0, 60)], [(30, 30, 5), (60, 30, 5)], True),
            ([(0, 0), (90, 0), (90, 60), (40, 80), (0, 60)], [(30, 30, 9), (30, 30, 5)], False),
            ([(0, 0), (90, 0), (90, 60), (0, 60)], [(30, 30, 5), (60, 30, 5)], False),
        ],
    )
    def test_over_layers_is_the_part_with_its_holes_but_not_a_frame(self, outline, inner, is_plain):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            space.add_lwpolyline(outline, close=True, dxfattribs={"layer": "OUTLINE"})
            for x, y, radius in inner:
                space.add_circle((x, y), radius, dxfattribs={"layer": "HOLES"})

        contours = drawing(draw)
        if is_plain:
            assert contours.choose().layer == "OUTLINE"
        else:
            with pytest.raises(swarm.TrajectoryFileError, match="There are contours on 2 layers"):
                contours.choose()

    def test_may_be_a_layer(self):
        def draw(document: Drawing) -> None:
            space = document.modelspace()
            space.add_circle((0, 0), 10, dxfattribs={"layer": "Cut"})
            space.add_line((0, 0), (5, 0), dxfattribs={"layer": "BEND"})

        assert lengths(drawing(draw, layer="cut")) == [round(20 * math.pi, 3)]
        with pytest.raises(
            swarm.TrajectoryFileError, match="No layer 'X' is drawn on; give one of 'Cut'"
        ):
            drawing(draw, layer="X")

    def test_does_not_change_the_hash_of_a_task(self, tmp_path):
        (tmp_path / "plate.nc").write_text(PLATE, "ascii")
        hashes = set()
        for keys in ("", ", contour: 3", ", contour: outer"):
            (tmp_path / "task.yaml").write_text(TASK.replace("ROTATED", keys), "utf-8")
            hashes.add(load_problem(tmp_path / "task.yaml").sha256)
        assert len(hashes) == 1


class TestHeads:
    @pytest.mark.parametrize("lines", [24, 60])
    def test_stand_alike_along_an_arc_and_along_its_chords(self, tmp_path, lines):
        arc = "G2 X600 Y0 I300 J0"
        chords = "\n".join(
            f"G1 X{300 - 300 * math.cos(w):.3f} Y{300 * math.sin(w):.3f}"
            for w in (math.pi * i / lines for i in range(1, lines + 1))
        )
        placed = []
        for code in (arc, chords):
            (tmp_path / "arc.nc").write_text(f"G21 G90\nG0 X0 Y0\nG1 Z-1\n{code}\n", "ascii")
            (tmp_path / "task.yaml").write_text(
                "kind: swarmitfix\nname: arc\nheads: {max_gap_m: 0.2, step_m: 0.05}\n"
                "trajectory: {file: arc.nc, offset_m: [0.9, 0.6]}\n",
                "utf-8",
            )
            config: Any = load_problem(tmp_path / "task.yaml").config
            placed.append(swarm.Job(config).heads)
        assert len(placed[0]) == len(placed[1])
        for head, other in zip(*placed, strict=True):
            assert head.position == pytest.approx(other.position, abs=3e-3)
