"""A result in the place of a task or a sequence: the folder that --out named, or its JSON."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image

from run_folders import HOPELESS, OPTIMAL, SWITCHED, write_runs
from thinned import slow_case

CONFIGS = Path(__file__).parents[2] / "configs"
BOARD = str(CONFIGS / "inverter_board.yaml")
JSON = ("--format", "json")


@pytest.fixture(scope="module")
def folder(solved, tmp_path_factory):
    """The optimum of the board within 40 steps, by the shapes of its parts."""
    words = ("--collision", "aabb", "--set", "step_limit=40")
    return Path(solved(tmp_path_factory.mktemp("earlier") / "run", BOARD, *words))


@pytest.fixture(scope="module")
def learned(solved, corner, tmp_path_factory):
    """A learner's answer to a chain."""
    words = ("--solver", "sarsa", "-O", "episodes=300", "--seed", "3")
    return str(solved(tmp_path_factory.mktemp("learned") / "run", corner, *words))


@pytest.fixture(params=["", "result.json"], ids=["folder", "file"])
def result(folder, request):
    """The same result in both forms."""
    return str(folder / request.param)


def texts(path: Path) -> str:
    """Return the texts of an SVG file, on lines of their own."""
    tags = ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")
    return "\n".join("".join(tag.itertext()).strip() for tag in tags)


class TestEvaluate:
    def test_the_plan_is_replayed_as_it_was_made(self, cli, result):
        """Feasible, complete, and at the same cost."""
        outcome = cli("evaluate", result, *JSON)
        document = outcome.document
        assert 0 == outcome.code
        assert (True, True) == (document["feasible"], document["complete"])
        assert pytest.approx(1.86709, abs=5e-6) == document["cost"]

    def test_what_the_line_says_goes_before(self, cli, result, bursting_detector):
        """A back end, and a change of the file, which makes another task of it."""
        slow = cli("evaluate", result, "--set", "robot.travel_speed_m_per_s=0.01", *JSON)
        assert 0 == slow.code
        assert cli("evaluate", result, *JSON).document["makespan_s"] < slow.document["makespan_s"]
        assert 3 == cli("evaluate", result, "--collision", bursting_detector).code

    def test_a_task_of_a_chain_is_named(self, cli, solved_corner):
        """It is grounded as it was: from the plans of the stages before."""
        stored = json.loads((solved_corner / "result.json").read_text("utf-8"))
        part = stored["sequences"][0]
        outcome = cli("evaluate", str(solved_corner), "--part", part["name"], *JSON)
        assert 0 == outcome.code
        assert part["cost"] == pytest.approx(outcome.document["cost"])

    @pytest.mark.parametrize(
        ("words", "message"),
        [((), "Name one by --part: heads-1"), (("--part", "heds-1"), "Did you mean 'heads-1'?")],
    )
    def test_a_chain_alone_has_no_single_plan(self, cli, solved_corner, words, message):
        """The message names its tasks, or the nearest."""
        assert message in cli("evaluate", str(solved_corner), *words).refusal

    def test_the_only_task_of_a_chain_needs_no_name(self, cli, tmp_path):
        """A case of the bench is one."""
        case, out = str(CONFIGS / "swarmitfix_cases.yaml"), str(tmp_path / "out")
        assert 0 == cli("search-optimal", case, "--out", out).code
        outcome = cli("evaluate", out, *JSON)
        assert (0, 4.0) == (outcome.code, outcome.document["cost"])

    def test_a_changed_task_is_refused_unless_told_otherwise(self, cli, tmp_path):
        """By the hash of its content."""
        task, out = tmp_path / "board.yaml", str(tmp_path / "out")
        shutil.copy(BOARD, task)
        cli("search-optimal", str(task), "--out", out)
        task.write_text(task.read_text("utf-8").replace("step_limit: 20", "step_limit: 25"))
        assert "has changed since" in cli("evaluate", out).refusal
        assert 0 == cli("evaluate", out, "--changed-task").code

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--sequence", "0"), "--sequence is for a task file, not for a result."),
            (("--policy", "p.json"), "--policy is for a task file, not for a result."),
            (("--episodes", "3"), "--episodes is for a folder of runs, not for a result."),
            (("-O", "aab.tolerance_m=1"), "No plugin 'aab' takes part in this run."),
        ],
    )
    def test_what_does_not_fit_is_refused(self, cli, folder, words, message):
        """Rather than ignored."""
        assert message in cli("evaluate", str(folder), *words).refusal

    def test_a_result_without_a_plan_is_refused(self, cli, no_way, tmp_path):
        """Its status says why there is none."""
        out = str(tmp_path / "out")
        cli("search-optimal", no_way, "--solver", "exact", "--out", out)
        refusal = cli("evaluate", out).refusal
        assert "holds no plan of" in refusal
        assert "its status is infeasible" in refusal


