"""``check`` warns of what is found out late; other commands of what is hardly meant."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import pytest

from skillplan.pipeline import registry

Cli = Callable[..., Any]


@pytest.fixture
def metres(tmp_path):
    """A task with a rectangle drawn in metres in a drawing that does not say so."""
    document = ezdxf.new("R2000", units=0)
    document.modelspace().add_lwpolyline([(0, 0), (3, 0), (3, 2), (0, 2)], close=True)
    document.saveas(tmp_path / "sheet.dxf")
    path = tmp_path / "job.yaml"
    path.write_text(
        "kind: swarmitfix\nname: job\nheads: {subdivisions: [1, 1, 1, 1]}\n"
        "trajectory: {file: sheet.dxf, offset_m: [1.0, 0.6]}\n",
        "utf-8",
    )
    return str(path)


DOUBT = (
    "job.yaml:4:20: trajectory.file: sheet.dxf: its unit is not given, and read in mm it is "
    "0.003 m long. Give trajectory.unit, such as m or in."
)


def test_a_rectangle_drawn_in_metres_is_told_of_by_check_in_its_document(cli, metres):
    """With its extent and its length, and nothing on stderr."""
    called = cli("check", metres, "--format", "json")
    assert (0, "") == (called.code, called.err)
    assert [str(Path(metres).parent / DOUBT)] == called.document["warnings"]
    shown = called.document["trajectory"]
    assert pytest.approx(0.010) == shown["length_m"]
    assert [[1.0, 0.6], [1.003, 0.602]] == [
        [round(value, 6) for value in corner] for corner in shown["extent_m"]
    ]


def test_a_rectangle_drawn_in_metres_is_told_of_by_other_commands_once_on_stderr(cli, metres):
    """Stdout holds the one document."""
    called = cli("search-optimal", metres, "--format", "json")
    assert "skillplan.result/1" == called.document["schema"]
    assert f"skillplan: warning: {Path(metres).parent / DOUBT}\n" == called.err


def test_check_derives_the_order_by_the_back_ends_that_it_is_given(cli, board):
    """And lists them as those that will be queried."""
    document = cli("check", board, "--collision", "aabb", "--format", "json").document
    assert [["kinematic", "precedence", "aabb"]] == [
        task["back_ends"] for task in document["tasks"]
    ]
    assert ["kinematic", "aabb"] == document["precedence"][0]["back_ends"]
    assert [] == document["precedence"][0]["cycle"]


def test_check_derives_the_order_by_geometry_whatever_the_file_chooses(cli, board):
    """The board's own choice, its chart, would only repeat itself."""
    document = cli("check", board, "--format", "json").document
    assert [["kinematic", "precedence"]] == [task["back_ends"] for task in document["tasks"]]
    geometric = "swept" if "swept" in registry.names("collision") else "aabb"
    assert ["kinematic", geometric] == document["precedence"][0]["back_ends"]


def test_check_refuses_a_detector_that_is_not_there(cli, board):
    """As every command does."""
    assert "Did you mean 'aabb'?" in cli("check", board, "--collision", "aab").refusal
