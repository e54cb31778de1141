"""Verdicts kept on disk."""

import json
import logging
import os
import subprocess
import sys
from dataclasses import replace

import pytest
from pydantic import Field

from situations import assembly, config_content, fake_back_end
from skillplan.collision.aabb import AabbDetector
from skillplan.model.feasibility import Feasibility
from skillplan.model.verdict_cache import DiskVerdictCache, VerdictCache, verdict_key
from skillplan.physics.engine import Engine
from skillplan.run import make_model, solve, warm_cache
from skillplan.task import back_end as back_ends
from skillplan.task.task import Precedence
from skillplan.task.verdict import Verdict
from skillplan.testing import lid_task, reachable_states, shut_box_task

TASK = lid_task()
SKILL = TASK.skills[0]


def dear_one(task=TASK, answer=None, **attributes):
    """Return a dear fake whose verdicts rest on where the fuse is."""

    def rests_on_the_fuse(skill, state):
        facts = task.facts
        if "placed(fuse)" in state:
            return Verdict.infeasible("blocked", facts.of("placed(fuse)"), facts.none, {"n": 3.5})
        return Verdict.feasible(facts.none, facts.of("placed(fuse)"))

    return fake_back_end(task, answer or rests_on_the_fuse, dear=True, **attributes)


def verdicts_of(folder, back_end, task=TASK, skill=None):
    """Rule on a skill in the initial state and with the fuse placed, with a cache in a folder."""
    skill = skill or task.skills[0]
    cache = DiskVerdictCache(folder)
    feasibility = Feasibility(task, [back_end], cache)
    states = task.initial, (task.initial | task.initial.facts.of("placed(fuse)"))
    return [feasibility.rule(skill, state) for state in states], cache


