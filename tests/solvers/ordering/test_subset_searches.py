"""Searches over feasible subsets: from one end and from both, and the bounds they rest on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import StopAfter, all_orders, arcs_of, instance_of, least_cost, orderings
from skillplan.solvers import ordering
from thinned import slow_case


def never():
    return False


def duals_of(instance, rounds):
    """Return the duals of the relaxation once it gave so many bounds; 0: no bound at all."""
    if not rounds:
        return ordering.Duals(
            0.0, np.where(instance.costs < ordering.NO_ARC, instance.costs, np.inf)
        )
    relaxation = ordering.CutRelaxation(instance, instance.costs < ordering.NO_ARC)
    bounds = []
    return ordering.tighten(relaxation, np.inf, lambda: len(bounds) >= rounds, bounds.append)


def slack(value):
    return 1e-9 * max(1.0, abs(value)) if np.isfinite(value) else 0.0


@settings(max_examples=examples(60))
@given(orderings(most=7), st.integers(0, 2), st.integers(0, 6))
def test_what_is_ahead_is_never_more_than_any_completion_spends(instance, rounds, bits):
    """Of every feasible order, cut after every node, with the neighbours that are left there."""
    duals = duals_of(instance, rounds)
    if not np.isfinite(duals.bound):
        return
    bounds = ordering.CompletionBounds(instance, duals, bits)
    for _, order in all_orders(instance):
        spends = duals.reduced[arcs_of(order)]
        for place, node in enumerate(order):
            row = bounds.slot[place, node]
            assert row >= 0
            known = bounds.near[node]
            left = sum(1 << b for b, other in enumerate(known) if other in order[place + 1 :])
            rest = spends[place:].sum()
            assert bounds.ahead[row, left] <= rest + slack(rest)


@settings(max_examples=examples(150))
@given(orderings(most=9), st.integers(0, 2), st.integers(0, 3), st.integers(1, 12))
def test_a_beam_keeps_its_word(instance, rounds, place, width):
    """A whole one has the optimum below the cutoff; a narrow one a bound, and maybe an order."""
    optimum = least_cost(instance)
    costs = [cost for cost, _ in all_orders(instance)] if place else []
    cutoff = instance.cutoff(costs[min(place, len(costs)) - 1]) if costs else np.inf
    duals = duals_of(instance, rounds)
    if not np.isfinite(duals.bound) or cutoff <= duals.bound:
        return
    for wide in (width, 10**5):
        search = ordering.run_beam(instance, duals, cutoff, wide, never)
        assert search.bound <= min(optimum, cutoff) + slack(optimum)
        if search.order is not None:
            assert instance.feasible(search.order)
            assert instance.cost(search.order) >= optimum - slack(optimum)
    assert search.whole
    if optimum < cutoff:
        assert instance.cost(search.order) == pytest.approx(optimum, rel=1e-9, abs=1e-9)
        assert search.bound == pytest.approx(optimum, rel=1e-9, abs=1e-9)
    else:
        assert search.bound == cutoff


def test_a_beam_in_which_all_ways_are_alike_still_leads_somewhere():
    """Where every order costs nothing, the narrowest finds one."""
    instance = instance_of(9, 4, kind="zero", density=0.2)
    search = ordering.run_beam(instance, duals_of(instance, 1), np.inf, 1, never)
    assert instance.feasible(search.order)
    assert instance.cost(search.order) == 0


def test_a_beam_that_is_stopped_says_nothing():
    """Not even a bound."""
    instance = instance_of(8, 2)
    assert ordering.run_beam(instance, duals_of(instance, 1), np.inf, 10, StopAfter(2)) is None


@settings(max_examples=examples(150))
@given(orderings(most=9), st.integers(0, 2), st.integers(0, 3))
def test_from_both_ends_it_finds_the_optimum_below_the_cutoff_or_proves_there_is_none(
    instance, rounds, place
):
    """Also where no order is known at all, and the cutoff is infinite."""
    optimum = least_cost(instance)
    costs = [cost for cost, _ in all_orders(instance)] if place else []
    cutoff = instance.cutoff(costs[min(place, len(costs)) - 1]) if costs else np.inf
    duals = duals_of(instance, rounds)
    if not np.isfinite(duals.bound) or cutoff <= duals.bound:
        return
    met = ordering.TwoEndedSearch(instance, duals, cutoff).run(10**6, never)
    assert met.whole
    if optimum < cutoff:
        assert instance.feasible(met.order)
        assert instance.cost(met.order) == pytest.approx(optimum, rel=1e-9, abs=1e-9)
        assert met.bound == pytest.approx(optimum, rel=1e-9, abs=1e-9)
    else:
        assert met.order is None
        assert met.bound == cutoff


@settings(max_examples=examples(150))
@given(orderings(least=4, most=9), st.integers(0, 2), st.integers(0, 30), st.integers(1, 200))
def test_from_both_ends_its_bound_holds_wherever_it_ends(instance, rounds, polls, states):
    """By a stop, before either end was searched or between the two, or for want of states."""
    optimum = least_cost(instance)
    duals = duals_of(instance, rounds)
    if not np.isfinite(duals.bound):
        return
    for limits in ((states, never), (10**6, StopAfter(polls))):
        met = ordering.TwoEndedSearch(instance, duals, np.inf).run(*limits)
        assert met.bound <= optimum + slack(optimum)
        if met.order is not None:
            assert instance.feasible(met.order)


@settings(max_examples=examples(40))
@given(orderings(least=3, most=8))
def test_read_backwards_an_instance_has_the_same_optimum(instance):
    """By every search, the costs of arcs turned around."""
    costs = np.where(instance.costs < ordering.NO_ARC, instance.costs, np.inf)
    mirrored = ordering.OrderingInstance(costs[::-1, ::-1].T, instance.before[::-1, ::-1].T)
    for item in (instance, mirrored):
        duals = duals_of(item, 1)
        if np.isfinite(duals.bound):
            met = ordering.TwoEndedSearch(item, duals, np.inf).run(10**6, never)
            assert met.bound == pytest.approx(least_cost(instance), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    "n",
    [
        *(63, 64, 65),
        *(slow_case(n, reason="63, 64 and 65 in every run") for n in (66, 127, 128, 129, 130, 200)),
    ],
)
def test_sets_may_fill_any_number_of_words(n):
    """Two chains that are to be woven; a small program of our own knows the optimum."""
    rng = np.random.default_rng(n)
    costs = rng.integers(1, 50, (n, n)).astype(np.float64)
    before = np.zeros((n, n), dtype=np.bool_)
    item = np.arange(1, n - 3)
    before[item, item + 2] = True
    instance = ordering.OrderingInstance(costs, before)
    optimum = least_cost(instance)
    duals = duals_of(instance, 1)
    search = ordering.run_beam(instance, duals, np.inf, 10**5, never)
    assert search.whole
    assert instance.cost(search.order) == search.bound == optimum
    met = ordering.TwoEndedSearch(instance, duals, optimum + 1).run(10**6, never)
    assert met.whole
    assert met.bound == optimum
