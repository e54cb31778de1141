"""Verdicts kept on disk."""

import json
import logging
import os
import random
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import Field

import situations
from example_count import examples
from expensive_back_ends import ExpensiveDetector, ExpensiveEngine
from skillplan.checks import (
    Checked,
    DiskVerdictCache,
    Feasibility,
    VerdictCache,
    VerdictFolder,
    VerdictRecord,
    compute_verdict_key,
    hash_content,
    read_record,
)
from skillplan.collision import AabbDetector, PrecedenceDetector
from skillplan.model import SkillModel
from skillplan.physics import Engine, KinematicEngine
from skillplan.pipeline import make_model, open_warm_cache, solve
from skillplan.task import Precedence, Verdict, VerdictStatus
from skillplan.task import back_end as back_ends
from skillplan.testing import lid_task, reachable_states, shut_box_task
from thinned import slow_case, thinned

TASK = lid_task()
SKILL = TASK.skills[0]


def dear_one(task=TASK, answer=None, **attributes):
    """Return an expensive fake whose verdicts rest on where the fuse is."""

    def rests_on_the_fuse(skill, state):
        facts = task.facts
        if "placed(fuse)" in state:
            return Verdict.infeasible("blocked", facts.of("placed(fuse)"), facts.none, {"n": 3.5})
        return Verdict.feasible(facts.none, facts.of("placed(fuse)"))

    return situations.fake_back_end(task, answer or rests_on_the_fuse, expensive=True, **attributes)


def verdicts_of(folder, back_end, task=TASK, skill=None):
    """Rule on a skill in the initial state and with the fuse placed, with a cache in a folder."""
    skill = skill or task.skills[0]
    cache = DiskVerdictCache(folder)
    feasibility = Feasibility(task, [back_end], cache)
    states = task.initial, (task.initial | task.initial.facts.of("placed(fuse)"))
    return [feasibility.verdict(skill, state) for state in states], cache


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


def test_a_file_says_what_was_asked_and_how_long_the_answer_took(tmp_path):
    """Each verdict has its own, in a folder for its back end and key."""
    back_end = dear_one()
    verdicts_of(tmp_path, back_end)
    paths = files_in(tmp_path)
    assert {path.parent for path in paths} == {
        tmp_path / "fake" / compute_verdict_key(back_end, SKILL)
    }
    feasible, infeasible = sorted((read_record(path) for path in paths), key=lambda r: r.status)
    assert (feasible.task, feasible.skill, feasible.back_end) == ("lid", SKILL.name, "fake")
    assert (feasible.version, feasible.options) == ("1", {})
    assert feasible.state == tuple(TASK.initial)
    assert (feasible.present, feasible.absent) == ((), ("placed(fuse)",))
    assert 0 <= feasible.took_s < 1
    assert (infeasible.reason, infeasible.evidence) == ("blocked", {"n": 3.5})
    assert infeasible.verdict(TASK.facts).applies_in(TASK.facts.of(*infeasible.state))


