"""simulate, and the pictures of explain, with an engine that only pretends to move bodies."""

import csv
import itertools
import json
import re
import signal
import subprocess
import sys
from typing import ClassVar

import imageio_ffmpeg
import pytest
from PIL import Image

from skillplan.pipeline import registry
from thinned import slow_case

JSON = ("--format", "json")
OPTIMUM = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"

# Every skill takes 2 s of 60 samples each; from the second on it shows another colour.
PUPPET = '''
    import math
    import time

    from pydantic import Field

    from skillplan import Engine, Verdict
    from skillplan.physics.performance import (
        Arrival, Image, PerformedSkill, Performance, Performer, Sample
    )
    from skillplan.task import back_end

    class Puppet(Engine, Performer):
        """Move bodies by pretending."""

        name = "puppet"

        class Options(back_end.Options):
            """Options of the puppet."""

            fails_at: str = Field(default="", description="skill that fails [-]")
            bursts: bool = Field(default=False, description="raise instead [-]")
            pause_s: float = Field(default=0.0, description="time of a sample [s]")

        def check(self, skill, state):
            none = state.facts.none
            figures = {"sensed": {"held": "pcb", "jaw_width_m": 0.0}, "moved_mm": {"brace": 1.25}}
            if skill.name == self.options.fails_at:
                return Verdict.infeasible(f"{skill.name} jams", none, none, figures)
            return Verdict.feasible(none, none, figures)

        def picture(self, skill, state):
            if self.options.bursts:
                raise OSError("the window has gone away")
            if skill.name == "pick(clock)":
                raise ValueError("the arm cannot get there")
            return Image(5, 3, bytes(range(45)))

        def footage(self, skill, state, frames_per_s):
            for index in range(0 if skill.name == "pick(clock)" else int(2 * frames_per_s)):
                yield Image(5, 3, bytes([index]) * 45)

        def perform(self, skills, *, frames_per_s=None, show=None, note=None, stopped=None, **_):
            if self.options.bursts:
                raise RuntimeError("the simulator has gone away")
            state, done = self.task.initial, []
            for number, skill in enumerate(skills):
                for tick in range(120):
                    time_s = 2 * number + tick / 60
                    poses = self.task.scene.at(state)
                    tip = (0.1, -0.0, 0.2)
                    joints_rad = (0.5,) * 7
                    phase = "the travel"
                    sample = (time_s, skill.name, phase, tip, tip, joints_rad, 0.04, 0.0, poses)
                    if note is not None:
                        note(Sample(*sample))
                    time.sleep(self.options.pause_s)
                if show is not None:
                    for index in range(int(2 * frames_per_s)):
                        show(Image(65, 49, bytes([10 * number + index % 10]) * (3 * 65 * 49)))
                verdict = self.check(skill, state)
                done.append(PerformedSkill(skill.name, verdict, 2.0 * number, 2.0 * number + 2))
                if not verdict.is_feasible:
                    break
                state = skill.prediction_in(state).apply(state)
                if stopped():
                    break
            arrivals = tuple(
                Arrival(name, pose, pose, 0.00025, math.radians(0.5))
                for name, pose in self.task.scene.at(state).items()
            )
            return Performance(tuple(done), arrivals, 2.0 * len(done), 480 * len(done))
'''


@pytest.fixture
def puppet(install):
    """An engine that pretends to move bodies."""
    install("physics", "puppet", "puppet_engine:Puppet", PUPPET)
    return "puppet"


