"""Failures that are almost certain: every claim is held against exact rational arithmetic.

Expected costs grow as 1 / (1 - p). Solvers that lose digits there must give up the proof.
"""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.errors import TaskError
from skillplan.model import SkillModel, compute_least_expected_cost
from skillplan.pipeline import load_problem, make_model, solve
from skillplan.records import Status
from skillplan.task import State

MOST = 1 - 1e-9
NEAR_ONE = [0.9, 0.999, 1 - 1e-6, 1 - 1e-8, MOST]
SOLVERS = ("auto", "job-values", "value-iteration", "policy-iteration", "replan")
Row = tuple[Fraction, list[tuple[Fraction, State]]]


def board(
    failures: list[float],
    cost: str,
    starts: list[int],
    charted: bool,
    look_m: list[float] | None = None,
) -> dict[str, Any]:
    """Return a task file of parts whose grasps fail with these probabilities."""
    parts: dict[str, Any] = {}
    for number, (failure, column) in enumerate(zip(failures, starts, strict=True)):
        parts[f"p{number}"] = {
            "tool": "t",
            "size_m": [0.01, 0.01, 0.01],
            "start_m": [0.3 + 0.03 * column, -0.1 - 0.03 * number],
            "goal_m": [0.4 + 0.03 * number, 0.1],
            "grasp_failure": failure,
        }
    return {
        "kind": "assembly",
        "name": "near-one",
        "cost": cost,
        "robot": {"home_m": [0.3, 0], **({} if look_m is None else {"look_m": look_m})},
        "tools": {"t": {"holder_m": [0.6, 0.2]}},
        "initial_tool": "t",
        "parts": parts,
        "collision": {"precedence": {}} if charted else {"aabb": {}},
        **({"chart": [{"before": "p0", "after": ["p1"]}]} if charted else {}),
    }


def rows_of(model: SkillModel) -> dict[State, list[Row]]:
    """Return what may be done in every state, with probabilities that sum to 1 exactly."""
    rows: dict[State, list[Row]] = {}
    open_states = [model.initial]
    while open_states:
        state = open_states.pop()
        if state in rows:
            continue
        rows[state] = []
        for step in () if model.is_goal(state) else model.transitions(state):
            shares = [[Fraction(share), following] for share, following in step.outcomes]
            # The smaller probability is exact, the other one its complement.
            largest = max(shares, key=lambda pair: pair[0])
            largest[0] = 1 - sum(share for share, _ in shares if share is not largest[0])
            rows[state].append((Fraction(step.cost), [(p, to) for p, to in shares]))
            open_states += [following for _, following in step.outcomes]
    return _without_dead_ends(rows, model)


def _without_dead_ends(rows: dict[State, list[Row]], model: SkillModel) -> dict[State, list[Row]]:
    """Return the rows that cannot end where nothing can be done before the goal is reached."""
    while dead := {state for state in rows if not rows[state] and not model.is_goal(state)}:
        rows = {
            state: [row for row in choices if not any(to in dead for _, to in row[1])]
            for state, choices in rows.items()
            if state not in dead
        }
    return rows


def value_of(rows: dict[State, list[Row]], policy: dict[State, int]) -> dict[State, Fraction]:
    """Return the exact value of every state, by elimination without division by zero."""
    order = list(rows)
    number = {state: index for index, state in enumerate(order)}
    solved: list[tuple[dict[int, Fraction], Fraction]] = []
    for index, state in enumerate(order):
        row = {index: Fraction(1)}
        known = Fraction(0)
        if rows[state]:
            known, outcomes = rows[state][policy[state]]
            for share, following in outcomes:
                row[number[following]] = row.get(number[following], Fraction(0)) - share
        while earlier := [column for column in row if column < index]:
            column = min(earlier)
            factor = row.pop(column)
            others, constant = solved[column]
            for other, value in others.items():
                row[other] = row.get(other, Fraction(0)) - factor * value
            known -= factor * constant
        pivot = row.pop(index)
        solved.append(({column: value / pivot for column, value in row.items()}, known / pivot))
    values = [Fraction(0)] * len(order)
    for index in reversed(range(len(order))):
        row, known = solved[index]
        values[index] = known - sum(value * values[column] for column, value in row.items())
    return dict(zip(order, values, strict=True))