class TestExplain:
    def test_a_step_is_the_state_in_which_it_begins(self, cli, result):
        """As the same sequence pasted by --after would have it."""
        step = ("--from", result, "--step", "7")
        document = cli("explain", BOARD, "place(brace)", *step, *JSON).document
        pasted = cli(
            "explain",
            BOARD,
            "place(brace)",
            *("--after", "0,1,2,3,4,5", "--collision", "aabb", "--set", "step_limit=40"),
            *JSON,
        ).document
        assert pasted == document

    def test_without_a_step_it_is_the_end(self, cli, result):
        """All is done there."""
        outcome = cli("explain", BOARD, "pick(pcb)", "--from", result, *JSON)
        assert 1 == outcome.code
        assert {"placed(pcb)", "placed(brace)"} <= set(outcome.document["state"])

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--step", "3"), "--step counts the steps of a result: name it by --from RESULT."),
            (("--from", "RESULT", "--after", "0"), "Give either --after or --from"),
            (("--from", "RESULT", "--step", "17"), "has 15 steps."),
        ],
    )
    def test_what_does_not_fit_is_refused(self, cli, folder, words, message):
        """In one message."""
        named = [str(folder) if word == "RESULT" else word for word in words]
        assert message in cli("explain", BOARD, "0", *named).refusal

    def test_a_result_of_another_task_is_refused(self, cli, motor, folder):
        """Both are named."""
        refusal = cli("explain", motor, "0", "--from", str(folder)).refusal
        assert "'inverter-board'" in refusal
        assert "'motor-drive'" in refusal


class TestPlot:
    def test_the_rewards_of_a_stored_plan_are_drawn(self, cli, result, tmp_path, monkeypatch):
        """Without a search: no solver is made."""
        path = tmp_path / "rewards.svg"
        monkeypatch.setattr(
            "skillplan.pipeline.chain.solve_chain", lambda *_, **__: pytest.fail("it has searched")
        )
        outcome = cli("plot", result, "rewards", "--out", str(path))
        assert (0, f"{path}\n") == (outcome.code, outcome.out)
        assert "place(transformer)" in texts(path)

    @pytest.mark.parametrize(
        "figure",
        [
            slow_case("gantt", reason="a board's in every run"),
            slow_case("placement", reason="draws two figures; another one in every run"),
            slow_case("rewards", reason="draws two figures; another one in every run"),
        ],
    )
    def test_a_stored_chain_is_drawn(self, cli, corner, solved_corner, tmp_path, figure):
        """The same as of the task, but for who has found it and how fast."""
        of_result, of_task = tmp_path / "result.png", tmp_path / "task.png"
        coarse = ("--dpi", "50", "--out")
        assert 0 == cli("plot", str(solved_corner), figure, *coarse, str(of_result)).code
        words = ("--solver", "exact", *coarse, str(of_task))
        assert 0 == cli("plot", corner, figure, *words).code
        with Image.open(of_result) as drawn, Image.open(of_task) as expected:
            assert expected.tobytes() == drawn.tobytes()

    @pytest.mark.slow(reason="draws a policy; a stored chain in every run")
    def test_a_stored_policy_is_drawn(self, cli, learned, tmp_path):
        """From the policies.json beside the plan."""
        path = tmp_path / "policy.svg"
        assert 0 == cli("plot", learned, "policy", "--out", str(path)).code
        assert "solver sarsa" in texts(path)

    @pytest.mark.slow(reason="solves a bench twice; a stored one in every run")
    def test_what_a_search_shows_is_searched_anew_as_it_was(self, cli, learned, tmp_path):
        """With the solver, the options and the seed of the result."""
        path = tmp_path / "values.svg"
        assert 0 == cli("plot", learned, "q-values", "--out", str(path)).code
        shown = texts(path)
        assert "seed 3" in shown
        assert "episodes = 300" in shown


