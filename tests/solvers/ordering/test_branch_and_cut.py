"""Branch and cut: a proof at the end, a bound before."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import StopAfter, instance_of, least_cost, orderings
from skillplan.solvers.ordering import NO_ARC, BranchAndCut, CutRelaxation


def search_of(instance, *, cost=np.inf, stop=lambda: False, kind=CutRelaxation):
    """Return a search that has not begun, and the orders that it will find."""
    orders, bounds = [], []
    relaxation = kind(instance, instance.costs < NO_ARC)
    search = BranchAndCut(
        relaxation,
        cost,
        stop,
        lambda order: orders.append(order),
        lambda bound, parts: bounds.append(bound),
    )
    return search, orders, bounds


class Uncut(CutRelaxation):
    """A relaxation that never looks at any pair, so that no cut is found."""

    def _window(self, look):
        return self._pairs[0][:0]


@pytest.mark.parametrize("kind", [CutRelaxation, Uncut])
@settings(max_examples=examples(100))
@given(instance=orderings(most=9))
def test_it_proves_the_optimum_or_that_there_is_no_order(kind, instance):
    """Branching alone would do: a part whose arcs are whole, but no order, is split as well."""
    search, orders, bounds = search_of(instance, kind=kind)
    search.run(10**12)
    approx = pytest.approx(least_cost(instance), rel=1e-9, abs=1e-9)
    assert search.done
    assert search.cost == approx
    assert search.bound == approx
    if orders:
        assert instance.feasible(orders[-1])
        assert instance.cost(orders[-1]) == search.cost
    assert all(bound <= search.cost for bound in bounds)


@settings(max_examples=examples(80))
@given(st.integers(10, 12), st.integers(0, 10**6), st.sampled_from(["few", "real", "spread"]))
def test_arcs_that_are_not_considered_yet_count_when_a_part_is_given_up(n, seed, kind):
    """Where nodes have more arcs than the relaxation considers at first, and an order is known."""
    instance = instance_of(n, seed, kind=kind, forbidden=0.2, density=0.1)
    greedy = np.array(
        [0, *1 + np.argsort(instance.before[:, 1:-1].sum(axis=0), kind="stable"), n - 1]
    )
    relaxation = CutRelaxation(instance, instance.costs < NO_ARC, greedy)
    search = BranchAndCut(relaxation, np.inf, lambda: False, lambda o: None, lambda b, p: None)
    search.run(10**12)
    assert search.cost == pytest.approx(least_cost(instance), rel=1e-9, abs=1e-9)


@settings(max_examples=examples(100))
@given(orderings(least=4, most=10), st.integers(0, 40))
def test_its_bound_holds_whenever_it_is_stopped(instance, polls):
    """And going on from there ends with the proof."""
    optimum = least_cost(instance)
    slack = 1e-9 * max(1.0, optimum) if np.isfinite(optimum) else 0.0
    stop = StopAfter(polls)
    search, _, _ = search_of(instance, stop=stop)
    search.run(10**12)
    assert search.bound <= optimum + slack
    assert search.cost >= optimum - slack
    stop.polls = 10**9
    search.run(10**12)
    assert search.done
    assert search.cost == pytest.approx(optimum, rel=1e-9, abs=1e-9)


def test_work_is_what_it_ends_by():
    """A little of it each time, with bounds that only rise."""
    instance = instance_of(12, 4, kind="whole", density=0.05)
    optimum = least_cost(instance)
    search, _, _ = search_of(instance)
    bounds = []
    while not search.done:
        search.run(1)
        bounds.append(search.bound)
        assert len(bounds) < 5_000
    assert len(bounds) > 1
    assert bounds == sorted(bounds)
    assert bounds[-1] == search.cost == optimum


def test_a_cost_that_is_known_already_need_only_be_proved():
    """No order is told then, and the bound is that cost."""
    instance = instance_of(9, 6)
    optimum = least_cost(instance)
    search, orders, _ = search_of(instance, cost=optimum)
    search.run(10**12)
    assert search.done
    assert orders == []
    assert search.bound == optimum
