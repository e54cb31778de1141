"""`--set KEY=VALUE`: a task file is read as if it held other values."""

from __future__ import annotations

from typing import Any

import pytest

from skillplan.domains import apply_changes
from skillplan.errors import OptionError, TaskError
from skillplan.files import parse
from skillplan.pipeline import load_problem

TEXT = """\
kind: swarmitfix
name: goals
base: {home: C66, goals: [C42, C29]}
heads:
"""


@pytest.fixture
def document():
    return parse(TEXT, "task.yaml")


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "task.yaml"
    file.write_text(TEXT.replace("heads:\n", ""))
    return file


class TestValues:
    @pytest.mark.parametrize(
        ("key", "text", "value"),
        [
            ("name", "other", "other"),
            ("base.home", "C1", "C1"),
            ("base.goals.1", "C1", ["C42", "C1"]),
            ("base.goals", "[C1]", ["C1"]),
            ("bench.pitch_m", "1e-1", 0.1),
            ("bench", "{rows: 3, cols: 5}", {"rows": 3, "cols": 5}),
            ("heads.step_m", "0.05", 0.05),
            ("pkm.leg_limits_m.A", "[0.2, 0.3]", [0.2, 0.3]),
            ("step_limit", "null", None),
            ("description", '"7"', "7"),
            ("description", "a=b", "a=b"),
        ],
    )
    def test_a_value_is_yaml_at_a_path(self, document, key, text, value):
        """Mappings on the way are made where there are none."""
        here: Any = apply_changes(document, {key: text}).data
        for step in [step for step in key.split(".") if not step.isdigit()]:
            here = here[step]
        assert value == here

    def test_the_file_s_own_content_stays_as_it_is(self, document):
        apply_changes(document, {"base.goals.0": "C1", "base.home": "C2"})
        assert {"home": "C66", "goals": ["C42", "C29"]} == document.data["base"]

    def test_without_changes_nothing_is_copied(self, document):
        assert document is apply_changes(document, {})

    def test_the_task_is_the_one_so_described(self, path):
        """Goal, start and hash; the same change written into the file gives the same."""
        changed = load_problem(path, None, {"base.goals.0": "C1", "base.home": "C20"})
        assert {"at(C20)"} == set(changed.tasks[0].initial)
        assert changed.sha256 != load_problem(path).sha256
        path.write_text(path.read_text().replace("C42", "C1").replace("C66", "C20"))
        assert changed.sha256 == load_problem(path).sha256


class TestFaults:
    @pytest.mark.parametrize(
        ("key", "text", "message"),
        [
            ("base.goals.2", "C1", "base.goals is a list of 2; give an index from 0 to 1"),
            ("base.goals.first", "C1", "instead of 'first'"),
            ("base.goals.-1", "C1", "instead of '-1'"),
            ("base.goals.\u0661", "C1", "is a list of 2"),
            ("base.goals." + "9" * 5000, "C1", "is a list of 2"),
            ("base.home.name", "C1", "base.home is a single value and has no keys"),
            ("name", "[", "--set name"),
            ("name", "a\0b", "--set name"),
            ("name", "*alias", "--set name"),
            ("name", "!!python/object:os.system x", "--set name"),
            (".".join("a" * 33), "1", "more than 32 keys deep"),
        ],
        ids=lambda text: text[:24],
    )
    def test_a_change_that_does_not_fit_is_told(self, document, key, text, message):
        with pytest.raises(OptionError) as raised:
            apply_changes(document, {key: text})
        assert message in str(raised.value)
        assert len(str(raised.value)) < 400

    def test_an_empty_list_has_no_index(self, tmp_path):
        document = parse("kind: swarmitfix\nbase: {goals: []}\n", "task.yaml")
        with pytest.raises(OptionError, match=r"base\.goals is an empty list"):
            apply_changes(document, {"base.goals.0": "C1"})

    def test_a_key_that_the_schema_does_not_know_is_its_fault(self, path):
        """Told like one of the file, with the nearest known key."""
        with pytest.raises(TaskError, match=r"base\.hoem: unknown key 'hoem'. Did you mean 'home'"):
            load_problem(path, None, {"base.hoem": "C1"})

    def test_a_value_that_is_wrong_is_told_of_no_line(self, path):
        """It does not stand in the file."""
        with pytest.raises(TaskError) as raised:
            load_problem(path, None, {"base.home": "C99"})
        (issue,) = raised.value.issues
        assert (("base", "home"), 0) == (issue.path, issue.line)
        assert "position 'C99' is not on" in issue.message
        assert issue.message.endswith("That is what --set says.")

    def test_a_file_that_is_no_mapping_is_its_own_fault(self, tmp_path):
        path = tmp_path / "task.yaml"
        path.write_text("[1]\n")
        with pytest.raises(TaskError, match="must be a mapping"):
            load_problem(path, None, {"a": "1"})
