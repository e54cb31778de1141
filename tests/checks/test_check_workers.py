"""Checks in parallel processes: the same as one after the other, and none harms another."""

import gc
import os
import random
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from expensive_back_ends import (
    CheapDetector,
    ExpensiveDetector,
    ExpensiveEngine,
    SharingDetector,
    StartlessEngine,
    TalkingEngine,
    checks_in,
)
from processes_in_any_order import AnyOrder
from situations import fake_back_end, small_tasks
from skillplan.checks import CheckCount, CheckWorkers, DiskVerdictCache, Feasibility, check_workers
from skillplan.collision import Detector
from skillplan.errors import BackEndError, SkillplanError
from skillplan.model import SkillModel, enumerate_feasibility
from skillplan.task import Verdict
from skillplan.testing import lid_task, reachable_states
from thinned import slow_case

TASK = lid_task()
PATIENCE_S = 30
SEEDS = st.integers(0, 2**32)


def chain(task, *, seed=0, **options):
    """Return a cheap and two expensive back ends."""
    options = {"seed": seed, **options}
    return [
        plugin(task, plugin.Options(**options))
        for plugin in (CheapDetector, ExpensiveEngine, ExpensiveDetector)
    ]


def one_engine(task=TASK, plugin=ExpensiveEngine, **options):
    return [plugin(task, plugin.Options(**options))]


def all_questions(task):
    """Return every applicable pair of skill and state, reachable by prediction or not."""
    states = reachable_states(SkillModel(Feasibility(task)), 60)
    return [(k, s) for s in states for k in task.skills if k.applicable(s)]


def kept_in(folder):
    """Return what every file of a cache holds, times aside."""
    return {
        str(path.relative_to(folder)): path.read_text("utf-8").partition('"took_s"')[0]
        for path in Path(folder).rglob("*.json")
    }


def outcome(task, questions, jobs, folder, seed=0):
    """Return all that asking came to: verdicts, counts and what is kept on disk."""
    feasibility = Feasibility(task, chain(task, seed=seed), DiskVerdictCache(folder), jobs=jobs)
    verdicts = feasibility.verdicts(questions)
    verdicts += feasibility.verdicts(questions[::2])
    feasibility.close()
    counts = (feasibility.checks, feasibility.hits, feasibility.executions, feasibility.reached)
    return verdicts, counts, dict(feasibility.queried), kept_in(folder)