class TestSimulate:
    def test_a_plan_that_reaches_the_goal_is_a_success(self, cli, board, puppet):
        """A row for every skill, where all bodies ended, and the whole below."""
        words = ("simulate", board, "--sequence", OPTIMUM, "--physics", puppet)
        outcome = cli(*words)
        assert 0 == outcome.code
        assert "feasible   yes\ncomplete   yes\n" in outcome.out
        assert "arrival    within 0.250 mm and 0.500 degrees\n" in outcome.out
        assert "effort     30.0 s simulated in 7,200 steps, " in outcome.out
        document = cli(*words, "--format", "json").document
        assert "skillplan.simulation/1" == document["schema"]
        assert [int(action) for action in OPTIMUM.split(",")] == document["actions"]
        assert 15 == len(document["skills"])
        assert (True, True, False) == tuple(
            document[key] for key in ("feasible", "complete", "stopped")
        )
        assert {"pcb", "switch_1", "screw_2"} <= {
            arrival["body"] for arrival in document["arrivals"]
        }

    @pytest.mark.parametrize("named", ["", "result.json"], ids=["folder", "file"])
    def test_a_result_is_as_good_as_its_sequence(self, cli, board, puppet, tmp_path, named):
        """Its task, part and changes are the result's; the engine is the one named."""
        cli("search-optimal", board, "--set", "step_limit=40", "--out", str(tmp_path / "out"))
        outcome = cli("simulate", str(tmp_path / "out" / named), "--physics", puppet, *JSON)
        document = outcome.document
        assert (0, puppet) == (outcome.code, document["physics"])
        assert [int(action) for action in OPTIMUM.split(",")] == document["actions"]

    def test_a_plan_is_given_once(self, cli, board, puppet, tmp_path):
        """Beside a task file, or in a result."""
        cli("search-optimal", board, "--out", str(tmp_path / "out"))
        engine = ("--physics", puppet)
        outcome = cli("simulate", board, *engine)
        assert (2, True) == (outcome.code, "Give the plan by --sequence, or a RES" in outcome.err)
        outcome = cli("simulate", str(tmp_path / "out"), "--sequence", "0", *engine)
        assert (2, True) == (outcome.code, "a result holds its own plan" in outcome.err)

    def test_a_skill_that_fails_ends_the_plan(self, cli, board, puppet):
        """Which one, why, and with what figures; exit code 1."""
        words = ("simulate", board, "--sequence", "0,1,2,3", "--physics", puppet)
        outcome = cli(*words, "-O", "puppet.fails_at=pick(switch_1)")
        assert 1 == outcome.code
        assert "failure    at step 3 (pick(switch_1)): pick(switch_1) jams\n" in outcome.out
        assert "feasible   no\n" in outcome.out
        assert "place(switch_1)" not in outcome.out

    def test_a_plan_short_of_the_goal_is_no_success(self, cli, board, puppet):
        """Every skill went well, and the goal is not reached: exit code 1."""
        outcome = cli("simulate", board, "--sequence", "0,1", "--physics", puppet)
        assert 1 == outcome.code
        assert "feasible   yes\ncomplete   no\n" in outcome.out
        assert "failure    at the end: the goal is not reached\n" in outcome.out

    def test_a_plan_is_performed_as_far_as_its_preconditions_hold(self, cli, board, puppet):
        """What cannot begin is named with what would have to hold."""
        words = ("simulate", board, "--sequence", "0,1,1", "--physics", puppet)
        outcome = cli(*words, "--format", "json")
        assert 1 == outcome.code
        assert 2 == len(outcome.document["skills"])
        expected = "at step 3 (place(pcb)): precondition: held(pcb) must hold"
        assert expected == outcome.document["obstacle"]
        nothing = cli("simulate", board, "--sequence", "1", "--physics", puppet)
        assert 1 == nothing.code
        assert "effort     0.0 s simulated in 0 steps" in nothing.out

    def test_the_trace_has_a_row_for_every_sample(self, cli, board, puppet, tmp_path):
        """Time, skill, hand, joints and bodies; what is nowhere has empty cells."""
        path = tmp_path / "trace.csv"
        words = ("simulate", board, "--sequence", "0,1", "--physics", puppet)
        outcome = cli(*words, "--trace", str(path), "--format", "json")
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        assert 240 == len(rows)
        assert ("pick(pcb)", "place(pcb)") == (rows[0]["skill"], rows[-1]["skill"])
        assert "3.983333" == rows[-1]["time_s"]
        assert ("0.100000", "0.000000") == (rows[0]["tip_x_m"], rows[0]["tip_y_m"])
        assert "0.500000" == rows[0]["joint_7_rad"]
        assert ("0.345000", "1.000000") == (rows[0]["pcb_x_m"], rows[0]["pcb_qw"])
        assert "" == rows[0]["screw_1_x_m"]
        assert {"trace": str(path)} == outcome.document["files"]

    @pytest.mark.parametrize(
        "suffix", [".gif", slow_case(".mp4", reason="another format in every run")]
    )
    def test_the_video_shows_simulated_time_at_the_speed_asked_for(
        self, cli, board, puppet, tmp_path, suffix
    ):
        """Four simulated seconds at twice the speed last two; sizes are even in MP4."""
        path = tmp_path / f"plan{suffix}"
        words = ("simulate", board, "--sequence", "0,1", "--physics", puppet, "--video", str(path))
        assert 1 == cli(*words, "--fps", "10", "--speed", "2").code
        if suffix == ".gif":
            with Image.open(path) as gif:
                lasts_ms = 0
                for index in range(gif.n_frames):
                    gif.seek(index)
                    lasts_ms += gif.info["duration"]
                assert (20, (65, 49), 2000) == (gif.n_frames, gif.size, lasts_ms)
        else:
            assert (20, 2.0) == imageio_ffmpeg.count_frames_and_secs(str(path))
            queries = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(path)]
            about = subprocess.run(queries, capture_output=True, text=True, check=False).stderr
            assert "Video: h264" in about
            assert "yuv420p" in about
            assert " 64x48" in about
        assert [path] == list(tmp_path.glob("plan*"))
        assert not list(tmp_path.glob(".*"))

    def test_nothing_is_written_where_the_engine_fails(self, cli, board, puppet, tmp_path):
        """Exit code 3, the engine named; what was there stays."""
        path = tmp_path / "plan.gif"
        path.write_text("precious")
        words = ("simulate", board, "--sequence", "0,1", "--physics", puppet, "--video", str(path))
        outcome = cli(*words, "-O", "puppet.bursts=true")
        assert 3 == outcome.code
        expected = "Back end 'puppet' failed: RuntimeError: the simulator has gone away"
        assert outcome.err.startswith(f"skillplan: error: {expected} (")
        assert "precious" == path.read_text()

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--video", "plan.avi"), "--video plan.avi: videos are not saved as .avi; "),
            (("--video", "plan"), "--video plan: does not say which format; end it in .gif or"),
            (("--trace", "plan.txt"), "--trace plan.txt: traces are not saved as .txt; "),
            (("--trace", "gone/plan.csv"), "there is no folder gone. Make it first."),
            (("--fps", "nan"), "must be above 0 and at most 50, not nan."),
            (("--speed", "0"), "must be above 0 and at most 1000, not 0."),
        ],
    )
    def test_what_cannot_be_written_is_said_before_anything_moves(
        self, cli, board, puppet, words, message, tmp_path, monkeypatch
    ):
        """One message with what to write instead; exit code 2."""
        monkeypatch.chdir(tmp_path)
        queries = ("simulate", board, "--sequence", "0,1", "--physics", puppet, *words)
        assert message in cli(*queries, "-O", "puppet.bursts=true").refusal

    def test_an_engine_without_bodies_cannot_simulate(self, cli, board):
        """It is told which can."""
        assert (
            "physics 'kinematic' performs no plans with bodies to move; "
            in cli("simulate", board, "--sequence", "0,1", "--physics", "kinematic").refusal
        )

    def test_without_an_engine_it_is_said_how_to_come_by_one(self, cli, board, monkeypatch):
        """Neither named, nor chosen by the file, nor installed."""
        installed = registry.names
        left_out = {"physics": ["kinematic"]}
        monkeypatch.setattr(registry, "names", lambda kind: left_out.get(kind, installed(kind)))
        refusal = cli("simulate", board, "--sequence", "0,1").refusal
        assert "simulate needs an engine that moves bodies, such as 'pybullet'" in refusal
        assert "pip install skillplan-pybullet" in refusal

    @pytest.mark.slow(
        reason="executes skills until then; every run has Ctrl-C of train and of search"
    )
    def test_ctrl_c_ends_it_after_the_skill_under_way(self, board, puppet, tmp_path, environment):
        """What was executed is told, the trace is whole, and the exit code is 130."""
        path = tmp_path / "trace.csv"
        words = ["simulate", board, "--sequence", OPTIMUM, "--physics", puppet, "--format=json"]
        words += ["-O", "puppet.pause_s=0.005", "--trace", str(path)]
        process = subprocess.Popen(
            [sys.executable, "-c", _SIGNALS_ITSELF, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        out, err = process.communicate(timeout=60)
        assert (130, "") == (process.returncode, err)
        document = json.loads(out)
        assert document["stopped"]
        assert ["pick(pcb)"] == [skill["skill"] for skill in document["skills"]]
        assert 121 == len(path.read_text("utf-8").splitlines())


# Ctrl-C comes half a second after the first sample at the latest.
_SIGNALS_ITSELF = f"""
import os, sys, threading
from skillplan.cli.app import main
from skillplan.cli import interruption

def after_a_while(request, handle=interruption.handle_signals):
    threading.Timer(0.2, os.kill, (os.getpid(), {int(signal.SIGINT)})).start()
    return handle(request)

interruption.handle_signals = after_a_while
main(sys.argv[1:])
"""


class TestExplainWithPictures:
    def test_a_picture_and_an_animation_are_drawn(self, cli, board, puppet, tmp_path):
        """As PNG and GIF; the table and the document say where they are."""
        png, gif = tmp_path / "moment.png", tmp_path / "whole.gif"
        words = ("explain", board, "pick(pcb)", "--physics", puppet, "--no-cache")
        words += ("--picture", str(png), "--animate", str(gif))
        outcome = cli(*words)
        assert 0 == outcome.code
        assert f"picture       {png}\n" in outcome.out
        assert f"animate       {gif}\n" in outcome.out
        with Image.open(png) as picture:
            assert ("PNG", (5, 3)) == (picture.format, picture.size)
            assert bytes(range(45)) == picture.tobytes()
        with Image.open(gif) as animation:
            assert ("GIF", 25, 80) == (
                animation.format,
                animation.n_frames,
                animation.info["duration"],
            )
        document = cli(*words, "--format", "json").document
        assert {"picture": str(png), "animate": str(gif)} == document["files"]

    def test_evidence_of_several_things_reads_well(self, cli, board, puppet):
        """What belongs to one thing stands on one line."""
        out = cli("explain", board, "pick(pcb)", "--physics", puppet, "--no-cache").out
        assert "\n  sensed    held pcb, jaw_width_m 0\n  moved_mm  brace 1.25\n" in out

    def test_what_cannot_begin_is_not_drawn(self, cli, board, puppet, tmp_path):
        """The precondition says why; no file is written."""
        path = tmp_path / "moment.png"
        words = ("explain", board, "place(pcb)", "--physics", puppet, "--picture", str(path))
        outcome = cli(*words, "--no-cache")
        assert 1 == outcome.code
        assert "picture       nothing to draw\n" in outcome.out
        assert not path.exists()

    def test_a_motion_that_cannot_be_shown_is_explained_all_the_same(
        self, cli, board, puppet, tmp_path
    ):
        """In the engine's words; no file is written."""
        png, gif = tmp_path / "moment.png", tmp_path / "whole.gif"
        words = ("explain", board, "pick(clock)", "--physics", puppet, "--no-cache")
        outcome = cli(*words, "--picture", str(png), "--animate", str(gif))
        assert 0 == outcome.code
        assert "picture       nothing to draw: the arm cannot get there\n" in outcome.out
        assert "animate       nothing to draw\n" in outcome.out
        assert not png.exists()
        assert not gif.exists()

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--picture", "m.jpg"), "--picture m.jpg: pictures are not saved as .jpg; "),
            (("--animate", "m.mp4"), "--animate m.mp4: animations are not saved as .mp4; "),
            (("--picture", "gone/m.png"), "--picture gone/m.png: there is no folder gone."),
        ],
    )
    def test_a_file_that_cannot_be_is_refused(self, cli, board, puppet, words, message):
        """Before anything is asked; with what to write instead."""
        assert message in cli("explain", board, "pick(pcb)", "--physics", puppet, *words).refusal

    def test_an_engine_without_bodies_has_nothing_to_draw(self, cli, board):
        """It is said which engine has."""
        assert (
            "physics 'kinematic' performs no plans with bodies to draw; "
            in cli("explain", board, "pick(pcb)", "--picture", "moment.png").refusal
        )

    def test_an_engine_that_cannot_draw_is_named(self, cli, board, puppet, tmp_path):
        """An error of its own, even one of input and output, is no fault of the file's."""
        words = ("explain", board, "pick(pcb)", "--physics", puppet, "--no-cache")
        words += ("--picture", str(tmp_path / "m.png"), "-O", "puppet.bursts=true")
        outcome = cli(*words)
        assert (3, "") == (outcome.code, outcome.out)
        assert "Back end 'puppet' failed: OSError: the window has gone away" in outcome.err


