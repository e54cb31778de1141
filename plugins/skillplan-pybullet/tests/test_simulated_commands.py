"""The commands that show simulated motion, with the real engine."""

import csv
import json
from pathlib import Path

import pytest
from PIL import Image

from skillplan.cli import main

BOARD = str(Path(__file__).parents[3] / "configs" / "inverter_board.yaml")
OPTIMUM = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"


@pytest.fixture
def call(capfd, tmp_path, monkeypatch):
    """Return what runs a command and gives exit code and stdout, also of what is not Python."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))

    def run(*words):
        capfd.readouterr()
        with pytest.raises(SystemExit) as ended:
            main(words)
        return ended.value.code, capfd.readouterr().out

    return run


@pytest.mark.release(reason="by the engine in every run, by the command in .ci/run")
def test_the_whole_plan_arrives_within_half_a_millimetre(call, tmp_path):
    """In one continuous world: every part in its place, every screw pressed; with a trace."""
    trace = tmp_path / "trace.csv"
    words = ("simulate", BOARD, "--sequence", OPTIMUM, "--trace", str(trace), "--format", "json")
    code, out = call(*words)
    document = json.loads(out)
    assert code == 0
    assert document["physics"] == "pybullet"
    assert document["feasible"]
    assert document["complete"]
    assert len(document["arrivals"]) == 8
    assert document["largest_offset_mm"] < 0.5
    assert document["largest_tilt_deg"] < 1.5
    pressed = [
        skill["evidence"]["sensed"]["fastening_force_n"]
        for skill in document["skills"]
        if skill["skill"].startswith("fasten")
    ]
    assert len(pressed) == 2
    assert min(pressed) >= 3.0
    with trace.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert abs(len(rows) - 60 * document["simulated_s"]) <= 60
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times)
    assert abs(float(rows[-1]["brace_x_m"]) - 0.520) < 0.0005
    # While the world settles no skill is under way.
    skills = {item["skill"] for item in document["skills"]}
    assert {row["skill"] for row in rows} - {""} == skills


@pytest.mark.slow(reason="by the engine in every run, and another plan by the command")
def test_a_wrong_plan_ends_where_it_fails(call):
    """A switch without a board to stand on: exit code 1, and how far it fell."""
    words = ("simulate", BOARD, "--sequence", "2,3,0", "--format", "json")
    code, out = call(*words)
    document = json.loads(out)
    assert code == 1
    assert [skill["status"] for skill in document["skills"]] == ["feasible", "infeasible"]
    assert "6.0 mm below its goal" in document["skills"][-1]["reason"]


@pytest.mark.slow(reason="by the engine in every run, by the command in .ci/run")
def test_the_moment_of_a_collision_is_drawn(call, tmp_path):
    """A picture of it, and the whole skill in motion; stdout holds the document alone."""
    png, gif = tmp_path / "moment.png", tmp_path / "whole.gif"
    words = ("explain", BOARD, "place(transformer)", "--after", "0,1,10,11,8", "--no-cache")
    words += ("--set", "chart=[]")
    words += ("--physics", "pybullet", "--collision", "contact-pairs", "--format", "json")
    code, out = call(*words, "--picture", str(png), "--animate", str(gif))
    document = json.loads(out)
    assert code == 1
    assert document["stage"] == "contact-pairs"
    assert document["files"] == {"picture": str(png), "animate": str(gif)}
    with Image.open(png) as picture:
        colours = picture.convert("RGB").getcolors(1_000_000)
        # What collides is red.
        assert sum(count for count, (r, g, b) in colours if r > 150 and g < 60 and b < 60) > 500
    with Image.open(gif) as animation:
        assert animation.n_frames > 10


@pytest.mark.slow(reason="executes and films; a film of a fake engine is in every run")
def test_a_video_shows_the_plan(call, tmp_path):
    """At ten times the speed it takes a tenth of the simulated seconds."""
    path = tmp_path / "plan.gif"
    words = ("simulate", BOARD, "--sequence", "0", "--video", str(path), "--speed", "10")
    code, out = call(*words, "--format", "json")
    assert code == 1
    document = json.loads(out)
    with Image.open(path) as animation:
        lasts_s = 0.0
        for index in range(animation.n_frames):
            animation.seek(index)
            lasts_s += animation.info["duration"] / 1000
    assert abs(lasts_s - document["simulated_s"] / 10) < 0.2