@pytest.mark.slow(reason="starts processes twice; the order of questions is in every run")
@settings(max_examples=examples(60))
@given(task=small_tasks(), seed=SEEDS, jobs=st.integers(2, 5))
def test_verdicts_counts_and_cache_do_not_depend_on_which_process_is_faster(
    tmp_path_factory, task, seed, jobs
):
    """Whatever the order in which answers come in, and however many there are at once."""
    folder = tmp_path_factory.mktemp("any-order")
    questions = all_questions(task) * 2
    random.Random(seed).shuffle(questions)
    expected = outcome(task, questions, 1, folder / "1", seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(AnyOrder, "rng", random.Random(seed))
        patch.setattr(check_workers, "LocalProcesses", AnyOrder)
        assert expected == outcome(task, questions, jobs, folder / "n", seed)


@pytest.mark.slow(reason="six real processes a task; an enumeration in two in every run")
@settings(max_examples=examples(3, fewest=1))
@given(task=small_tasks(), seed=SEEDS)
def test_verdicts_counts_and_cache_are_the_same_in_one_two_and_three_processes(
    tmp_path_factory, task, seed
):
    """Real ones: evidence is the same bit for bit."""
    folder = tmp_path_factory.mktemp("processes")
    questions = all_questions(task)
    item, two, three = (outcome(task, questions, n, folder / str(n), seed) for n in (1, 2, 3))
    assert item == two == three


@settings(max_examples=examples(40))
@given(task=small_tasks(), seed=SEEDS)
def test_verdicts_and_cache_do_not_depend_on_the_order_of_questions(tmp_path_factory, task, seed):
    """Nor does how often each back end is asked that is not kept from it by another."""
    folder = tmp_path_factory.mktemp("orders")
    questions = all_questions(task)
    shuffled = random.Random(seed).sample(questions, len(questions))
    results = []
    for name, queries in (("one", questions), ("other", shuffled)):
        cache = DiskVerdictCache(folder / name)
        feasibility = Feasibility(task, chain(task, seed=seed), cache)
        verdicts = feasibility.verdicts(queries)
        by_question = {(k.name, s): v for (k, s), v in zip(queries, verdicts, strict=True)}
        decided = {kept.rpartition("/")[2] for kept in kept_in(folder / name)}
        results.append((by_question, dict(feasibility.queried), decided))
    assert results[0] == results[1]


def test_no_answer_is_worked_out_twice(tmp_path):
    """Of one skill one question is under way at a time: its verdict answers the others."""
    pick = TASK.skill("pick(box)")
    states = [s for s in reachable_states(SkillModel(Feasibility(TASK))) if pick.applicable(s)]
    queries = one_engine(plugin=SharingDetector, log=str(tmp_path))
    feasibility = Feasibility(TASK, queries, jobs=3)
    feasibility.verdicts([(pick, state) for state in states])
    assert len(states) > 1
    assert len(checks_in(tmp_path)) == 1
    assert (feasibility.checks, feasibility.hits) == (1, len(states) - 1)


@pytest.mark.slow(reason="starts processes; that order changes nothing is in every run")
def test_several_skills_are_checked_at_once(tmp_path):
    """In other processes than this one."""
    (tmp_path / "log").mkdir()
    questions = all_questions(TASK)[:12]
    feasibility = Feasibility(TASK, one_engine(log=str(tmp_path / "log"), wait_s=0.1), jobs=2)
    feasibility.verdicts(questions)
    processes = {process for *_, process in checks_in(tmp_path / "log")}
    assert len(processes) == 2
    assert str(os.getpid()) not in processes


def test_the_engine_and_the_detector_of_one_question_are_asked_in_one_process(tmp_path):
    """So that the detector can read what the engine has just simulated."""
    options = {"log": str(tmp_path), "wait_s": 0.02}
    back_ends = [
        ExpensiveEngine(TASK, ExpensiveEngine.Options(**options)),
        SharingDetector(TASK, SharingDetector.Options(**options)),
    ]
    feasibility = Feasibility(TASK, back_ends, jobs=2)
    questions = list({k.name: (k, s) for k, s in all_questions(TASK)}.values())
    feasibility.verdicts(questions)
    by_question = {}
    for _, skill, bits, process in checks_in(tmp_path):
        by_question.setdefault((skill, bits), []).append(process)
    pairs = [processes for processes in by_question.values() if len(processes) == 2]
    assert pairs
    assert all(first == other for first, other in pairs)


@pytest.mark.parametrize("jobs", [1, slow_case(2, reason="one process in every run")])
def test_every_process_tells_its_back_ends_what_is_beside_them(jobs):
    """As this one does."""
    plain = Feasibility(TASK, one_engine())
    question = next(item for item in all_questions(TASK) if plain.verdict(*item).is_feasible)
    sharing = SharingDetector(TASK)
    feasibility = Feasibility(TASK, [*one_engine(), sharing], jobs=jobs)
    feasibility.verdict(*question)
    assert feasibility.cache.find(sharing, *question).evidence == {"beside": "expensive-engine"}


def test_cheap_back_ends_are_asked_in_this_process():
    """Sending them would take longer than asking; they need not even be importable."""
    cheap = fake_back_end(TASK, name="local")
    feasibility = Feasibility(TASK, [cheap], jobs=3)
    questions = all_questions(TASK)[:5]
    expected = Feasibility(TASK, [fake_back_end(TASK, name="local")]).verdicts(questions)
    assert feasibility.verdicts(questions) == expected
    assert {skill for skill, _ in cheap.asked} == {skill.name for skill, _ in questions}


def test_what_cannot_be_sent_to_a_process_is_one_clear_error():
    """Such as a class that was made in a function."""
    unsendable = fake_back_end(TASK, name="made-here", expensive=True)
    with pytest.raises(SkillplanError, match="processes for checks start from cannot be sent"):
        Feasibility(TASK, [unsendable], jobs=2).verdict(*all_questions(TASK)[0])


def question_on(name):
    return next((k, s) for k, s in all_questions(TASK) if k.name == name)


def test_a_process_that_is_killed_costs_its_check_only(tmp_path):
    """The check is made once more; after the second time it is unknown, and says why."""
    log = tmp_path / "log"
    log.mkdir()
    options = {"log": str(log), "fail_on": "pick(fuse)", "how": "kill"}
    questions = list({k.name: (k, s) for k, s in all_questions(TASK)}.values())
    feasibility = Feasibility(
        TASK, one_engine(**options), DiskVerdictCache(tmp_path / "kept"), jobs=2
    )
    verdicts = dict(
        zip([k.name for k, _ in questions], feasibility.verdicts(questions), strict=True)
    )
    lost = verdicts.pop("pick(fuse)")
    what = "signal 9 (SIGKILL)"
    assert lost.status == "unknown"
    assert lost.reason == f"the process that checked it was ended by {what}, twice"
    assert lost.stage == "expensive-engine"
    assert len([check for check in checks_in(log) if check[1] == "pick(fuse)"]) == 2
    expected = Feasibility(TASK, one_engine()).verdicts(questions)
    expected = dict(zip([k.name for k, _ in questions], expected, strict=True))
    del expected["pick(fuse)"]
    assert verdicts == expected
    assert '"skill": "pick(fuse)"' not in "".join(kept_in(tmp_path / "kept").values())
    # Within the run it is not tried again.
    feasibility.verdict(
        *next(question for question in questions if question[0].name == "pick(fuse)")
    )
    assert len([item for item in checks_in(log) if item[1] == "pick(fuse)"]) == 2


@pytest.mark.slow(reason="two processes that end; one that is killed twice in every run")
def test_a_back_end_that_ends_its_process_twice_has_failed(tmp_path):
    """As it has in this process, whatever the exit code."""
    log = tmp_path / "log"
    log.mkdir()
    options = {"log": str(log), "fail_on": "pick(fuse)", "how": "exit"}
    feasibility = Feasibility(TASK, one_engine(**options), jobs=2)
    words = "failed on pick\\(fuse\\): the process that checked it was ended by exit code 7, twice"
    with pytest.raises(BackEndError, match=words):
        feasibility.verdicts([question_on("pick(fuse)")])
    assert len(checks_in(log)) == 2


@pytest.mark.slow(reason="a process that is killed; one that is killed twice in every run")
def test_a_process_that_is_killed_once_costs_nothing_but_time(tmp_path):
    """The second attempt gives the verdict."""
    options = {"log": str(tmp_path), "fail_on": "pick(fuse)", "how": "kill", "once": True}
    question = question_on("pick(fuse)")
    feasibility = Feasibility(TASK, one_engine(**options), jobs=2)
    assert feasibility.verdict(*question) == Feasibility(TASK, one_engine()).verdict(*question)
    assert len({process for *_, process in checks_in(tmp_path)}) == 2


@pytest.mark.slow(reason="four kills, each with another start; one of each kind in every run")
def test_processes_killed_from_outside_in_the_middle_of_checks_change_no_verdict(tmp_path):
    """SIGKILL to a process for each of four skills, each time during another check."""
    questions = list({k.name: (k, s) for k, s in all_questions(TASK)}.values())[:4]
    feasibility = Feasibility(TASK, one_engine(log=str(tmp_path), wait_s=0.2), jobs=2)
    killed, over = set(), threading.Event()

    def kill():
        while not over.wait(0.01):
            for _, skill, _, process in checks_in(tmp_path):
                if skill not in killed:
                    killed.add(skill)
                    os.kill(int(process), signal.SIGKILL)

    thread = threading.Thread(target=kill)
    thread.start()
    try:
        verdicts = feasibility.verdicts(questions)
    finally:
        over.set()
        thread.join()
    assert len(killed) == len(questions)
    assert verdicts == Feasibility(TASK, one_engine()).verdicts(questions)


def test_a_back_end_that_raises_in_a_process_is_the_same_error_as_in_this_one(tmp_path):
    """To the letter; of several the first question's."""
    options = {"log": str(tmp_path), "fail_on": "pick(fuse)", "how": "raise"}
    questions = list({k.name: (k, s) for k, s in all_questions(TASK)}.values())
    messages = []
    for jobs in (1, 2):
        with pytest.raises(BackEndError, match="RuntimeError: the simulator has gone") as caught:
            Feasibility(TASK, one_engine(**options), jobs=jobs).verdicts(questions)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
    assert caught.value.exit_code == 3


def test_a_back_end_that_fails_in_this_process_beside_others_is_named():
    """A cheap one that raises ends the asking."""

    def boom(skill, state):
        raise ZeroDivisionError

    cheap = fake_back_end(TASK, boom, name="broken", base=Detector)
    local = Feasibility(TASK, [cheap, *one_engine()], jobs=2)
    with pytest.raises(BackEndError, match="'broken' failed on"):
        local.verdicts(all_questions(TASK)[:3])


def test_a_process_in_which_a_back_end_does_not_start_is_one_clear_error():
    """It names the back end."""
    with pytest.raises(
        BackEndError, match=r"'startless-engine' failed to start in a process of its"
    ):
        Feasibility(TASK, one_engine(plugin=StartlessEngine), jobs=2).verdict(
            *all_questions(TASK)[0]
        )


@pytest.mark.slow(reason="starts processes; their end with the program in every run")
def test_what_a_process_prints_never_reaches_stdout(capfd):
    """Neither Python's nor a C library's."""
    questions = all_questions(TASK)[:4]
    Feasibility(TASK, one_engine(plugin=TalkingEngine), jobs=2).verdicts(questions)
    out, err = capfd.readouterr()
    assert out == ""
    assert "to stderr" in err


def alive(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def wait_until_gone(processes):
    deadline_s = time.monotonic() + PATIENCE_S
    while any(alive(process) for process in processes):
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.mark.parametrize("end", ["close", slow_case("forget", reason="closed in every run")])
def test_processes_end_when_nobody_needs_them_any_more(tmp_path, end):
    """When closed, or with what asked them; once closed, it may be asked again."""
    questions = all_questions(TASK)
    feasibility = Feasibility(TASK, one_engine(log=str(tmp_path)), jobs=2)
    feasibility.verdicts(questions[:8])
    processes = {process for *_, process in checks_in(tmp_path)}
    assert processes
    assert all(alive(process) for process in processes)
    if end == "close":
        feasibility.close()
        wait_until_gone(processes)
        assert feasibility.verdict(*questions[-1]).stage != "nobody"
    del feasibility
    gc.collect()
    wait_until_gone(processes)


PROGRAM = """
    import signal
    import sys
    # A shell starts what runs in its background deaf to interrupts.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.path[:0] = {path!r}
    from expensive_back_ends import ExpensiveEngine
    from skillplan.checks.feasibility import Feasibility
    from skillplan.testing import lid_task

    if __name__ == "__main__":
        task = lid_task()
        engine = ExpensiveEngine(task, ExpensiveEngine.Options(log={log!r}, wait_s={wait_s}))
        feasibility = Feasibility(task, [engine], jobs=2)
        questions = [(k, task.initial) for k in task.skills if k.applicable(task.initial)]
        feasibility.verdicts(questions)
        print("done", flush=True)
"""


def program(tmp_path, wait_s, *, guarded=True):
    log = tmp_path / "log"
    log.mkdir()
    script = tmp_path / "program.py"
    filled = PROGRAM.format(path=sys.path, log=str(log), wait_s=wait_s)
    filled = textwrap.dedent(filled)
    script.write_text(filled if guarded else filled.replace('__name__ == "__main__"', "True"))
    process = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    return process, log


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGKILL,
        *(
            slow_case(number, reason="SIGKILL in every run")
            for number in (signal.SIGINT, signal.SIGTERM)
        ),
    ],
)
def test_processes_end_with_the_program_that_started_them(tmp_path, number):
    """However it ends in the middle of a check."""
    process, log = program(tmp_path, 60)
    try:
        deadline_s = time.monotonic() + PATIENCE_S
        while len(checks_in(log)) < 2:
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
        process.send_signal(number)
        process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
        process.communicate()
    wait_until_gone({check for *_, check in checks_in(log)})


