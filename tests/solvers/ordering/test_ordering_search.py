"""The whole search, each method by itself and all together, against the sets already visited."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import StopAfter, all_orders, instance_of, least_cost, orderings
from skillplan.solvers.ordering import METHODS, OrderingSearch
from thinned import slow_case

PROVING = tuple((method,) for method in METHODS if method != "local-search")
EXACT = METHODS[1:]


def search_of(instance, methods, **more):
    """Return a search that has ended, and what it told."""
    calls = {"orders": [], "bounds": []}
    search = OrderingSearch(
        instance,
        methods,
        on_order=lambda order, cost: calls["orders"].append(cost),
        on_bound=lambda bound, nodes: calls["bounds"].append(bound),
        **more,
    )
    search.run()
    return search, calls


def slack(value):
    return 1e-9 * max(1.0, value) if np.isfinite(value) else 0.0


def assert_sound(search, message, minimum):
    """Assert that bound <= optimum <= cost, and that a proof is one."""
    assert search.bound <= minimum + slack(minimum)
    assert search.cost >= minimum - slack(minimum)
    assert message["orders"] == sorted(message["orders"], reverse=True)
    assert message["bounds"] == sorted(message["bounds"])
    assert all(bound <= minimum + slack(minimum) for bound in message["bounds"])
    if search.order is not None:
        assert search.instance.feasible(search.order)
        assert search.instance.cost(search.order) == search.cost
    if search.proved:
        assert search.cost == pytest.approx(minimum, rel=1e-9, abs=1e-9)
        assert search.bound == pytest.approx(minimum, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("methods", PROVING)
@settings(max_examples=examples(150))
@given(instance=orderings(most=9))
def test_each_method_proves_the_optimum_or_that_there_is_none(methods, instance):
    """By itself: whole numbers and others, ties, nothing, costs far apart, arcs forbidden."""
    search, message = search_of(instance, methods)
    assert search.proved
    assert_sound(search, message, least_cost(instance))


@pytest.mark.parametrize("methods", [*PROVING, EXACT])
@settings(max_examples=examples(30))
@given(st.integers(10, 13), st.integers(0, 10**6), st.sampled_from(["few", "real", "spread"]))
def test_they_do_so_beyond_the_arcs_considered_first(methods, n, seed, kind):
    """Nodes with more neighbours than the relaxation begins with, and few feasible orders."""
    instance = instance_of(n, seed, kind=kind, forbidden=0.4 * (seed % 2), density=0.2)
    search, message = search_of(instance, methods)
    assert search.proved
    assert_sound(search, message, least_cost(instance))


@pytest.mark.parametrize("methods", [METHODS, ("local-search",)])
@settings(max_examples=6)
@given(instance=orderings(most=8, kinds=("whole", "real", "few")))
def test_with_local_search_they_do_as_well(methods, instance):
    """Alone it has the relaxation's bound, and ends after the rounds it was given."""
    search, message = search_of(instance, methods, rounds=2)
    optimum = least_cost(instance)
    assert_sound(search, message, optimum)
    assert search.proved or methods != METHODS
    if np.isfinite(optimum):
        assert search.cost == pytest.approx(optimum, rel=1e-9, abs=1e-9)
    if not search.proved:
        assert search.ended == "limit of 2 rounds"


@pytest.mark.parametrize("methods", [*PROVING, EXACT])
@settings(max_examples=examples(100))
@given(instance=orderings(least=4, most=9), polls=st.integers(0, 40))
def test_wherever_it_is_stopped_what_it_says_holds(methods, instance, polls):
    """Bound <= optimum <= cost, after any number of questions whether to stop."""
    search, message = search_of(instance, methods, stop=StopAfter(polls))
    assert_sound(search, message, least_cost(instance))


@settings(max_examples=examples(60))
@given(orderings(least=3, most=8), st.integers(0, 10**6), st.integers(0, 12))
def test_an_order_to_start_from_is_never_made_worse(instance, which, polls):
    """Also where it is stopped at once."""
    orders = all_orders(instance)
    if not orders:
        return
    cost, order = orders[which % len(orders)]
    search, message = search_of(instance, EXACT, start=np.array(order), stop=StopAfter(polls))
    assert search.cost <= cost + slack(cost)
    assert_sound(search, message, orders[0][0])


def test_an_order_to_start_from_that_is_none_is_not_used():
    """Nodes twice, or against the precedence."""
    instance = instance_of(7, 2, density=0.4)
    for wrong in (np.zeros(7, dtype=np.int64), all_orders(instance)[0][1][::-1]):
        search, message = search_of(instance, EXACT, start=np.array(wrong))
        assert search.proved
        assert_sound(search, message, least_cost(instance))


@pytest.mark.parametrize("methods", [METHODS, *PROVING])
@pytest.mark.parametrize("kind", ["whole", slow_case("real", reason="whole costs in every run")])
def test_the_same_seed_makes_the_same_moves(methods, kind):
    """Order, bound and every figure of the effort."""
    instance = instance_of(14, 1, kind=kind, density=0.1)
    runs = [search_of(instance, methods, seed=3) for _ in range(2)]
    (first, message), (other, told_again) = runs
    assert np.array_equal(first.order, other.order)
    assert (first.bound, first.effort) == (other.bound, other.effort)
    assert message == told_again


@pytest.mark.parametrize("methods", [*PROVING, EXACT])
def test_without_memory_it_ends_with_a_bound(methods):
    """Branch and cut alone needs none to speak of."""
    instance = instance_of(12, 5, density=0.05)
    search, message = search_of(instance, methods, memory_bytes=lambda: 0)
    assert_sound(search, message, least_cost(instance))
    assert search.ended in ("", "memory limit")
    assert search.proved or search.ended == "memory limit"


@pytest.mark.parametrize("kind", ["whole", "real"])
def test_where_no_order_can_be_the_bound_is_infinite(kind):
    """Whatever the costs are like, and whatever finds out."""
    instance = instance_of(8, 4, kind=kind, forbidden=0.8)
    assert least_cost(instance) == np.inf
    for methods in (METHODS, *PROVING):
        search, _ = search_of(instance, methods)
        assert (search.proved, search.bound, search.order) == (True, np.inf, None)
