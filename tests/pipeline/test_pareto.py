"""The Pareto front of two costs: the plans that no other beats in both, each proved."""

import json
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import assembly, model_of, small_assemblies
from skillplan.cli import main
from skillplan.errors import OptionError
from skillplan.model import replay
from skillplan.pipeline import Setup, load_problem, make_model, solve, solve_front
from skillplan.records import Status
from skillplan.solvers import Objective, Stop, search_front
from timed_back_end import clock

CONFIGS = Path(__file__).parents[2] / "configs"
CELL = CONFIGS / "cell_cost.yaml"
SAME = 1e-9


def enumerate_front(model, objectives):
    """Return the front by paths from state to state without any bound or order."""
    labels = {model.initial: {(0.0, 0.0)}}
    todo, plans = [(model.initial, (0.0, 0.0), 0)], set()
    while todo:
        state, costs, steps = todo.pop()
        if model.is_goal(state):
            plans.add(costs)
            continue
        if steps == model.step_limit:
            continue
        for step in model.transitions(state):
            action = model.task.action(step.skill)
            more = [o.price(action, state, step.duration_s) for o in objectives]
            total = costs[0] + more[0], costs[1] + more[1]
            known = labels.setdefault(step.next_state, set())
            if not any(k[0] <= total[0] + 1e-13 and k[1] <= total[1] + 1e-13 for k in known):
                known.add(total)
                todo.append((step.next_state, total, steps + 1))
    front = []
    for costs in sorted(plans):
        if not front or costs[1] < front[-1][1] - SAME:
            front.append(costs)
    return front


def two_costs(content):
    """Return a task by time and its two costs."""
    timed = assembly({**content, "cost": "time", "step_limit": 60})
    planar = assembly({**content, "cost": "distance", "step_limit": 60})
    return timed, (Objective("time", timed), Objective("distance", planar))


@settings(max_examples=examples(25))
@given(small_assemblies(), st.integers(0, 99))
def test_the_front_is_that_of_all_paths(content, seed):
    """With times from a back end, which are unknown at first, and with those of the file."""
    timed, objectives = two_costs(content)
    for back_ends in ([clock(timed, seed=seed)], []):
        found = search_front(model_of(timed, *back_ends), objectives, Stop())
        expected = enumerate_front(model_of(timed, *back_ends), objectives)
        assert found.complete
        assert [plan.costs for plan in found.plans] == [
            pytest.approx(costs, abs=2 * SAME) for costs in expected
        ]


@settings(max_examples=examples(10))
@given(small_assemblies(), st.integers(1, 60))
def test_what_an_interrupted_search_has_is_the_beginning_of_the_front(content, labels):
    """Up to the first cost that it states."""
    timed, objectives = two_costs(content)
    whole = search_front(model_of(timed), objectives, Stop())
    part = search_front(model_of(timed), objectives, Stop(), max_labels=labels)
    assert part.plans == whole.plans[: len(part.plans)]
    missing = whole.plans[len(part.plans) :]
    assert all(plan.costs[0] >= part.reached - SAME for plan in missing)


@pytest.mark.slow(reason="solves a cell with trajectories; random boards have none")
def test_every_point_is_a_plan_of_the_file_with_the_costs_that_it_states():
    """Its ends are the optima of either cost."""
    problem = load_problem(CELL)
    front = solve_front(problem, ("time", "distance"))
    assert front.status == "optimal"
    assert len(front.points) > 1
    assert front.confirmed_by == "auto"
    for before, after in pairwise(front.points):
        assert before.costs[0] < after.costs[0]
        assert before.costs[1] > after.costs[1]
    for index, cost in enumerate(("time", "distance")):
        task = load_problem(CELL, changes={"cost": cost}).task
        assert min(p.costs[index] for p in front.points) == pytest.approx(solve(task).cost)
        for point in front.points:
            walked = replay(make_model(task), [task.skill(name) for name in point.skills])
            assert walked.complete
            assert walked.cost == pytest.approx(point.costs[index])


@pytest.mark.slow(reason="solves a cell with trajectories; random boards have none")
def test_a_sum_lies_on_the_front_of_its_terms():
    """A weighted sum is least at one of the points."""
    problem = load_problem(CELL)
    front = solve_front(problem, ("cost", "wear"))
    assert front.points[0].costs[0] == pytest.approx(solve(problem.task).cost)
    assert front.points[0].costs[1] == pytest.approx(2 * 1.5 + 2 * 0.8)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("time",), "takes two of distance, time"),
        (("time", "time"), "takes two of distance, time"),
        (("time", "wear"), "unknown cost 'wear'"),
        (("tme", "distance"), "Did you mean 'time'"),
    ],
)
def test_a_front_is_of_two_costs_of_the_file(names, words):
    """Those of a weighted sum are its own."""
    with pytest.raises(OptionError, match=words):
        solve_front(load_problem(CONFIGS / "inverter_board.yaml"), names)


def test_a_kind_of_task_with_one_cost_has_no_front():
    """It says so."""
    with pytest.raises(OptionError, match="has a single cost"):
        solve_front(load_problem(CONFIGS / "br17.10.sop"), ("time", "distance"))


@pytest.mark.parametrize(
    ("alone", "status", "proved", "words"),
    [
        ((Status.OPTIMAL, 1.0, ""), "wrong", False, "auto proves 1.0"),
        ((Status.SOLVED, 1.0, ""), "wrong", False, "auto finds 1.0"),
        ((Status.WRONG, None, "why"), "wrong", False, "auto alone ends as wrong: why"),
        ((Status.SOLVED, 1e3, "time limit"), "optimal", True, "time not confirmed by auto: time"),
    ],
)
def test_a_front_shows_what_another_solver_contradicts_or_does_not_confirm(
    monkeypatch, alone, status, proved, words
):
    names = ("status", "cost", "reason", "solver")
    result = SimpleNamespace(**dict(zip(names, (*alone, "auto"), strict=True)))
    monkeypatch.setattr("skillplan.pipeline.pareto.solve", lambda *given, **options: result)
    setup = Setup(collision=("precedence",))
    front = solve_front(load_problem(CONFIGS / "inverter_board.yaml"), ("time", "distance"), setup)
    assert (front.status, front.confirmed_by) == (status, "")
    assert {point.proved for point in front.points} == {proved}
    assert words in front.reason


def run(command):
    """Run a command and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(command)
    return ended.value.code


def test_a_folder_holds_points_and_picture_and_a_report_shows_them(tmp_path, capsys):
    """The document is that of stdout."""
    out, page = tmp_path / "front", tmp_path / "front.html"
    board = str(CONFIGS / "inverter_board.yaml")
    command = ["search-optimal", board, "--pareto", "time,distance", "--collision", "precedence"]
    assert run([*command, "--out", str(out), "--format", "json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((out / "result.json").read_text())
    assert document["schema"] == "skillplan.front/1"
    assert (out / "front.svg").read_text().count("<svg") == 1
    assert len((out / "front.csv").read_text().splitlines()) == 1 + len(document["points"])
    assert run(["report", str(out), "--out", str(page)]) == 0
    assert "Pareto front" in page.read_text()
    assert run([*command, "--solver", "exact"]) == 2
    assert "--solver is for one cost" in capsys.readouterr().err
