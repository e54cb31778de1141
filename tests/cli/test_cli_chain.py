"""The command line on chains of tasks: what is saved, shown, compared, and how it ends."""

import contextlib
import csv
import io
import json
from pathlib import Path

import pytest

from skillplan.cli import main
from thinned import thinned

CONFIGS = Path(__file__).parents[2] / "configs"
POLYGONAL = str(CONFIGS / "swarmitfix_polygonal.yaml")
CURVE = str(CONFIGS / "swarmitfix_open_curve.yaml")
TRIANGLE = str(CONFIGS / "swarmitfix_triangular.yaml")
CASES = str(CONFIGS / "swarmitfix_cases.yaml")
SOLVERS = ("sarsa", "monte-carlo", "policy-iteration", "csp", "exact")
TABLE_3 = [2, 1, 1, 0, 0, 0, 4, 0, 0, 3, 0, 2, 2, 1, 1, 0]
RESULT_KEYS = {
    *("schema", "task", "solver", "seed", "physics", "collision", "status", "reason", "cost"),
    *("cost_unit", "lower_bound", "gap", "makespan", "makespan_s", "skills", "actions", "steps"),
    *("stats", "trace", "sequences", "stages", "bench", "timeline"),
}


@pytest.fixture(scope="module")
def goals(tmp_path_factory):
    """Two ways: C66 to C42 to C29."""
    path = tmp_path_factory.mktemp("goals") / "goals.yaml"
    path.write_text("kind: swarmitfix\nname: goals\nbase: {home: C66, goals: [C42, C29]}\n")
    return str(path)


@pytest.fixture(scope="module")
def policies(solved, goals, tmp_path_factory):
    """What policy iteration learned for both goals."""
    folder = tmp_path_factory.mktemp("learned") / "run"
    return str(solved(folder, goals, "--solver", "policy-iteration") / "policies.json")


class TestSearch:
    @pytest.mark.slow(reason="a search; one of a chain as a table in every run")
    def test_json_is_one_document_with_every_sequence(self, cli):
        """The keys of any result, and start, goal and path of every way."""
        outcome = cli("search-optimal", POLYGONAL, "--format", "json")
        assert (0, "") == (outcome.code, outcome.err)
        document = outcome.document
        assert set(document) >= RESULT_KEYS
        assert ("optimal", 17.0, "steps") == (
            document["status"],
            document["cost"],
            document["cost_unit"],
        )
        sequences = document["sequences"]
        assert TABLE_3 == [sequence["makespan"] for sequence in sequences]
        assert TABLE_3 == [sequence["optimum"] for sequence in sequences]
        for sequence in sequences:
            assert (sequence["start"], sequence["goal"]) == (
                sequence["path"][0],
                sequence["path"][-1],
            )
        assert ["goals"] == [stage["name"] for stage in document["stages"]]

    def test_the_table_shows_supports_and_then_every_way(self, cli):
        outcome = cli("search-optimal", POLYGONAL)
        supports, ways = outcome.out.split("polygonal: exact")
        assert "C42" in supports
        assert "C66 B2 C54 B2 C42" in ways
        assert "cost       17 steps  (lower bound 17 steps, gap 0.00 %)" in ways

    def test_out_saves_plan_result_and_timeline(self, cli, corner, tmp_path):
        """Exact search has no policy to save."""
        folder = tmp_path / "out"
        shown = cli("search-optimal", corner, "--out", str(folder), "--format", "json").document
        assert {"result.json", "plan.csv", "timeline.csv"} == {p.name for p in folder.iterdir()}
        saved = json.loads((folder / "result.json").read_text("utf-8"))
        assert shown == saved
        plan = list(csv.DictReader(io.StringIO((folder / "plan.csv").read_text("utf-8"))))
        parts = [*saved["stages"], *saved["sequences"]]
        assert [part["name"] for part in parts] == [row["task"] for row in plan]
        timeline = list(csv.DictReader(io.StringIO((folder / "timeline.csv").read_text("utf-8"))))
        assert len(saved["timeline"]) == len(timeline)

    @pytest.mark.slow(reason="learns; the planner saves its own in every run")
    def test_a_learner_saves_its_policies(self, policies):
        """One for every goal."""
        document = json.loads(Path(policies).read_text("utf-8"))
        assert "skillplan.policy/1" == document["schema"]
        assert [["at(C42)"], ["at(C29)"]] == [entry["goal"] for entry in document["policies"]]

    @pytest.mark.slow(reason="solves a whole sheet; a value of a board is set in every run")
    def test_a_value_may_be_set_beside_the_file(self, cli):
        """Another rule for the goals: not the optimum, and said to be so."""
        words = ("--set", "base.goal_choice=nearest-centroid", "--set", "base.home=C78")
        document = cli("search-optimal", TRIANGLE, *words, "--format", "json").document
        assert ("solved", "nearest-centroid") == (document["status"], document["goal_choice"])
        assert "C78" == document["sequences"][0]["start"]
        assert document["bound_given_stages_before"] < document["cost"]
        assert not document["proved_by_level"]

    def test_a_stage_may_have_its_own_solver(self, cli, goals):
        words = ("--solver", "base=policy-iteration", "--format", "json")
        document = cli("search-optimal", goals, *words).document
        assert {"policy-iteration"} == {entry["solver"] for entry in document["sequences"]}

    @pytest.mark.slow(reason="solves twice; from Python in every run")
    def test_the_same_seed_gives_the_same_result(self, cli, goals):
        """All but the seconds."""
        words = ("--solver", "sarsa", "-O", "episodes=500", "--seed", "3", "--format", "json")
        first, other = (cli("search-optimal", goals, *words).document for _ in range(2))
        assert [s["path"] for s in first["sequences"]] == [s["path"] for s in other["sequences"]]
        assert first["stats"]["expanded"] == other["stats"]["expanded"]


