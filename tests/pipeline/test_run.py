"""The straight line: from a path to a judged result."""

from dataclasses import replace

import pytest

from expensive_back_ends import ExpensiveEngine
from situations import CONFIGS, FakeSetup, fake_back_end, solver_that, two_roads_task
from skillplan import ChainResult, Result, Status, solve_problem
from skillplan.checks import DiskVerdictCache
from skillplan.collision import AabbDetector, Detector
from skillplan.errors import BackEndError, OptionError, PluginError, TaskError
from skillplan.files import get_cache_folder
from skillplan.judge import cross_examine
from skillplan.pipeline import (
    Setup,
    Terms,
    load_problem,
    make_model,
    make_solver,
    registry,
    rows_in_turn,
    solve,
)
from skillplan.solvers import Plan, Solution, Stop
from skillplan.task import BackEndChoice, Verdict
from skillplan.testing import lid_task
from thinned import slow_case

BOARD = CONFIGS / "inverter_board.yaml"


GEOMETRIC = "swept" if "swept" in registry.names("collision") else "aabb"


def names(task, setup=Setup()):
    return [back_end.name for back_end in setup.back_ends(task)]


def solve_with_all(task, solvers, setup=Setup(), make_stop=lambda name: Stop()):
    """Return the results of several solvers that a comparison runs in turn on any task."""
    problem = replace(load_problem(BOARD), tasks=(task,))
    return cross_examine(rows_in_turn(Terms(problem, setup), solvers, make_stop))


def test_a_path_becomes_a_judged_result():
    """Load, solve, judge; the result says by what and of which content."""
    problem = load_problem(BOARD)
    result = solve(problem.task)
    assert (result.status, result.solver, result.seed) == ("optimal", "auto", 0)
    assert (result.physics, result.collision) == ("kinematic", "precedence")
    assert (result.task, result.kind, result.sha256) == (
        "inverter-board",
        "assembly",
        problem.sha256,
    )
    assert result.cost_unit == "m"
    assert result.makespan == 15
    assert result.makespan_s == pytest.approx(sum(step.duration_s for step in result.steps))
    assert (result.wall_s > 0, result.checks > 0, result.expanded > 0) == (True, True, True)


def test_the_makespan_is_durations_and_travel(board_task):
    """12 picks and places of 3 s, two screws of 8 s, and the path at 0.25 m/s.

    The swap puts back one tool in 5 s and attaches the other in 10 s, at one place here.
    """
    result = solve(board_task)
    assert result.makespan_s == pytest.approx(12 * 3 + 5 + 10 + 2 * 8 + result.cost / 0.25)


def test_the_task_file_chooses_the_back_ends():
    """Or else the default geometric detector; none for a task without bodies."""
    task = lid_task().replace(collision=(), chart=())
    assert names(task) == ["kinematic", GEOMETRIC]
    assert names(two_roads_task()) == ["kinematic"]
    assert names(task.replace(collision=(BackEndChoice("aabb"),))) == ["kinematic", "aabb"]


def test_a_chart_is_checked_beside_the_geometric_detector():
    """Whether that is the default, the task file's choice or the user's."""
    task = lid_task().replace(collision=())
    assert names(task) == ["kinematic", GEOMETRIC, "precedence"]
    assert names(task, Setup(collision=("aabb",))) == ["kinematic", "aabb", "precedence"]
    by_boxes = task.replace(collision=(BackEndChoice("aabb"),))
    assert names(by_boxes) == ["kinematic", "aabb", "precedence"]
    assert names(by_boxes, Setup(with_chart=False)) == ["kinematic", "aabb"]


def test_detectors_that_include_the_chart_are_used_as_they_are():
    """Only then a chart may stand alone; the task lists that geometry is not checked."""
    task = lid_task().replace(collision=())
    assert names(task, Setup(collision=("precedence",))) == ["kinematic", "precedence"]
    assert names(task, Setup(collision=("precedence", "aabb"))) == [
        "kinematic",
        "precedence",
        "aabb",
    ]
    in_file = task.replace(collision=(BackEndChoice("precedence"),))
    assert names(in_file) == ["kinematic", "precedence"]
    assert names(in_file, Setup(with_chart=False)) == ["kinematic", GEOMETRIC]


def test_a_search_by_the_chart_alone_lists_geometry_as_not_checked():
    """With a geometric detector beside the chart it does not."""
    task = lid_task().replace(collision=())
    (sentence,) = solve(task, "exact", Setup(collision=("precedence",))).not_checked
    assert sentence.startswith("geometry (collisions, support, the arm's motion)")
    by_both = solve(task, "exact", Setup(collision=("precedence", "aabb")))
    assert sentence not in by_both.not_checked


