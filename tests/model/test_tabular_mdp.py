"""The array export of a model."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import situations
from skillplan.checks import Feasibility
from skillplan.errors import ModelTooLarge
from skillplan.model import TabularMDP, enumerate_feasibility
from skillplan.pipeline import load_problem, make_model, solve
from skillplan.task import Facts, Verdict
from skillplan.testing import ExpensiveBoxes, lid_task
from skillplan.workers import Answer, Executor, Worker


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


# The complete feasibility of a task.


@given(task=situations.small_tasks())
def test_every_applicable_skill_is_asked_about_in_every_state_that_can_be_reached(task):
    """Counted independently, on the explicit graph."""
    task = task.replace(step_limit=1_000)
    arrows = situations.graph_of(situations.model_of(task))
    counts = enumerate_feasibility(Feasibility(task, [situations.fake_back_end(task)]))
    expected = sum(
        skill.applicable(state)
        for state in arrows
        if not task.goal.holds(state)
        for skill in task.skills
    )
    assert (counts.states, counts.queries) == (len(arrows), expected)
    assert counts.executions_by_state == counts.queries
    assert counts.checks == counts.executions <= counts.queries
    assert counts.checks + counts.hits == counts.queries
    assert counts.complete


def test_what_the_step_limit_rules_out_is_not_asked():
    """No plan could use it."""
    facts = Facts(("a", "b", "done"))
    skills = [
        situations.make_skill(facts, "one", forbids=("a",), add=("a",)),
        situations.make_skill(facts, "two", requires=("a",), forbids=("b",), add=("b",)),
        situations.make_skill(facts, "three", requires=("b",), forbids=("done",), add=("done",)),
    ]
    task = situations.make_task(facts, skills, goal=("done",), step_limit=2)
    counts = enumerate_feasibility(Feasibility(task))
    assert (counts.states, counts.queries) == (2, 2)


def test_an_infeasible_skill_leads_nowhere_and_an_unknown_one_is_counted():
    """As for a solver."""
    task = situations.retry_task(0.5)
    answers = {"infeasible": Verdict.infeasible("no"), "unknown": Verdict.unknown("no idea")}
    for status, verdict in answers.items():
        counts = enumerate_feasibility(Feasibility(task, [situations.fake_back_end(task, verdict)]))
        assert (counts.states, counts.queries, counts.feasible) == (1, 1, 0)
        assert counts.unknown == (status == "unknown")


def test_whatever_may_come_of_a_skill_is_followed():
    """Not the nominal outcome only."""
    facts = Facts(("luck", "misfortune"))
    outcomes = [(0.5, ("luck",), ()), (0.5, ("misfortune",), ())]
    skill = situations.make_skill(facts, "try", forbids=("luck", "misfortune"), outcomes=outcomes)
    counts = enumerate_feasibility(
        Feasibility(situations.make_task(facts, [skill], goal=("luck",)))
    )
    assert counts.states == 3


def test_it_stops_when_it_is_told_to_and_counts_what_was_asked():
    """What has been decided stays in the cache."""
    task = lid_task()
    back_end = situations.fake_back_end(task)
    feasibility = Feasibility(task, [back_end])
    counts = enumerate_feasibility(feasibility, lambda: len(back_end.asked) >= 3)
    assert (counts.complete, counts.checks) == (False, 3)
    again = enumerate_feasibility(Feasibility(task, [back_end], feasibility.cache))
    assert again.complete
    assert again.hits >= 3


def test_counts_are_never_negative():
    """The check of its constructor."""
    counts = enumerate_feasibility(Feasibility(situations.retry_task(1)))
    with pytest.raises(ValueError, match="fewer than 0"):
        replace(counts, states=-1)


class Aside(Executor):
    """So many workers that do their jobs in this process; the one that has waited longest first."""

    name = "aside"

    def start(self, prepare, content, what):
        return AsideWorker(what, prepare(pickle.loads(content)))

    def first_ready(self, workers, patience_s=0.0):
        return list(workers)[:1]

    def close(self):
        """Nothing is to be ended."""


class AsideWorker(Worker):
    """Does its job when it is heard."""

    number = None
    alive = True

    def __init__(self, what, work):
        super().__init__(what)
        self._work = work

    def take(self, job):
        self._job = job

    def answer(self):
        return Answer(self._work(self._job))

    def ask_to_stop(self):
        """Nobody asks."""

    def end(self, *, gently=True):
        """Nothing is left behind."""


def test_idle_processes_check_the_next_distances_ahead_and_nothing_counts_twice():
    """With more processes than a distance has skills; the figures are those of one process."""
    task = lid_task()
    alone = enumerate_feasibility(Feasibility(task, [ExpensiveBoxes(task)]))
    checks = Feasibility(task, [ExpensiveBoxes(task)], jobs=8, make_executor=Aside)
    assert enumerate_feasibility(checks) == alone
    assert checks.foresight.useful > 0
    assert checks.foresight.made <= 2 * checks.foresight.useful