def exact_least_cost(model: SkillModel) -> Fraction:
    """Return the least expected cost, by policy iteration from a policy that may arrive."""
    rows = rows_of(model)
    arriving = {state for state in rows if not rows[state]}
    policy: dict[State, int] = {}
    while len(arriving) < len(rows):
        for state, choices in rows.items():
            if state not in arriving:
                for index, (_, outcomes) in enumerate(choices):
                    if any(following in arriving for _, following in outcomes):
                        policy[state] = index
                        arriving.add(state)
                        break
    while True:
        values = value_of(rows, policy)
        better = {}
        for state, choices in rows.items():
            costs = [
                cost + sum(share * values[following] for share, following in outcomes)
                for cost, outcomes in choices
            ]
            if costs and min(costs) < costs[policy[state]]:
                better[state] = costs.index(min(costs))
        if not better:
            return values[model.initial]
        policy.update(better)


BOARDS = st.integers(2, 3).flatmap(
    lambda count: st.builds(
        board,
        st.lists(st.sampled_from([0.0, 0.3, 1e-12, *NEAR_ONE]), min_size=count, max_size=count),
        st.sampled_from(["time", "distance"]),
        st.lists(st.integers(0, 4), min_size=count, max_size=count),
        st.booleans(),
        st.sampled_from([None, [0.3, -0.2], [0.5, 0.0]]),
    )
)


def load(document: dict[str, Any], folder: Path) -> Any:
    path = folder / "board.yaml"
    path.write_text(yaml.safe_dump(document), "utf-8")
    return load_problem(path).task


@pytest.mark.slow(
    reason="five solvers on random boards; test_up_to_one_in_a_billion_... in every run"
)
@settings(max_examples=examples(20))
@given(document=BOARDS)
def test_every_solver_is_right_or_proves_nothing(document, tmp_path_factory):
    """And the referee, by its own sweeps, believes none that is wrong."""
    task = load(document, tmp_path_factory.mktemp("board"))
    minimum = float(exact_least_cost(make_model(task)))
    own = compute_least_expected_cost(make_model(task), 20_000)
    assert own is None or own == pytest.approx(minimum, rel=1e-9)
    for solver in SOLVERS:
        result = solve(task, solver)
        assert result.status is not Status.WRONG, (solver, result.reason)
        assert result.lower_bound is None or result.lower_bound <= minimum * (1 + 1e-9)
        if result.status is Status.OPTIMAL:
            assert result.cost == pytest.approx(minimum, rel=1e-9), solver


@pytest.mark.parametrize("solver", ["auto", "job-values", "value-iteration", "policy-iteration"])
@pytest.mark.parametrize("failure", NEAR_ONE)
def test_up_to_one_in_a_billion_the_optimum_is_proved(solver, failure, tmp_path):
    task = load(board([failure, 0.5], "time", [0, 3], charted=True), tmp_path)
    result = solve(task, solver)
    minimum = float(exact_least_cost(make_model(task)))
    assert result.status is Status.OPTIMAL, result.reason
    assert result.cost == pytest.approx(minimum, rel=1e-9)


@pytest.mark.parametrize("failure", [1 - 1e-10, 1 - 1e-12, 1 - 1e-16, 1.0, 1.5, float("nan")])
def test_failures_beyond_are_refused_with_file_and_line(failure, tmp_path):
    with pytest.raises(TaskError) as refused:
        load(board([failure, 0.0], "time", [0, 3], charted=True), tmp_path)
    assert "board.yaml:" in str(refused.value)
    assert "parts.p0.grasp_failure: must be" in str(refused.value)
