"""The linear relaxation: what its duals say holds of every order that matters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import StopAfter, all_orders, arcs_of, instance_of, least_cost, orderings
from skillplan.solvers.ordering import NO_ARC, CutRelaxation, propagate, repair, tighten


def never():
    return False


def ignore(*shared):
    """Whatever it is."""


def relaxation_of(instance, start=None):
    return CutRelaxation(instance, instance.costs < NO_ARC, start)


def assert_valid(duals, orders, cutoff=np.inf):
    """Assert that every order below a cutoff costs at least the bound and its reduced costs."""
    assert not (duals.reduced < 0).any()
    for cost, order in orders:
        if cost < cutoff:
            spent = duals.bound + duals.reduced[arcs_of(order)].sum()
            assert spent <= cost + 1e-9 * max(1.0, cost)


@settings(max_examples=examples(120))
@given(orderings(most=8), st.integers(0, 8), st.integers(0, 3))
def test_every_order_costs_its_duals(instance, polls, place):
    """Whenever it is stopped, and whatever the cutoff; where there is no order, it may say so."""
    orders = all_orders(instance)
    cutoff = np.inf if place == 0 or len(orders) <= place else orders[place][0]
    messages = []
    stop = never if polls == 8 else StopAfter(polls)
    duals = tighten(relaxation_of(instance), cutoff, stop, messages.append)
    if orders:
        assert duals.bound <= orders[0][0] + 1e-9 * max(1.0, orders[0][0]) or duals.bound >= cutoff
    for result in (duals, *messages):
        assert_valid(result, orders, cutoff)


@settings(max_examples=examples(100))
@given(orderings(least=3, most=8), st.integers(0, 4))
def test_fixing_leaves_every_better_order_its_arcs(instance, place):
    """With the cutoff of any order, again and again."""
    orders = all_orders(instance)
    if len(orders) <= place:
        return
    cutoff = instance.cutoff(orders[place][0])
    relaxation = relaxation_of(instance, np.array(orders[-1][1]))
    duals = tighten(relaxation, cutoff, never, ignore)
    relaxation.fix(duals, cutoff)
    for cost, order in orders:
        if cost < cutoff:
            assert relaxation.arcs[arcs_of(order)].all()
    assert_valid(relaxation.duals(), orders, cutoff)


@pytest.mark.parametrize("kind", ["whole", "real", "large"])
def test_it_begins_with_few_arcs_and_prices_the_others(kind):
    """The bound is that over all arcs: a relaxation that considers all of them has the same."""
    instance = instance_of(24, 5, kind=kind, density=0.1)
    order = np.array([0, *np.argsort(instance.before[:, 1:-1].sum(axis=0), kind="stable") + 1, 23])
    few, all_arcs = relaxation_of(instance, order), relaxation_of(instance)
    assert len(few.tails) < len(all_arcs.tails)
    for relaxation in (few, all_arcs):
        assert relaxation.settle(relaxation.arcs, never)
    assert len(few.tails) < len(all_arcs.tails)
    assert few.duals().bound == pytest.approx(all_arcs.duals().bound, rel=1e-7)


def test_what_a_trial_finds_without_some_arcs_is_no_proof():
    """The only arc considered that leaves a node is avoided; there are others to consider."""
    instance = instance_of(14, 3, density=0.0)
    relaxation = relaxation_of(instance, np.arange(14))
    relaxation.forbid(np.ones((14, 14), dtype=np.bool_) & (relaxation._column < 0))
    relaxation.arcs = instance.costs < NO_ARC
    assert relaxation.settle(relaxation.arcs, never)
    duals, basis = relaxation.duals(), relaxation.basis()
    considered = np.zeros((14, 14), dtype=np.bool_)
    considered[relaxation.tails, relaxation.heads] = True
    optimum = least_cost(instance)
    for node in range(13):
        half = relaxation.arcs & ~(considered & (np.arange(14) == node)[:, None])
        if half[node].any():
            bound = relaxation.trial(half, relaxation.arcs, basis, duals)
            assert bound < np.inf
            assert duals.bound <= bound
    assert duals.bound <= optimum + 1e-9


def test_where_some_node_can_only_be_left_to_nowhere_there_is_no_order():
    """It says so at once, with a bound that no cost reaches."""
    instance = instance_of(7, 1, forbidden=0.9)
    assert all_orders(instance) == []
    assert tighten(relaxation_of(instance), np.inf, never, ignore).bound == np.inf


@settings(max_examples=examples(60))
@given(orderings(least=3, most=7), st.integers(0, 2**32))
def test_any_prices_become_valid_duals(instance, seed):
    """However wrong the prices are that a solver gives: what is negative is taken off the bound."""
    rng = np.random.default_rng(seed)
    n = instance.n
    leaving, reaching = rng.normal(scale=50, size=n - 1), rng.normal(scale=50, size=n - 1)
    reduced = np.where(instance.costs < NO_ARC, instance.costs, np.inf)
    reduced[:-1] -= leaving[:, None]
    reduced[:, 1:] -= reaching
    assert_valid(repair(float(leaving.sum() + reaching.sum()), reduced), all_orders(instance))


def test_cuts_that_do_not_matter_are_dropped_and_the_bound_stays_valid():
    """Also after rows have gone, duals belong to the cuts that are left."""
    instance = instance_of(9, 8, density=0.3)
    relaxation = relaxation_of(instance)
    orders = all_orders(instance)
    dropped = 0
    for _ in range(30):
        relaxation.settle(relaxation.arcs, never)
        assert_valid(relaxation.duals(), orders)
        relaxation.cut(5)
        dropped += relaxation.drop()
    relaxation.settle(relaxation.arcs, never)
    assert len(relaxation.leave) == len(relaxation.reach)
    assert_valid(relaxation.duals(), orders)


# What follows from arcs that must be taken.


@settings(max_examples=examples(250))
@given(orderings(least=3, most=7, kinds=("zero",)), st.integers(0, 2**32), st.floats(0, 0.7))
def test_no_order_of_these_arcs_loses_one(instance, seed, share):
    """Where some arcs are taken away and some others must be taken; and its "none" is true."""
    rng = np.random.default_rng(seed)
    given_arcs = (instance.costs < NO_ARC) & (rng.random(instance.costs.shape) >= share)
    orders = [arcs_of(order) for _, order in all_orders(instance)]
    kept = [order for order in orders if given_arcs[order].all()]
    arcs, before = given_arcs.copy(), instance.before.copy()
    possible = propagate(arcs, before)
    assert not (arcs & ~given_arcs).any()
    if kept:
        assert possible
        assert all(arcs[order].all() for order in kept)
    if possible:
        for tails, heads in kept:
            place = np.empty(instance.n, dtype=np.int64)
            place[np.append(tails, heads[-1])] = np.arange(instance.n)
            first, other = np.nonzero(before)
            assert (place[first] < place[other]).all()


def test_what_comes_before_the_second_of_two_neighbours_comes_before_the_first():
    """And so on, until nothing follows: of three nodes in a row, none is passed by another."""
    instance = instance_of(6, 1, kind="zero", density=0.0)
    arcs = instance.costs < NO_ARC
    before = instance.before.copy()
    before[4, 2] = True
    for i, j in ((1, 2), (2, 3)):
        arcs[i, :] = arcs[:, j] = False
        arcs[i, j] = True
    assert propagate(arcs, before)
    assert before[4, [1, 2, 3]].all()
    assert not arcs[3, 4]


def test_neighbours_in_a_circle_are_no_order():
    """Each is left for the other only."""
    arcs = instance_of(5, 1, kind="zero", density=0.0).costs < NO_ARC
    arcs[1], arcs[2] = np.arange(5) == 2, np.arange(5) == 1
    assert not propagate(arcs, instance_of(5, 1, density=0.0).before.copy())
