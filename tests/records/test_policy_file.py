"""Policies kept in files: written once, read for the task that they were learned on only."""

import json
import os
from dataclasses import replace

import pytest

from skillplan.errors import OptionError
from skillplan.model import roll_out
from skillplan.pipeline import make_model, solve
from skillplan.records import make_policy_document, read_policy
from skillplan.records.stored import policy_file
from skillplan.solvers import Policy
from skillplan.task import read_start_state
from skillplan_swarmitfix import BaseGrounding, Bench
from swarm_situations import SWING_S, base_task

HASH = "0123456789abcdef" * 4


@pytest.fixture(scope="module")
def task():
    """From C66 to C42, two swings."""
    return base_task(66, 42).replace(sha256=HASH)


@pytest.fixture(scope="module")
def learned(task):
    """A policy for all positions."""
    return solve(task, "policy-iteration")


@pytest.fixture
def document(task, learned):
    policy_document = make_policy_document(HASH, "policy-iteration", [(task, learned)])
    assert policy_document is not None
    return policy_document


@pytest.fixture
def path(tmp_path):
    return tmp_path / "policies.json"


class TestWriting:
    def test_it_holds_a_skill_for_every_state(self, document, task):
        """By the names of its facts; where the goal is, none is needed."""
        assert ("skillplan.policy/1", HASH) == (document["schema"], document["sha256"])
        (entry,) = document["policies"]
        assert ("C66-C42", ["at(C42)"]) == (entry["task"], entry["goal"])
        assert set(task.facts.names) - set(entry["choices"]) <= {"at(C42)"}
        assert set(entry["choices"].values()) <= {skill.name for skill in task.skills}

    def test_a_solver_that_gives_a_plan_has_none(self, task, learned):
        assert make_policy_document(HASH, "exact", [(task, solve(task))]) is None
        assert make_policy_document(HASH, "exact", [(task, replace(learned, policy=None))]) is None


