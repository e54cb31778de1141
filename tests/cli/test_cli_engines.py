"""compare --engines: how often engines agree, and both pieces of evidence where they do not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

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
