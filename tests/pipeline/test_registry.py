"""Plugins found through entry points."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel, Field

from skillplan import load_problem
from skillplan.errors import OptionError, PluginError
from skillplan.pipeline import Setup, Terms, compare_solvers, registry, rows_side_by_side
from skillplan.solvers import Stop
from skillplan.workers import LocalProcesses
from thinned import slow_case

MODULE = """
from skillplan.solvers.solver import Solver
from skillplan.solvers.solution import Solution

class Sound(Solver):
    '''A sound solver.

    And more about it.
    '''
    name = "sound"
    def solve(self, model, *, seed=0):
        return Solution()

class Unfinished(Solver):
    '''Lacks its method.'''
    name = "unfinished"

class Stranger:
    '''No solver at all.'''

def function():
    pass
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Put distributions with entry points on the path, for one test."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def put(distribution, entries, module=None, text=MODULE, version="1.0"):
        folder = tmp_path / f"{distribution.replace('-', '_')}-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {distribution}\nVersion: {version}\n"
        )
        groups = {}
        for (kind, name), value in entries.items():
            groups.setdefault(f"skillplan.{kind}", []).append(f"{name} = {value}")
        (folder / "entry_points.txt").write_text(
            "\n".join(f"[{group}]\n" + "\n".join(lines) for group, lines in groups.items())
        )
        if module is not None:
            (tmp_path / f"{module}.py").write_text(text)
        registry.refresh()

    yield put
    registry.refresh()
    for name in [name for name in sys.modules if name.startswith("plugin_under_test")]:
        del sys.modules[name]


def test_the_built_ins_are_registered_like_any_plugin():
    """By kind; names are sorted."""
    assert registry.names("domain") == sorted(registry.names("domain"))
    assert "assembly" in registry.names("domain")
    assert "kinematic" in registry.names("physics")
    assert {"aabb", "precedence"} <= set(registry.names("collision"))
    assert {"exact", "exhaustive"} <= set(registry.names("solver"))
    for kind in registry.KINDS:
        assert all(info.problem is None for info in registry.describe(kind))


def test_an_unknown_kind_is_named_with_the_nearest():
    """There are four."""
    with pytest.raises(
        PluginError, match=r"Unknown kind of plugin 'solvers'. Did you mean 'solver'"
    ):
        registry.names("solvers")


def test_an_unknown_name_is_answered_with_the_nearest():
    """A slip of the hand."""
    with pytest.raises(PluginError, match=r"Unknown solver 'exat'. Did you mean 'exact'\?"):
        registry.load("solver", "exat")


def test_an_unknown_name_that_is_like_none_is_answered_with_what_is_installed():
    """All of it."""
    with pytest.raises(PluginError, match=r"Unknown collision 'zzz'. Known: .*aabb.*precedence"):
        registry.load("collision", "zzz")


def test_an_installed_plugin_is_listed_and_loaded(install):
    """With its distribution, its version and the first line of its docstring."""
    install("my-solvers", {("solver", "sound"): "plugin_under_test:Sound"}, "plugin_under_test")
    assert "sound" in registry.names("solver")
    assert registry.load("solver", "sound").name == "sound"
    info = next(info for info in registry.describe("solver") if info.name == "sound")
    assert (info.distribution, info.version) == ("my-solvers", "1.0")
    assert (info.summary, info.problem) == ("A sound solver.", None)


def test_names_are_listed_without_importing_anything(install):
    """A plugin that would bring the tool down does no harm until it is used."""
    install(
        "bomb",
        {("solver", "bomb"): "plugin_under_test_bomb:Bomb"},
        "plugin_under_test_bomb",
        "raise SystemExit('imported')",
    )
    assert "bomb" in registry.names("solver")
    assert "plugin_under_test_bomb" not in sys.modules


def test_two_providers_of_one_name_are_both_named(install):
    """Neither is preferred."""
    entries = {("solver", "sound"): "plugin_under_test:Sound"}
    install("first-party", entries, "plugin_under_test")
    install("second-party", entries, version="2.5")
    with pytest.raises(PluginError) as caught:
        registry.load("solver", "sound")
    message = str(caught.value)
    assert "first-party 1.0" in message
    assert "second-party 2.5" in message
    assert "Uninstall one of them" in message
    problems = [i.problem for i in registry.describe("solver") if i.name == "sound"]
    assert problems == [message, message]


def test_a_plugin_that_takes_the_name_of_a_built_in_is_no_replacement(install):
    """It is a second provider like any other."""
    install("usurper", {("solver", "exact"): "plugin_under_test:Sound"}, "plugin_under_test")
    with pytest.raises(PluginError, match=r"'exact' is provided by .*usurper 1.0"):
        registry.load("solver", "exact")


