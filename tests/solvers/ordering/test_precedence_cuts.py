"""Cuts: what they forbid is no order, and they are violated where that is said."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import all_orders, arcs_of, instance_of, orderings
from skillplan.model import SequencingProblem
from skillplan.solvers import ordering
from skillplan.solvers.ordering.relaxation import precedence_cuts as counted


def all_pairs(before):
    """Return all pairs of nodes, the first before the second."""
    return np.ascontiguousarray(np.argwhere(before))


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
    tails, heads = np.array(np.nonzero(values > 1e-7))
    return tails, heads, np.minimum(values[tails, heads], 1.0)


@settings(max_examples=examples(150))
@given(orderings(least=3, most=7, kinds=("zero",)), st.integers(0, 2**32))
def test_every_order_crosses_every_cut(instance, seed):
    """Also where the cut was lifted; and the point that it was found at does not."""
    tails, heads, values = fractional(instance, seed, feasible=False)
    pairs = all_pairs(instance.before)
    leave, reach = ordering.separate(tails, heads, values, instance.before, pairs, 0.02, 200)
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
    assert len(ordering.separate(*point, instance.before, pairs, 0.02, 200)[0]) == 0


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
    leave, reach = ordering.separate(*point, before, np.array([[1, 4]]), 0.02, 10)
    assert leave[0, 1]
    assert reach[0, 4]
    assert not (leave[0, point[0]] & reach[0, point[1]]).any()


def test_a_circle_beside_the_path_is_cut_off():
    """By the first node and any on the circle."""
    instance = instance_of(6, 0, kind="zero", density=0.0)
    tails, heads = np.array([0, 1, 2, 3, 4]), np.array([1, 5, 3, 4, 2])
    point = tails, heads, np.ones(5)
    assert len(ordering.separate(*point, instance.before, np.array([[0, 3]]), 0.02, 10)[0]) == 1


def test_no_more_cuts_come_than_were_asked_for():
    """They are the first of all."""
    instance = instance_of(8, 2, kind="zero", density=0.5)
    point = fractional(instance, 5, feasible=False)
    pairs = all_pairs(instance.before)
    full, few = (ordering.separate(*point, instance.before, pairs, 0.02, most) for most in (200, 2))
    assert len(full[0]) > len(few[0]) == 2
    for all_sets, sets in zip(full, few, strict=True):
        assert np.array_equal(all_sets[:2], sets)


def test_without_pairs_there_is_nothing_to_cut():
    """Two nodes, or a window that is empty."""
    instance = instance_of(3, 0)
    none = np.zeros((0, 2), dtype=np.int64)
    assert len(ordering.separate(*whole_point([0, 1, 2]), instance.before, none, 0.02, 10)[0]) == 0


# Cuts of set-ups: how often an order has to go from one family of nodes to another.


@settings(max_examples=examples(80))
@given(
    n=st.integers(2, 8),
    seed=st.integers(0, 2**32),
    density=st.sampled_from([0.0, 0.2, 0.5]),
    families=st.integers(1, 4),
)
def test_the_least_number_of_changes_is_that_of_some_order_and_of_none_less(
    n, seed, density, families
):
    """Counted over every order that the precedence allows."""
    instance = instance_of(n, seed, density=density, families=families)

    def changes(order):
        of = [family for family in instance.families[list(order)] if family >= 0]
        return sum(first != other for first, other in itertools.pairwise(of))

    minimum = min(changes(order) for _, order in all_orders(instance))
    assert ordering.count_changes(instance.families, instance.before) == minimum


@settings(max_examples=examples(80))
@given(
    n=st.integers(2, 8),
    seed=st.integers(0, 2**32),
    density=st.sampled_from([0.0, 0.2, 0.5]),
    families=st.integers(2, 4),
)
def test_every_order_keeps_every_cut(n, seed, density, families):
    """The sum of its arcs among those of the cut is no less than the cut says."""
    instance = instance_of(n, seed, density=density, families=families)
    for cut in ordering.find_set_up_cuts(instance):
        for _, order in all_orders(instance):
            assert cut.arcs[arcs_of(order)].sum() >= cut.number


def test_an_instance_without_families_has_no_cut():
    instance = instance_of(6, 0)
    assert ordering.find_set_up_cuts(instance) == []


def test_where_too_many_sets_would_be_looked_at_the_count_so_far_is_the_bound(monkeypatch):
    """A lower one, which is still a bound."""
    instance = instance_of(9, 1, density=0.5, families=4)
    whole = ordering.count_changes(instance.families, instance.before)
    monkeypatch.setattr(counted, "_MOST_SETS", 2)
    assert 0 < ordering.count_changes(instance.families, instance.before) < whole


def test_relaxations_prove_more_with_families_than_without():
    """Both that over arcs and that over pairs, which begins with the cuts of the first."""
    with_families = instance_of(20, 3, density=0.1, families=3)
    costs = np.where(with_families.costs >= ordering.NO_ARC, np.inf, with_families.costs)
    without = ordering.OrderingInstance(costs, with_families.before)
    bounds = []
    for instance in (without, with_families):
        relaxation = ordering.CutRelaxation(instance, instance.costs < ordering.NO_ARC)
        arcs = ordering.tighten(relaxation, np.inf, lambda: False, lambda duals: None)
        pairs = ordering.PairRelaxation(relaxation)
        pairs.run(2_000_000, np.inf, lambda: False, lambda duals: None)
        bounds.append((arcs.bound, pairs.duals.bound))
    assert bounds[1][0] > bounds[0][0] + 1
    assert bounds[1][1] > bounds[0][1] + 1


@pytest.fixture
def two_tools():
    """Four jobs that need two tools in turns, the first of them at hand, and a chart."""
    between = {(i, j): ("offload", "load") for i in (0, 2) for j in (1, 3)}
    between |= {(j, i): path for (i, j), path in between.items()}
    between |= {(-1, 1): ("load",), (-1, 3): ("load",)}
    costs = np.where(np.eye(4) > 0, np.inf, 1.0)
    return SequencingProblem(
        jobs=tuple("abcd"),
        skills=tuple((job,) for job in "abcd"),
        first=np.ones(4),
        costs=costs,
        precedence=frozenset({(0, 1), (1, 2), (2, 3)}),
        paths=between,
        step_limit=20,
    )


def test_jobs_between_which_nothing_is_done_are_a_family(two_tools):
    """And so is the initial state with those that may follow at once."""
    instance = ordering.JobOrders(two_tools).instance
    assert (instance.families == [0, 0, 2, 0, 2]).all()
    assert ordering.count_changes(instance.families, instance.before) == 3


def test_where_nothing_is_done_between_jobs_there_are_no_families(two_tools):
    assert ordering.JobOrders(replace(two_tools, paths={})).instance.families is None
