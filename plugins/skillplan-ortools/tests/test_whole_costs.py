"""Costs in whole units: no order looks cheaper by rounding than a proof may ignore."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings

from example_count import examples
from sequencing_problems import problem_of, random_problems
from skillplan_ortools import START, WholeCosts


def whole_cost(network, order):
    return sum(network.arcs[arc] for arc in zip((START, *order), order, strict=False))


@settings(max_examples=examples(100))
@given(random_problems())
def test_whole_costs_bound_costs_from_below_and_closely(problem):
    """For every order that the precedence allows, within a tenth of what a proof may ignore."""
    network = WholeCosts(problem)
    for order in itertools.permutations(range(network.n)):
        if network.allows(order):
            cost = problem.cost(order)
            bound = network.in_problem_units(whole_cost(network, order))
            assert cost - 1e-10 <= bound <= cost + 1e-14


@settings(max_examples=examples(100))
@given(random_problems())
def test_an_order_takes_no_arc_that_was_left_out(problem):
    """What the precedence allows, the arcs and ranks allow, too."""
    network = WholeCosts(problem)
    for order in itertools.permutations(range(network.n)):
        place = {job: position for position, job in enumerate(order)}
        if all(place[i] < place[j] for i, j in problem.precedence):
            assert network.allows(order)
            for job in order:
                first, last = network.ranks(job)
                assert first <= place[job] <= last


def test_costs_that_are_whole_stay_as_they_are():
    """So that an integer instance is solved as it stands in its file."""
    network = WholeCosts(problem_of([3, 4], [[math.inf, 7], [9, math.inf]]))
    assert network.exponent == 0
    assert network.arcs == {(START, 0): 3, (START, 1): 4, (0, 1): 7, (1, 0): 9}


def test_costs_too_large_to_be_added_exactly_are_made_coarser():
    """Sums stay where floats hold every whole number; the bound still holds."""
    most = 2.0**52 + 2
    network = WholeCosts(problem_of([most, most], [[math.inf, most], [most, math.inf]]))
    total = whole_cost(network, (0, 1))
    assert total <= 2**52
    assert 0.999 * 2 * most < network.in_problem_units(total) <= 2 * most


def test_a_way_that_does_not_exist_is_no_arc():
    """An infinite cost says that nothing leads there."""
    network = WholeCosts(problem_of([3, math.inf], [[math.inf, 7], [9, math.inf]]))
    assert (START, 1) not in network.arcs
    assert not network.allows((1, 0))
    assert network.allows((0, 1))


def test_the_nearest_order_goes_on_to_the_cheapest_job_that_may_come_next():
    """It respects the precedence; of equals the first comes first."""
    costs = np.array([[math.inf, 5, 1], [1, math.inf, 1], [2, 1, math.inf]])
    assert WholeCosts(problem_of([2, 1, 2], costs)).nearest_order() == (1, 0, 2)
    assert WholeCosts(problem_of([2, 1, 2], costs, {(0, 1)})).nearest_order() == (0, 2, 1)


def test_where_the_nearest_order_comes_to_a_dead_end_there_is_none():
    """From the cheapest first job nothing leads on."""
    network = WholeCosts(problem_of([1, 5], [[math.inf, math.inf], [1, math.inf]]))
    assert network.nearest_order() is None


@pytest.mark.parametrize("order", [(0,), (0, 0), (0, 1, 2), (1, 0)])
def test_what_is_no_order_or_breaks_the_precedence_is_not_allowed(order):
    """Every job once, and what comes before before."""
    network = WholeCosts(problem_of([1, 1], [[math.inf, 1], [1, math.inf]], {(0, 1)}))
    assert not network.allows(order)
