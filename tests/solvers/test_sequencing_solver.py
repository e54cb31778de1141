"""The solvers that put jobs into an order, on models and on the field's own instances."""

import json
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import situations
from example_count import examples
from ordering_instances import instance_of
from skillplan.collision import PrecedenceDetector
from skillplan.errors import NotASequencing
from skillplan.model import SequencingProblem, replay
from skillplan.pipeline import Setup, load_problem, make_model, solve
from skillplan.pipeline import make_solver as made_solver
from skillplan.records import Status
from skillplan.solvers import Plan, Stop
from skillplan.testing import SolverSuite
from sop_instances import BEST_KNOWN, FOLDER, instance, tsplib_text
from thinned import release_case, slow_case

PROVING = ["portfolio", "subset-dp", "tree-search", "branch-and-cut"]
CHART = Setup(collision=("precedence",))
ASSEMBLIES = ["battery_module", "inverter_board", "motor_drive", "relay_rail", "sensor_stack"]
LARGEST = ["motor_drive", "relay_rail", "sensor_stack"]


class TestPortfolioSolver(SolverSuite):
    solver = "portfolio"


class TestSubsetDpSolver(SolverSuite):
    solver = "subset-dp"


class TestTreeSearchSolver(SolverSuite):
    solver = "tree-search"


class TestLocalSearchSolver(SolverSuite):
    solver = "local-search"
    options = {"rounds": 2}  # noqa: RUF012


class TestBranchAndCutSolver(SolverSuite):
    solver = "branch-and-cut"


def make_solver(name, stop=None):
    """Return a solver with its default options."""
    return made_solver(name, {}, stop)


@pytest.mark.parametrize(
    ("config", "detector"),
    [
        *((config, "precedence") for config in ASSEMBLIES if config not in LARGEST),
        *((config, "aabb") for config in ASSEMBLIES if config not in LARGEST),
        *(
            (release_case if config == "motor_drive" else slow_case)(
                config, "precedence", reason="the largest; others in every run"
            )
            for config in LARGEST
        ),
        *(
            release_case(config, "aabb", reason="the largest by boxes; others in every run")
            for config in LARGEST
        ),
    ],
)
def test_it_proves_what_exact_search_proves(config, detector):
    """On every board that is a sequencing problem; on others it says why not, and names exact."""
    task = load_problem(f"configs/{config}.yaml").task
    setup = Setup(collision=(detector,))
    model = make_model(task, setup)
    refusal = make_solver("subset-dp").refuses(model)
    if refusal is not None:
        with pytest.raises(NotASequencing):
            SequencingProblem.from_model(model)
        assert "Take exact" in refusal
        return
    solution = solve(task, "subset-dp", setup)
    assert solution.status == Status.OPTIMAL
    assert solution.cost == pytest.approx(solve(task, "exact", setup).cost, abs=1e-9)


@settings(max_examples=examples(40))
@given(content=situations.small_assemblies(), solver=st.sampled_from(PROVING[1:]))
def test_it_is_never_wrong_whatever_the_step_limit(content, solver):
    """Where the cheapest order has a plan that is too long, nothing is said to be optimal."""
    task = situations.assembly(content)
    model = situations.model_of(task, PrecedenceDetector(task))
    learner = make_solver(solver)
    if learner.refuses(model) is not None:
        return
    best = situations.optimum(
        situations.cheapest_by_length(situations.model_of(task, PrecedenceDetector(task)))
    )
    solution = learner.solve(model)
    if solution.plan is not None:
        walked = replay(model, [task.skill(name) for name in solution.plan.skills])
        assert walked.violations == ()
        assert solution.plan.cost == pytest.approx(walked.cost, abs=1e-9)
        assert best[0] <= walked.cost + 1e-9
    if best is not None and solution.lower_bound is not None:
        assert solution.lower_bound <= best[0] + 1e-9
    if solution.proved:
        assert (solution.plan is None) == (best is None)
        if best is not None:
            assert solution.plan.cost == pytest.approx(best[0], abs=1e-9)


def test_a_step_limit_that_binds_leaves_a_bound_and_words(board_task):
    """Fourteen skills are too few for any order of the board."""
    result = solve(board_task.replace(step_limit=14), "subset-dp", CHART)
    assert result.status == Status.UNSOLVED
    assert "more skills than the step limit allows" in result.reason


@given(task=situations.small_tasks())
@settings(max_examples=examples(30))
def test_what_is_no_sequencing_problem_is_refused_in_words(task):
    """One sentence, with another solver to take."""
    refusal = make_solver("portfolio").refuses(situations.model_of(task))
    assert refusal is None or refusal.endswith("Take exact.")


def test_under_chance_another_solver_is_named():
    """As no order is a plan there."""
    refusal = make_solver("portfolio").refuses(situations.model_of(situations.retry_task(0.5)))
    assert refusal.endswith("Take value-iteration.")


