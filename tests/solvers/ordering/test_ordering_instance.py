"""The instance: what follows from precedence, and what orders can cost at all."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ordering_instances import all_orders, arcs_of, instance_of, orderings
from sequencing_problems import problem_of, random_problems
from skillplan.solvers.ordering import MOST, NO_ARC, JobOrders, OrderingInstance


def bare(n, value=1.0):
    """Return costs that are all alike, and no precedence."""
    return np.full((n, n), value), np.zeros((n, n), dtype=np.bool_)


@given(instance=orderings(most=7))
def test_no_order_takes_an_arc_that_is_left_out(instance):
    """Arcs are left out against the precedence, past what comes between, and to oneself."""
    used = np.zeros((instance.n, instance.n), dtype=np.bool_)
    for _, order in all_orders(instance):
        used[arcs_of(order)] = True
    assert not (used & (instance.costs >= NO_ARC)).any()


@given(st.integers(3, 7), st.integers(0, 10**6), st.sampled_from([0.1, 0.4]))
def test_without_forbidden_arcs_every_arc_that_is_left_belongs_to_some_order(n, seed, density):
    """So that exactly the others are left out."""
    instance = instance_of(n, seed, density=density)
    used = np.zeros((n, n), dtype=np.bool_)
    for _, order in all_orders(instance):
        used[arcs_of(order)] = True
    assert (used == (instance.costs < NO_ARC)).all()


@given(instance=orderings(most=7))
def test_an_order_is_feasible_if_it_is_among_all_orders(instance):
    """Also those that permute nodes at random."""
    known = {order for _, order in all_orders(instance)}
    rng = np.random.default_rng(instance.n)
    for _ in range(20):
        inner = 1 + rng.permutation(instance.n - 2) if instance.n > 2 else []
        order = np.array([0, *inner, instance.n - 1])
        assert instance.feasible(order) == (tuple(order.tolist()) in known)
    assert not instance.feasible(np.zeros(instance.n, dtype=np.int64))


@given(instance=orderings(most=7))
def test_every_order_costs_the_offset_and_whole_steps(instance):
    """The step is 0 only where costs are not whole numbers, or sums of them very large."""
    used = instance.costs[instance.costs < NO_ARC]
    whole = bool((used == np.rint(used)).all())
    assert (instance.step > 0) == (whole and instance.n * used.max(initial=0) <= 1e9)
    if instance.step:
        for cost, _ in all_orders(instance):
            steps = (cost - instance.offset) / instance.step
            assert steps >= 0
            assert steps == round(steps)


@pytest.mark.parametrize("density", [0.0, 0.3])
def test_a_step_that_all_costs_share_is_found(density):
    """All of them are 4 and a multiple of 6."""
    instance = instance_of(9, 1, kind="even", density=density)
    assert instance.step % 6 == 0
    assert (instance.offset - 4 * 8) % 6 == 0


@given(instance=orderings(most=7), place=st.floats(-0.2, 1.2))
def test_rounding_up_and_cutting_off_lose_no_order(instance, place):
    """No order lies between a bound and what that becomes, nor between a cutoff and its cost."""
    costs = [cost for cost, _ in all_orders(instance)]
    if not costs:
        return
    bound = costs[0] + place * (costs[-1] - costs[0])
    rounded = instance.rounded_up(bound)
    slack = 1e-9 * max(1.0, abs(bound))
    # Rounding down is for the tolerance only.
    assert rounded >= bound - 1e-6 * max(instance.step, 1.0) - slack
    assert not any(bound + 1e-5 * instance.step < cost < rounded - slack for cost in costs)
    for cost in costs:
        cutoff = instance.cutoff(cost)
        assert cutoff < cost
        assert not any(cutoff <= other < cost - slack for other in costs)


@pytest.mark.parametrize("kind", ["whole", "real"])
def test_while_no_order_is_known_nothing_is_cut_off(kind):
    """The cutoff of no order is infinite, whatever costs are like, and a bound may reach it."""
    assert instance_of(5, 1, kind=kind).cutoff(np.inf) == np.inf


@given(instance=orderings(most=8))
def test_the_relation_is_closed_with_the_first_before_all_and_the_last_after_all(instance):
    """Transitive, irreflexive."""
    before = instance.before
    assert before[0, 1:].all()
    assert before[:-1, -1].all()
    assert not before.diagonal().any()
    two_steps = (before.astype(int) @ before.astype(int)) > 0
    assert (before >= two_steps).all()


def test_a_circle_is_no_precedence():
    """Directly, by way of others, and with the ends."""
    costs, before = bare(5)
    for circle in ([(1, 2), (2, 1)], [(1, 2), (2, 3), (3, 1)], [(3, 0)], [(4, 2)]):
        relation = before.copy()
        relation[tuple(np.array(circle).T)] = True
        with pytest.raises(ValueError, match="cycle"):
            OrderingInstance(costs, relation)


def test_what_is_no_instance_is_refused():
    """Shapes that do not fit, too few nodes, costs out of range."""
    costs, before = bare(4)
    for wrong in ((costs[:3], before), (costs, before[:3]), (costs[:1, :1], before[:1, :1])):
        with pytest.raises(ValueError, match="n >= 2"):
            OrderingInstance(*wrong)
    for value in (-1.0, 2 * MOST):
        with pytest.raises(ValueError, match="Costs must be in"):
            OrderingInstance(np.where(np.eye(4, k=1) > 0, value, costs), before)


def test_costs_of_arcs_that_nobody_takes_may_be_anything():
    """Such as those back to the first node."""
    costs, before = bare(4)
    costs[:, 0] = costs[-1] = -5.0
    assert OrderingInstance(costs, before).n == 4


@settings(max_examples=20)
@given(instance=orderings(least=3, most=7))
def test_what_is_given_is_left_as_it_was(instance):
    """The instance has arrays of its own."""
    costs, before = instance.costs.copy(), instance.before.copy()
    costs[costs >= NO_ARC] = np.inf
    kept = costs.copy(), before.copy()
    OrderingInstance(costs, before)
    assert np.array_equal(costs, kept[0])
    assert np.array_equal(before, kept[1])


# Jobs as nodes and back.


@given(problem=random_problems())
def test_orders_of_jobs_are_orders_of_nodes_at_the_same_cost(problem):
    """All of them, there and back."""
    orders = JobOrders(problem)
    result = all_orders(orders.instance)
    assert result
    for cost, nodes in result:
        jobs = orders.jobs(np.array(nodes))
        assert sorted(jobs) == list(range(len(problem.jobs)))
        assert cost == pytest.approx(problem.cost(jobs), abs=1e-9)
        place = {job: position for position, job in enumerate(jobs)}
        assert all(place[i] < place[j] for i, j in problem.precedence)
        assert tuple(orders.nodes(jobs).tolist()) == nodes


def test_where_no_job_comes_last_an_end_that_costs_nothing_does():
    """With it there is one node more."""
    costs = [[math.inf, 2.0], [3.0, math.inf]]
    free = JobOrders(problem_of([1.0, 1.0], costs))
    tied = JobOrders(problem_of([1.0, 1.0], costs, {(1, 0)}))
    assert (free.instance.n, tied.instance.n) == (4, 3)
    assert [cost for cost, _ in all_orders(free.instance)] == [3.0, 4.0]
    assert [cost for cost, _ in all_orders(tied.instance)] == [4.0]
    assert tied.jobs(np.array([0, 1, 2])) == (1, 0)


def test_one_job_is_an_order():
    """It comes after all others, there being none."""
    orders = JobOrders(problem_of([7.0], [[math.inf]]))
    assert all_orders(orders.instance) == [(7.0, (0, 1))]


def test_what_cannot_follow_is_no_order():
    """Costs that are infinite stay so."""
    costs = [[math.inf, math.inf], [3.0, math.inf]]
    orders = JobOrders(problem_of([1.0, math.inf], costs))
    assert all_orders(orders.instance) == []


def test_a_circle_is_refused():
    """By the instance."""
    costs = [[math.inf, 2.0], [3.0, math.inf]]
    with pytest.raises(ValueError, match="cycle"):
        JobOrders(problem_of([1.0, 1.0], costs, {(0, 1), (1, 0)}))