class TestReading:
    def test_what_was_written_is_read_back(self, document, task, learned, path):
        path.write_text(json.dumps(document))
        stored = read_policy(str(path), task)
        assert "policy-iteration" == stored.solver
        assert isinstance(stored.policy, Policy)
        assert learned.policy is not None
        assert dict(learned.policy) == dict(stored.policy)

    def test_it_answers_from_another_start(self, document, task, path):
        """Without planning: from C20 as few swings as exact search takes."""
        path.write_text(json.dumps(document))
        stored = read_policy(str(path), task)
        elsewhere = task.replace(initial=read_start_state(task, "C20"), sha256=HASH)
        skills = roll_out(make_model(elsewhere), stored.policy.get)
        assert solve(elsewhere).cost == len(skills)

    def test_it_serves_any_file_with_the_same_skills_and_goal(self, document, path):
        """Another name, start and hash are no matter."""
        path.write_text(json.dumps(document))
        other = base_task(20, 42).replace(sha256="f" * 64, name="other")
        assert 77 <= len(read_policy(str(path), other).policy)

    def test_a_policy_of_other_skills_is_refused(self, document, path):
        """With two swings more the same name may stand for another one."""
        path.write_text(json.dumps(document))
        grounding = BaseGrounding(Bench(6, 13, 0.34, 13), SWING_S)
        with pytest.raises(OptionError, match="learned on a task with other skills than more"):
            read_policy(str(path), grounding.task("more", 65, 41))

    def test_a_policy_for_another_goal_is_refused(self, document, path):
        path.write_text(json.dumps(document))
        elsewhere = base_task(66, 1)
        with pytest.raises(OptionError, match=r"no policy for at\(C1\), only for at\(C42\)"):
            read_policy(str(path), elsewhere)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "is not JSON"),
            ("{", "is not JSON"),
            ("[" * 100_000, "is not JSON"),
            ("[]", "is no document skillplan.policy/1"),
            ('{"schema": "skillplan.result/1"}', "is no document skillplan.policy/1"),
            ('{"schema": "skillplan.policy/1"}', "is damaged"),
        ],
        ids=["empty", "cut", "nested", "list", "other", "bare"],
    )
    def test_what_is_no_policy_file_is_refused(self, text, message, task, path):
        path.write_text(text)
        with pytest.raises(OptionError, match=message):
            read_policy(str(path), task)

    @pytest.mark.parametrize(
        "change",
        [
            {"sha256": 1},
            {"solver": None},
            {"policies": {}},
            {"policies": 7},
            {"policies": [7]},
            {"policies": [{}]},
            {"policies": [{"goal": "at(C42)", "choices": {}}]},
            {"policies": [{"goal": [1], "choices": {}}]},
            {"policies": [{"goal": ["at(C42)"], "choices": {}, "fingerprint": 1}]},
            {"policies": [{"goal": ["at(C42)"], "choices": []}]},
            {"policies": [{"goal": ["at(C42)"], "choices": {"at(C1)": 1}}]},
        ],
        ids=str,
    )
    def test_a_damaged_file_is_refused(self, change, document, task, path):
        path.write_text(json.dumps({**document, **change}))
        with pytest.raises(OptionError, match=r"policies\.json: (is damaged|holds no policy)"):
            read_policy(str(path), task)

    @pytest.mark.parametrize(
        ("choices", "message"), [({"at(C99)": "B1"}, r"at\(C99\)"), ({"at(C1)": "B99"}, "B99")]
    )
    def test_an_unknown_fact_or_skill_is_refused_with_the_file(
        self, choices, message, document, task, path
    ):
        document["policies"][0]["choices"] = choices
        path.write_text(json.dumps(document))
        with pytest.raises(OptionError, match=rf"policies\.json: is damaged: .*{message}"):
            read_policy(str(path), task)

    def test_a_file_that_is_not_there_is_told(self, task, tmp_path):
        with pytest.raises(OptionError, match="cannot be read: No such file"):
            read_policy(str(tmp_path / "none.json"), task)
        with pytest.raises(OptionError, match="is a folder"):
            read_policy(str(tmp_path), task)

    @pytest.mark.parametrize("name", ["a\0b", "\udcff"])
    def test_a_name_that_is_none_is_told(self, name, task):
        with pytest.raises(OptionError, match="cannot be read"):
            read_policy(name, task)

    def test_a_pipe_is_not_waited_for(self, task, tmp_path):
        os.mkfifo(tmp_path / "pipe.json")
        with pytest.raises(OptionError, match="is no regular file"):
            read_policy(str(tmp_path / "pipe.json"), task)

    def test_a_file_of_another_encoding_is_told(self, task, path):
        path.write_bytes(b"\xff\xfe{}")
        with pytest.raises(OptionError, match="is not JSON"):
            read_policy(str(path), task)

    def test_a_file_too_large_is_not_read(self, document, task, path, monkeypatch):
        monkeypatch.setattr(policy_file, "_MOST_BYTES", 10)
        path.write_text(json.dumps(document))
        with pytest.raises(OptionError, match="larger than any policy file"):
            read_policy(str(path), task)


class TestStart:
    def test_it_is_a_place_or_a_fact(self, task):
        assert (
            task.facts.of("at(C20)")
            == read_start_state(task, "C20")
            == read_start_state(task, "at(C20)")
        )

    def test_several_facts_stand_between_commas(self, board_task):
        facts = list(board_task.initial)
        assert board_task.initial == read_start_state(board_task, " , ".join(facts))

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "names no fact"),
            (" , ", "names no fact"),
            ("C99", "C99"),
            ("C20,C21", r"at\(C20\) and at\(C21\) cannot both hold"),
        ],
    )
    def test_what_is_no_start_is_told(self, text, message, task):
        with pytest.raises(OptionError, match=message):
            read_start_state(task, text)
