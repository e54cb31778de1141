"""Iterated descent: what it returns is feasible, costs what it says and is no worse."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import all_orders
from skillplan.solvers.ordering.instance import OrderingInstance
from skillplan.solvers.ordering.local_search.annealing import cheapest_first, followers, nearest
from skillplan.solvers.ordering.local_search.iterated_descent import descend_again


def kicked(instance, order, seed, kicks=60):
    """Return the last and the best order, and the cost that was told."""
    now, best = np.array(order), np.array(order)
    random = np.array([2 * seed + 1], dtype=np.uint64)
    arrays = (instance.costs, instance.before, nearest(instance), followers(instance))
    told = descend_again(now, best, *arrays, kicks, 10.0, 0.5, random)
    return now, best, told


def loose(n, seed, skew=0.0):
    """Return an instance whose costs hardly depend on the direction, with a few pairs in order."""
    chance = np.random.default_rng(seed)
    costs = chance.integers(1, 100, (n, n)).astype(float)
    costs = np.minimum(costs, costs.T) + skew * chance.random((n, n))
    places = chance.permutation(np.arange(1, n - 1))
    before = np.zeros((n, n), dtype=bool)
    for _ in range(n // 4):
        one, other = np.sort(chance.choice(n - 2, 2, replace=False))
        before[places[one], places[other]] = True
    return OrderingInstance(costs, before)


@settings(max_examples=examples(60))
@given(st.integers(8, 40), st.integers(0, 10**6), st.sampled_from([0.0, 30.0]))
def test_orders_stay_feasible_and_cost_what_is_told(n, seed, skew):
    """The last as well as the best, whether or not a direction costs more."""
    instance = loose(n, seed, skew)
    order = cheapest_first(instance)
    now, best, told = kicked(instance, order, seed)
    for one in (now, best):
        assert sorted(one.tolist()) == list(range(n))
        assert not np.tril(instance.before[np.ix_(one, one)]).any()
    assert abs(told - instance.cost(best)) <= 1e-9 * told
    assert instance.cost(best) <= min(instance.cost(now), instance.cost(order))


def test_it_descends_to_an_end_where_directions_cost_differently():
    """No exchange is taken for a gain that is none, or it would be made and unmade for ever."""
    for seed in range(20):
        instance = loose(40, seed, skew=30.0)
        _, best, told = kicked(instance, cheapest_first(instance), seed, kicks=200)
        assert abs(told - instance.cost(best)) <= 1e-9 * told


def test_it_finds_the_best_order_both_ways_alike():
    """Costs are the same in either direction, so that strings have to be turned round."""
    chance = np.random.default_rng(4)
    costs = chance.integers(1, 100, (9, 9)).astype(float)
    before = np.zeros((9, 9), dtype=bool)
    before[[1, 2, 4], [2, 3, 5]] = True
    instance = OrderingInstance(np.minimum(costs, costs.T), before)
    orders = all_orders(instance)
    for seed in range(5):
        _, best, _ = kicked(instance, orders[-1][1], seed, kicks=300)
        assert instance.cost(best) == orders[0][0]


def test_the_same_state_of_chance_makes_the_same_kicks():
    """The last order, the best and its cost."""
    instance = loose(20, 1)
    runs = [kicked(instance, cheapest_first(instance), 5) for _ in range(2)]
    for one, other in zip(*runs, strict=True):
        assert np.array_equal(one, other)
