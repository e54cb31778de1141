"""compare --engines: how often engines agree, and both pieces of evidence where they do not."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, ClassVar

import jsonschema
import pytest
import yaml

from same_process import SameProcess
from skillplan.collision import AabbDetector
from skillplan.pipeline import registry
from skillplan.workers import Prepare, Worker
from tabular_learner import learner_installed

DOCUMENTS = Path(__file__).parents[2] / "docs" / "reference" / "documents"

# Refuses one skill, whatever the state.
DOUBTER = '''
    from pydantic import Field

    from skillplan import Engine, Verdict
    from skillplan.task import back_end

    class Doubter(Engine):
        """Trusts everything but one skill."""

        name = "doubter"

        class Options(back_end.Options):
            """Options of the doubter."""

            skill: str = Field(default="place(clock)", description="what it doubts [-]")

        def check(self, skill, state):
            none = state.facts.none
            if skill.name == self.options.skill:
                return Verdict.infeasible("hardly", none, none, {"doubt": 0.5})
            return Verdict.feasible(none, none)
'''

# Doubts the same, and draws what it doubts.
SKETCHER = (
    DOUBTER.replace('"doubter"', '"sketcher"')
    + '''
    from skillplan.physics.performance import Image, Performer

    class Sketcher(Doubter, Performer):
        """Draws a dark square."""

        def picture(self, skill, state):
            return Image(8, 8, bytes(192))

        def footage(self, skill, state, frames_per_s):
            raise NotImplementedError

        def perform(self, skills, **_):
            raise NotImplementedError
'''
)


@pytest.fixture
def doubter(install):
    """An engine that differs from the kinematic one on a skill."""
    install("physics", "doubter", "doubting_engine:Doubter", DOUBTER)
    return "doubter"


def compared(cli: Any, board: str, *words: str) -> Any:
    return cli("compare", board, "--engines", "kinematic,doubter", *words)


def test_a_contradiction_is_listed_once_with_what_both_say(cli, board, doubter):
    """In the first state in which it was met, and how many there are; the document is described."""
    document = compared(cli, board, "--format", "json").document
    described = yaml.safe_load((DOCUMENTS / "agreement.yaml").read_text())
    jsonschema.validate(document, described)
    (result,) = document["contradictions"]
    assert result["skill"] == "place(clock)"
    assert result["verdicts"]["kinematic"]["status"] == "feasible"
    message = result["verdicts"]["doubter"]
    assert (message["reason"], message["evidence"]) == ("hardly", {"doubt": 0.5})
    stages = {stage["stage"] for stage in message["stages"]}
    assert {"precondition", "doubter"} <= stages
    assert "precedence" not in stages
    assert document["complete"]
    assert document["questions"] == document["agree"] + result["states"]
    assert set(document["seconds"]) == {"kinematic", "doubter"}


def test_contradictions_are_drawn_by_each_engine_that_can(cli, board, install, tmp_path):
    """A file a contradiction and engine, which the document and the table name."""
    install("physics", "sketcher", "sketching_engine:Sketcher", SKETCHER)
    words = ("compare", board, "--engines", "kinematic,sketcher", "--pictures")
    document = cli(*words, str(tmp_path / "drawn"), "--format", "json").document
    (result,) = document["contradictions"]
    assert result["pictures"] == {"sketcher": str(tmp_path / "drawn" / "001-sketcher.png")}
    assert Path(result["pictures"]["sketcher"]).read_bytes().startswith(b"\x89PNG")
    assert "001-sketcher.png" in cli(*words, str(tmp_path / "again")).out.replace("\n", "")


def test_what_one_engine_grants_is_followed(cli, board, doubter):
    """So that as much is asked as without the doubt."""
    trusting = compared(cli, board, "-O", "doubter.skill=none", "--format", "json").document
    doubting = compared(cli, board, "--format", "json").document
    assert trusting["contradictions"] == []
    assert trusting["questions"] == trusting["agree"] == doubting["questions"]


def test_the_table_names_engines_reasons_and_seconds(cli, board, doubter):
    """Contradictions first, the summary last."""
    outcome = compared(cli, board)
    contradictions, _, summary = outcome.out.partition("engines on the same questions")
    assert outcome.code == 0
    assert "hardly" in contradictions
    assert "place(clock)" in contradictions
    assert "seconds" in summary
    assert "agree" in summary


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--engines", "kinematic"), "--engines needs two engines at least"),
        (("--engines", "kinematic,bulet"), "Unknown physics 'bulet'."),
        (("--engines", "a,b", "--solvers", "exact"), "Give one of --solvers, --detectors and"),
        (
            ("--engines", "a,b", "--physics", "kinematic"),
            "--physics is for --solvers; name engines",
        ),
        (("--engines", "a,b", "--warm"), "--warm is for --solvers."),
        (("--solvers", "exact", "--pictures", "d"), "--pictures is for --engines."),
    ],
)
def test_what_does_not_go_together_is_refused(cli, board, words, message):
    """One message, exit code 2."""
    assert message in cli("compare", board, *words).refusal


# `--executor`: where the processes of `--jobs` are.


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--executor", "lokal"], "Unknown executor 'lokal'. Did you mean 'local'?"),
        (["--executor", "local:here"], "The executor 'local' takes no address"),
        (["--executor", "local:"], "no address follows the colon"),
        (["--executor", "local", "-O", "local.slots=3"], "has no option 'slots'"),
    ],
)
@pytest.mark.parametrize("command", ["search-optimal", "cache fill", "compare", "sweep"])
def test_a_wrong_one_is_refused_before_anything_is_done(cli, board, command, words, message):
    """In one line, by every command that has jobs."""
    more = ["--solvers", "exact"] if command == "compare" else []
    assert message in cli(*command.split(), board, *more, *words).refusal


class Noted(SameProcess):
    """An executor of somebody else's: it notes what it was asked for."""

    name = "noted"
    takes_address = True
    started: ClassVar[list[str]] = []

    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        self.started.append(f"{what}, {self.slots} at {self.address}")
        return super().start(prepare, content, what)