def test_the_user_chooses_before_the_task_file():
    """A detector named twice is asked once."""
    task = lid_task().replace(chart=(), collision=(BackEndChoice("swept"),))
    assert names(task, Setup(collision=("aabb",))) == ["kinematic", "aabb"]
    assert names(task, Setup(collision=("aabb", "aabb"))) == ["kinematic", "aabb"]


def test_options_of_the_file_hold_until_the_user_changes_them():
    """One by one."""
    choice = BackEndChoice("aabb", {"tolerance_m": 0.001, "check_support": False})
    task = lid_task().replace(chart=(), collision=(choice,))
    (_, aabb) = Setup().back_ends(task)
    assert (aabb.options.tolerance_m, aabb.options.check_support) == (0.001, False)
    (_, aabb) = Setup(options={"aabb": {"tolerance_m": 0.002}}).back_ends(task)
    assert (aabb.options.tolerance_m, aabb.options.check_support) == (0.002, False)


def test_an_unknown_plugin_or_option_is_a_user_error():
    """Before anything is searched."""
    task = lid_task()
    with pytest.raises(PluginError, match="Unknown physics 'kinematik'"):
        make_model(task, Setup(physics="kinematik"))
    with pytest.raises(PluginError, match="Unknown solver 'exakt'"):
        solve(task, "exakt")
    with pytest.raises(OptionError, match="'aabb' has no option 'tolerance'"):
        make_model(task, Setup(collision=("aabb",), options={"aabb": {"tolerance": 1}}))
    with pytest.raises(OptionError, match="max_labels"):
        make_solver("exact", {"max_labels": -1})
    with pytest.raises(TaskError):
        load_problem("no/such/file.yaml")


@pytest.mark.parametrize("method", ["__init__", "refuses"])
def test_a_back_end_that_fails_to_start_is_named(monkeypatch, method):
    """It is a failure of the back end, not of the input."""

    def fail(self, *arguments):
        raise OSError("no licence")

    def check(self, skill, state):
        return Verdict.feasible()

    broken = type("Broken", (Detector,), {"name": "broken", "check": check, method: fail})
    load = registry.load
    monkeypatch.setattr(
        registry, "load", lambda kind, name: broken if name == "broken" else load(kind, name)
    )
    with pytest.raises(BackEndError, match="collision 'broken' failed on 'lid': OSError: no lic"):
        make_model(lid_task(), Setup(collision=("broken",)))


def test_each_solver_of_a_comparison_starts_cold(lid_task):
    """The second asks as much as it would alone."""
    together = solve_with_all(lid_task, ["exact", "exhaustive", "exact"])
    alone = solve(lid_task, "exhaustive")
    assert [result.status for result in together] == ["optimal"] * 3
    assert together[1].checks == alone.checks
    assert together[2].checks == together[0].checks > 0


def test_a_comparison_holds_the_claims_together(monkeypatch):
    """Whoever is refuted by another's plan is wrong, even where the audit found nothing."""
    liar = solver_that(lambda s, m: Solution(Plan(("to_b", "finish"), 4.0), 4.0, proved=True))
    honest = solver_that(lambda s, m: Solution(Plan(("to_a", "a_to_b", "finish"), 3.0)), "honest")
    monkeypatch.setattr("skillplan.judge.referee.AUDIT_STATES", 0)
    task, setup = two_roads_task(), FakeSetup()
    monkeypatch.setattr(
        "skillplan.pipeline.solving.make_solver",
        lambda name, *rest: {"liar": liar, "honest": honest}[name],
    )
    assert solve(task, "liar", setup).status == "optimal"
    judged = solve_with_all(task, ["liar", "honest"], setup)
    assert [result.status for result in judged] == ["wrong", "solved"]


def test_an_interrupted_comparison_leaves_out_the_rest(board_task):
    """What was found so far is judged and shown."""

    def make_stop(name):
        stop = Stop()
        stop.interrupt()
        return stop

    results = solve_with_all(board_task, ["exhaustive", "exact"], make_stop=make_stop)
    assert len(results) == 1
    assert results[0].interrupted