@pytest.mark.parametrize("polls", [1, 2, 3, 5, 9, 20])
@pytest.mark.parametrize("solver", PROVING[1:])
def test_what_a_stopped_search_says_holds(solver, polls):
    """On an instance that takes more polls than these to prove."""
    model = make_model(instance("br17.10").task)
    searching = make_solver(solver, stop=situations.PatientStop(polls))
    searching.problem(model)
    solution = searching.solve(model)
    assert solution.lower_bound <= 55
    if solution.plan is not None:
        assert solution.plan.cost >= 55
    assert not solution.proved or solution.plan.cost == solution.lower_bound == 55


@pytest.mark.slow(reason="a second search; the command line starts from plans in every run")
def test_a_plan_to_start_from_is_where_it_begins():
    """Stopped at once it has that plan and no worse."""
    task = instance("ESC25").task
    first = solve(task, "tree-search", stop=situations.PatientStop(40))
    known = Plan(tuple(step.skill for step in first.steps))
    again = solve(task, "tree-search", stop=situations.PatientStop(2), start=known)
    assert again.cost <= first.cost


@pytest.mark.parametrize("solver", [*PROVING[1:], "local-search"])
def test_the_same_seed_gives_the_same_figures(solver):
    """Of plan, bound and effort."""
    task = instance("ESC12").task
    model = make_model(task)
    first, other = (make_solver(solver).solve(model, seed=5) for _ in range(2))
    assert first == other


@pytest.mark.parametrize(
    "name",
    [
        *("ESC07", "ESC12", "br17.10"),
        *(
            slow_case(name, reason="over a hundred jobs; fewer in every run")
            for name in ("rbg109a", "rbg150a")
        ),
    ],
)
def test_the_dynamic_program_proves_what_is_published(name):
    """Of the smaller and the tighter instances."""
    result = solve(instance(name).task, "subset-dp")
    assert (result.status, result.cost) == (Status.OPTIMAL, float(BEST_KNOWN[name]["best_known"]))
    assert "dynamic programming" in result.bound_method or "relaxation" in result.bound_method


@pytest.mark.slow(reason="up to a minute an instance; smaller ones are proved in every run")
@pytest.mark.parametrize(
    "name",
    [
        "ESC47",
        "ft53.4",
        *(
            release_case(name, reason="up to a minute, alone on it")
            for name in ("p43.1", "prob.42", "rbg253a", "ft53.1", "ft70.1")
        ),
    ],
)
def test_the_portfolio_proves_what_is_published(name):
    """Within a minute each."""
    result = solve(instance(name).task, "portfolio", stop=Stop(time_limit_s=60))
    assert (result.status, result.cost) == (Status.OPTIMAL, float(BEST_KNOWN[name]["best_known"]))


@pytest.mark.slow(reason="20 instances, a quarter of a second each")
@pytest.mark.parametrize("name", sorted(path.stem for path in FOLDER.glob("*.sop")))
def test_no_bound_is_above_and_no_cost_below_what_is_published(name):
    """Within a quarter of a second each, whether proved or not."""
    known = BEST_KNOWN[name]
    result = solve(instance(name).task, "portfolio", stop=Stop(time_limit_s=0.25))
    assert result.cost >= float(known["lower_bound"])
    assert result.lower_bound <= float(known["best_known"])
    if result.status == Status.OPTIMAL:
        assert result.cost == float(known["best_known"])


def searched(folder, n, limit_mib, time_limit_s):
    """Return the result of a search in a process of its own, and its largest size [MiB]."""
    drawn = instance_of(n, 1, density=3 / n)
    costs = [[0 if i == j else int(min(drawn.costs[i, j], 99)) for j in range(n)] for i in range(n)]
    for i in range(n):
        for j in range(n):
            if drawn.before[i, j]:
                costs[j][i] = -1
    file = folder / "large.sop"
    file.write_text(tsplib_text(costs), encoding="utf-8")
    words = ["search-optimal", str(file), "--solver", "portfolio", "--format", "json"]
    words += ["--memory-limit", f"{limit_mib}MiB", "--time-limit", str(time_limit_s)]
    # The size that the system keeps count of for a child begins with that of its parent.
    size = folder / "size"
    code = (
        "import atexit, sys; from pathlib import Path; from skillplan.cli import main; "
        f"atexit.register(lambda: Path({str(size)!r}).write_bytes("
        "Path('/proc/self/status').read_bytes())); sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=True
    )
    (largest,) = [line for line in size.read_text().splitlines() if line.startswith("VmHWM:")]
    return json.loads(done.stdout), int(largest.split()[1]) / 1024


@pytest.mark.skipif(sys.platform != "linux", reason="sizes are told in KiB on Linux")
@pytest.mark.parametrize(
    ("n", "limit_mib", "time_limit_s"),
    [
        slow_case(40, 400, 2, reason="2 s; every run has a memory limit in a process"),
        release_case(380, 600, 25, reason="380 nodes for 25 s; 40 in every run"),
    ],
)
def test_a_memory_limit_is_kept_and_leaves_a_plan_and_a_bound(tmp_path, n, limit_mib, time_limit_s):
    """To within a tenth, as the largest size that the process ever had."""
    document, largest_mib = searched(tmp_path, n, limit_mib, time_limit_s)
    assert largest_mib <= 1.1 * limit_mib
    assert 0 < document["lower_bound"] <= document["cost"]
