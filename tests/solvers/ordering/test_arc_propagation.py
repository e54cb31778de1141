"""What follows from arcs that must be taken."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import all_orders, arcs_of, instance_of, orderings
from skillplan.solvers.ordering import NO_ARC, propagate


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
