"""Jobs as nodes and back."""

import math

import numpy as np
import pytest
from hypothesis import given

from ordering_instances import all_orders
from sequencing_problems import problem_of, random_problems
from skillplan.solvers.ordering import JobOrders


@given(problem=random_problems())
def test_orders_of_jobs_are_orders_of_nodes_at_the_same_cost(problem):
    """All of them, there and back."""
    orders = JobOrders(problem)
    result = all_orders(orders.instance)
    assert result
    for cost, nodes in result:
        jobs = orders.jobs(np.array(nodes))
        assert sorted(jobs) == list(range(len(problem.jobs)))
        assert cost == pytest.approx(problem.cost(jobs), abs=1e-9)
        place = {job: position for position, job in enumerate(jobs)}
        assert all(place[i] < place[j] for i, j in problem.precedence)
        assert tuple(orders.nodes(jobs).tolist()) == nodes


def test_where_no_job_comes_last_an_end_that_costs_nothing_does():
    """With it there is one node more."""
    costs = [[math.inf, 2.0], [3.0, math.inf]]
    free = JobOrders(problem_of([1.0, 1.0], costs))
    tied = JobOrders(problem_of([1.0, 1.0], costs, {(1, 0)}))
    assert (free.instance.n, tied.instance.n) == (4, 3)
    assert [cost for cost, _ in all_orders(free.instance)] == [3.0, 4.0]
    assert [cost for cost, _ in all_orders(tied.instance)] == [4.0]
    assert tied.jobs(np.array([0, 1, 2])) == (1, 0)


def test_one_job_is_an_order():
    """It comes after all others, there being none."""
    orders = JobOrders(problem_of([7.0], [[math.inf]]))
    assert all_orders(orders.instance) == [(7.0, (0, 1))]


def test_what_cannot_follow_is_no_order():
    """Costs that are infinite stay so."""
    costs = [[math.inf, math.inf], [3.0, math.inf]]
    orders = JobOrders(problem_of([1.0, math.inf], costs))
    assert all_orders(orders.instance) == []


def test_a_circle_is_refused():
    """By the instance."""
    costs = [[math.inf, 2.0], [3.0, math.inf]]
    with pytest.raises(ValueError, match="cycle"):
        JobOrders(problem_of([1.0, 1.0], costs, {(0, 1), (1, 0)}))
