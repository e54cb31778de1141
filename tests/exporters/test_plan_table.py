"""A plan as CSV: what a spreadsheet and a script find in it."""

from __future__ import annotations

import csv
import io
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handovers import solved
from situations import assembly
from skillplan import Setup, exporters, load_problem
from skillplan.exporters.plan_table import _escape
from skillplan.testing import hostile_task, lid_content, solved_lid


def rows(handover: exporters.Handover) -> list[dict[str, str]]:
    (text,) = exporters.CsvExporter().files(handover).values()
    assert isinstance(text, str)
    return list(csv.DictReader(io.StringIO(text)))


def test_a_row_a_skill_says_what_is_done_where_and_at_what_cost(board):
    """Costs add up to the plan's, and times one after another; 12 digits hide binary noise."""
    result = rows(board)
    assert board.plan is not None
    assert tuple(result[0]) == exporters.COLUMNS
    assert sum(float(row["cost"]) for row in result) == pytest.approx(board.plan.cost, rel=1e-11)
    assert not any("00000" in cell for row in result for cell in row.values())
    assert {"m"} == {row["cost_unit"] for row in result}
    first, second, *_, last = result
    expected = {"skill": "pick(pcb)", "subject": "pcb", "tool": "gripper"}
    assert expected.items() <= first.items()
    assert ("home", "pcb.start") == (first["from"], first["to"])
    assert ("pcb.start", "pcb.goal", first["duration_s"]) == (
        second["from"],
        second["to"],
        second["begin_s"],
    )
    assert "fasten" == last["kind"]
    assert all(row["from"] == before["to"] for before, row in pairwise(result))


@pytest.mark.parametrize(
    "exporter",
    [exporters.CsvExporter, exporters.StructuredTextExporter, exporters.BehaviourTreeExporter],
)
def test_a_file_without_paths_leaves_zones_to_the_controller_and_says_so(exporter, board):
    task = load_problem("configs/cell_zones.yaml").task
    zones = solved(task, Setup(collision=("aabb",)))
    (note,) = exporter().notes(zones)
    assert note.endswith("keep-out zones and limits of speed of belt, view, curtain, aisle")
    assert exporter().notes(board) == ()


def test_a_stated_torque_reaches_the_controller():
    """In each format of a plan; without one, files are as before."""
    content = lid_content()
    content["screws"]["screw"]["torque_nm"] = 2.8
    handover = solved(assembly(content))
    *others, fasten = rows(handover)
    assert (fasten["torque_nm"], {row["torque_nm"] for row in others}) == ("2.8", {""})
    (tree,) = exporters.BehaviourTreeExporter().files(handover).values()
    assert 'torque_nm="2.8"' in tree
    assert '<input_port name="torque_nm"' in tree
    (block,) = exporters.StructuredTextExporter().files(handover).values()
    assert "Torque : REAL;" in block
    assert block.count("Torque := 0.0;") == len(others)
    assert "Torque := 2.8;" in block


def test_a_spreadsheet_computes_nothing_of_a_name():
    """What it would take for a formula is marked as text, and numbers stay numbers."""
    result = rows(solved_lid(hostile_task()))
    assert "'=1+1\n,'\"" in {row["skill"] for row in result}
    assert not any(row["skill"][:1] in "=+-@\t\r\n" for row in result)
    assert any(float(row["start_y_m"]) < 0 for row in result if row["start_y_m"])


@given(st.text())
def test_what_is_marked_is_read_back(text):
    """Whatever a name begins with."""
    assert text == exporters.read_cell(_escape(text))
