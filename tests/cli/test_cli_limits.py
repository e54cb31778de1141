"""When a search ends by itself, what it starts from, and what it shows meanwhile."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from skillplan.cli import format_progress, memory_size, waiting
from skillplan.solvers import Progress
from thinned import slow_case

MIB = 1024**2
EXACT = ("--solver", "exact", "--format", "json")


@pytest.fixture
def big_board(cli, tmp_path):
    """Forty parts in almost any order: exact search would need far more memory than there is."""
    path = tmp_path / "big_board.yaml"
    words = ("--parts", "40", "--density", "0.1", "--tools", "1", "--seed", "1")
    assert 0 == cli("generate", "assembly", *words, "--out", str(path)).code
    return str(path)


class TestMemorySize:
    @pytest.mark.parametrize(
        ("text", "size"),
        [
            ("2GiB", 2 * 1024**3),
            ("512MiB", 512 * MIB),
            ("1.5GB", 1_500_000_000),
            ("67108864", 64 * MIB),
            ("100 mb", 100_000_000),
            ("65536KiB", 64 * MIB),
            ("1tib", 1024**4),
            ("100000000B", 100_000_000),
        ],
    )
    def test_it_is_in_bytes_or_with_a_unit(self, text, size):
        """Of powers of 1000 or, with an i, of 1024; in any case of letters."""
        assert size == memory_size(text)

    @pytest.mark.parametrize(
        "text", ["", "GiB", "2Gib2", "two", "2 G iB", "-2GiB", "1e9", "nan", "2Gi", "\u0662GiB"]
    )
    def test_anything_else_is_refused_with_examples(self, text):
        """Also a negative size, and digits that are not those of a keyboard."""
        with pytest.raises(typer.BadParameter, match=r"is no size of memory\. Write it as 2GiB"):
            memory_size(text)

    @pytest.mark.parametrize("text", ["63MiB", "1", "0", "64MB"])
    def test_less_than_a_program_needs_is_refused(self, text):
        """The message names the least."""
        with pytest.raises(typer.BadParameter, match=f"must be at least 64MiB, not {text}"):
            memory_size(text)

    def test_an_endless_number_is_refused(self):
        """It does not become infinite."""
        with pytest.raises(typer.BadParameter, match="more memory than any machine has"):
            memory_size("9" * 400)

    @pytest.mark.parametrize("command", ["search-optimal", "compare"])
    def test_on_the_command_line_it_is_wrong_input(self, cli, board, command):
        """Exit code 2 and the option's name."""
        assert "--memory-limit" in cli(command, board, "--memory-limit", "2 apples").refusal


# In a process of its own: the peak is that of all children that have ended.
PEAK = """
import json, resource, subprocess, sys
done = subprocess.run(sys.argv[1:], capture_output=True, text=True, check=False)
factor = 1 if sys.platform == "darwin" else 1024
peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * factor
print(json.dumps([done.returncode, json.loads(done.stdout), peak]))
"""


class TestMemoryLimit:
    @pytest.mark.slow(reason="fills 64 MiB; the portfolio keeps its limit in every run")
    def test_exact_search_ends_with_a_bound_within_the_limit(self, big_board):
        """No more than 10 % above it at any time, and the most of it is used."""
        words = [sys.executable, "-m", "skillplan", "search-optimal", big_board, *EXACT]
        words += ["--memory-limit", "64MiB"]
        measuring = [sys.executable, "-c", PEAK, *words]
        done = subprocess.run(measuring, capture_output=True, text=True, check=True)
        code, document, peak = json.loads(done.stdout)
        assert (0, "solved", "memory limit") == (code, document["status"], document["reason"])
        assert 0 < document["lower_bound"] < document["cost"]
        assert 0.9 * 64 * MIB < peak < 1.1 * 64 * MIB

    def test_a_limit_that_is_met_already_leaves_no_plan(self, cli, seven):
        """The tests hold more than that: the search ends where it begins."""
        held = bytearray(b"x" * (64 * MIB))
        outcome = cli("search-optimal", seven, *EXACT, "--memory-limit", "64MiB")
        document = outcome.document
        assert (1, "unsolved") == (outcome.code, document["status"])
        assert document["reason"].startswith("memory limit")
        assert 64 * MIB == len(held)

    def test_where_it_cannot_be_kept_it_is_refused(self, cli, board, monkeypatch):
        """Rather than given up in silence."""
        monkeypatch.setattr(waiting, "measure_resident_bytes", lambda: None)
        assert (
            "--memory-limit cannot be kept"
            in cli("search-optimal", board, "--memory-limit", "1GiB").refusal
        )

    def test_a_search_that_needs_less_is_not_touched(self, cli, board):
        """It is proved as ever."""
        words = ("--memory-limit", "8GiB", "--stall", "60")
        assert "optimal" == cli("search-optimal", board, *EXACT, *words).document["status"]


