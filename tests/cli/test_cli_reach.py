"""The command line on benches whose machine does not reach every support."""

import json
import shutil
from pathlib import Path

import pytest

CONFIGS = Path(__file__).parents[2] / "configs"
POLYGONAL = str(CONFIGS / "swarmitfix_polygonal.yaml")
OUT_OF_REACH = """\
kind: swarmitfix
name: edge
trajectory: {vertices_m: [[0.6, 0.6], [0.06, 0.12], [0.6, 0.3]]}
heads: {max_gap_m: 0.25, step_m: 0.05}
base: {home: C66, side: left}
"""
FIRST = (
    "support 4 of 6, at (0.06, 0.12) m, is beyond the legs from every position: C68 comes nearest, "
    "and there leg A must be 0.324 m long, 2 mm more than its limit of 0.322 m"
)


@pytest.fixture
def edge(tmp_path):
    """A path to a corner of the bench that no position reaches."""
    path = tmp_path / "edge.yaml"
    path.write_text(OUT_OF_REACH)
    return str(path)


@pytest.fixture(scope="module")
def polygonal(solved, tmp_path_factory):
    """The paper's polygonal trajectory, solved as it is."""
    return Path(solved(tmp_path_factory.mktemp("reach") / "run", POLYGONAL))


@pytest.fixture(scope="module")
def former(solved, corner, tmp_path_factory):
    """A result of a file that says nothing about reach, as an earlier version wrote it."""
    folder = tmp_path_factory.mktemp("former") / "run"
    solved(folder, corner, "--set", "base.reachable=preferred")
    document = json.loads((folder / "result.json").read_text("utf-8"))
    document["origin"]["set"] = {}
    del document["reachable"]
    for part in (document, *document["sequences"], *document["stages"]):
        part.pop("dwells_from", None)
    (folder / "result.json").write_text(json.dumps(document), "utf-8")
    return folder


class TestNoPlan:
    @pytest.mark.parametrize("solver", ["exact", "csp", "policy-iteration"])
    def test_the_first_support_out_of_reach_is_named_and_the_exit_code_is_1(
        self, cli, edge, solver
    ):
        outcome = cli("search-optimal", edge, "--solver", solver, "--format", "json")
        assert 1 == outcome.code
        assert ("infeasible", f"goals: {FIRST}") == (
            outcome.document["status"],
            outcome.document["reason"],
        )
        unreachable = outcome.document["unreachable"]
        assert (4, "C68", "A") == (
            unreachable["support"],
            unreachable["nearest"],
            unreachable["pkm"]["leg"],
        )
        assert 0.001 < unreachable["pkm"]["excess_m"] < 0.003

    def test_check_warns_of_it(self, cli, edge):
        outcome = cli("check", edge)
        assert 0 == outcome.code
        message = " ".join(outcome.out.split())
        assert f"edge.yaml:3:1: trajectory: no plan exists: {FIRST}." in message

    def test_a_figure_says_why_nothing_is_drawn(self, cli, edge, tmp_path):
        outcome = cli("plot", edge, "placement", "--out", str(tmp_path / "x.png"))
        assert 1 == outcome.code
        assert FIRST in outcome.err

    def test_verify_tries_every_position_again(self, cli, edge, tmp_path):
        folder = tmp_path / "run"
        assert 1 == cli("search-optimal", edge, "--out", str(folder)).code
        outcome = cli("verify", str(folder), "--format", "json")
        assert 0 == outcome.code
        claims = {claim["claim"]: claim for claim in outcome.document["claims"]}
        assert ("holds", "no position reaches support 4") == (
            claims["reach"]["outcome"],
            claims["reach"]["detail"],
        )

    def test_a_support_that_the_paper_s_rules_reach_is_planned_if_reach_is_ignored(self, cli, edge):
        """Eqs 1-4 do not know the legs; the result counts what they do not reach."""
        words = ("--set", "base.reachable=ignored", "--set", "base.reach_m=[0.3, 0.5]")
        outcome = cli("search-optimal", edge, *words, "--format", "json")
        assert 0 == outcome.code
        beyond = outcome.document["supports_beyond_leg_limits"]
        assert beyond > 0
        (sentence,) = [s for s in outcome.document["not_checked"] if s.startswith("reach:")]
        assert (
            f"{beyond} of {len(outcome.document['goals'])} supports lie beyond the legs" in sentence
        )


class TestVerify:
    def test_the_paper_s_plan_is_valid_and_its_reach_not_checked(self, cli, polygonal):
        outcome = cli("verify", str(polygonal))
        assert 0 == outcome.code
        assert "not checked: reach" in " ".join(outcome.out.split())

    def test_a_plan_beyond_the_legs_is_refuted_where_reach_is_required(
        self, cli, polygonal, tmp_path
    ):
        """The paper's plan, passed off as one of the task that requires reach."""
        words = ("--set", "base.reachable=required", "--format", "json")
        expected = cli("search-optimal", POLYGONAL, *words).document
        forged = Path(shutil.copytree(polygonal, tmp_path / "forged"))
        text = (forged / "result.json").read_text("utf-8")
        document = json.loads(text)
        text = text.replace(document["task"]["sha256"], expected["task"]["sha256"])
        document = json.loads(text)
        document["origin"]["set"] = expected["origin"]["set"]
        document["reachable"], document["supports_beyond_leg_limits"] = "required", 0
        (forged / "result.json").write_text(json.dumps(document), "utf-8")
        outcome = cli("verify", str(forged))
        assert 1 == outcome.code
        assert "NOT VALID: goals: plan" in outcome.out

    @pytest.mark.parametrize(
        ("key", "value"), [("reachable", "required"), ("supports_beyond_leg_limits", 0)]
    )
    def test_a_count_or_rule_that_is_changed_is_noticed(self, cli, polygonal, tmp_path, key, value):
        forged = Path(shutil.copytree(polygonal, tmp_path / "forged"))
        document = json.loads((forged / "result.json").read_text("utf-8"))
        document[key] = value
        (forged / "result.json").write_text(json.dumps(document), "utf-8")
        outcome = cli("verify", str(forged))
        assert 1 == outcome.code
        assert "NOT VALID: record" in outcome.out


def test_the_former_key_is_read_with_a_note(cli, tmp_path):
    text = (
        Path(POLYGONAL).read_text("utf-8").replace("reachable: ignored", "prefer_reachable: false")
    )
    path = tmp_path / "old.yaml"
    path.write_text(text)
    outcome = cli("search-optimal", str(path), "--format", "json")
    assert (0, 17) == (outcome.code, outcome.document["cost"])
    assert "base.prefer_reachable: is read as reachable: ignored" in outcome.err


class TestResultsOfEarlierVersions:
    """Their default was `preferred`, which their hash stands for."""

    def test_they_are_verified_with_the_default_of_their_time(self, cli, former):
        outcome = cli("verify", str(former))
        assert (0, "") == (outcome.code, outcome.err)

    def test_they_are_reported_with_the_default_of_their_time(self, cli, former, tmp_path):
        outcome = cli("report", str(former), "--out", str(tmp_path / "page.html"))
        assert 0 == outcome.code, outcome.err

    def test_a_file_that_changed_is_another_task(self, cli, corner, former, tmp_path):
        changed = tmp_path / "corner.yaml"
        text = Path(corner).read_text("utf-8")
        changed.write_text(text.replace("max_gap_m: 0.25", "max_gap_m: 0.24"), "utf-8")
        assert "has changed since" in cli("verify", str(former), "--task", str(changed)).refusal