@pytest.fixture
def noted(monkeypatch):
    """What it was asked for; checks by boxes are worth a process meanwhile."""
    known = registry.load
    monkeypatch.setattr(
        registry, "load", lambda kind, name: Noted if name == "noted" else known(kind, name)
    )
    monkeypatch.setattr(Noted, "started", [])
    monkeypatch.setattr(AabbDetector, "expensive", True)
    return Noted.started


@pytest.mark.slow(reason="a command each; checks, searches and studies by themselves in every run")
@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("search-optimal BOARD --collision aabb --no-cache", "checks, 2 at there"),
        ("chart BOARD --collision aabb", "checks, 2 at there"),
        ("cache fill BOARD --collision aabb", "checks, 2 at there"),
        ("cache verify BOARD --collision aabb", "checks, 2 at there"),
        ("compare BOARD --solvers exact,value-iteration", "the comparison, 2 at there"),
        ("compare GENERATED --solvers exact,value-iteration", "the comparison, 2 at there"),
        ("sweep BOARD --solver exact --runs 2", "the runs, 2 at there"),
        ("sweep GENERATED --solver exact --runs 2 --collision precedence", "the runs, 2 at there"),
        ("train BOARD --solver tabular --runs 2 --steps 100", "the training, 2 at there"),
        ("train GENERATED --solver tabular --runs 2 --steps 100", "the training, 2 at there"),
    ],
)
def test_every_command_that_has_jobs_gives_them_to_the_executor(
    cli, board, noted, tmp_path, monkeypatch, words, what
):
    """On generated boards, too; and of as many slots as there are jobs."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))
    generated = str(tmp_path / "generated.yaml")
    if "GENERATED" in words:
        cli(*["generate", "assembly", "--parts", "5", "--density", "0.3", "--out"], generated)
    if "verify" in words:
        cli("cache", "fill", board, "--collision", "aabb")
    paths = {"BOARD": board, "GENERATED": generated}
    call = [paths.get(word, word) for word in words.split()]
    call += ["--out", str(tmp_path / "out")] if call[0] in ("train", "sweep") else []
    with learner_installed(tmp_path / "site", monkeypatch):
        outcome = cli(*call, "--jobs", "2", "--executor", "noted:there")
    assert outcome.code in (0, 1), outcome.err
    assert {what} == set(noted)


# The command line on benches whose machine does not reach every support.


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
