"""The array export of a model."""

import numpy as np
import pytest

from skillplan.errors import ModelTooLarge
from skillplan.model import TabularMDP
from skillplan.pipeline import load_problem, make_model, solve
from skillplan.testing import lid_task


@pytest.fixture(scope="module")
def board_model():
    return make_model(load_problem("configs/inverter_board.yaml").task)


def test_it_holds_every_reachable_state_once(board_model):
    """The board has 320 states and 603 feasible (state, action) pairs."""
    mdp = TabularMDP.from_model(board_model)
    assert len(set(mdp.states)) == len(mdp.states) == 320
    assert len(mdp.actions) == 603


def test_its_rows_are_the_transitions_of_the_lazy_model(board_model):
    """Array view and lazy view agree on actions, costs, times, successors and goals."""
    mdp = TabularMDP.from_model(board_model)
    for i, state in enumerate(mdp.states):
        assert mdp.goal[i] == board_model.is_goal(state)
        steps = () if mdp.goal[i] else board_model.transitions(state)
        rows = range(mdp.rows[i], mdp.rows[i + 1])
        assert len(steps) == len(rows)
        for row, step in zip(rows, steps, strict=True):
            assert mdp.actions[row] == board_model.task.action(step.skill)
            assert mdp.costs[row] == step.cost
            assert mdp.durations_s[row] == step.duration_s
            following = slice(mdp.outcomes[row], mdp.outcomes[row + 1])
            outcomes = [
                (float(p), mdp.states[s])
                for s, p in zip(
                    mdp.successors[following], mdp.probabilities[following], strict=True
                )
            ]
            assert outcomes == list(step.outcomes)


def test_value_iteration_on_the_arrays_finds_the_proved_optimum(board_model):
    """Sweeping the arrays to convergence gives the cost that exact search proves."""
    mdp = TabularMDP.from_model(board_model)
    value = np.where(mdp.goal, 0.0, np.inf)
    row_state = np.repeat(np.arange(len(mdp.states)), np.diff(mdp.rows))
    for _ in range(len(mdp.states)):
        ahead = mdp.costs + value[mdp.successors]
        better = value.copy()
        np.minimum.at(better, row_state, ahead)
        if np.array_equal(better, value):
            break
        value = better
    assert value[0] == pytest.approx(solve(board_model.task).cost, abs=1e-9)


def test_more_states_than_the_limit_are_refused_in_words(board_model):
    """The message names the task, the limit and what to use instead."""
    with pytest.raises(ModelTooLarge, match="'inverter-board' has more than 100 reachable") as info:
        TabularMDP.from_model(board_model, limit=100)
    assert "exact" in str(info.value)


def test_the_limit_itself_is_allowed(board_model):
    """Exactly as many states as the limit still fit."""
    assert len(TabularMDP.from_model(board_model, limit=320).states) == 320


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("rows", lambda rows: rows[:-1]),
        ("actions", lambda actions: actions[:-1]),
        ("outcomes", lambda outcomes: outcomes[:-1]),
        ("successors", lambda successors: successors[:-1]),
        ("probabilities", lambda probabilities: probabilities / 2),
    ],
)
def test_arrays_that_do_not_fit_are_refused(field, change):
    """Every check of the type is tripped by one broken array."""
    fields = dict(vars(TabularMDP.from_model(make_model(lid_task()))))
    fields[field] = change(fields[field])
    with pytest.raises(ValueError, match="TabularMDP"):
        TabularMDP(**fields)