@pytest.fixture(scope="module")
def table_3():
    """Table 3 of the paper, by five solvers."""
    out = io.StringIO()
    words = ["compare", POLYGONAL, "--solvers", ",".join(SOLVERS), "--format", "json"]
    with contextlib.redirect_stdout(out), pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    return json.loads(out.getvalue())


class TestCompare:
    @pytest.mark.slow(
        reason="learns with every solver of the table; every run compares fewer on the board"
    )
    def test_every_solver_has_a_row(self, table_3):
        assert "skillplan.comparison/1" == table_3["schema"]
        assert list(SOLVERS) == [row["solver"] for row in table_3["rows"]]
        assert all(set(row) >= RESULT_KEYS - {"timeline"} for row in table_3["rows"])

    @pytest.mark.slow(reason="four solvers of a bench; each alone in every run")
    def test_the_makespans_of_table_3_come_out(self, table_3):
        """By every solver that learns or proves."""
        for row in table_3["rows"]:
            if row["solver"] != "csp":
                assert TABLE_3 == [sequence["makespan"] for sequence in row["sequences"]]
                assert 17.0 == row["cost"]

    @pytest.mark.slow(reason="a whole comparison; the rule by itself in every run")
    def test_the_csp_fails_as_in_the_paper(self, cli):
        outcome = cli("compare", POLYGONAL, "--solvers", "csp", "--format", "json")
        assert 1 == outcome.code
        (row,) = outcome.document["rows"]
        assert ("unsolved", None, []) == (row["status"], row["cost"], row["sequences"])
        assert row["reason"].startswith("goals: nothing that ")

    def test_the_table_has_all_sequences_side_by_side(self, cli, goals):
        outcome = cli("compare", goals, "--solvers", "exact,policy-iteration", "--format", "csv")
        rows = list(csv.DictReader(io.StringIO(outcome.out)))
        assert [("C66", "C42", "2", "2"), ("C42", "C29", "1", "1")] == [
            (r["from"], r["to"], r["exact makespan"], r["policy-iteration makespan"]) for r in rows
        ]

    @pytest.mark.slow(reason="solves a bench; as JSON in every run")
    def test_nothing_solved_is_exit_code_1(self, cli):
        outcome = cli("compare", POLYGONAL, "--solvers", "csp")
        assert 1 == outcome.code
        assert "csp: goals: nothing that" in outcome.out


