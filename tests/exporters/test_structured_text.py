"""Structured Text: a function block that a controller can take, with a handshake a skill."""

from __future__ import annotations

import re

import pytest

from skillplan.exporters import Handover, StructuredTextExporter
from skillplan.testing import hostile_task, solved_lid


def text_of(handover: Handover) -> str:
    (text,) = StructuredTextExporter().files(handover).values()
    assert isinstance(text, str)
    return text


def test_there_is_a_step_of_the_case_for_every_skill(board):
    """In order, with the number that the task gives it, and how long it should take."""
    text = text_of(board)
    numbers = [int(item) for item in re.findall(r"SkillNumber := (\d+);", text)]
    assert numbers == [skill.step.action for skill in board.skills]
    assert re.findall(r"(?m)^    (\d+): //", text) == [str(i) for i in range(1, 16)]
    assert "SkillName := 'pick(pcb)';" in text
    assert "ExpectedTime := T#3152ms;" in text
    assert "LAST_STEP : INT := 15;" in text


def test_every_step_waits_for_its_answer_and_for_the_answer_before_to_go(board):
    """Done leads to the next step, an error to where one may retry the same."""
    steps = re.split(r"(?m)^    \d+: //", text_of(board))[1:]
    for number, step in enumerate(steps, start=1):
        assert step.count("IF NOT SkillDone AND NOT SkillError THEN") == 1
        assert "ELSIF SkillDone THEN\n            SkillExecute := FALSE;" in step
        assert f"StepNumber := {number + 1};" in step
        assert f"ErrorStep := {number};" in step
    assert "IF Retry THEN\n            StepNumber := ErrorStep;" in text_of(board)


def test_no_name_ends_a_text_or_a_comment():
    """Quotes and dollar signs are escaped, what is not ASCII is written as numbers."""
    text = text_of(solved_lid(hostile_task()))
    assert text.isascii()
    assert "SkillName := '$$$'N';" in text
    for line in text.splitlines():
        code = re.sub(r"'(?:[^'$]|\$.)*'", "''", line.partition("//")[0])
        assert "'" not in code.replace("''", "")
        assert "*)" not in code


@pytest.mark.slow(reason="blark takes seconds to make its grammar; steps and texts in every run")
class TestBlark:
    """A parser of IEC 61131-3 that is not ours."""

    @pytest.fixture(scope="class")
    def parse(self):
        blark = pytest.importorskip("blark.parse", reason="blark is not installed: skillplan[test]")
        return blark.parse_source_code

    @pytest.mark.filterwarnings("ignore")
    def test_reads_it_whatever_names_it_has_and_refuses_broken_text(self, parse):
        """So that being read means something."""
        text = text_of(solved_lid(hostile_task()))
        assert parse(text).exception is None
        assert parse(text.replace("END_CASE", "END_CAS")).exception is not None