BROKEN = {
    "plugin_under_test_gone:Solver": "cannot be imported .*ModuleNotFoundError",
    "plugin_under_test:Gone": "cannot be imported .*AttributeError",
    "plugin_under_test:Stranger": "not a subclass of skillplan.solvers.solver.Solver",
    "plugin_under_test:function": "not a subclass of skillplan.solvers.solver.Solver",
    "plugin_under_test:Unfinished": "does not implement solve",
}


@pytest.mark.parametrize("value", BROKEN)
def test_a_broken_plugin_is_reported_where_it_is_asked_for(install, value):
    """With its distribution; it does not take the others down."""
    install("faulty", {("solver", "broken"): value}, "plugin_under_test")
    with pytest.raises(PluginError, match=f"'broken' of faulty 1.0.*{BROKEN[value]}"):
        registry.load("solver", "broken")
    infos = {info.name: info for info in registry.describe("solver")}
    assert infos["broken"].problem is not None
    assert infos["broken"].summary == ""
    assert infos["exact"].problem is None


def test_a_plugin_that_fails_while_it_is_imported_says_why(install):
    """Whatever it raises."""
    install(
        "faulty",
        {("solver", "broken"): "plugin_under_test_faulty:Solver"},
        "plugin_under_test_faulty",
        "raise OSError('libfancy.so: cannot open shared object file')",
    )
    with pytest.raises(PluginError, match=r"OSError: libfancy.so: cannot open"):
        registry.load("solver", "broken")


def test_a_plugin_of_another_kind_does_not_fit(install):
    """A solver is no engine."""
    install("mixed-up", {("physics", "sound"): "plugin_under_test:Sound"}, "plugin_under_test")
    with pytest.raises(PluginError, match=r"not a subclass of skillplan.physics.engine.Engine"):
        registry.load("physics", "sound")


class Optioned:
    class Options(BaseModel):
        """What an engine might have."""

        force_n: float = Field(default=5.0, ge=0, le=100, description="grip force [N]")
        retries: int = Field(default=3, ge=1, description="attempts [-]")


def options(**values):
    return registry.make_options("physics", "optioned", Optioned, values)


def test_options_are_validated_and_have_defaults():
    """What is left out keeps its default."""
    created = options(force_n=20.0)
    assert (created.force_n, created.retries) == (20.0, 3)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"forcen": 1.0}, ["'optioned' has no option 'forcen'", "Did you mean 'force_n'?"]),
        ({"force_n": 101.0}, ["force_n", "100"]),
        ({"force_n": -1.0}, ["force_n", "0"]),
        ({"force_n": "strong"}, ["force_n", "number"]),
        ({"retries": 0}, ["retries", "1"]),
        ({"retries": 1.5}, ["retries"]),
    ],
)
def test_a_wrong_option_is_named_with_what_would_be_right(values, words):
    """The nearest name, or the range."""
    with pytest.raises(OptionError) as caught:
        options(**values)
    message = str(caught.value)
    assert "physics 'optioned'" in message
    assert all(word in message for word in words), message


def test_several_wrong_options_are_reported_at_once():
    """Not the first only."""
    with pytest.raises(OptionError, match=r"force_n.*retries"):
        options(force_n=101.0, retries=0)


@pytest.mark.parametrize(
    ("kind", "name", "option", "value"),
    [
        ("collision", "aabb", "tolerance_m", 1.0),
        ("collision", "aabb", "check_support", "perhaps"),
        ("collision", "precedence", "hold_back_pick", True),
        ("solver", "exact", "max_labels", 0),
        ("physics", "kinematic", "anything", 1),
    ],
)
def test_the_built_ins_check_their_options(kind, name, option, value):
    """Unknown ones and values out of range."""
    with pytest.raises(OptionError, match=option):
        registry.make_options(kind, name, registry.load(kind, name), {option: value})


@pytest.mark.parametrize(
    ("kind", "name", "distribution"),
    [
        ("exporter", "ros", "skillplan-ros2"),
        ("collision", "swept", "skillplan-pinocchio"),
        ("collision", "contact-pairs", "skillplan-simulation"),
    ],
)
def test_a_plugin_of_this_project_that_is_missing_is_named_with_its_distribution(
    monkeypatch, kind, name, distribution
):
    monkeypatch.setattr(registry, "_providers", lambda _: {})
    with pytest.raises(PluginError, match=f"is not installed: pip install {distribution}, or in"):
        registry.load(kind, name)


# Solvers of a comparison side by side: the rows are those of solvers in turn.