class TestStall:
    def test_a_search_that_stalls_ends(self, cli, board, tmp_path):
        """Brute force has its best plan early and a bound that does not rise."""
        path = tmp_path / "patient_board.yaml"
        text = Path(board).read_text("utf-8").replace("step_limit: 20", "step_limit: 60")
        path.write_text(text, "utf-8")
        words = ("--solver", "exhaustive", "--stall", "0.3", "--format", "json")
        outcome = cli("search-optimal", str(path), *words, "--time-limit", "60")
        document = outcome.document
        assert (0, "solved", "stalled") == (outcome.code, document["status"], document["reason"])
        assert 0.3 <= document["stats"]["wall_s"] < 30

    @pytest.mark.slow(reason="two searches that stall; every run has one")
    def test_of_compare_each_solver_has_its_own(self, cli, board):
        """What one waits for is not taken from the next."""
        words = ("--solvers", "exhaustive,exact", "--stall", "30", "--memory-limit", "8GiB")
        rows = cli("compare", board, *words, "--format", "json").document["rows"]
        assert ["optimal", "optimal"] == [row["status"] for row in rows]

    @pytest.mark.parametrize("words", [("--stall", "5"), ("--memory-limit", "2GiB")])
    def test_detectors_know_no_such_limits(self, cli, board, words):
        """They search nothing."""
        assert (
            f"{words[0]} is for --solvers."
            in cli("compare", board, "--detectors", "aabb,precedence", *words).refusal
        )

    @pytest.mark.parametrize("value", ["0", "-1", "nan", "soon"])
    def test_it_is_a_time(self, cli, board, value):
        """Above 0."""
        refusal = cli("search-optimal", board, f"--stall={value}").refusal
        assert "'--stall'" in refusal
        assert value in refusal