@pytest.mark.slow(reason="two processes; the same key from other objects in every run")
def test_another_process_finds_the_same_file(tmp_path):
    """The key does not depend on the order of hashes."""
    aabb = AabbDetector(TASK)
    code = (
        "from skillplan.testing import lid_task; from skillplan.collision import "
        "AabbDetector; from skillplan.checks.verdict_files import compute_verdict_key; "
        "task = lid_task(); print(compute_verdict_key(AabbDetector(task), task.skills[3]))"
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
    assert keys == {compute_verdict_key(aabb, TASK.skills[3])}


def test_only_expensive_back_ends_are_written(tmp_path):
    """Asking the others again is cheaper than reading."""
    model = make_model(TASK, cache=DiskVerdictCache(tmp_path))
    reachable_states(model)
    assert model.stats.checks > 0
    assert files_in(tmp_path) == []


def test_unknown_is_never_kept_on_disk(tmp_path):
    """The next run may decide; within this one it is not asked again."""
    back_end = dear_one(answer=Verdict.unknown("too slow"))
    verdicts, cache = verdicts_of(tmp_path, back_end)
    assert {v.reason for v in verdicts} == {"too slow"}
    assert Feasibility(TASK, [back_end], cache).verdict(SKILL, TASK.initial).reason == "too slow"
    assert len(back_end.asked) == 2
    assert files_in(tmp_path) == []


def test_an_unknown_beside_a_decided_verdict_is_left_out_of_the_file(tmp_path):
    """Only what was decided is written."""

    def answer(skill, state):
        if "placed(fuse)" in state:
            return Verdict.feasible(TASK.facts.of("placed(fuse)"), TASK.facts.none)
        return Verdict.unknown("too slow")

    verdicts_of(tmp_path, dear_one(answer=answer))
    (path,) = files_in(tmp_path)
    assert read_record(path).status == "feasible"


def test_what_differs_in_anything_that_may_change_the_answer_has_another_key():
    """Scene, chart, skill, facts, name, version and options; not the goal or the step limit."""

    class Options(back_ends.Options):
        friction: float = Field(default=0.5, description="friction [-]")

    back_end = dear_one()
    moved = situations.config_content("inverter_board")
    board = situations.assembly(moved)
    moved["parts"]["clock"]["goal_m"][0] += 0.001
    keys = [
        compute_verdict_key(back_end, SKILL),
        compute_verdict_key(back_end, TASK.skills[1]),
        compute_verdict_key(back_end, replace(SKILL, parameters={"part": "fuse"})),
        compute_verdict_key(back_end, replace(SKILL, motion=TASK.skills[1].motion)),
        compute_verdict_key(back_end, replace(SKILL, precondition=TASK.skills[1].precondition)),
        compute_verdict_key(back_end, replace(SKILL, outcomes=TASK.skills[1].outcomes)),
        compute_verdict_key(dear_one(version="2"), SKILL),
        compute_verdict_key(dear_one(name="other"), SKILL),
        compute_verdict_key(dear_one(Options=Options), SKILL),
        compute_verdict_key(dear_one(TASK.replace(chart=(Precedence("lid", "box"),))), SKILL),
        compute_verdict_key(dear_one(board), board.skills[0]),
        compute_verdict_key(dear_one(situations.assembly(moved)), board.skills[0]),
    ]
    with_option = dear_one(Options=Options)
    with_option.options = Options(friction=0.6)
    keys.append(compute_verdict_key(with_option, SKILL))
    assert len(set(keys)) == len(keys)
    message = dear_one(basis={"engine": {"friction": 0.5}})
    keys.append(compute_verdict_key(message, SKILL))
    assert len(set(keys)) == len(keys)
    same = dear_one(TASK.replace(step_limit=99, goal=TASK.skills[0].precondition))
    assert compute_verdict_key(same, SKILL) == keys[0]


def test_another_version_is_queried_again(tmp_path):
    """What an old one said is not found."""
    verdicts_of(tmp_path, dear_one())
    newer = dear_one(version="2")
    verdicts_of(tmp_path, newer)
    assert len(newer.asked) == 2
    assert len(files_in(tmp_path)) == 4


def test_what_a_back_end_reads_of_others_tells_verdicts_apart_in_memory_too():
    """A detector beside an engine of other options says other things."""
    cache = VerdictCache()
    first, other = (dear_one(basis={"friction": friction}) for friction in (0.5, 0.6))
    for back_end in (first, other):
        Feasibility(TASK, [back_end], cache).verdict(SKILL, TASK.initial)
    assert (len(first.asked), len(other.asked)) == (1, 1)


def altered(change):
    """Return what makes the content of a file another, with a checksum that fits."""

    def alter(text):
        content = json.loads(text)
        del content["checksum"]
        change(content)
        return json.dumps({**content, "checksum": hash_content(content)}).encode()

    return alter


def said(**changes):
    return altered(lambda content: content["verdict"].update(changes))


CORRUPT = {
    "empty": lambda text: b"",
    "no JSON": lambda text: b"{verdicts",
    "cut short": lambda text: text[:-9],
    "another reason": lambda text: text.replace(b'"reason": "', b'"reason": "b'),
    "another time": lambda text: text.replace(b'"took_s": ', b'"took_s": 1'),
    "another state": lambda text: text.replace(b'"state": [', b'"state": ["placed(lid)", '),
    "not UTF-8": lambda text: b'{"format": "\xff\xfe"}',
    "a list": lambda text: b"[]",
    "a number": lambda text: b"3",
    "endless brackets": lambda text: b"[" * 100_000,
    "no checksum": lambda text: json.dumps({**json.loads(text), "checksum": None}).encode(),
    "another format": altered(lambda content: content.update(format="skillplan.verdict/9")),
    "another key": altered(lambda content: content.update(key="0" * 64)),
    "no verdict": altered(lambda content: content.pop("verdict")),
    "other facts": said(present=["held(box)"], absent=[]),
    "an unknown status": said(status="perhaps"),
    "a status that is never kept": said(status="unknown", reason="?"),
    "no reason": said(status="infeasible", reason=""),
    "facts that are no list": said(present=7),
    "facts that are lists": said(present=[["placed(fuse)"]]),
    "no evidence": said(evidence=None),
    "a state in which it does not apply": altered(
        lambda content: content.update(
            state=[] if content["verdict"]["present"] else ["placed(fuse)"]
        )
    ),
    "a state of unknown facts": altered(lambda content: content.update(state=["placed(ghost)"])),
    "a time below 0": altered(lambda content: content.update(took_s=-1.0)),
}


@pytest.mark.parametrize(
    "what", thinned(CORRUPT, *list(CORRUPT)[::3], why="every third in every run")
)
def test_a_corrupt_file_is_dropped_and_its_verdict_made_again(tmp_path, what):
    """Never trusted, never an error; afterwards the files are sound again."""
    expected, _ = verdicts_of(tmp_path, dear_one())
    paths = files_in(tmp_path)
    for path in paths:
        before = path.read_bytes()
        path.write_bytes(CORRUPT[what](before))
        assert path.read_bytes() != before
    again = dear_one()
    actual, cache = verdicts_of(tmp_path, again)
    assert expected == actual
    assert len(again.asked) == 2
    assert sorted(cache.dropped) == paths
    healed = dear_one()
    assert verdicts_of(tmp_path, healed)[0] == expected
    assert healed.asked == []


def test_a_file_under_anothers_name_is_dropped(tmp_path):
    """Verdicts are never mixed up, whatever is copied where."""
    verdicts_of(tmp_path, dear_one())
    first, other = files_in(tmp_path)
    other.write_bytes(first.read_bytes())
    elsewhere = tmp_path / "fake" / compute_verdict_key(dear_one(), TASK.skills[1])
    elsewhere.mkdir()
    (elsewhere / first.name).write_bytes(first.read_bytes())
    cache = DiskVerdictCache(tmp_path)
    cache.find(dear_one(), SKILL, TASK.initial)
    cache.find(dear_one(), TASK.skills[1], TASK.initial)
    assert sorted(cache.dropped) == sorted([other, elsewhere / first.name])


def test_the_alterations_above_are_told_by_what_they_say(tmp_path):
    """A file that was altered to what it said already is read."""
    verdicts_of(tmp_path, dear_one())
    for path in files_in(tmp_path):
        path.write_bytes(altered(lambda content: None)(path.read_bytes()))
    again = dear_one()
    _, cache = verdicts_of(tmp_path, again)
    assert (cache.dropped, again.asked) == ([], [])


def test_files_of_the_format_before_are_left_alone(tmp_path):
    """One for every skill, in the folder of the back end."""
    back_end = dear_one()
    old = tmp_path / "fake" / f"{compute_verdict_key(back_end, SKILL)}.json"
    old.parent.mkdir()
    old.write_text('{"format": "skillplan.verdicts/1", "verdicts": []}')
    verdicts, cache = verdicts_of(tmp_path, back_end)
    assert [verdict.is_feasible for verdict in verdicts] == [True, False]
    assert cache.dropped == []
    assert old.is_file()


def test_what_another_process_has_kept_meanwhile_is_found(tmp_path):
    """Nothing is asked that is known by now."""
    early, late = dear_one(), dear_one()
    feasibility = Feasibility(TASK, [late], DiskVerdictCache(tmp_path))
    placed = TASK.initial | TASK.facts.of("placed(fuse)")
    assert feasibility.verdict(SKILL, placed).is_infeasible
    Feasibility(TASK, [early], DiskVerdictCache(tmp_path)).verdict(SKILL, TASK.initial)
    assert feasibility.verdict(SKILL, TASK.initial).is_feasible
    assert (len(early.asked), len(late.asked)) == (1, 1)


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    """A crash before the rename leaves neither a file nor a temporary one."""

    def crash(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("skillplan.files.atomic_file.os.replace", crash)
    with pytest.raises(KeyboardInterrupt):
        verdicts_of(tmp_path, dear_one())
    assert files_in(tmp_path) == []
    monkeypatch.undo()
    verdicts_of(tmp_path, dear_one())
    assert len(files_in(tmp_path)) == 2


WRITER = """
import sys
from pathlib import Path

from expensive_back_ends import ExpensiveEngine
from skillplan.checks.feasibility import Feasibility
from skillplan.model.skill_model import SkillModel
from skillplan.checks.verdict_cache import DiskVerdictCache
from skillplan.testing import lid_task, reachable_states

task = lid_task()
states = reachable_states(SkillModel(Feasibility(task)))
print("ready", flush=True)
for seed in range(int(sys.argv[2]), 10_000):
    engine = ExpensiveEngine(task, ExpensiveEngine.Options(seed=seed % 40))
    feasibility = Feasibility(task, [engine], DiskVerdictCache(Path(sys.argv[1])))
    for state in states:
        for skill in task.skills:
            if skill.applicable(state):
                feasibility.verdict(skill, state)
"""


@pytest.mark.slow(reason="starts and kills processes; torn files are in every run")
def test_processes_killed_at_any_instant_leave_a_sound_cache(tmp_path):
    """Two at a time write to one folder and are killed again and again: what is there holds."""
    rng = random.Random(3)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    for seed in range(examples(4, fewest=2)):
        writers = [
            subprocess.Popen(
                [sys.executable, "-c", WRITER, str(tmp_path), str(10 * seed + number)],
                stdout=subprocess.PIPE,
                env=environment,
            )
            for number in range(2)
        ]
        for writer in writers:
            assert writer.stdout.readline() == b"ready\n"
            time.sleep(rng.uniform(0.0, 0.2))
            writer.kill()
            writer.communicate()
    paths = [path for path in files_in(tmp_path) if not path.name.startswith(".")]
    assert len(paths) > 4
    for path in paths:
        record = read_record(path)
        engine = ExpensiveEngine(TASK, ExpensiveEngine.Options(**record.options))
        state = TASK.facts.of(*record.state)
        fresh = Feasibility(TASK, [engine]).stages(TASK.skill(record.skill), state)[1]
        assert fresh == record.verdict(TASK.facts)


def test_records_that_make_no_sense_are_refused():
    """Both checks of the constructor."""
    verdict = Verdict.feasible().grounded(TASK.initial, "fake")
    record = VerdictRecord.of(dear_one(), SKILL, Checked(verdict, 0.5), TASK.initial)
    with pytest.raises(ValueError, match="unknown is never kept"):
        replace(record, status=VerdictStatus.UNKNOWN)
    with pytest.raises(ValueError, match=r"cannot take -1\.0 s"):
        replace(record, took_s=-1.0)
    with pytest.raises(ValueError, match=r"cannot take -1\.0 s"):
        Checked(verdict, -1.0)


def test_a_folder_that_cannot_be_written_costs_a_warning_and_no_run(tmp_path, caplog):
    """Reuse goes on in memory."""
    (tmp_path / "file").write_text("in the way")
    back_end = dear_one()
    with caplog.at_level(logging.WARNING):
        verdicts, cache = verdicts_of(tmp_path / "file", back_end)
    assert [v.is_feasible for v in verdicts] == [True, False]
    assert len(caplog.records) == 1
    assert Feasibility(TASK, [back_end], cache).verdict(SKILL, TASK.initial).is_feasible
    assert len(back_end.asked) == 2


def test_the_folder_is_chosen_by_the_environment(tmp_path, monkeypatch):
    """It is made when first needed."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "here"))
    cache = open_warm_cache()
    assert not (tmp_path / "here").exists()
    Feasibility(TASK, [dear_one()], cache).verdict(SKILL, TASK.initial)
    assert len(files_in(tmp_path / "here")) == 1


def test_a_copy_for_some_back_ends_starts_with_theirs_only():
    """What is added to it does not flow back."""
    cache = VerdictCache()
    checked = Checked(Verdict.feasible(TASK.facts.none, TASK.facts.none), 0.0)
    first, other = (
        situations.fake_back_end(TASK, name="one"),
        situations.fake_back_end(TASK, name="other"),
    )
    for back_end in (first, other):
        cache.keep(back_end, SKILL, checked, TASK.initial)
    copy = cache.only([first])
    assert copy.find(first, SKILL, TASK.initial) is not None
    assert copy.find(other, SKILL, TASK.initial) is None
    copy.keep(first, TASK.skills[1], checked, TASK.initial)
    assert cache.find(first, TASK.skills[1], TASK.initial) is None


def test_what_is_taken_over_is_found_and_stays_where_it_was():
    """Beside what was there; of a folder nothing need be taken over."""
    cache, other = VerdictCache(), VerdictCache()
    checked = Checked(Verdict.feasible(TASK.facts.none, TASK.facts.none), 0.0)
    back_end = situations.fake_back_end(TASK, name="one")
    cache.keep(back_end, SKILL, checked, TASK.initial)
    other.keep(back_end, TASK.skills[1], checked, TASK.initial)
    cache.take_over(other)
    assert all(cache.find(back_end, skill, TASK.initial) is not None for skill in TASK.skills[:2])
    assert other.find(back_end, SKILL, TASK.initial) is None


def test_a_cache_on_disk_takes_nothing_over_that_is_not_in_its_folder(tmp_path):
    """So what others keep there later is still found."""
    cache, other = DiskVerdictCache(tmp_path), VerdictCache()
    checked = Checked(Verdict.feasible(TASK.facts.none, TASK.facts.none), 0.0)
    dear = dear_one()
    other.keep(dear, SKILL, checked, TASK.initial)
    cache.take_over(other)
    assert cache.find(dear, SKILL, TASK.initial) is None
    DiskVerdictCache(tmp_path).keep(dear, SKILL, checked, TASK.initial)
    assert cache.find(dear, SKILL, TASK.initial) is not None


def test_an_engine_and_a_detector_of_one_name_do_not_share_verdicts():
    """Names are unique within a kind only."""
    yes = situations.fake_back_end(
        TASK, lambda skill, state: Verdict.feasible(), name="twin", base=Engine
    )
    no = situations.fake_back_end(TASK, lambda skill, state: Verdict.infeasible("no"), name="twin")
    assert not Feasibility(TASK, [yes, no]).verdict(SKILL, TASK.initial).is_feasible


def test_one_cache_serves_two_tasks_without_mixing_them_up():
    """What holds in one task says nothing about another with the same names."""
    cache = VerdictCache()
    results = [solve(task, "exact", cache=cache) for task in (shut_box_task(), lid_task())]
    assert ["infeasible", "optimal"] == [result.status for result in results]


# All that is kept on disk: what is there, and what clearing it leaves.


OTHER = TASK.replace(name="other", chart=())


def filled(folder, task=TASK, plugin=ExpensiveEngine, **options):
    """Keep some verdicts in a folder; return the back end that gave them."""
    queries = plugin(task, plugin.Options(**options))
    feasibility = Feasibility(task, [queries], DiskVerdictCache(folder))
    for state in reachable_states(SkillModel(Feasibility(task)), 20):
        feasibility.verdicts([(k, state) for k in task.skills if k.applicable(state)])
    return queries


def names_in(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_a_survey_finds_every_sound_verdict(tmp_path):
    """Of whatever task and back end; an empty folder, or none, holds none."""
    assert VerdictFolder(tmp_path / "nowhere").survey() == ([], [])
    filled(tmp_path)
    filled(tmp_path, OTHER, ExpensiveDetector)
    sound, others = VerdictFolder(tmp_path).survey()
    assert {(record.record.back_end, record.record.task) for record in sound} == {
        ("expensive-engine", "lid"),
        ("expensive-detector", "other"),
    }
    assert len(sound) == len([name for name in names_in(tmp_path) if name.endswith(".json")])
    assert others == []
    assert all(item.size_bytes == item.path.stat().st_size for item in sound)
    assert all(entry.modified_s == entry.path.stat().st_mtime for entry in sound)


def test_what_a_back_end_would_use_is_what_it_finds(tmp_path):
    """By its key: not what others said, or the same with another option."""
    back_end = filled(tmp_path, seed=1)
    filled(tmp_path, seed=2)
    filled(tmp_path, OTHER, seed=1)
    (own,) = VerdictFolder(tmp_path).kept_for([back_end])
    assert own
    assert {(entry.record.task, entry.record.options["seed"]) for entry in own} == {("lid", 1)}
    fresh = ExpensiveEngine(TASK, back_end.options)
    again = Feasibility(TASK, [fresh], DiskVerdictCache(tmp_path))
    for item in own:
        record = item.record
        again.verdict(TASK.skill(record.skill), TASK.facts.of(*record.state))
    assert again.executions == 0


def litter(folder):
    """Put files into a folder of verdicts that are not the cache's, and some that are."""
    key = next(path for path in (folder / "expensive-engine").iterdir())
    own = [
        folder / "expensive-engine" / f"{'a' * 64}.json",
        key / f".{'b' * 64}.json.123.tmp",
        key / f"{'c' * 64}.json",
    ]
    foreign = [
        folder / "README",
        folder / "expensive-engine" / "notes.txt",
        key / "notes.json",
        folder / "photos" / "holiday.json",
    ]
    for path in (*own, *foreign):
        path.parent.mkdir(exist_ok=True)
        path.write_text("{}")
    return own, foreign


def test_damaged_and_unfinished_files_and_those_of_the_format_before_are_told_apart(tmp_path):
    """From verdicts, and from what is not the cache's."""
    filled(tmp_path)
    own, _ = litter(tmp_path)
    assert sorted(VerdictFolder(tmp_path).survey()[1]) == sorted(own)


def test_clearing_removes_all_that_is_the_caches_own_and_nothing_else(tmp_path):
    """Neither files nor folders, nor what a link leads to."""
    filled(tmp_path / "cache")
    _, foreign = litter(tmp_path / "cache")
    filled(tmp_path / "cache", plugin=ExpensiveDetector)
    filled(tmp_path / "elsewhere")
    (tmp_path / "cache" / "linked").symlink_to(tmp_path / "elsewhere" / "expensive-engine")
    before = names_in(tmp_path / "elsewhere")
    count = len([path for path in (tmp_path / "cache").rglob("*") if path.is_file()])
    assert VerdictFolder(tmp_path / "cache").clear() == count - len(foreign)
    left = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert sorted(left) == sorted(foreign)
    assert not (tmp_path / "cache" / "expensive-detector").exists()
    assert names_in(tmp_path / "elsewhere") == before


def test_clearing_a_task_leaves_the_others(tmp_path):
    """By the name it was kept under."""
    filled(tmp_path)
    kept = filled(tmp_path, OTHER)
    count = len(VerdictFolder(tmp_path).survey()[0])
    (own,) = VerdictFolder(tmp_path).kept_for([kept])
    assert VerdictFolder(tmp_path).clear({"lid"}) == count - len(own)
    assert [record.path for record in VerdictFolder(tmp_path).survey()[0]] == sorted(
        item.path for item in own
    )


# Invariant: a reused verdict equals a fresh one, in any state, reachable or not.


seeds = st.integers(0, 2**32)
BOARD = situations.assembly(situations.config_content("inverter_board"))


def aabb(**options):
    return lambda task: AabbDetector(task, AabbDetector.Options(**options))


def precedence(**options):
    return lambda task: PrecedenceDetector(task, PrecedenceDetector.Options(**options))


BACK_ENDS = {
    "kinematic": KinematicEngine,
    "aabb": aabb(),
    "aabb without supports": aabb(check_support=False),
    "aabb with tolerance": aabb(tolerance_m=0.004),
    "precedence": precedence(),
    "precedence holding back picks": precedence(hold_back_picks=True),
}


def assert_reuse(task, make, rng, pairs):
    """Assert that a verdict equals a fresh one wherever it applies; return how many did.

    The second state of a pair shares the facts of the first one's verdict and is random else.
    """
    queries, reused = make(task), 0
    for skill in task.skills:
        for _ in range(pairs):
            state = situations.imagined_state(task, skill, rng)
            if state is None:
                continue
            verdict = queries.check(skill, state).grounded(state, queries.name)
            assert verdict.applies_in(state)
            other = situations.imagined_state(task, skill, rng, verdict.present, verdict.absent)
            if other is None or not verdict.applies_in(other):
                continue
            fresh = make(task).check(skill, other).grounded(other, queries.name)
            assert verdict == fresh
            reused += other != state
    return reused


@pytest.mark.parametrize(
    "back_end",
    [
        slow_case(name, reason="three back ends in every run") if " " in name else name
        for name in BACK_ENDS
    ],
)
@settings(max_examples=examples(100))
@given(content=situations.crowded_assemblies(), seed=seeds)
def test_a_reused_verdict_equals_a_fresh_one_in_crowded_assemblies(back_end, content, seed):
    """Tall, turned and stacked parts, feeders, envelopes, swaps and separate tool changes."""
    assert_reuse(situations.assembly(content), BACK_ENDS[back_end], random.Random(seed), pairs=5)


@pytest.mark.parametrize("back_end", BACK_ENDS)
@pytest.mark.parametrize(
    "config",
    ["inverter_board", slow_case("motor_drive", reason="twelve parts; a board in every run")],
)
def test_a_reused_verdict_equals_a_fresh_one_on_the_configs(back_end, config):
    """Most pairs of states differ, so that reuse is put to the test."""
    task = situations.assembly(situations.config_content(config))
    reused = assert_reuse(task, BACK_ENDS[back_end], random.Random(1), pairs=8)
    assert reused > 4 * len(task.skills)


@settings(max_examples=examples(60))
@given(content=situations.crowded_assemblies(), seed=seeds)
def test_a_chain_that_remembers_rules_like_one_that_does_not(content, seed):
    """The whole of it: several back ends, one cache, many random states in turn."""
    task, rng = situations.assembly(content), random.Random(seed)
    makers = list(BACK_ENDS.values())
    makers = [makers[0], makers[1], makers[4]]
    warm = Feasibility(task, [make(task) for make in makers])
    for skill in task.skills:
        for _ in range(10):
            state = situations.imagined_state(task, skill, rng)
            if state is not None:
                cold = Feasibility(task, [make(task) for make in makers])
                assert warm.verdict(skill, state) == cold.verdict(skill, state)


@settings(max_examples=examples(30))
@given(content=situations.small_assemblies(), seed=seeds)
def test_what_cannot_say_is_reused_in_the_same_state_only(content, seed):
    """A verdict without facts never serves another state."""
    task, rng = situations.assembly(content), random.Random(seed)
    back_end = situations.fake_back_end(task, Verdict.feasible())
    feasibility = Feasibility(task, [back_end])
    seen = set()
    for skill in task.skills:
        for _ in range(4):
            state = situations.imagined_state(task, skill, rng)
            if state is None:
                continue
            for _ in range(2):
                verdict = feasibility.verdict(skill, state)
                assert verdict.present == state
                assert verdict.absent == state.complement()
            seen.add((skill.name, state))
            assert len(back_end.asked) == len(seen)


@given(st.lists(st.tuples(st.integers(0, 63), st.integers(0, 63)), max_size=12), seeds)
def test_the_cache_finds_what_a_scan_of_all_kept_verdicts_finds(entries, seed):
    """However the verdicts' facts overlap."""
    task = BOARD
    facts, skill = task.facts, task.skills[0]
    back_end, cache = situations.fake_back_end(task), VerdictCache()
    kept = []
    for i, (present, absent) in enumerate(entries):
        sets = facts.state(present), facts.state(absent & ~present)
        # Verdicts of one back end agree where both apply: here on which facts they rest.
        if any(not (v.present & sets[1]).bits and not (v.absent & sets[0]).bits for v in kept):
            continue
        kept.append(Verdict.infeasible(f"reason {i}", *sets))
        cache.keep(back_end, skill, Checked(kept[-1], 0.0), sets[0])
    rng = random.Random(seed)
    for _ in range(20):
        state = facts.state(rng.randrange(64))
        expected = next((verdict for verdict in kept if verdict.applies_in(state)), None)
        assert expected == cache.find(back_end, skill, state)
        assert cache.find(back_end, task.skills[1], state) is None
