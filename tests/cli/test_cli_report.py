"""``skillplan report``: pages of real results, and what can be no page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from skillplan.views.report.player_files import Player


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """Where a page goes."""
    return tmp_path / "page.html"


def test_a_board_is_reported(cli: Any, board: str, page: Path) -> None:
    """Status, proof, plan, time line, pictures, precedence: all without a script."""
    outcome = cli("report", board, "--no-simulation", "--out", str(page))
    assert (0, f"{page}\n") == (outcome.code, outcome.out)
    text = page.read_text("utf-8")
    assert {"optimal", "1.86709 m", "place(transformer)", "Time line", "follow from"} <= {
        one
        for one in ("optimal", "1.86709 m", "place(transformer)", "Time line", "follow from")
        if one in text
    }
    assert "db0e94f40288b71a" in text, "the hash of the task"
    assert 150_000 > len(text.encode())


def test_without_a_player_a_page_is_written_all_the_same(
    cli: Any, board: str, page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And stderr says how to get one."""
    monkeypatch.setattr("skillplan.views.report.player_files.player", lambda: None)
    outcome = cli("report", board, "--no-simulation", "--out", str(page))
    assert 0 == outcome.code
    assert "make web builds it" in outcome.err
    assert "<script" not in page.read_text("utf-8")


def test_a_page_that_is_there_stays(cli: Any, board: str, page: Path) -> None:
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
def test_what_can_be_no_page_is_told(
    cli: Any, board: str, page: Path, words: tuple[str, ...], message: str
) -> None:
    """Exit code 2, and no file."""
    named = [word.format(board=board) for word in words]
    outcome = cli("report", "--out", str(page), *named)
    assert 2 == outcome.code
    assert message in outcome.err
    assert not page.exists()


def test_the_bench_is_played_by_its_times(
    cli: Any, tmp_path: Path, page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two bases on one bench: kinematic, and the page says so."""
    path = tmp_path / "meet.yaml"
    robots = "robots: {left: {home: C1, goal: C3}, right: {home: C66, goal: C68}}"
    path.write_text(f"kind: swarmitfix\nname: meet\n{robots}\n")
    player = Player("document.title;", "", "")
    monkeypatch.setattr("skillplan.views.report.player_files.player", lambda: player)
    assert 0 == cli("report", str(path), "--out", str(page)).code
    text = page.read_text("utf-8")
    data = text.partition('id="playback">')[2].partition("</script>")[0]
    playback = json.loads(data)
    assert "not simulated" in playback["note"]
    bases = [one["name"] for one in playback["bodies"] if one["kind"] == "base"]
    assert ["left", "right"] == bases
    assert playback["duration_s"] > 0


def test_several_inputs_are_chapters(cli: Any, board: str, tmp_path: Path, page: Path) -> None:
    """A comparison beside a plan; what the comparison holds is data."""
    rows = [{"solver": "<script>", "status": "optimal", "cost": 1.0, "stats": {"wall_s": 0.1}}]
    other = tmp_path / "compared.json"
    other.write_text(json.dumps({"schema": "skillplan.comparison/1", "warm": False, "rows": rows}))
    outcome = cli("report", board, str(other), "--no-simulation", "--out", str(page))
    assert 0 == outcome.code
    text = page.read_text("utf-8")
    assert "Solvers compared" in text
    assert "<script>" not in text