class TestStart:
    @pytest.mark.parametrize(
        "named", ["", slow_case("result.json", reason="another name of the same file in every run")]
    )
    def test_a_search_goes_on_from_an_earlier_result(self, cli, seven, solved_within_a_gap, named):
        """By the folder or the file; the optimum is the same."""
        start = ("--start", str(solved_within_a_gap / named))
        document = cli("search-optimal", seven, *EXACT, *start).document
        assert ("optimal", "5.19890") == (document["status"], f"{document['cost']:.5f}")
        assert document["trace"]["start"].startswith("from a plan of ")

    def test_it_is_never_made_worse(self, cli, seven, solved_within_a_gap):
        """A search that finds nothing in its time hands over what it was given."""
        given = json.loads((solved_within_a_gap / "result.json").read_text("utf-8"))
        words = ("--solver", "exhaustive", "--time-limit", "0.001", "--format", "json")
        outcome = cli("search-optimal", seven, *words, "--start", str(solved_within_a_gap))
        assert (0, "solved") == (outcome.code, outcome.document["status"])
        assert given["actions"] == outcome.document["actions"]
        assert outcome.document["cost"] == pytest.approx(given["cost"], abs=1e-12)

    def test_the_table_says_so(self, cli, seven, solved_within_a_gap):
        """In a line of its own."""
        words = ("--solver", "exact", "--start", str(solved_within_a_gap))
        assert "\nstart      from a plan of " in cli("search-optimal", seven, *words).out

    def test_that_of_another_task_is_refused(self, cli, board, solved_within_a_gap):
        """The message names both."""
        words = ("--start", str(solved_within_a_gap))
        refusal = cli("search-optimal", board, *EXACT[:2], *words).refusal
        for word in ("is of another task", "generated-7-parts-2-tools-seed-1", "inverter-board"):
            assert word in refusal

    def test_that_of_the_task_before_a_change_is_replayed(self, cli, board, tmp_path):
        """Moving a part by 1 mm keeps the plan; a plan that no longer holds is not used."""
        cli("search-optimal", board, "--out", str(tmp_path / "before"))
        words = ("--start", str(tmp_path / "before"), "--format", "json")
        for change, start in (
            ("parts.clock.start_m=[0.557, -0.134]", "from a plan of 1.8"),
            ("chart=[{before: clock, after: [switch_1]}]", "the plan given is not used, it fails"),
        ):
            outcome = cli("search-optimal", board, *words, "--set", change)
            assert (0, "optimal") == (outcome.code, outcome.document["status"])
            assert outcome.document["trace"]["start"].startswith(start)

    @pytest.mark.parametrize("form", ["{plan}", "@{file}"])
    def test_a_sequence_is_a_start(self, cli, board, tmp_path, form):
        """As --sequence takes it."""
        plan, file = "0,1,4,5,2,3,8,9,10,11,6,7,13,14,15", tmp_path / "plan.txt"
        file.write_text(plan)
        words = ("--start", form.format(plan=plan, file=file), "--format", "json")
        outcome = cli("search-optimal", board, *words)
        assert outcome.document["trace"]["start"] == "from a plan of 1.88012 m"

    def test_that_without_a_plan_is_refused(self, cli, no_way, tmp_path):
        """There is nothing to start from."""
        folder = str(tmp_path / "unsolved")
        cli("search-optimal", no_way, *EXACT, "--out", folder)
        assert (
            "holds no plan, its status is infeasible"
            in cli("search-optimal", no_way, *EXACT[:2], "--start", folder).refusal
        )

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("{", "is damaged"),
            ("[]", "is no document skillplan.result/1"),
            ('{"schema": "skillplan.chart/1"}', "is no document skillplan.result/1"),
            ('{"schema": "skillplan.result/9"}', "is of another version"),
            ('{"schema": "skillplan.result/1"}', "is damaged: solver: key 'solver' is missing"),
        ],
    )
    def test_what_is_no_result_is_refused(self, cli, board, tmp_path, text, message):
        """In words, before anything is searched."""
        path = tmp_path / "other.json"
        path.write_text(text)
        assert message in cli("search-optimal", board, *EXACT[:2], "--start", str(path)).refusal

    @pytest.mark.slow(reason="solves a bench; a board goes on in every run")
    def test_a_chain_is_refused_and_its_parts_are_not(self, cli, corner, solved_corner, tmp_path):
        """By --part each task of a chain can go on from a result of its own."""
        bench, whole = corner, str(solved_corner)
        part = ("--part", "heads-1")
        folder = str(tmp_path / "part")
        cli("search-optimal", bench, *EXACT, *part, "--out", folder)
        assert 0 == cli("search-optimal", bench, *EXACT, *part, "--start", folder).code
        outcome = cli("search-optimal", bench, *EXACT, "--start", folder)
        assert (2, True) == (outcome.code, "Name one of its tasks by --part" in outcome.err)
        outcome = cli("search-optimal", bench, *EXACT, *part, "--start", whole)
        assert (2, True) == (outcome.code, "is of the whole chain" in outcome.err)
        other = ("--part", "base-1")
        outcome = cli("search-optimal", bench, *EXACT, *other, "--start", folder)
        assert (2, True) == (outcome.code, "is of 'heads-1', not of 'base-1'" in outcome.err)


class TestDisplay:
    @pytest.mark.parametrize(
        ("progress", "shown"),
        [
            (Progress(None, None, 0), "0 nodes"),
            (Progress(2.0, 1.0, 12345), "best 2.00000  bound 1.00000  gap 50.00 %  12,345 nodes"),
            (
                Progress(55.0, 54.0, 7, nodes_per_s=1234.5, decimals=0),
                "best 55  bound 54  gap 1.82 %  7 nodes  1,234 nodes/s",
            ),
            (Progress(None, 54.9, 7, decimals=0), "bound 54  7 nodes"),
            (Progress(None, 54.999999999, 7, decimals=0), "bound 55  7 nodes"),
            (Progress(None, float("-inf"), 7), "7 nodes"),
        ],
    )
    def test_it_shows_cost_bound_gap_nodes_and_speed(self, progress, shown):
        """With the decimals of the task; a bound is never rounded up."""
        assert shown == format_progress(progress)


def test_solvers_are_told_how_many_processes_they_may_use(cli, board, install):
    """By --jobs; one by default."""
    source = '''
        from skillplan import Solution, Solver

        class Counting(Solver):
            """Say how many processes there may be."""

            name = "counting"

            def solve(self, model, *, seed=0):
                return Solution(trace={"jobs": self.jobs})
    '''
    install("solver", "counting", "counting_solver:Counting", source)
    words = ("search-optimal", board, "--solver", "counting", "--format", "json")
    assert 1 == cli(*words).document["trace"]["jobs"]
    assert 3 == cli(*words, "--jobs", "3").document["trace"]["jobs"]
