"""The 3-D player in a real browser: what it draws, what keys do, and what it asks for."""

import itertools
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from browser import Page, executable
from playback_pages import part_at, playback, tip_at, with_keys, write_page
from skillplan import load_problem
from skillplan.views import FRAMES_PER_S, PLANNED, build_arm_playback
from skillplan.views.report import read_page_style

PLAYER = resources.files("skillplan") / "views" / "report" / "player" / "player.js"
BOARD = Path(__file__).parents[2] / "configs" / "inverter_board.yaml"
TENTH_OF_A_MM = 1e-4
NO_WEBGL = "HTMLCanvasElement.prototype.getContext = () => null"
pytestmark = [
    pytest.mark.slow(
        reason="starts a browser; tests/views/test_playback.py holds what it is handed in every run"
    ),
    pytest.mark.skipif(executable() is None, reason="no Chromium on this machine"),
    pytest.mark.skipif(not PLAYER.is_file(), reason="`make web` has not built the player here"),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    scratch = tmp_path_factory.mktemp("browser")
    opened = Page(scratch)
    opened.open(write_page(scratch / "page.html", playback()))
    yield opened
    opened.close()


def test_the_page_asks_for_nothing_but_itself_and_complains_of_nothing(page):
    page.seek(0.0)
    assert [url.partition(":")[0] for url in page.requests] == ["file"]
    assert page.complaints == []
    assert page.evaluate("skillplanPlayer.webgl") is True


def test_the_picture_moves_with_time(page):
    drawn = "document.querySelector('.player-canvas').toDataURL()"
    page.seek(1.0)
    before = page.evaluate(drawn)
    page.seek(11.0)
    assert page.evaluate(drawn) != before
    page.seek(1.0)
    assert page.evaluate(drawn) == before


@pytest.mark.parametrize("time_s", [0.0, 2.75, 13.5, 24.0])
def test_tip_and_parts_are_within_a_tenth_of_a_millimetre(page, time_s):
    page.seek(time_s)
    tip = page.evaluate("skillplanPlayer.poseOf('arm')")
    np.testing.assert_allclose(tip[:3], tip_at(np.array(time_s)), atol=TENTH_OF_A_MM)
    board = page.evaluate("skillplanPlayer.poseOf('board')")
    np.testing.assert_allclose(board[:3], part_at(1, np.array(time_s)), atol=TENTH_OF_A_MM)


def test_a_planned_motion_is_played_within_a_tenth_of_a_millimetre(tmp_path):
    """The board's arm along its planned paths: tip, and every part that is there."""
    swept = pytest.importorskip("skillplan_pinocchio.swept")
    task = load_problem(str(BOARD)).task
    skills = task.parse_sequence("0,1,2,3,4,5,8,9,10,11,6,7,13,14,15")
    motion = swept.SweptDetector(task).planned_motion(skills, FRAMES_PER_S)
    document = build_arm_playback(task, motion.skills, motion.samples, note=PLANNED).document()
    page = Page(tmp_path / "browser")
    page.open(write_page(tmp_path / "page.html", document))
    assert PLANNED in page.evaluate("document.getElementById('playback-root').textContent")
    for sample in motion.samples[30::400]:
        page.seek(sample.time_s)
        tip = page.evaluate("skillplanPlayer.poseOf('panda')")
        np.testing.assert_allclose(tip[:3], sample.tip, atol=TENTH_OF_A_MM)
        for name, pose in sample.bodies.items():
            shown = page.evaluate(f"skillplanPlayer.poseOf('{name}')")
            np.testing.assert_allclose(shown[:3], pose.position, atol=TENTH_OF_A_MM)
    complaints = page.complaints
    page.close()
    assert complaints == []


def test_tracks_of_some_frames_only_are_read_between_them(tmp_path):
    page = Page(tmp_path / "browser")
    page.open(write_page(tmp_path / "page.html", with_keys(playback())))
    page.seek(13.6)
    tip = page.evaluate("skillplanPlayer.poseOf('arm')")
    page.seek(8.1)
    between = page.evaluate("skillplanPlayer.poseOf('arm')")
    page.close()
    np.testing.assert_allclose(tip[:3], tip_at(np.array(13.6)), atol=TENTH_OF_A_MM)
    ends = tip_at(np.array([8.0, 8.2]))
    np.testing.assert_allclose(between[:3], ends.mean(axis=0), atol=TENTH_OF_A_MM)


def test_a_body_that_is_not_there_has_no_pose(page):
    page.seek(5.0)
    assert page.evaluate("skillplanPlayer.poseOf('cover')") is None
    page.seek(12.0)
    assert page.evaluate("skillplanPlayer.poseOf('cover')") is not None


def test_keys_play_step_and_switch(page):
    page.evaluate("document.querySelector('.player-canvas').focus()")
    page.seek(0.0)
    page.press("n")
    assert page.evaluate("skillplanPlayer.time()") == 4.0
    page.press("n")
    page.press("p")
    assert page.evaluate("skillplanPlayer.time()") == 4.0
    labels = "document.querySelector('[aria-keyshortcuts=l]').getAttribute('aria-pressed')"
    page.press("l")
    page.seek(4.0)
    assert page.evaluate(labels) == "false"
    page.press("l")
    page.press("k")
    page.seek(4.0)
    assert page.evaluate("document.querySelector('.player-play').ariaLabel") == "Pause"
    page.press("k")
    page.press("?")
    assert page.evaluate("document.querySelector('.player-help').open") is True
    page.evaluate("document.querySelector('.player-help').close()")


def test_the_chart_leads_and_follows_and_a_screen_reader_hears_the_skill(page):
    page.seek(0.0)
    page.evaluate(
        "document.getElementById('bar').dispatchEvent(new MouseEvent('click', {bubbles: true}))"
    )
    page.seek(page.evaluate("skillplanPlayer.time()"))
    cursor = "document.getElementById('gantt-cursor').getAttribute('transform')"
    assert page.evaluate(cursor) == "translate(80.00 0)"
    assert page.evaluate("document.getElementById('bar').getAttribute('aria-current')") == "step"
    spoken = page.evaluate("document.querySelector('[role=status]').textContent")
    assert spoken == "3 of 6: pick(board), with gripper"


def test_nothing_sticks_out_where_the_page_is_360_pixels_wide(page):
    page.resize(360, 700)
    width = page.evaluate("document.documentElement.scrollWidth")
    page.resize(900, 800)
    assert width <= 360


def test_without_webgl_the_page_says_so_and_the_clock_goes_on(tmp_path):
    page = Page(tmp_path / "browser")
    page.open(write_page(tmp_path / "page.html", playback()), before=NO_WEBGL)
    assert page.evaluate("skillplanPlayer.webgl") is False
    value = page.evaluate("document.getElementById('playback-root').innerText")
    page.seek(8.0)
    time_s = page.evaluate("skillplanPlayer.time()")
    complaints = page.complaints
    page.close()
    assert "needs WebGL" in value
    assert "A still." in value
    assert time_s == 8.0
    assert complaints == []


def test_every_skill_is_one_step_from_the_last(page):
    page.seek(0.0)
    steps = [page.evaluate("skillplanPlayer.time()")]
    page.evaluate("document.querySelector('.player-canvas').focus()")
    for _ in range(6):
        page.press("n")
        steps.append(page.evaluate("skillplanPlayer.time()"))
    assert [b - a for a, b in itertools.pairwise(steps)] == [4.0] * 6


def test_the_page_takes_the_theme_of_its_button_and_is_printed_light(tmp_path):
    """Styles of the page and of the player alike; nobody prints white on black."""
    back = "getComputedStyle(document.body).backgroundColor"
    ink = "getComputedStyle(document.querySelector('.player')).getPropertyValue('--player-text')"
    page = Page(tmp_path / "browser")
    try:
        page.open(write_page(tmp_path / "page.html", playback(), style=read_page_style()))
        light = page.evaluate(back), page.evaluate(ink)
        page.evaluate("document.documentElement.dataset.theme = 'dark'")
        dark = page.evaluate(back), page.evaluate(ink)
        assert not set(light) & set(dark)
        page.call("Emulation.setEmulatedMedia", media="print")
        assert page.evaluate(back) == "rgb(255, 255, 255)"
        assert page.evaluate(ink) == light[1]
    finally:
        page.close()
