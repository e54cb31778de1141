"""A chart of the task file is checked beside geometry, which it never switches off."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import pytest

import skillplan.domains.assembly as assembly_domain
from skillplan.pipeline import registry

Cli = Callable[..., Any]
STARTER = Path(assembly_domain.__file__).with_name("starter.yaml").read_text("utf-8")
GEOMETRIC = "swept" if "swept" in registry.names("collision") else "aabb"
# Its cover has to be in place before the screw that goes through it is driven.
AGAINST_GEOMETRY = "chart: [{before: screw, after: [chip]}]\n"
WITH_GEOMETRY = "chart: [{before: chip, after: [cover]}]\n"
NOT_CHECKED = "geometry (collisions, support, the arm's motion): only the chart is checked"


@pytest.fixture
def task_file(tmp_path):
    """Write the board of `skillplan init` with more lines; return its path."""

    def write(lines: str) -> str:
        path = tmp_path / "board.yaml"
        path.write_text(STARTER + lines, "utf-8")
        return str(path)

    return write


def stored_by_an_older_version(cli: Cli, path: str, folder: Path) -> Path:
    """Return a result as older versions stored it, which checked nothing but a chart by default."""
    cli("search-optimal", path, "--collision", "precedence", "--out", str(folder))
    file = folder / "result.json"
    document = json.loads(file.read_text("utf-8"))
    document["origin"]["collision"] = []
    for key in ("proved_by", "simulation", "not_checked"):
        del document[key]
    file.write_text(json.dumps(document), "utf-8")
    return folder


class TestAChartThatContradictsGeometry:
    def test_leaves_no_plan_and_the_reason_names_both(self, cli, task_file):
        outcome = cli("search-optimal", task_file(AGAINST_GEOMETRY), "--format", "json")
        document = outcome.document
        assert (1, "infeasible") == (outcome.code, document["status"])
        assert ["kinematic", GEOMETRIC, "precedence"] == document["proved_by"]
        assert "chip" in document["reason"]
        assert "screw before chip" in document["reason"]
        assert "runs into" in document["reason"] or "in the way" in document["reason"]

    def test_is_listed_by_check_with_the_place_in_the_file(self, cli, task_file):
        path = task_file(AGAINST_GEOMETRY)
        outcome = cli("check", path, "--format", "json")
        (contradiction,) = outcome.document["precedence"][0]["contradictions"]
        assert contradiction.startswith("chart: screw before chip contradicts geometry: chip ")
        assert "(place(chip): " in contradiction
        line = 1 + STARTER.count("\n")
        warned = [w for w in outcome.document["warnings"] if w.startswith(f"{path}:{line}:")]
        assert [contradiction.removeprefix("chart: ")] == [w.split(": ", 2)[2] for w in warned]

    def test_is_compared_by_check_even_if_the_chart_alone_is_chosen(self, cli, task_file):
        path = task_file(AGAINST_GEOMETRY + "collision: {precedence: {}}\n")
        document = cli("check", path, "--format", "json").document
        assert [["kinematic", "precedence"]] == [task["back_ends"] for task in document["tasks"]]
        assert [NOT_CHECKED] == document["not_checked"]
        assert 1 == len(document["precedence"][0]["contradictions"])

    def test_makes_an_older_result_by_the_chart_alone_invalid(self, cli, task_file, tmp_path):
        folder = stored_by_an_older_version(cli, task_file(AGAINST_GEOMETRY), tmp_path / "old")
        outcome = cli("verify", str(folder), "--format", "json")
        assert 1 == outcome.code
        (failing,) = [c for c in outcome.document["claims"] if c["outcome"] == "fails"]
        assert "geometry" == failing["claim"]
        assert "fasten(screw)" in failing["detail"]
        assert GEOMETRIC in failing["detail"]

    @pytest.mark.parametrize("lines", ["", "collision: {aabb: {}}\n"])
    def test_is_not_saved_by_a_result_that_hides_its_detectors(
        self, cli, task_file, tmp_path, lines
    ):
        path = task_file(AGAINST_GEOMETRY + lines)
        folder = stored_by_an_older_version(cli, path, tmp_path / "forged")
        file = folder / "result.json"
        document = json.loads(file.read_text("utf-8"))
        document["collision"] = "" if not lines else "precedence"
        file.write_text(json.dumps(document), "utf-8")
        assert 1 == cli("verify", str(folder)).code


class TestAChartThatAgreesWithGeometry:
    def test_is_checked_beside_the_default_detector(self, cli, task_file):
        outcome = cli("search-optimal", task_file(WITH_GEOMETRY), "--format", "json")
        assert (0, "optimal") == (outcome.code, outcome.document["status"])
        assert f"{GEOMETRIC},precedence" == outcome.document["collision"]
        assert NOT_CHECKED not in outcome.document["not_checked"]

    def test_is_checked_beside_a_detector_that_the_user_names(self, cli, task_file):
        words = ("search-optimal", task_file(WITH_GEOMETRY), "--collision", "aabb")
        assert "aabb,precedence" == cli(*words, "--format", "json").document["collision"]

    def test_leaves_an_older_result_by_the_chart_alone_valid(self, cli, task_file, tmp_path):
        """Its plan holds under geometry, too, so that it is the best of those that do."""
        path = task_file(
            "chart: [{before: plate, after: [chip]}, {before: chip, after: [cover]},\n"
            "        {before: cover, after: [screw]}]\n"
        )
        folder = stored_by_an_older_version(cli, path, tmp_path / "old")
        outcome = cli("verify", str(folder), "--format", "json")
        assert (0, True) == (outcome.code, outcome.document["valid"])
        claims = {claim["claim"]: claim["outcome"] for claim in outcome.document["claims"]}
        assert ("holds", "holds") == (claims["geometry"], claims["optimal"])


class TestTheChartAlone:
    def test_is_chosen_by_name_and_every_output_says_that_geometry_is_not_checked(
        self, cli, task_file, tmp_path
    ):
        path, folder = task_file(AGAINST_GEOMETRY), tmp_path / "run"
        by_chart = ("--collision", "precedence")
        searched = cli("search-optimal", path, *by_chart, "--out", str(folder))
        assert 0 == searched.code
        assert f"not checked  {NOT_CHECKED}" in searched.out
        assert [NOT_CHECKED] == json.loads((folder / "result.json").read_text())["not_checked"]
        assert f"not checked  {NOT_CHECKED}" in cli("check", path, *by_chart).out
        verified = cli("verify", str(folder))
        assert 0 == verified.code
        assert f"not checked  {NOT_CHECKED}" in verified.out


def test_commands_query_the_same_default_detector(cli, task_file):
    """A chart is derived without that of the file, of which it would say nothing."""
    path = task_file(WITH_GEOMETRY)
    search, check, chart, explain, compare = (
        cli(*words, "--format", "json").document
        for words in (
            ("search-optimal", path),
            ("check", path),
            ("chart", path),
            ("explain", path, "pick(plate)"),
            ("compare", path, "--solvers", "exact"),
        )
    )
    by_all = {"kinematic", GEOMETRIC, "precedence"}
    assert by_all == set(search["proved_by"])
    assert by_all == set(check["tasks"][0]["back_ends"])
    assert by_all == {stage["stage"] for stage in explain["stages"]} - {"precondition"}
    assert by_all == set(compare["rows"][0]["proved_by"])
    assert {"kinematic", GEOMETRIC} == set(chart["back_ends"])
    assert {"kinematic", GEOMETRIC} == set(check["precedence"][0]["back_ends"])


# ``check`` warns of what is found out late; other commands of what is hardly meant.


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
