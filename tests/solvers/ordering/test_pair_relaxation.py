"""The relaxation over arcs and pairs: what it proves, and what it charges on the way."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import StopAfter, all_orders, arcs_of, instance_of, least_cost, orderings
from skillplan.solvers import ordering

MUCH = 10**9


def never():
    return False


def ignore(*shared):
    """Whatever it is."""


def pairs_of(instance, work=MUCH, cutoff=np.inf, stop=never, on_bound=ignore):
    """Return the relaxation over pairs after some work, begun where that over arcs ended."""
    relaxation = ordering.CutRelaxation(instance, instance.costs < ordering.NO_ARC)
    relaxation.fix(ordering.tighten(relaxation, cutoff, never, ignore), cutoff)
    pairs = ordering.PairRelaxation(relaxation)
    pairs.run(work, cutoff, stop, on_bound)
    return pairs


def beyond(duals, order):
    """Return what an order costs more than the bound, as far as the prices tell."""
    prices = duals.prices
    rank = np.argsort(order)
    first, second = rank[prices.pairs].T
    j, k, i = rank[prices.triples].T
    apart = (i - j) != 1
    charged = ((j < i) & (i < k) & apart) | ((k < j) & (j < i) & apart) | ((i < k) & (k < j))
    return (
        duals.reduced[arcs_of(order)].sum()
        + prices.pair_prices[first < second].sum()
        + prices.triple_prices[charged].sum()
    )


def spent(duals, order):
    """Return what the search over subsets says was spent, after each node of an order."""
    charges = ordering.build_charges(duals)
    sums = [0.0]
    for place in range(1, len(order)):
        last, node, visited = order[place - 1], order[place], set(order[:place])
        total = duals.reduced[last, node]
        for c in range(charges.first[node], charges.first[node + 1]):
            if charges.has[c] in visited and charges.after[c] != last:
                total += 0.0 if charges.lacks[c] in visited else charges.amounts[c]
        sums.append(sums[-1] + total)
    return np.array(sums)


def slack(value):
    return 1e-9 * max(1.0, abs(value)) if np.isfinite(value) else 0.0


@settings(max_examples=examples(50))
@given(orderings(least=3, most=8), st.integers(0, 8), st.integers(0, 3))
def test_every_order_below_the_cutoff_costs_its_duals_and_prices(instance, polls, place):
    """Whenever it is stopped, and whatever the cutoff."""
    orders = all_orders(instance)
    cutoff = np.inf if place == 0 or len(orders) <= place else orders[place][0]
    messages = []
    pairs_of(instance, MUCH, cutoff, never if polls == 8 else StopAfter(polls), messages.append)
    for duals in messages:
        assert not (duals.reduced < 0).any()
        assert not (duals.prices.pair_prices <= 0).any()
        for cost, order in orders:
            if cost < cutoff:
                assert duals.bound + beyond(duals, order) <= cost + slack(cost)


@settings(max_examples=examples(50))
@given(orderings(least=3, most=8), st.integers(1, 3))
def test_no_order_is_charged_more_than_it_costs_wherever_it_is_cut(instance, place):
    """What both ends say was spent, and the arc between them, is at most the rest of its cost."""
    orders = all_orders(instance)
    cutoff = np.inf if len(orders) <= place else orders[place][0]
    duals = pairs_of(instance, MUCH, cutoff).duals
    if duals is None:
        return
    duals = duals.without(cutoff)
    n = instance.n
    for cost, order in orders:
        if cost < cutoff:
            ahead = spent(duals, order)
            behind = spent(duals.mirrored(), [n - 1 - node for node in reversed(order)])
            assert (np.diff(ahead) >= 0).all()
            for cut in range(n - 1):
                arc = duals.reduced[order[cut], order[cut + 1]]
                both = duals.bound + ahead[cut] + arc + behind[n - 2 - cut]
                assert both <= cost + slack(cost)


@settings(max_examples=examples(50))
@given(orderings(least=4, most=9), st.integers(0, 3))
def test_with_its_prices_both_searches_over_subsets_find_the_optimum_or_prove_there_is_none(
    instance, place
):
    """From both ends, and as a beam that leaves nothing out."""
    optimum = least_cost(instance)
    costs = [cost for cost, _ in all_orders(instance)] if place else []
    cutoff = instance.cutoff(costs[min(place, len(costs)) - 1]) if costs else np.inf
    duals = pairs_of(instance, MUCH, cutoff).duals
    if duals is None or cutoff <= duals.bound:
        return
    duals = duals.without(cutoff)
    met = ordering.TwoEndedSearch(instance, duals, cutoff).run(10**6, never)
    search = ordering.run_beam(instance, duals, cutoff, 10**5, never)
    assert met.whole
    assert search.whole
    for order, bound in ((met.order, met.bound), (search.order, search.bound)):
        if optimum < cutoff:
            assert instance.cost(order) == pytest.approx(optimum, rel=1e-9, abs=1e-9)
            assert bound == pytest.approx(optimum, rel=1e-9, abs=1e-9)
        else:
            assert order is None or instance.cost(order) >= cutoff
            assert bound == cutoff


@settings(max_examples=examples(50))
@given(orderings(least=4, most=7, kinds=("zero",)), st.integers(0, 2**32))
def test_every_order_keeps_every_cut_between_nodes(instance, seed):
    """Found at any point whatever; what flows and what comes before need not even agree there."""
    rng = np.random.default_rng(seed)
    n = instance.n
    taken = rng.random((n, n)) * (rng.random((n, n)) < 0.4)
    earlier = np.where(ordering.find_open_pairs(instance), rng.random((n, n)), instance.before)
    tails, heads = np.array(np.nonzero(taken))
    nodes = np.ascontiguousarray(np.argwhere(~np.eye(n, dtype=np.bool_) & ~instance.before.T))
    arrive, depart, violated = ordering.separate_between(
        tails, heads, taken[tails, heads], earlier, nodes, 0.05
    )
    through = arrive & ~depart
    for (i, j), left, reached, passed, amount in zip(
        nodes, depart, ~arrive, through, violated, strict=True
    ):
        if not amount:
            continue
        capacity = np.minimum(earlier[i], earlier[:, j])[passed].sum()
        crossing = taken[np.ix_(left, reached)].sum()
        assert crossing + capacity == pytest.approx(earlier[i, j] - amount)
        for _, order in all_orders(instance):
            rank = np.argsort(order)
            if rank[i] < rank[j]:
                between = (rank[i] < rank) & (rank < rank[j])
                crosses = [left[a] and reached[b] for a, b in itertools.pairwise(order)]
                assert any(crosses) or (between & passed).any()


@settings(max_examples=examples(50))
@given(orderings(least=4, most=8, kinds=("zero",)))
def test_every_order_is_transitive(instance):
    """And nothing comes between neighbours: at orders no triple is violated, between them some."""
    orders = [order for _, order in all_orders(instance)]
    n = instance.n
    for order in orders:
        rank = np.argsort(order)
        earlier = (rank[:, None] < rank).astype(np.float64)
        taken = np.zeros((n, n))
        taken[arcs_of(order)] = 1.0
        assert not len(ordering.find_violated_triples(earlier, taken, 1e-9)[0])
    circle = np.zeros((n, n))
    circle[1, 2] = circle[2, 3] = circle[3, 1] = 1.0
    if n > 4:
        assert len(ordering.find_violated_triples(circle, np.zeros((n, n)), 0.5)[0]) == 3


def test_pairs_prove_more_than_arcs_do():
    """On what is ordered somewhat; and the more work, the more."""
    instance = instance_of(22, 3, density=0.12)
    arcs = ordering.tighten(
        ordering.CutRelaxation(instance, instance.costs < ordering.NO_ARC), np.inf, never, ignore
    ).bound
    messages = []
    pairs = pairs_of(instance, on_bound=messages.append)
    bounds = [duals.bound for duals in messages]
    assert bounds == sorted(bounds)
    assert pairs.duals.bound == bounds[-1] > arcs + 1
    assert len(pairs.duals.prices.triples)


def test_work_may_be_done_in_portions():
    """With the same bound in the end."""
    instance = instance_of(18, 5, density=0.12)
    whole, portions = pairs_of(instance), pairs_of(instance, 1)
    rounds = 0
    while not portions.exhausted:
        portions.run(50_000, np.inf, never, ignore)
        rounds += 1
    assert rounds > 3
    assert portions.duals.bound == pytest.approx(whole.duals.bound)


@pytest.mark.parametrize("free", range(4))
def test_a_triple_around_the_node_where_both_ends_would_meet_hides_no_order(free):
    """Either end is charged for it there; the optimum lies just below the cutoff."""
    n = 2 * free + 5
    first, middle, last = free + 1, free + 2, free + 3
    before = np.zeros((n, n), dtype=np.bool_)
    before[: first + 1, first:middle] = before[: middle + 1, middle:last] = True
    before[: last + 1, last : last + 1] = before[last, last:] = True
    np.fill_diagonal(before, False)
    instance = ordering.OrderingInstance(np.full((n, n), 10.0), before)
    cost = 10.0 * (n - 1)
    triple = ordering.PairPrices(
        np.zeros((0, 2), dtype=np.int64),
        np.zeros(0),
        np.array([[last, middle, first]]),
        np.array([6.0]),
    )
    duals = ordering.Duals(
        cost - 6, np.where(instance.costs < ordering.NO_ARC, 0.0, np.inf), triple
    )
    met = ordering.TwoEndedSearch(instance, duals, cost + 1).run(10**5, never)
    assert met.whole
    assert met.bound == instance.cost(met.order) == cost


@settings(max_examples=examples(50))
@given(orderings(least=6, most=9, kinds=("real",)), st.sampled_from([10_000, 30_000, 100_000]))
def test_an_optimum_right_below_the_cutoff_is_found(instance, work):
    """Where there is hardly any room, with prices of a relaxation that is not at its end."""
    optimum = least_cost(instance)
    cutoff = optimum * (1 + 5e-4) + 1e-6
    duals = pairs_of(instance, work, cutoff).duals if np.isfinite(optimum) else None
    if duals is None or cutoff <= duals.bound:
        return
    met = ordering.TwoEndedSearch(instance, duals.without(cutoff), cutoff).run(10**6, never)
    assert met.bound == pytest.approx(optimum, rel=1e-9)
    assert instance.cost(met.order) == pytest.approx(optimum, rel=1e-9)
