"""How long skills take: asked once, bounded before, and never less than the bound."""

import math

import pytest

from situations import fake_back_end, make_skill, make_task, model_of
from skillplan.checks import Feasibility
from skillplan.errors import BackEndError
from skillplan.task import BackEnd, Facts, Metric

FACTS = Facts(("a", "b", "done"))
SKILL = make_skill(FACTS, "finish", requires=("a",), forbids=("done",), add=("done",), cost=7.0)
TASK = make_task(FACTS, [SKILL], initial=("a",), goal=("done",))
TIMED = TASK.replace(metric=Metric("time", "s", is_duration=True))
START = TASK.initial


def says(answer):
    return lambda self, *question: answer


def timing(duration_s, least_s=None, name="clock", task=TIMED):
    """Return a back end that says so and, where given, bounds it so."""
    more = {} if least_s is None else {"least_duration_s": says(least_s)}
    return fake_back_end(task, name=name, duration_s=says(duration_s), **more)


def test_a_cost_that_is_a_time_is_the_back_ends():
    """As is the time; each is told once, and counted."""
    model = model_of(TIMED, timing(2.5))
    assert model.asks_costs
    for _ in range(2):
        step = model.transition(START, SKILL)
        assert (step.cost, step.duration_s, model.cost(START, SKILL)) == (2.5, 2.5, 2.5)
    assert model.stats.trajectories == 1


def test_another_cost_is_the_tasks_also_beside_a_back_end_that_tells_time():
    """Only the time is told."""
    model = model_of(TASK, timing(2.5, task=TASK))
    assert not model.asks_costs
    step = model.transition(START, SKILL)
    assert (step.cost, step.duration_s) == (7.0, 2.5)
    assert model.cost(START, SKILL) == model.least_cost(SKILL, 0, 0) == 7.0


def test_where_nobody_tells_time_the_tasks_figures_are_the_cost():
    """Nothing is counted."""
    model = model_of(TIMED, fake_back_end(TIMED))
    assert not model.asks_costs
    assert model.cost(START, SKILL) == 7.0
    assert model.stats.trajectories == 0


def test_a_bound_asks_for_no_time():
    """Without one of its own a back end's is 0."""
    queries = []

    def duration_s(self, skill, state):
        queries.append(skill.name)
        return 2.5

    for least_s, expected in ((None, 0.0), (1.5, 1.5)):
        more = {} if least_s is None else {"least_duration_s": says(least_s)}
        model = model_of(TIMED, fake_back_end(TIMED, duration_s=duration_s, **more))
        assert model.least_cost(SKILL, START.bits, 0) == expected
        assert not queries


def test_where_a_back_end_never_tells_a_time_the_bound_is_of_the_tasks_figure():
    """As of a skill without motion."""
    model = model_of(TIMED, timing(None, math.inf))
    assert model.least_cost(SKILL, START.bits, 0) == 7.0
    assert model.cost(START, SKILL) == 1.0
    assert model.stats.trajectories == 0


def test_what_cannot_be_timed_takes_no_less_than_the_bound():
    """Otherwise the bound would be none."""
    model = model_of(TIMED, timing(None, 4.0))
    assert model.cost(START, SKILL) == 4.0
    assert model_of(TIMED, timing(None, 0.5)).cost(START, SKILL) == 1.0


def test_a_time_below_the_bound_is_refused():
    """A proof would rest on it; rounding is allowed for."""
    with pytest.raises(
        BackEndError, match=r"'clock' says that finish takes 2.5 s in .*2.6 s at le"
    ):
        model_of(TIMED, timing(2.5, 2.6)).cost(START, SKILL)
    assert model_of(TIMED, timing(2.5, 2.5 + 1e-10)).cost(START, SKILL) == 2.5


@pytest.mark.parametrize("least_s", [-1.0, math.nan, "2", None])
def test_a_bound_that_is_no_time_is_refused(least_s):
    """In words that name the back end."""
    clock = fake_back_end(TIMED, name="odd", duration_s=says(1.0), least_duration_s=says(least_s))
    with pytest.raises(BackEndError, match=r"'odd' says that finish takes .* s at least"):
        model_of(TIMED, clock).least_cost(SKILL, 0, 0)


def test_a_back_end_that_fails_to_bound_is_named():
    """As one that fails to time."""

    def boom(self, *question):
        raise ZeroDivisionError("in the bound")

    clock = fake_back_end(TIMED, name="odd", duration_s=says(1.0), least_duration_s=boom)
    with pytest.raises(BackEndError, match="'odd' failed to bound the time of finish"):
        model_of(TIMED, clock).least_cost(SKILL, 0, 0)


def test_a_screen_tells_no_time():
    """What a skill costs does not depend on whether it is screened."""
    screen = timing(2.5)
    screen.screens = True
    times = Feasibility(TIMED, [screen]).times
    assert times.sources == ()
    assert times.duration_s(SKILL, START) is None


def test_the_least_bound_counts_where_several_tell_time():
    """Any of them may be the one that knows."""
    first, other = timing(None, 1.0, "one"), timing(2.5, 2.0, "other")
    model = model_of(TIMED, first, other)
    assert model.least_cost(SKILL, START.bits, 0) == 1.0
    assert model.cost(START, SKILL) == 2.5


def test_a_back_end_bounds_times_by_0():
    """Which is always true."""
    assert BackEnd.least_duration_s(timing(1.0), SKILL, 0, 0) == 0.0