ROOT = Path(__file__).parents[2]
BOARD = ROOT / "configs" / "inverter_board.yaml"
BENCH = ROOT / "configs" / "swarmitfix_polygonal.yaml"
OPEN = ROOT / "tests" / "instances" / "sop" / "kro124p.4.sop"


def timeless(document: Any) -> Any:
    """Return a document without what is measured in seconds of this machine."""
    if isinstance(document, dict):
        measured = {
            "wall_s",
            "learning_s",
            "sampling_s",
            "enumeration_s",
            "compile_s",
            "solve_s",
            "seconds",
        }
        return {key: timeless(item) for key, item in document.items() if key not in measured}
    return [timeless(entry) for entry in document] if isinstance(document, list) else document


@pytest.mark.parametrize(
    ("file", "solvers"),
    [
        (BOARD, ["exact", "value-iteration"]),
        slow_case(
            BENCH,
            ["csp", "monte-carlo", "policy-iteration"],
            reason="learns in processes; one task in every run",
        ),
    ],
)
def test_rows_are_those_of_solvers_in_turn(file, solvers):
    """But for seconds: plans, bounds, counts and figures of the search, in the given order."""
    problem = load_problem(file)
    in_turn = compare_solvers(problem, solvers)
    at_once = compare_solvers(problem, solvers, jobs=2)
    assert [row.solver for row in at_once] == solvers
    assert timeless([item.document() for item in at_once]) == timeless(
        [entry.document() for entry in in_turn]
    )


def started(monkeypatch: pytest.MonkeyPatch, then: Callable[[Any], None]) -> list[Any]:
    """Note every process that is started from now on, and have something done with it."""
    begin, created = LocalProcesses.start, []

    def start(self: LocalProcesses, *args: Any) -> Any:
        worker = begin(self, *args)
        created.append(worker)
        then(worker)
        return worker

    monkeypatch.setattr(LocalProcesses, "start", start)
    return created


def test_a_process_goes_on_with_the_next_solver(monkeypatch):
    """Two processes for four rows; every solver starts with a cold cache of verdicts."""
    created = started(monkeypatch, lambda worker: None)
    rows = compare_solvers(load_problem(BOARD), ["exact", "exact", "exact", "exact"], jobs=2)
    assert len(created) == 2
    assert len({row.checks for row in rows}) == 1  # type: ignore[union-attr]
    assert rows[0].checks > 0  # type: ignore[union-attr]


def test_with_more_processes_than_solvers_each_may_use_all(monkeypatch):
    """Then they run in turn, here."""
    created = started(monkeypatch, lambda worker: None)
    rows = compare_solvers(load_problem(BOARD), ["exact", "value-iteration"], jobs=3)
    assert [row.status for row in rows] == ["optimal", "optimal"]
    assert created == []


def test_a_solver_whose_process_is_killed_has_failed_and_the_others_go_on(monkeypatch):
    """The row says by which signal."""

    def kill(worker: Any) -> None:
        if len(created) == 1:
            os.kill(worker.number, signal.SIGKILL)

    created: list[Any] = []
    created = started(monkeypatch, kill)
    rows = compare_solvers(load_problem(BOARD), ["exact", "value-iteration"], jobs=2)
    assert [row.status for row in rows] == ["failed", "optimal"]  # type: ignore[union-attr]
    assert "its process ended by signal 9" in rows[0].reason  # type: ignore[union-attr]


def test_wrong_input_that_a_process_meets_is_the_user_s_to_repair():
    """As in turn: no row, but an error."""
    setup = Setup(options={"exact": {"no_such_option": 1}})
    terms = Terms(load_problem(BOARD), setup)
    with pytest.raises(OptionError, match="no_such_option"):
        rows_side_by_side(terms, ["exact", "exact"], 2, {}, Stop())


def test_an_interruption_ends_what_runs_with_what_it_has_and_begins_no_other():
    """Rows of those that have not begun are missing."""
    stop = Stop()
    terms = Terms(load_problem(OPEN), Setup())
    begun_s = time.monotonic()
    threading.Timer(2.0, stop.interrupt).start()
    rows = rows_side_by_side(terms, ["exact", "local-search", "exact"], 2, {}, stop)
    assert time.monotonic() - begun_s < 60.0
    assert [row.solver for row in rows] == ["exact", "local-search"]
    assert all(row.interrupted for row in rows)  # type: ignore[union-attr]


def test_limits_hold_for_each():
    """Time counts from the beginning of each search."""
    problem = load_problem(OPEN)
    rows = compare_solvers(problem, ["exact", "exact"], jobs=2, limits={"time_limit_s": 0.5})
    # With or without a plan, depending on the machine.
    assert {row.status for row in rows} <= {"solved", "unsolved"}  # type: ignore[union-attr]
    assert all(row.wall_s < 5.0 for row in rows)
