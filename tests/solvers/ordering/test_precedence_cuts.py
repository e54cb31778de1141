"""Cuts: what they forbid is no order, and they are violated where that is said."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import all_orders, arcs_of, instance_of, orderings
from skillplan.solvers.ordering import separate


def all_pairs(before):
    """Return all pairs of nodes, the first before the second."""
    return np.argwhere(before)


def fractional(instance, seed, *, feasible):
    """Return tails, heads and values of a mixture of feasible orders or of any assignments."""
    rng = np.random.default_rng(seed)
    n = instance.n
    values = np.zeros((n, n))
    orders = [order for _, order in all_orders(instance)]
    for weight in rng.dirichlet(np.ones(rng.integers(1, 5))):
        if feasible:
            order = orders[rng.integers(len(orders))]
            values[arcs_of(order)] += weight
        else:
            # Heads in any order at all: circles, and against the precedence.
            values[np.arange(n - 1), 1 + rng.permutation(n - 1)] += weight
    np.fill_diagonal(values, 0.0)
    tails, heads = np.nonzero(values > 1e-7)
    return tails, heads, np.minimum(values[tails, heads], 1.0)


@settings(max_examples=examples(150))
@given(orderings(least=3, most=7, kinds=("zero",)), st.integers(0, 2**32))
def test_every_order_crosses_every_cut(instance, seed):
    """Also where the cut was lifted; and the point that it was found at does not."""
    tails, heads, values = fractional(instance, seed, feasible=False)
    pairs = all_pairs(instance.before)
    leave, reach = separate(tails, heads, values, instance.before, pairs, 0.02, 200)
    orders = [arcs_of(order) for _, order in all_orders(instance)]
    for left, reached in zip(leave, reach, strict=True):
        assert not (left & reached).any()
        for order_tails, order_heads in orders:
            assert (left[order_tails] & reached[order_heads]).any()
        assert values[left[tails] & reached[heads]].sum() <= 1 - 0.02 + 1e-9


@settings(max_examples=examples(80))
@given(orderings(least=3, most=8, kinds=("zero",)), st.integers(0, 2**32))
def test_a_mixture_of_orders_violates_no_cut(instance, seed):
    """What can be, is not cut off."""
    if not all_orders(instance):
        return
    point = fractional(instance, seed, feasible=True)
    pairs = all_pairs(instance.before)
    assert len(separate(*point, instance.before, pairs, 0.02, 200)[0]) == 0


def whole_point(order):
    """Return the arcs of a sequence of nodes, each taken wholly."""
    tails, heads = np.array(order[:-1]), np.array(order[1:])
    return tails, heads, np.ones(len(tails))


def test_a_sequence_against_the_precedence_is_cut_off():
    """Though it visits every node once."""
    instance = instance_of(6, 0, kind="zero", density=0.0)
    before = instance.before.copy()
    before[1, 4] = True
    point = whole_point([0, 4, 2, 1, 3, 5])
    leave, reach = separate(*point, before, np.array([[1, 4]]), 0.02, 10)
    assert leave[0, 1]
    assert reach[0, 4]
    assert not (leave[0, point[0]] & reach[0, point[1]]).any()


def test_a_circle_beside_the_path_is_cut_off():
    """By the first node and any on the circle."""
    instance = instance_of(6, 0, kind="zero", density=0.0)
    tails, heads = np.array([0, 1, 2, 3, 4]), np.array([1, 5, 3, 4, 2])
    point = tails, heads, np.ones(5)
    assert len(separate(*point, instance.before, np.array([[0, 3]]), 0.02, 10)[0]) == 1


def test_no_more_cuts_come_than_were_asked_for():
    """They are the first of all."""
    instance = instance_of(8, 2, kind="zero", density=0.5)
    point = fractional(instance, 5, feasible=False)
    pairs = all_pairs(instance.before)
    full, few = (separate(*point, instance.before, pairs, 0.02, most) for most in (200, 2))
    assert len(full[0]) > len(few[0]) == 2
    for all_sets, sets in zip(full, few, strict=True):
        assert np.array_equal(all_sets[:2], sets)


def test_without_pairs_there_is_nothing_to_cut():
    """Two nodes, or a window that is empty."""
    instance = instance_of(3, 0)
    none = np.zeros((0, 2), dtype=np.int64)
    assert len(separate(*whole_point([0, 1, 2]), instance.before, none, 0.02, 10)[0]) == 0