@pytest.mark.slow(
    reason="a script in processes of its own; another one of processes that end in every run"
)
def test_a_script_that_would_start_itself_again_is_told(tmp_path):
    """Its last line says what is missing; nothing hangs."""
    process, _ = program(tmp_path, 0, guarded=False)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out) == (1, "")
    last = err.splitlines()[-1]
    assert "A process for checks could not be started; what it said is above." in last
    assert "needs `if __name__ == '__main__':`." in last


@pytest.mark.slow(reason="a program with processes; one that is killed in every run")
def test_a_program_ends_at_once_though_its_processes_were_never_closed(tmp_path):
    """Nothing hangs, and nothing is said."""
    process, log = program(tmp_path, 0)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out, err) == (0, "done\n", "")
    wait_until_gone({check for *_, check in checks_in(log)})


@pytest.mark.slow(reason="processes; ending a trial early in every run")
def test_whoever_polls_can_end_the_asking_in_the_middle_of_a_check(tmp_path):
    """What is under way is given up; the next question finds processes again."""

    class Enough(Exception):
        pass

    begin_s = time.monotonic()

    def poll():
        if checks_in(tmp_path):
            raise Enough

    options = {"log": str(tmp_path), "fail_on": "pick(fuse)", "how": "hang", "once": True}
    feasibility = Feasibility(TASK, one_engine(**options), jobs=2)
    with pytest.raises(Enough):
        feasibility.verdicts([question_on("pick(fuse)")], poll)
    assert time.monotonic() - begin_s < PATIENCE_S
    wait_until_gone({process for *_, process in checks_in(tmp_path)})
    assert feasibility.verdict(*question_on("pick(fuse)")).stage in ("", "expensive-engine")