class TestPolicies:
    def test_a_stored_policy_answers_from_elsewhere(self, cli, goals, policies):
        """Without learning again, and as shortly as can be proved."""
        words = ("--policy", policies, "--part", "base-1", "--from", "C20", "--format", "json")
        outcome = cli("evaluate", goals, *words)
        document = outcome.document
        assert (0, True, 3.0) == (outcome.code, document["complete"], document["cost"])
        assert 0.0 == document["deviation"]

    def test_it_answers_for_the_file_s_own_start(self, cli, goals, policies):
        words = ("--policy", policies, "--part", "base-2", "--format", "json")
        assert 1.0 == cli("evaluate", goals, *words).document["cost"]

    @pytest.mark.parametrize(
        ("words", "message"),
        thinned(
            [
                (("--part", "base-1"), "Give either --sequence or --policy."),
                (("--part", "base-1", "--sequence", "B2", "--policy", "FILE"), "Give either"),
                (("--part", "base-1", "--policy", "none.json"), "cannot be read: No such file"),
                (("--part", "base-1", "--policy", "FILE", "--from", "C99"), "C99"),
                (("--part", "base-1", "--policy", "FILE", "--from", ""), "names no fact"),
                (("--part", "base-1", "--policy", "TASK"), "is not JSON"),
                (
                    ("--part", "base-1", "--policy", "FILE", "--set", "base.goals.0=C1"),
                    "holds no policy for at(C1), only for at(C42); at(C29).",
                ),
                (
                    ("--part", "base-1", "--policy", "FILE", "--set", "bench.actions=13"),
                    "was learned on a task with other skills than base-1. Learn again",
                ),
            ],
            (("--part", "base-1", "--policy", "TASK"), "is not JSON"),
            (("--part", "base-1"), "Give either --sequence or --policy."),
        ),
    )
    def test_a_wrong_question_is_one_clear_message(self, cli, goals, policies, words, message):
        given = [{"FILE": policies, "TASK": goals}.get(word, word) for word in words]
        outcome = cli("evaluate", goals, *given)
        assert (2, "", 1) == (outcome.code, outcome.out, len(outcome.err.splitlines()))
        assert message in outcome.err


class TestParts:
    @pytest.mark.parametrize(
        "words", [("evaluate", "--sequence", "B2"), ("explain", "B2")], ids=lambda words: words[0]
    )
    def test_without_a_part_the_names_are_told(self, cli, words):
        """All of a short chain, both ends of a long one."""
        command, *rest = words
        refusal = cli(command, POLYGONAL, *rest).refusal
        assert (
            f"skillplan: error: {POLYGONAL}: describes 17 tasks in a chain; name one by --part, "
            "in Python by `part`: goals, base-1, base-2, base-3, ..., base-14, base-15, base-16.\n"
        ) == refusal

    def test_an_unknown_part_is_told_with_the_nearest(self, cli, goals):
        refusal = cli("explain", goals, "B2", "--part", "base1").refusal
        assert "No task 'base1'" in refusal
        assert "Did you mean 'base-1'?" in refusal

    def test_a_file_of_one_task_needs_no_part(self, cli):
        """C20 to C1, the first of the paper's five cases."""
        outcome = cli("evaluate", CASES, "--sequence", "B1,B9,B9,B9", "--format", "json")
        assert (0, 4.0) == (outcome.code, outcome.document["cost"])

    @pytest.mark.parametrize(
        ("sequence", "code", "expected"),
        [
            ("B2,B2", 0, (True, True, None)),
            ("2,2", 0, (True, True, None)),
            ("B2", 1, (True, False, "goal")),
            ("B4,B4", 1, (False, False, "precondition")),
        ],
    )
    def test_a_sequence_of_a_part_is_replayed(self, cli, goals, sequence, code, expected):
        """Complete, incomplete, and off the bench."""
        words = ("--sequence", sequence, "--part", "base-1", "--format", "json")
        outcome = cli("evaluate", goals, *words)
        document = outcome.document
        stages = [violation["stage"] for violation in document["violations"]]
        assert code == outcome.code
        assert expected == (
            document["feasible"],
            document["complete"],
            stages[0] if stages else None,
        )

    def test_a_swing_is_explained(self, cli, goals):
        """B4 would leave the bench at C66; B2 does not."""
        assert 0 == cli("explain", goals, "B2", "--part", "base-1").code
        outcome = cli("explain", goals, "B4", "--part", "base-1", "--format", "json")
        assert 1 == outcome.code
        assert cli("explain", goals, "B4", "--part", "base-1", "--after", "B2").code == 0