def test_a_warm_cache_spares_dear_checks(tmp_path):
    """A second run asks an expensive back end nothing, and finds the same."""
    created = []

    def expensive(task):
        created.append(fake_back_end(task, Verdict.feasible(), expensive=True))
        return [created[-1]]

    results = [
        solve(
            two_roads_task(), "exact", FakeSetup(make=expensive), cache=DiskVerdictCache(tmp_path)
        )
        for _ in range(2)
    ]
    assert results[0].steps == results[1].steps
    assert (results[0].checks > 0, results[1].checks) == (True, 0)
    assert [bool(back_end.asked) for back_end in created] == [True, False]


def test_without_a_choice_the_cache_is_the_users(monkeypatch):
    """Never the working folder."""
    monkeypatch.delenv("SKILLPLAN_CACHE_DIR")
    assert get_cache_folder().name == "skillplan"
    assert get_cache_folder().is_absolute()
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", "/somewhere/else")
    assert str(get_cache_folder()) == "/somewhere/else"


def test_a_refusal_is_a_result_in_words():
    """Not an error: in a comparison the others go on."""
    solver = solver_that(lambda s, m: Solution())
    type(solver).refuses = lambda self, model: "needs a larger task"
    result = solve(two_roads_task(), solver, FakeSetup())
    assert (result.status, result.reason, result.cost) == ("refused", "needs a larger task", None)


def test_a_search_shows_what_it_asks_of_expensive_back_ends():
    """With its own figures, through the stop."""
    shown = []
    stop = Stop(on_progress=shown.append)
    setup = FakeSetup(make=lambda task: [fake_back_end(task, Verdict.feasible(), expensive=True)])
    result = solve(two_roads_task(), "exact", setup, stop=stop)
    queries = [progress.queries for progress in shown if progress.queries is not None]
    assert queries[-1].checks == result.checks > 0
    assert queries[0].checks == queries[-1].to_go == 0
    quiet = []
    solve(two_roads_task(), "exact", FakeSetup(), stop=Stop(on_progress=quiet.append))
    assert all(progress.queries is None for progress in quiet)


def test_a_plan_takes_as_long_as_the_back_ends_say():
    """Instead of what the task says."""
    clock = {"duration_s": lambda self, skill, state: 7.5}
    setup = FakeSetup(make=lambda task: [fake_back_end(task, Verdict.feasible(), **clock)])
    result = solve(two_roads_task(), "exact", setup)
    assert result.makespan_s == 7.5 * len(result.steps) > 0
    assert {step.duration_s for step in result.steps} == {7.5}


@pytest.mark.parametrize(
    "solver", ["exact", slow_case("exhaustive", reason="exact search in every run")]
)
def test_a_result_does_not_depend_on_how_many_processes_check(solver):
    """Neither plan, nor proof, nor counts, but for what idle processes made of their time."""
    task = lid_task()
    options = ExpensiveEngine.Options(seed=2)
    setup = FakeSetup(make=lambda task: [ExpensiveEngine(task, options)])
    results = []
    for jobs in (1, 2):
        result = solve(task, solver, setup, jobs=jobs)
        trace = {key: message for key, message in result.trace.items() if key != "ahead"}
        results.append(replace(result, wall_s=0.0, trace=trace))
    assert results[0] == results[1]
    assert results[0].checks > 0


