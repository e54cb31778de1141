"""Whole pages as `report` writes them, in a real browser: the board's, and one of the bench."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from browser import Page, executable

CONFIGS = Path(__file__).parents[2] / "configs"
PLAYER = resources.files("skillplan") / "views" / "report" / "player" / "player.js"
TENTH_OF_A_MM = 1e-4
MOST_BYTES = 1_500_000
NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"
TWO_PARTS = """\
kind: assembly
name: two
robot: {name: panda, home_m: [0.307, 0.0], reach_m: 0.855, safe_height_m: 0.15}
tools: {gripper: {type: gripper, opening_m: 0.08, holder_m: [0.642, -0.2]}}
initial_tool: gripper
chart: [{before: plate, after: [block]}]
collision: {precedence: {}}
parts:
  plate: {tool: gripper, mass_kg: 0.1, size_m: [0.05, 0.04, 0.01],
          start_m: [0.4, -0.1], goal_m: [0.45, 0.1]}
  block: {tool: gripper, mass_kg: 0.05, size_m: [0.03, 0.03, 0.03],
          start_m: [0.5, -0.1], goal_m: [0.45, 0.1], goal_on: plate}
"""
# A row of one line is 1.55 times its text and two paddings high.
MOST_ROW_PX = 40
pytestmark = [
    pytest.mark.slow(
        reason="simulates a board and starts a browser; the pages' text is held in every run"
    ),
    pytest.mark.skipif(executable() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not PLAYER.is_file(), reason="`make web` has not built the player here"),
]


def skillplan(*words: object) -> None:
    command = [sys.executable, "-m", "skillplan", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The page of the inverter board's optimum as pybullet executes it."""
    pytest.importorskip("skillplan_pybullet")
    path = tmp_path_factory.mktemp("board") / "page.html"
    skillplan("report", CONFIGS / "inverter_board.yaml", "--out", path)
    return path


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Four bases on a bench."""
    path = tmp_path_factory.mktemp("bench") / "page.html"
    skillplan("report", CONFIGS / "swarmitfix_fleet.yaml", "--out", path)
    return path


@pytest.fixture(scope="module")
def page(written, tmp_path_factory):
    opened = Page(tmp_path_factory.mktemp("browser"))
    opened.open(written)
    yield opened
    opened.close()


def test_the_page_of_the_board_is_light_and_asks_for_nothing(page, written):
    """Ready, at most 1.5 MB, nothing in the console, and itself the only thing that is read."""
    assert written.stat().st_size <= MOST_BYTES
    # Images within the page count as requests in the browser's log.
    assert [written.as_uri()] == [url for url in page.requests if not url.startswith("data:")]
    assert [] == page.complaints
    assert page.evaluate("skillplanPlayer.webgl") is True


def test_ten_seconds_on_the_picture_is_another(page):
    drawn = "document.querySelector('.player-canvas').toDataURL()"
    page.seek(10.0)
    before = page.evaluate(drawn)
    page.seek(20.0)
    assert page.evaluate(drawn) != before


@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_tip_and_parts_are_within_a_tenth_of_a_millimetre_of_the_trace(engine, tmp_path):
    """What `simulate --trace` writes; two parts, at some moments of each skill."""
    pytest.importorskip(f"skillplan_{engine}")
    task, page_file, trace = (tmp_path / name for name in ("two.yaml", "page.html", "trace.csv"))
    task.write_text(TWO_PARTS, "utf-8")
    skillplan("report", task, "--physics", engine, "--out", page_file)
    plan = "pick(plate),place(plate),pick(block),place(block)"
    words = ("--sequence", plan, "--physics", engine, "--trace", trace)
    skillplan("simulate", task, *words)
    with trace.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    page = Page(tmp_path / "browser")
    try:
        page.open(page_file)
        # Frames are 20 a second, rows 60: the first of these is a second after the beginning.
        for row in rows[59::60]:
            page.seek(float(row["time_s"]))
            for name, column in (("panda", "tip"), ("plate", "plate"), ("block", "block")):
                pose = page.evaluate(f"skillplanPlayer.poseOf('{name}')")
                expected = [float(row[f"{column}_{axis}_m"]) for axis in "xyz"]
                np.testing.assert_allclose(pose[:3], expected, atol=TENTH_OF_A_MM, err_msg=name)
        assert page.complaints == []
    finally:
        page.close()


def test_on_a_narrow_screen_nothing_sticks_out_and_rows_are_one_line_high(page, bench):
    page.resize(360, 700)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    heights = "[...document.querySelectorAll('#c1-plan tbody tr')].map(row => row.offsetHeight)"
    assert max(page.evaluate(heights)) <= MOST_ROW_PX
    page.resize(900, 800)
    page.open(bench, size=(360, 700))
    width = page.evaluate("document.documentElement.scrollWidth")
    assert ([], True) == (page.complaints, width <= 360)


def test_without_javascript_tables_and_pictures_stay(written, bench, tmp_path):
    """A still stands where the playback would be, and a line says what that needs."""
    page = Page(tmp_path / "browser")
    try:
        page.open_without_script(written)
        assert page.evaluate("document.querySelectorAll('#c1-plan tbody tr').length") == 15
        assert page.evaluate("document.querySelectorAll('svg.picture').length") == 5
        value = page.evaluate("document.getElementById('playback-root').innerText")
        assert "needs JavaScript and WebGL" in value
        assert "brace" in value, "the still names the parts"
        page.open_without_script(bench)
        assert page.evaluate("document.querySelectorAll('svg.picture').length") == 2
        assert page.complaints == []
    finally:
        page.close()


def test_without_webgl_the_still_of_the_product_stays(written, tmp_path):
    page = Page(tmp_path / "browser")
    try:
        page.open(written, before=NO_WEBGL)
        value = page.evaluate("document.getElementById('playback-root').innerText")
        assert "needs WebGL" in value
        assert page.evaluate("document.querySelectorAll('#playback-root svg.picture').length") == 1
        assert page.complaints == []
    finally:
        page.close()


def test_it_prints_as_a_few_pages_with_the_picture_on_them(page, written):
    """Of A4 or letter; what is only for a screen is left out."""
    page.open(written)
    page.seek(12.0)
    created = page.printed()
    assert created.startswith(b"%PDF")
    assert 4 <= len(re.findall(rb"/Type\s*/Page\b", created)) <= 8
    sizes = [(int(w), int(h)) for w, h in re.findall(rb"/Width (\d+)\s*/Height (\d+)", created)]
    assert any(width >= 600 and height >= 300 for width, height in sizes), sizes
    page.call("Emulation.setEmulatedMedia", media="print")
    bar = "getComputedStyle(document.querySelector('.player-bar')).display"
    links = "getComputedStyle(document.querySelector('nav')).display"
    assert ("none", "none") == (page.evaluate(bar), page.evaluate(links))
    page.call("Emulation.setEmulatedMedia", media="")