@pytest.mark.parametrize("jobs", [1, slow_case(2, reason="in one process in every run")])
def test_progress_counts_checks_done_reused_and_to_go(jobs):
    """Up to the last of a batch; a question that is answered from memory is not shown."""
    counts = []
    questions = all_questions(TASK)[:20]
    feasibility = Feasibility(TASK, one_engine(), jobs=jobs, on_check=counts.append)
    feasibility.verdicts(questions)
    assert counts[0] == CheckCount(0, 0, 20)
    assert counts[-1].checks == feasibility.checks
    assert all(count.checks + count.hits + count.to_go == 20 for count in counts)
    seen = len(counts)
    feasibility.verdicts(questions)
    assert len(counts) == seen
    cheap = Feasibility(TASK, [fake_back_end(TASK)], jobs=jobs, on_check=counts.append)
    cheap.verdicts(questions)
    assert len(counts) == seen


@pytest.mark.slow(reason="processes that wait; several skills are checked at once in every run")
def test_a_model_asks_for_all_skills_of_a_state_at_once(tmp_path):
    """Its transitions are those of one that asks one after the other."""
    (tmp_path / "log").mkdir()
    engine = one_engine(log=str(tmp_path / "log"), wait_s=0.05)
    results = [
        SkillModel(Feasibility(TASK, back_ends, jobs=jobs)).transitions(TASK.initial)
        for jobs, back_ends in ((1, one_engine()), (2, engine))
    ]
    assert results[0] == results[1]
    assert len({process for *_, process in checks_in(tmp_path / "log")}) == 2


@pytest.mark.parametrize("make", [CheckWorkers, lambda *a: Feasibility(*a[:2], jobs=a[2])])
def test_there_is_at_least_one_process(make):
    """Whoever asks for none is told."""
    with pytest.raises(ValueError, match="at least one process, not 0"):
        make(TASK, [], 0)


@pytest.mark.slow(reason="processes; verdicts in several processes in every run")
def test_an_enumeration_is_the_same_in_several_processes():
    """A whole level of states at a time."""
    results = [
        enumerate_feasibility(Feasibility(TASK, chain(TASK, seed=5), jobs=jobs)) for jobs in (1, 2)
    ]
    assert results[0] == results[1]
    assert results[0].executions > 0


def test_a_verdict_is_the_same_object_of_facts_wherever_it_was_made():
    """Facts of a verdict from a process are those of the task here."""
    verdict = Feasibility(TASK, one_engine(), jobs=2).verdict(*all_questions(TASK)[0])
    assert isinstance(verdict, Verdict)
    assert verdict.present.facts is TASK.facts
