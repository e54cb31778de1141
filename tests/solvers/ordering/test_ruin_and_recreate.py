"""Local search: what it returns is feasible, costs what it says and is no worse."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import all_orders, instance_of, orderings
from skillplan.solvers.ordering import OrderingInstance, find_followers, find_nearest, improve


def improved(instance, order, seed, iterations=300, moves=0.5):
    """Return the last and the best order, and the cost that was told."""
    now, best = np.array(order), np.array(order)
    random = np.array([2 * seed + 1], dtype=np.uint64)
    arrays = (instance.costs, instance.before, find_nearest(instance))
    message = improve(now, best, *arrays, iterations, 10.0, 0.01, moves, random)
    return now, best, message


@settings(max_examples=examples(150))
@given(
    orderings(most=8, kinds=("whole", "real", "few", "zero")),
    st.integers(0, 10**6),
    st.sampled_from([0.0, 0.5, 1.0]),
)
def test_orders_stay_feasible_and_cost_what_is_told(instance, seed, moves):
    """The last as well as the best, by either kind of move."""
    orders = all_orders(instance)
    if not orders:
        return
    order = np.array(orders[-1][1])
    cost = instance.cost(order)
    now, best, message = improved(instance, order, seed, moves=moves)
    assert instance.feasible(best)
    assert sorted(now.tolist()) == list(range(instance.n))
    ranked = instance.before[np.ix_(now, now)]
    assert not np.tril(ranked).any()
    assert abs(message - instance.cost(best)) <= 1e-9 * max(1.0, cost)
    assert instance.cost(best) <= cost


@settings(max_examples=examples(30))
@given(orderings(least=4, most=7, kinds=("whole",)), st.integers(0, 10**6))
def test_with_a_little_time_it_finds_the_best_of_few_orders(instance, seed):
    """From the worst, on instances of up to 120 orders without forbidden arcs."""
    orders = all_orders(instance)
    whole = (instance.costs < 1e15).sum() >= (instance.n - 2) * (instance.n - 3) // 2
    if orders and whole:
        _, best, _ = improved(instance, orders[-1][1], seed, iterations=3_000)
        assert instance.cost(best) <= orders[len(orders) // 4][0]


def test_the_same_state_of_chance_makes_the_same_moves():
    """The last order, the best and its cost."""
    instance = instance_of(9, 3)
    order = all_orders(instance)[-1][1]
    runs = [improved(instance, order, 5) for _ in range(2)]
    for run, other in zip(*runs, strict=True):
        assert np.array_equal(run, other)


def test_followers_leave_out_what_is_implied():
    """Of 1 before 2 before 3 and 1 before 3, the last goes without saying."""
    before = np.zeros((6, 6), dtype=bool)
    before[[1, 2, 1, 1], [2, 3, 3, 4]] = True
    follow = find_followers(OrderingInstance(np.ones((6, 6)), before))
    assert [[node for node in row if node >= 0] for row in follow] == [[], [2, 4], [3], [], [], []]
