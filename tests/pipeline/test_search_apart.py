"""Limits need no consent: a solver that never looks at its stop is ended from outside."""

from __future__ import annotations

import os
import sys
import time
from textwrap import dedent
from typing import Any

import pytest

from situations import FakeSetup
from skillplan.errors import BackEndError, SearchStopped, SolverError
from skillplan.pipeline import GRACE_S, make_solver, registry, solve
from skillplan.solvers import Solver, Stop
from skillplan.testing import lid_task
from skillplan.workers import measure_resident_bytes
from thinned import slow_case

PATIENCE_S = 20
HEAD = """
import os, time
from skillplan import Detector, Plan, Solution, Solver, Verdict


class Unsure(Detector):
    name = "unsure"

    def check(self, skill, state):
        return Verdict.unknown("who knows")


class TooFew(Detector):
    name = "too-few"

    def check(self, skill, state):
        nothing = self.task.facts.none
        if skill.name == "place(lid)" and "placed(fuse)" in state:
            return Verdict.infeasible("the fuse is in the way", nothing, nothing)
        return Verdict.feasible(nothing, nothing)


class Fickle(Detector):
    name = "fickle"

    def __init__(self, task, options=None):
        super().__init__(task, options)
        self.asked = set()

    def check(self, skill, state):
        known = (skill.name, state) in self.asked
        self.asked.add((skill.name, state))
        return Verdict.infeasible("not again") if known else Verdict.feasible()


class Screen(Detector):
    name = "screen"

    def __init__(self, task, options=None):
        super().__init__(task, options)
        self.screens = True

    def check(self, skill, state):
        if skill.name == "load(screwdriver)" and "placed(lid)" not in state:
            return Verdict.infeasible("too early")
        return Verdict.feasible()


class Grants(Detector):
    name = "grants"
    expensive = True
    expected_s = 1.0

    def check(self, skill, state):
        return Verdict.feasible()


class Stubborn(Solver):
    name = "stubborn"

    def solve(self, model, *, seed=0):
"""


