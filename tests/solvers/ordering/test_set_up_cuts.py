"""Cuts of set-ups: how often an order has to go from one family of nodes to another."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from ordering_instances import all_orders, arcs_of, instance_of
from skillplan.model import SequencingProblem
from skillplan.solvers.ordering import (
    NO_ARC,
    CutRelaxation,
    JobOrders,
    OrderingInstance,
    PairRelaxation,
    count_changes,
    find_set_up_cuts,
    tighten,
)
from skillplan.solvers.ordering.relaxation import precedence_cuts as counted


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
    assert count_changes(instance.families, instance.before) == minimum


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
    for cut in find_set_up_cuts(instance):
        for _, order in all_orders(instance):
            assert cut.arcs[arcs_of(order)].sum() >= cut.number


def test_an_instance_without_families_has_no_cut():
    instance = instance_of(6, 0)
    assert find_set_up_cuts(instance) == []


def test_where_too_many_sets_would_be_looked_at_the_count_so_far_is_the_bound(monkeypatch):
    """A lower one, which is still a bound."""
    instance = instance_of(9, 1, density=0.5, families=4)
    whole = count_changes(instance.families, instance.before)
    monkeypatch.setattr(counted, "_MOST_SETS", 2)
    assert 0 < count_changes(instance.families, instance.before) < whole


def test_relaxations_prove_more_with_families_than_without():
    """Both that over arcs and that over pairs, which begins with the cuts of the first."""
    with_families = instance_of(20, 3, density=0.1, families=3)
    costs = np.where(with_families.costs >= NO_ARC, np.inf, with_families.costs)
    without = OrderingInstance(costs, with_families.before)
    bounds = []
    for instance in (without, with_families):
        relaxation = CutRelaxation(instance, instance.costs < NO_ARC)
        arcs = tighten(relaxation, np.inf, lambda: False, lambda duals: None)
        pairs = PairRelaxation(relaxation)
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
    instance = JobOrders(two_tools).instance
    assert (instance.families == [0, 0, 2, 0, 2]).all()
    assert count_changes(instance.families, instance.before) == 3


def test_where_nothing_is_done_between_jobs_there_are_no_families(two_tools):
    assert JobOrders(replace(two_tools, paths={})).instance.families is None