class TestVerifyAndStart:
    def test_both_take_folder_and_file(self, cli, result):
        """As ever."""
        assert cli("verify", result, *JSON).document["valid"]
        words = ("--collision", "aabb", "--set", "step_limit=40", "--start", result)
        trace = cli("search-optimal", BOARD, *words, *JSON).document["trace"]
        assert trace["start"].startswith("from a plan of ")


@pytest.mark.slow(reason="trainings; results of searches in every run")
class TestRuns:
    @pytest.fixture
    def good(self, tmp_path):
        """Two runs, which complete the board."""
        return write_runs(tmp_path / "good", BOARD, [OPTIMAL, SWITCHED])

    @pytest.fixture
    def poor(self, tmp_path):
        """Two runs, of which one completes it."""
        return write_runs(tmp_path / "poor", BOARD, [SWITCHED, HOPELESS])

    @pytest.mark.slow(reason="two trainings; one in every run")
    def test_several_stand_side_by_side(self, cli, good, poor):
        """In JSON each with all that is said of it alone."""
        outcome = cli("evaluate", str(good), str(poor), *JSON)
        document = outcome.document
        assert (0, "skillplan.trainings/1") == (outcome.code, document["schema"])
        assert [2, 1] == [row["completed_runs"] for row in document["rows"]]
        halved = document["rows"][1]["completion"]
        assert 0.5 == halved["value"]
        assert [0.0945, 0.9055] == pytest.approx(halved["ci95"], abs=1e-4)
        assert cli("evaluate", str(good), *JSON).document["runs"] == document["rows"][0]["runs"]

    @pytest.mark.slow(reason="every run has them side by side in JSON")
    def test_the_table_has_a_row_for_each(self, cli, good, poor):
        """By its folder."""
        lines = cli("evaluate", str(good), str(poor), "--format", "csv").out.splitlines()
        assert 3 == len(lines)
        assert [str(good), str(poor)] == [line.split(",")[0] for line in lines[1:]]
        assert "50 % [9 %, 91 %]" in lines[2]

    @pytest.mark.parametrize("command", ["evaluate", "plot"])
    def test_something_else_among_them_is_refused(self, cli, good, command):
        """By name."""
        assert f"{BOARD} is not a folder of training runs" in cli(command, str(good), BOARD).refusal

    @pytest.mark.slow(reason="evaluates twice; a folder in every run")
    def test_the_document_of_a_folder_means_the_folder(self, cli, good):
        """Of training runs as of results."""
        (good / "result.json").write_text("{}")
        document = cli("evaluate", str(good), *JSON).document
        assert (
            document["runs"] == cli("evaluate", str(good / "result.json"), *JSON).document["runs"]
        )

    @pytest.mark.parametrize(
        "figure", ["success", slow_case("distances", reason="another figure in every run")]
    )
    def test_their_curves_stand_in_one_figure(self, cli, good, poor, tmp_path, figure):
        """The legend names each by its folder and solver."""
        path = tmp_path / "together.svg"
        assert 0 == cli("plot", str(good), str(poor), figure, "--out", str(path)).code
        shown = texts(path)
        assert "good: " in shown
        assert "poor: " in shown
        assert "2 trainings: inverter-board" in shown

    @pytest.mark.slow(reason="draws two figures; every run draws each by name")
    def test_without_a_name_both_figures_go_here(self, cli, good, poor, tmp_path, monkeypatch):
        """After the task; no folder of runs is written to."""
        here = tmp_path / "here"
        here.mkdir()
        monkeypatch.chdir(here)
        outcome = cli("plot", str(good), str(poor))
        names = ["inverter-board-success.png", "inverter-board-distances.png"]
        assert names == outcome.out.split()
        assert sorted(names) == sorted(path.name for path in here.iterdir())

    def test_those_of_other_tasks_are_refused(self, cli, good, motor, tmp_path):
        """They have no axis in common."""
        other = write_runs(tmp_path / "other", motor, [OPTIMAL])
        assert (
            "is of another task, 'motor-drive'"
            in cli(
                "plot", str(good), str(other), "success", "--out", str(tmp_path / "x.svg")
            ).refusal
        )