class TestCheck:
    def test_every_task_of_the_chain_is_listed(self, cli):
        document = cli("check", CURVE, "--format", "json").document
        names = [task["name"] for task in document["tasks"]]
        assert ["heads-1", "heads-2", "heads-3", "goals", "base-1"] == names[:5]
        assert document["valid"]


class TestExitCodes:
    @pytest.mark.slow(
        reason="plans a sheet in vain; the comparison tells the same reason in every run"
    )
    def test_no_goals_is_1_with_the_reason(self, cli):
        outcome = cli("search-optimal", POLYGONAL, "--solver", "csp", "--format", "json")
        assert (1, "unsolved") == (outcome.code, outcome.document["status"])
        assert outcome.document["reason"].startswith("goals: nothing that ")

    def test_no_time_is_1(self, cli):
        words = ("--time-limit", "0.000001", "--format", "json")
        outcome = cli("search-optimal", POLYGONAL, *words)
        assert (1, "unsolved") == (outcome.code, outcome.document["status"])
        assert "time limit" in outcome.document["reason"]

    def test_a_lie_is_2(self, cli, goals, lying_solver):
        """What the referee refutes in one part, it refutes for the chain."""
        outcome = cli("search-optimal", goals, "--solver", lying_solver, "--format", "json")
        assert (2, "wrong") == (outcome.code, outcome.document["status"])
        assert outcome.document["reason"].startswith("base-1: ")

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("--solver", "exat"), "Did you mean 'exact'?"),
            (("--solver", "bases=exact"), "No stage 'bases' in this task. Did you mean 'base'?"),
            (("--solver", "base=exat"), "Did you mean 'exact'?"),
            (("--solver", "base="), "solver"),
            (("--set", "base.home"), "must have the form KEY=VALUE"),
            (("--set", "=C1"), "must have the form KEY=VALUE"),
            (("--set", "base..home=C1"), "must have the form KEY=VALUE"),
            (("--set", "base.goals.7=C1"), "is a list of 2; give an index from 0 to 1"),
            (("--set", "base.hom=C1"), "unknown key 'hom'. Did you mean 'home'?"),
            (("--set", "kind=assemblies"), "unknown kind 'assemblies'. Did you mean 'assembly'?"),
            (("-O", "episodes=5"), "episodes"),
            (("-O", "sarsa.episodes=5"), "No plugin 'sarsa' takes part in this run."),
            (("--solver", "sarsa", "-O", "episodes=0"), "episodes"),
        ],
    )
    def test_a_wrong_word_is_2_and_one_clear_message(self, cli, goals, words, message):
        assert message in cli("search-optimal", goals, *words).refusal


class TestFleetMakespan:
    """The makespan of a fleet is a number of parallel steps, with a bound of its own."""

    @pytest.mark.parametrize(
        ("objective", "skills", "makespan"),
        [
            ("swings", 11, "5 parallel steps, 58.2 s (lower bound 4, gap 20.00 %)"),
            (
                "makespan",
                12,
                "4 parallel steps, 50.7 s (lower bound 4, gap 0.00 %, proved to be the least)",
            ),
        ],
    )
    def test_it_is_shown_with_its_proof(self, cli, tmp_path, objective, skills, makespan):
        """Fewer parallel steps may take more swings."""
        path = tmp_path / "fleet.yaml"
        path.write_text(
            "kind: swarmitfix\nname: f\nrobots:\n  r0: {home: C27, goal: C21}\n"
            "  r1: {home: C48, goal: C55}\n  r2: {home: C19, goal: C30}\n"
        )
        outcome = cli("search-optimal", str(path), "-O", f"objective={objective}")
        assert 0 == outcome.code
        message = " ".join(outcome.out.split())
        assert f"plan {skills} skills makespan {makespan}" in message
