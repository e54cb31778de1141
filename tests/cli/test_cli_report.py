"""``skillplan report``: pages of real results, and what can be no page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from skillplan.views.report import Player


@pytest.fixture
def page(tmp_path):
    """Where a page goes."""
    return tmp_path / "page.html"


def test_a_board_is_reported(cli, board, page, monkeypatch):
    """Status, proof, plan, time line, pictures, precedence: all without a script or a player.

    And stderr says how to get the player.
    """
    monkeypatch.setattr("skillplan.views.report.page.load_player", lambda: None)
    outcome = cli("report", board, "--no-simulation", "--out", str(page))
    assert (0, f"{page}\n") == (outcome.code, outcome.out)
    text = page.read_text("utf-8")
    assert {"optimal", "1.86709 m", "place(transformer)", "Time line", "follow from"} <= {
        item
        for item in ("optimal", "1.86709 m", "place(transformer)", "Time line", "follow from")
        if item in text
    }
    assert "db0e94f40288b71a" in text, "the hash of the task"
    assert 150_000 > len(text.encode())
    assert "make web builds it" in outcome.err
    assert "<script" not in text


@pytest.mark.parametrize("hidden", ["the engines", "none"])
def test_what_no_engine_performs_is_played_along_its_planned_paths(
    cli, tmp_path, page, monkeypatch, hidden
):
    """Without forces, and the page says so outside the player, too."""
    pytest.importorskip("skillplan_pinocchio")
    player = Player("document.title;", "", "")
    monkeypatch.setattr("skillplan.views.report.page.load_player", lambda: player)
    words = ["--no-simulation"]
    if hidden == "the engines":
        performing = "skillplan.pipeline.performing.find_performing_engine"
        monkeypatch.setattr(performing, lambda: None)
        words = []
    assert 0 == cli("report", one_part(tmp_path), *words, "--out", str(page)).code
    text = page.read_text("utf-8")
    data = text.partition('id="playback">')[2].partition("</script>")[0]
    playback = json.loads(data)
    assert "planned, not simulated: no contact forces" == playback["note"]
    assert "The motion is planned, not simulated: no contact forces." in text
    assert "Times along the planned paths." in text
    assert [] == playback["contacts"]
    assert ["pick(cover)", "place(cover)"] == [skill["name"] for skill in playback["skills"]]
    assert "cover" in {body["name"] for body in playback["bodies"] if body["track"] is not None}


def one_part(folder: Path) -> str:
    """Return the file of a task in which an arm places one part."""
    path = folder / "one.yaml"
    path.write_text(
        "kind: assembly\nname: one\n"
        "robot: {name: panda, home_m: [0.307, 0.0], reach_m: 0.855, safe_height_m: 0.15}\n"
        "tools: {gripper: {type: gripper, opening_m: 0.08, holder_m: [0.642, -0.2]}}\n"
        "initial_tool: gripper\n"
        "parts:\n  cover: {tool: gripper, mass_kg: 0.1, size_m: [0.05, 0.04, 0.02], "
        "start_m: [0.4, -0.1], goal_m: [0.45, 0.1]}\n"
    )
    return str(path)


def test_where_nothing_plans_paths_the_page_says_how_to_get_it(cli, tmp_path, page, monkeypatch):
    player = Player("document.title;", "", "")
    monkeypatch.setattr("skillplan.views.report.page.load_player", lambda: player)
    for module in ("performing", "setup"):
        monkeypatch.setattr(f"skillplan.pipeline.{module}.SCREEN", "absent")
    words = ["--no-simulation", "--collision", "aabb"]
    assert 0 == cli("report", one_part(tmp_path), *words, "--out", str(page)).code
    assert "pip install skillplan-pinocchio" in page.read_text("utf-8")


def test_a_page_that_is_there_stays(cli, board, page):
    """It is refused before anything is solved."""
    page.write_text("mine")
    outcome = cli("report", board, "--out", str(page))
    assert (2, "mine") == (outcome.code, page.read_text())
    assert "is there already" in outcome.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("no.yaml",), "no.yaml"),
        (("no.json",), "no.json"),
        (("{board}", "--out", "page.pdf"), "end it in .html"),
        (("{board}", "--physics", "magic"), "magic"),
    ],
)
def test_what_can_be_no_page_is_told(cli, board, page, words, message):
    """Exit code 2, and no file."""
    named = [word.format(board=board) for word in words]
    assert message in cli("report", "--out", str(page), *named).refusal
    assert not page.exists()


def test_the_bench_is_played_by_its_times(cli, tmp_path, page, monkeypatch):
    """Two bases on one bench: kinematic, and the page says so."""
    path = tmp_path / "meet.yaml"
    robots = "robots: {left: {home: C1, goal: C3}, right: {home: C66, goal: C68}}"
    path.write_text(f"kind: swarmitfix\nname: meet\n{robots}\n")
    player = Player("document.title;", "", "")
    monkeypatch.setattr("skillplan.views.report.page.load_player", lambda: player)
    assert 0 == cli("report", str(path), "--out", str(page)).code
    text = page.read_text("utf-8")
    data = text.partition('id="playback">')[2].partition("</script>")[0]
    playback = json.loads(data)
    assert "not simulated" in playback["note"]
    bases = [body["name"] for body in playback["bodies"] if body["kind"] == "base"]
    assert ["left", "right"] == bases
    assert "Bench of meet from above" in text, "a picture that stands without a script"
    assert playback["duration_s"] > 0


def test_several_inputs_are_chapters(cli, seven, tmp_path, page, monkeypatch):
    """A comparison beside a plan; what the comparison holds is data."""
    monkeypatch.setattr("skillplan.views.report.page.load_player", lambda: None)
    rows = [{"solver": "<script>", "status": "optimal", "cost": 1.0, "stats": {"wall_s": 0.1}}]
    other = tmp_path / "compared.json"
    other.write_text(json.dumps({"schema": "skillplan.comparison/1", "warm": False, "rows": rows}))
    outcome = cli("report", seven, str(other), "--no-simulation", "--out", str(page))
    assert 0 == outcome.code
    text = page.read_text("utf-8")
    assert "Solvers compared" in text
    assert "nothing was verified for this page" in text
    assert "<script>" not in text