def files_in(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_verdicts_survive_to_the_next_run(tmp_path):
    """A new cache and a new back end ask nothing and rule the same, evidence included."""
    first, second = dear_one(), dear_one()
    expected, _ = verdicts_of(tmp_path, first)
    actual, _ = verdicts_of(tmp_path, second)
    assert expected == actual
    assert actual[1].evidence == {"n": 3.5}
    assert (len(first.asked), len(second.asked)) == (2, 0)


def test_another_process_finds_the_same_file(tmp_path):
    """The key does not depend on the order of hashes."""
    aabb = AabbDetector(TASK)
    code = (
        "from skillplan.testing import lid_task; from skillplan.collision.aabb import "
        "AabbDetector; from skillplan.model.verdict_cache import verdict_key; "
        "task = lid_task(); print(verdict_key(AabbDetector(task), task.skills[3]))"
    )
    keys = {
        subprocess.run(
            [sys.executable, "-c", code],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout.strip()
        for seed in ("1", "2")
    }
    assert keys == {verdict_key(aabb, TASK.skills[3])}


def test_only_dear_back_ends_are_written(tmp_path):
    """Asking the others again is cheaper than reading."""
    model = make_model(TASK, cache=DiskVerdictCache(tmp_path))
    reachable_states(model)
    assert model.stats.checks > 0
    assert files_in(tmp_path) == []


def test_unknown_is_never_kept_on_disk(tmp_path):
    """The next run may decide; within this one it is not asked again."""
    asked = dear_one(answer=Verdict.unknown("too slow"))
    verdicts, cache = verdicts_of(tmp_path, asked)
    assert {v.reason for v in verdicts} == {"too slow"}
    assert Feasibility(TASK, [asked], cache).rule(SKILL, TASK.initial).reason == "too slow"
    assert len(asked.asked) == 2
    assert files_in(tmp_path) == []


def test_an_unknown_beside_a_decided_verdict_is_left_out_of_the_file(tmp_path):
    """Only what was decided is written."""

    def answer(skill, state):
        if "placed(fuse)" in state:
            return Verdict.feasible(TASK.facts.of("placed(fuse)"), TASK.facts.none)
        return Verdict.unknown("too slow")

    verdicts_of(tmp_path, dear_one(answer=answer))
    (path,) = files_in(tmp_path)
    assert [entry["status"] for entry in json.loads(path.read_text())["verdicts"]] == ["feasible"]


def test_what_differs_in_anything_that_may_change_the_answer_has_another_key():
    """Scene, chart, skill, facts, name, version and options; not the goal or the step limit."""

    class Options(back_ends.Options):
        friction: float = Field(default=0.5, description="friction [-]")

    back_end = dear_one()
    moved = config_content("inverter_board")
    board = assembly(moved)
    moved["parts"]["clock"]["goal_m"][0] += 0.001
    keys = [
        verdict_key(back_end, SKILL),
        verdict_key(back_end, TASK.skills[1]),
        verdict_key(back_end, replace(SKILL, parameters={"part": "fuse"})),
        verdict_key(back_end, replace(SKILL, motion=TASK.skills[1].motion)),
        verdict_key(back_end, replace(SKILL, precondition=TASK.skills[1].precondition)),
        verdict_key(back_end, replace(SKILL, outcomes=TASK.skills[1].outcomes)),
        verdict_key(dear_one(version="2"), SKILL),
        verdict_key(dear_one(name="other"), SKILL),
        verdict_key(dear_one(Options=Options), SKILL),
        verdict_key(dear_one(TASK.replace(chart=(Precedence("lid", "box"),))), SKILL),
        verdict_key(dear_one(board), board.skills[0]),
        verdict_key(dear_one(assembly(moved)), board.skills[0]),
    ]
    with_option = dear_one(Options=Options)
    with_option.options = Options(friction=0.6)
    keys.append(verdict_key(with_option, SKILL))
    assert len(set(keys)) == len(keys)
    same = dear_one(TASK.replace(step_limit=99, goal=TASK.skills[0].precondition))
    assert verdict_key(same, SKILL) == keys[0]


def test_another_version_asks_anew(tmp_path):
    """What an old one said is not found."""
    verdicts_of(tmp_path, dear_one())
    newer = dear_one(version="2")
    verdicts_of(tmp_path, newer)
    assert len(newer.asked) == 2
    assert len(files_in(tmp_path)) == 2


def entry(**changes):
    sound = {
        "status": "feasible",
        "reason": "",
        "stage": "fake",
        "present": [],
        "absent": ["placed(fuse)"],
        "evidence": {},
    }
    return {"format": "skillplan.verdicts/1", "verdicts": [{**sound, **changes}]}


CORRUPT = {
    "empty": b"",
    "no JSON": b"{verdicts",
    "cut short": json.dumps(entry()).encode()[:-9],
    "not UTF-8": b'{"format": "\xff\xfe"}',
    "a list": b"[]",
    "a number": b"3",
    "another format": json.dumps({**entry(), "format": "skillplan.verdicts/0"}).encode(),
    "no format": json.dumps({"verdicts": []}).encode(),
    "no verdicts": json.dumps({"format": "skillplan.verdicts/1"}).encode(),
    "an unknown fact": json.dumps(entry(present=["placed(ghost)"])).encode(),
    "an unknown status": json.dumps(entry(status="perhaps")).encode(),
    "a status that is never kept": json.dumps(entry(status="unknown", reason="?")).encode(),
    "a contradiction": json.dumps(entry(present=["placed(fuse)"])).encode(),
    "no reason": json.dumps(entry(status="infeasible")).encode(),
    "facts that are no list": json.dumps(entry(present=7)).encode(),
    "facts that are lists": json.dumps(entry(present=[["placed(fuse)"]])).encode(),
    "no evidence": json.dumps(entry(evidence=None)).encode(),
    "an entry that is no mapping": b'{"format": "skillplan.verdicts/1", "verdicts": ["x"]}',
    "endless brackets": b"[" * 100_000,
}


@pytest.mark.parametrize("what", CORRUPT)
def test_a_corrupt_file_is_dropped_and_its_verdicts_made_anew(tmp_path, what):
    """Never trusted, never an error; afterwards the file is sound again."""
    expected, _ = verdicts_of(tmp_path, dear_one())
    (path,) = files_in(tmp_path)
    path.write_bytes(CORRUPT[what])
    again = dear_one()
    actual, cache = verdicts_of(tmp_path, again)
    assert expected == actual
    assert len(again.asked) == 2
    assert cache.dropped == [path]
    healed = dear_one()
    assert verdicts_of(tmp_path, healed)[0] == expected
    assert healed.asked == []


def test_the_corrupt_entries_above_are_corrupt_only_in_what_they_say(tmp_path):
    """The sound one beside them is read."""
    _, cache = verdicts_of(tmp_path, dear_one())
    (path,) = files_in(tmp_path)
    path.write_text(json.dumps(entry()))
    again = dear_one()
    _, cache = verdicts_of(tmp_path, again)
    assert cache.dropped == []
    assert len(again.asked) == 1


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    """A crash before the rename leaves the old content and no temporary file."""
    verdicts_of(tmp_path, dear_one())
    (path,) = files_in(tmp_path)
    before = path.read_bytes()

    def crash(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("skillplan.task.atomic_file.os.replace", crash)
    path.write_text(json.dumps(entry()))
    with pytest.raises(KeyboardInterrupt):
        verdicts_of(tmp_path, dear_one())
    assert files_in(tmp_path) == [path]
    assert path.read_text() == json.dumps(entry())
    monkeypatch.undo()
    verdicts_of(tmp_path, dear_one())
    assert files_in(tmp_path) == [path]
    assert len(path.read_bytes()) == len(before)


def test_a_folder_that_cannot_be_written_costs_a_warning_and_no_run(tmp_path, caplog):
    """Reuse goes on in memory."""
    (tmp_path / "file").write_text("in the way")
    asked = dear_one()
    with caplog.at_level(logging.WARNING):
        verdicts, cache = verdicts_of(tmp_path / "file", asked)
    assert [v.is_feasible for v in verdicts] == [True, False]
    assert len(caplog.records) == 1
    assert Feasibility(TASK, [asked], cache).rule(SKILL, TASK.initial).is_feasible
    assert len(asked.asked) == 2


def test_the_folder_is_chosen_by_the_environment(tmp_path, monkeypatch):
    """It is made when first needed."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "here"))
    cache = warm_cache()
    assert not (tmp_path / "here").exists()
    Feasibility(TASK, [dear_one()], cache).rule(SKILL, TASK.initial)
    assert len(files_in(tmp_path / "here")) == 1


def test_a_copy_for_some_back_ends_starts_with_theirs_only():
    """What is added to it does not flow back."""
    cache = VerdictCache()
    one, other = fake_back_end(TASK, name="one"), fake_back_end(TASK, name="other")
    for back_end in (one, other):
        cache.keep(back_end, SKILL, Verdict.feasible(TASK.facts.none, TASK.facts.none))
    copy = cache.only([one])
    assert copy.find(one, SKILL, TASK.initial) is not None
    assert copy.find(other, SKILL, TASK.initial) is None
    copy.keep(one, TASK.skills[1], Verdict.feasible(TASK.facts.none, TASK.facts.none))
    assert cache.find(one, TASK.skills[1], TASK.initial) is None


def test_an_engine_and_a_detector_of_one_name_do_not_share_verdicts():
    """Names are unique within a kind only."""
    yes = fake_back_end(TASK, lambda skill, state: Verdict.feasible(), name="twin", base=Engine)
    no = fake_back_end(TASK, lambda skill, state: Verdict.infeasible("no"), name="twin")
    assert not Feasibility(TASK, [yes, no]).rule(SKILL, TASK.initial).is_feasible


def test_one_cache_serves_two_tasks_without_mixing_them_up():
    """What holds in one task says nothing about another with the same names."""
    cache = VerdictCache()
    results = [solve(task, "exact", cache=cache) for task in (shut_box_task(), lid_task())]
    assert ["infeasible", "optimal"] == [result.status for result in results]