@pytest.fixture
def stubborn(tmp_path, monkeypatch):
    """Install a solver whose `solve` is some lines of Python, here and in other processes."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *sys.path]))

    def put(body: str) -> str:
        lines = "".join(f"        {line}\n" for line in dedent(body).strip().splitlines())
        (tmp_path / "stubborn_solver.py").write_text(HEAD + lines)
        info = tmp_path / "stubborn-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stubborn\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(
            "[skillplan.solver]\nstubborn = stubborn_solver:Stubborn\n"
        )
        registry.refresh()
        return "stubborn"

    yield put
    sys.modules.pop("stubborn_solver", None)
    registry.refresh()


def best_of(task: Any) -> tuple[tuple[str, ...], float]:
    best = solve(task, "exact")
    assert best.cost is not None
    return tuple(step.skill for step in best.steps), best.cost


@pytest.mark.slow(reason="waits for the limit; every run ends one that holds too much memory")
def test_one_that_never_polls_is_ended_and_its_incumbent_counts(stubborn):
    """Soon after the limit, with the last plan and bound that it reported."""
    skills, cost = best_of(lid_task())
    name = stubborn(
        f"""
        self.stop.incumbent(Plan({skills!r}, {cost!r}))
        self.stop.bound({cost / 2!r})
        while True:
            time.sleep(0.01)
        """
    )
    begin_s = time.monotonic()
    result = solve(lid_task(), name, stop=Stop(time_limit_s=2))
    assert time.monotonic() - begin_s < PATIENCE_S
    assert ("solved", cost) == (result.status, result.cost)
    assert cost / 2 == result.lower_bound
    assert result.reason.startswith("time limit")


@pytest.mark.slow(reason="waits for a process to be ended; every run has one that is")
def test_one_that_swallows_every_error_is_ended_too(stubborn):
    """Though it queries the model for ever."""
    name = stubborn(
        """
        while True:
            try:
                model.transitions(model.initial)
            except BaseException:
                pass
        """
    )
    result = solve(lid_task(), name, stop=Stop(time_limit_s=1))
    assert ("unsolved", "time limit") == (result.status, result.reason.partition(":")[0])


@pytest.mark.slow(reason="fills memory; limits of time in every run")
def test_memory_is_measured_from_outside(stubborn):
    """What it allocates in one go, without ever looking, ends it; its incumbent counts."""
    skills, cost = best_of(lid_task())
    # The limit is for this process, too, in which other tests have run.
    limit = (measure_resident_bytes() or 0) + 300 * 1024 * 1024
    name = stubborn(
        f"""
        self.stop.incumbent(Plan({skills!r}, {cost!r}))
        held = bytearray(os.urandom(1)) * ({limit} + 100 * 1024 * 1024)
        while True:
            time.sleep(0.01)
        """
    )
    result = solve(lid_task(), name, stop=Stop(memory_limit_bytes=limit))
    assert ("solved", cost) == (result.status, result.cost)
    assert result.reason.startswith("memory limit")


def test_one_that_hears_the_request_returns_what_it_has(stubborn):
    """An interruption reaches its stop in the other process."""
    skills, cost = best_of(lid_task())
    name = stubborn(
        f"""
        self.stop.bound(0.0)
        while not self.stop():
            time.sleep(0.01)
        return Solution(Plan({skills!r}, {cost!r}), trace={{"heard": True}})
        """
    )
    stop = Stop(time_limit_s=60, on_progress=lambda progress: stop.interrupt())
    result = solve(lid_task(), name, stop=stop)
    assert ("solved", cost) == (result.status, result.cost)
    assert result.trace["heard"]
    assert result.interrupted


def test_what_it_finds_and_proves_in_time_is_judged_as_ever(stubborn):
    """Plan, proof, trace and what it queried come back."""
    skills, cost = best_of(lid_task())
    name = stubborn(
        f"""
        model.transitions(model.initial)
        return Solution(Plan({skills!r}, {cost!r}), {cost!r}, True, {{"where": os.getpid()}})
        """
    )
    result = solve(lid_task(), name, stop=Stop(time_limit_s=60))
    assert ("optimal", cost) == (result.status, result.cost)
    assert os.getpid() != result.trace["where"]
    assert 1 == result.states
    assert result.checks


def test_without_a_limit_it_stays_here(stubborn):
    """A process costs time."""
    name = stubborn('return Solution(trace={"where": os.getpid()})')
    assert os.getpid() == solve(lid_task(), name).trace["where"]


def test_one_that_says_it_polls_stays_here(stubborn, monkeypatch):
    """It is spared the process."""
    name = stubborn('return Solution(trace={"where": os.getpid()})')
    monkeypatch.setattr(registry.load("solver", name), "polls", True)
    assert os.getpid() == solve(lid_task(), name, stop=Stop(time_limit_s=60)).trace["where"]


@pytest.mark.slow(reason="imports every plugin; each is imported by tests of its own")
def test_all_that_come_with_skillplan_poll():
    """None of them needs a process of its own."""
    for name in registry.names("solver"):
        solver: type[Solver] = registry.load("solver", name)
        assert solver.polls, name


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("raise LookupError('no table')", "failed: LookupError: no table .*stubborn_solver.py"),
        slow_case(
            "raise SystemExit(0)", "failed: SystemExit: 0", reason="another one in every run"
        ),
        ("os.kill(os.getpid(), 9)", "its process was ended by signal 9"),
        ("return 7", "returned int, not a Solution"),
        slow_case(
            "return Solution(trace={'x': float('nan')})",
            "cannot be read: its trace is not JSON",
            reason="what it returns is read in every run",
        ),
    ],
)
def test_what_goes_wrong_there_is_said_here(stubborn, body, words):
    """The solver has failed, in words that name it."""
    with pytest.raises(SolverError, match=words):
        solve(lid_task(), stubborn(body), stop=Stop(time_limit_s=60))


WALKS = """
from skillplan.testing.tasks import reachable_states
reachable_states(model)
"""


class TestWhatItsSearchRestedOn:
    @pytest.mark.parametrize(
        ("detector", "words"),
        [
            (
                "TooFew",
                r"'too-few' contradicts itself about place\(lid\): .* resting on no fact, .*"
                r"should have named .*placed\(fuse\)",
            ),
            slow_case(
                "Fickle",
                "'fickle' answers differently the second time: ",
                reason="a process; another fault in every run",
            ),
        ],
    )
    def test_is_asked_again_here(self, stubborn, detector, words):
        """A detector that names too few facts, or changes its mind, is found out."""
        name = stubborn(WALKS + "return Solution()")
        with pytest.raises(BackEndError, match=words):
            solve(lid_task(), name, asking(detector), stop=Stop(time_limit_s=60), audit=64)

    @pytest.mark.slow(reason="waits for a process to be ended; one that ends in every run")
    def test_is_asked_again_where_it_was_ended(self, stubborn):
        """What it last told comes with what that rests on."""
        name = stubborn(
            WALKS
            + """