class TestConstruction:
    """A back end may take seconds to start: it is constructed once for a solver and its judge."""

    @pytest.fixture
    def made(self):
        """The back ends that were constructed."""
        return []

    @pytest.fixture
    def setup(self, made):
        """A setup whose one back end is noted when it is constructed."""

        def make(task):
            made.append(fake_back_end(task, Verdict.feasible()))
            return [made[-1]]

        return FakeSetup(make=make)

    def test_search_and_judge_share_it(self, made, setup):
        """As does the walk along a plan to start from."""
        start = Plan(("to_a", "a_to_b", "finish"))
        result = solve(two_roads_task(), "exact", setup, start=start)
        assert result.status == "optimal"
        assert len(made) == 1

    def test_it_is_told_of_the_others_once(self):
        """However many models are made of it."""
        messages = []

        class Social(Detector):
            """Notes who is beside it."""

            name = "social"

            def beside(self, others):
                messages.append(len(others))

            def check(self, skill, state):
                return Verdict.feasible()

        setup = FakeSetup(make=lambda task: [Social(task), fake_back_end(task, name="other")])
        solve(two_roads_task(), "exact", setup)
        assert messages == [1]

    def test_a_result_lists_each_sentence_about_what_is_not_checked_once(self):
        """A back end that names nothing adds nothing."""

        class Partial(Detector):
            """Leaves the cables unchecked."""

            name = "partial"

            def not_checked(self):
                return ("cables: the task does not describe them",)

            def check(self, skill, state):
                return Verdict.feasible()

        class Alike(Partial):
            name = "alike"

        back_ends = (Partial, Alike, lambda task: fake_back_end(task, name="full"))
        setup = FakeSetup(make=lambda task: [make(task) for make in back_ends])
        result = solve(two_roads_task(), "exact", setup)
        assert result.not_checked == ("cables: the task does not describe them",)
        assert result.document()["not_checked"] == [*result.not_checked]

    def test_what_fails_to_say_what_it_leaves_unchecked_is_blamed(self):
        class Mute(Detector):
            name = "mute"

            def not_checked(self):
                raise ValueError("lost")

            def check(self, skill, state):
                return Verdict.feasible()

        with pytest.raises(BackEndError, match=r"mute.*lost"):
            solve(two_roads_task(), "exact", FakeSetup(make=lambda task: [Mute(task)]))

    def test_each_solver_of_a_comparison_has_its_own(self, made, setup):
        """What a back end remembers for one must not spare the next its work."""
        solve_with_all(two_roads_task(), ["exact", "exhaustive"], setup)
        assert len(made) == 2

    def test_the_referee_has_a_fresh_model(self, made, setup):
        """It queries cheap back ends anew, whoever has queried them before."""
        queried = []
        solver = solver_that(
            lambda self, model: (
                queried.append(len(made[0].asked)) or Solution(Plan(("to_b", "finish")))
            )
        )
        assert solve(two_roads_task(), solver, setup).status == "solved"
        assert queried == [0]
        assert len(made[0].asked) == 2

    def test_one_that_loading_constructed_is_handed_on_once(self):
        """The next who wants one constructs another."""
        problem = load_problem("configs/inverter_board.yaml", {"collision": ["aabb"]})
        problem.spare_back_ends.append(AabbDetector(problem.task))
        (spare,) = problem.spare_back_ends
        setup = Setup(collision=("aabb",))
        assert setup.back_ends(problem.task, problem.spare_back_ends)[1] is spare
        assert setup.back_ends(problem.task, problem.spare_back_ends)[1] is not spare

    def test_one_with_other_options_is_not_taken(self):
        """Nor one of another task."""
        task = lid_task()
        spare = [AabbDetector(task)]
        setup = Setup(collision=("aabb",), options={"aabb": {"tolerance_m": 0.002}})
        assert setup.back_ends(task, spare)[1] is not spare[0]
        assert Setup(collision=("aabb",)).back_ends(lid_task(), spare)[1] is not spare[0]
        assert len(spare) == 1


# A loaded file, solved: one task, one task of a chain, or the whole chain.


@pytest.fixture
def chain():
    """The four cases of the bench, each a task."""
    return load_problem(CONFIGS / "swarmitfix_cases.yaml")


def test_a_single_task_is_one_result():
    """By the solver that serves the file best, where none is named."""
    result = solve_problem(load_problem(CONFIGS / "inverter_board.yaml"))
    assert isinstance(result, Result)
    assert (Status.OPTIMAL, "auto") == (result.status, result.solver)


def test_a_chain_is_solved_whole(chain):
    """Nobody has to look whether it is one."""
    result = solve_problem(chain)
    assert isinstance(result, ChainResult)
    assert result.complete


def test_one_part_of_a_chain_is_one_result(chain):
    """As it stands before anything is solved."""
    result = solve_problem(chain, chain.tasks[0].name, "exact")
    assert isinstance(result, Result)
    assert chain.tasks[0].name == result.task


def test_a_plan_to_start_from_is_of_one_task(chain):
    """A whole chain has none."""
    with pytest.raises(OptionError, match="for one task of a chain; name its part"):
        solve_problem(chain, start=Plan(()))


def test_back_ends_that_loading_constructed_are_used(monkeypatch):
    """A command constructs each of them once."""
    constructed = []
    begin = AabbDetector.__init__

    def note(self: AabbDetector, *arguments: object) -> None:
        constructed.append(self)
        begin(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(AabbDetector, "__init__", note)
    monkeypatch.setattr(AabbDetector, "faults", lambda self: {})
    problem = load_problem(CONFIGS / "inverter_board.yaml", {"collision": ["aabb"]})
    assert 1 == len(constructed)
    result = solve_problem(problem, setup=Setup(collision=("aabb",)))
    assert Status.OPTIMAL == result.status
    assert 1 == len(constructed)
