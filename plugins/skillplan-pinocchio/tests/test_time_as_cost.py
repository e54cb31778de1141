"""The inverter board in the shortest cycle time, by the trajectories of ``swept``."""

import json

import pytest

from skillplan import load_problem
from skillplan.cli import main
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model, solve

SWEPT = Setup(collision=("swept",))
BOARD = "configs/inverter_board.yaml"
BY_DISTANCE = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
REST = ("--collision", "swept", "--set", "cost=time")


@pytest.fixture(scope="module")
def timed_board():
    return load_problem(BOARD, changes={"cost": "time"}).task


@pytest.fixture(scope="module")
def fastest(timed_board):
    """The optimum that exact search proves."""
    return solve(timed_board, "exact", SWEPT)


def output(capsys, *args):
    """Return the exit code of a command, and what it prints as JSON."""
    with pytest.raises(SystemExit) as ended:
        main([*args, "--format", "json"])
    return ended.value.code, json.loads(capsys.readouterr().out)


def test_the_plan_costs_the_time_of_its_trajectories(timed_board, fastest):
    """The cycle time is the cost; and the order of the least distance takes longer."""
    assert fastest.status == "optimal"
    assert (fastest.cost_unit, fastest.timed_by) == ("s", "swept")
    assert fastest.cost == pytest.approx(fastest.makespan_s) == pytest.approx(96.18989, abs=1e-5)
    assert fastest.cost == fastest.lower_bound
    model = make_model(timed_board, SWEPT)
    walked = replay(model, timed_board.parse_sequence(BY_DISTANCE))
    assert fastest.cost < walked.cost < 1.0005 * fastest.cost


def test_fewer_trajectories_are_computed_than_there_are(timed_board, fastest):
    """The figure counts what the search asked for; that of the document, too."""
    assert 15 <= fastest.trajectories < 58
    assert fastest.document()["stats"]["trajectories"] == fastest.trajectories


@pytest.mark.slow(reason="a search; of the board in every run")
def test_cost_by_distance_is_as_ever(timed_board):
    """Swept tells the time of its plan, and has no say in its cost."""
    by_distance = solve(load_problem(BOARD).task, "exact", SWEPT)
    assert by_distance.cost == pytest.approx(1.86709, abs=5e-6)
    assert (by_distance.cost_unit, by_distance.timed_by) == ("m", "swept")
    assert ",".join(str(step.action) for step in by_distance.steps) == BY_DISTANCE


@pytest.mark.slow(reason="all 12,420 sequences; every run solves the board by exact search")
def test_the_optimum_is_that_of_brute_force_over_all_sequences(timed_board, fastest):
    """With the same trajectories: by enumeration without bounds."""
    every = solve(timed_board, "exhaustive", SWEPT)
    assert every.trace["sequences"] == 12_420
    assert every.cost == pytest.approx(fastest.cost, abs=1e-9)
    assert [step.skill for step in every.steps] == [step.skill for step in fastest.steps]
    assert every.trajectories == 57


@pytest.mark.slow(reason="four more solvers; every run solves the board by exact search")
@pytest.mark.parametrize("solver", ["subset-dp", "branch-and-cut", "portfolio", "value-iteration"])
def test_other_solvers_prove_the_same_time(timed_board, fastest, solver):
    """Those that put jobs into an order, and dynamic programming."""
    other = solve(timed_board, solver, SWEPT)
    assert other.status == "optimal"
    assert other.cost == pytest.approx(fastest.cost, abs=1e-9)


@pytest.mark.slow(reason="six commands; every run solves the board from Python")
def test_commands_know_of_time_as_the_cost(tmp_path, capsys):
    """A result is verified, replayed and explained; a file with the key is as `--set`."""
    out = tmp_path / "run"
    code, result = output(capsys, "search-optimal", BOARD, *REST, "--out", str(out))
    assert (code, result["cost_unit"], result["timed_by"]) == (0, "s", "swept")
    code, verified = output(capsys, "verify", str(out))
    assert (code, verified["valid"]) == (0, True)
    assert {claim["outcome"] for claim in verified["claims"]} <= {"holds", "not checked"}
    code, walked = output(capsys, "evaluate", BOARD, *REST, "--sequence", BY_DISTANCE)
    assert code == 0
    assert walked["deviation"] == pytest.approx(0.00047, abs=1e-5)
    assert walked["cost"] == walked["makespan_s"]
    code, explained = output(capsys, "explain", BOARD, "pick(brace)", *REST, "--after", "0,1")
    assert (code, explained["status"]) == (0, "feasible")
    _, of_file = output(capsys, "search-optimal", "configs/inverter_time.yaml")
    assert of_file["cost"] == result["cost"]
    stored = json.loads((out / "result.json").read_text("utf-8"))
    stored["cost"] = stored["lower_bound"] = stored["cost"] - 0.01
    (out / "result.json").write_text(json.dumps(stored), "utf-8")
    code, forged = output(capsys, "verify", str(out))
    assert (code, forged["valid"]) == (1, False)