class TestReportOfAFailedSimulation:
    """The plan is proved, and an engine that performs it fails at step 6 of 15."""

    pages: ClassVar[list[str]] = []

    @pytest.fixture
    def page(self, cli, board, install, tmp_path, monkeypatch):
        """The text of the page, without markup; what stands between tags is a line."""
        if self.pages:
            return self.pages[0]
        broken = PUPPET.replace(
            'default="", description="skill that',
            'default="place(switch_2)", description="skill that',
        )
        install("physics", "puppet", "puppet_engine:Puppet", broken)
        performing = "skillplan.pipeline.performing.find_performing_engine"
        monkeypatch.setattr(performing, lambda: "puppet")
        monkeypatch.setattr("skillplan.views.report.page.load_player", lambda: None)
        outcome = cli("report", board, "--out", str(tmp_path / "page.html"))
        assert 0 == outcome.code
        markup = (tmp_path / "page.html").read_text("utf-8").partition("<body")[2]
        self.pages.append(re.sub(r"(\s*<[^>]*>\s*)+", "\n", markup))
        return self.pages[0]

    def test_the_headline_puts_the_failure_first(self, page):
        begin = page.index("Proved by kinematic, precedence; the simulation by puppet fails at ")
        assert "step 6 of 15, place(switch_2): place(switch_2) jams." in page[begin : begin + 120]
        assert "A valid plan" not in page
        assert begin < page.index("Not checked: geometry")

    def test_the_time_line_says_where_measured_times_end(self, page):
        assert "Times as simulated up to step 6, which fails; later steps as planned" in page
        titles = set(re.findall(r"\n(\d+\. [^;\n]* s, as planned, not simulated)\n", page))
        assert 9 == len(titles)

    def test_planned_times_fill_the_table_after_the_failure(self, page):
        table = page.partition("15 skills in order")[2].partition("Cell and product")[0]
        assert 9 == table.count("not simulated")
        assert 1 == table.count("fails")
        rows = re.findall(r"\n(\d+)\n([a-z]+\([a-z0-9_]+\))\n(?:[a-z]+|-)\n([0-9.]+|-)\n", table)
        assert 15 == len(rows)
        begins = [float(row[2]) for row in rows]
        assert begins == sorted(begins)
        assert 12.0 == begins[6], "where the failed step ended"

    def test_the_facts_list_proof_simulation_and_what_is_not_checked(self, page):
        facts = page.rpartition("What was asked and found")[2].split("\n")
        after = dict(itertools.pairwise(filter(None, facts)))
        assert "kinematic, precedence" == after["Proved by"]
        assert after["Simulation"].startswith("by puppet fails at step 6 of 15")
        assert after["Not checked"].startswith("geometry (")