self.stop.bound(0.1)
while True:
    time.sleep(0.01)
"""
        )
        with pytest.raises(BackEndError, match=r"should have named .*placed"):
            solve(lid_task(), name, asking("TooFew"), stop=Stop(time_limit_s=3), audit=64)

    def test_is_not_asked_again_where_nobody_wants_it(self, stubborn):
        """The size is that of `--audit`."""
        name = stubborn(WALKS + "return Solution()")
        stop = Stop(time_limit_s=60)
        assert "unsolved" == solve(lid_task(), name, asking("TooFew"), stop=stop, audit=0).status

    def test_has_refusals_of_screens_that_are_executed_here(self, stubborn):
        """As many as of a search in this process; one that is granted takes the proof back."""
        skills, cost = best_of(lid_task())
        name = stubborn(WALKS + f"return Solution(Plan({skills!r}, {cost!r}), {cost!r}, True)")
        setup = asking("Screen", "Grants")
        here = solve(lid_task(), make_solver(name, {}), setup)
        apart = solve(lid_task(), name, setup, stop=Stop(time_limit_s=60))
        assert here.trace["screening"] == apart.trace["screening"]
        assert apart.trace["screening"]["refused"] > 1
        assert here.reason == apart.reason
        assert "solved" == apart.status
        assert "which grants grants in {" in apart.reason


def asking(*detectors: str) -> FakeSetup:
    """Return a setup with some of the detectors that stand beside the solver."""
    import stubborn_solver

    return FakeSetup(
        make=lambda task: [getattr(stubborn_solver, detector)(task) for detector in detectors]
    )


def test_no_exception_handler_of_a_solver_catches_a_stop():
    """It is none of what `except Exception` stands for, and no back end's failure."""
    assert not issubclass(SearchStopped, Exception)
    assert not issubclass(SearchStopped, BackEndError)
    assert GRACE_S > 0


@pytest.mark.slow(reason="waits for a process to be ended; every run has one that is")
def test_a_bound_that_rests_on_unknown_verdicts_is_none(stubborn):
    """What was queried is told with the bound, so that an ended process leaves no false proof."""
    name = stubborn(
        """
        model.transitions(model.initial)
        self.stop.bound(1.0)
        while True:
            time.sleep(0.01)
        """
    )
    import stubborn_solver

    unsure = FakeSetup(make=lambda task: [stubborn_solver.Unsure(task)])
    result = solve(lid_task(), name, unsure, stop=Stop(time_limit_s=2))
    assert ("unsolved", None) == (result.status, result.lower_bound)
    assert "unknown" in result.reason
