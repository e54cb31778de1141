"""Partial orders at random: of just as many pairs as wanted, each within all larger ones."""

from __future__ import annotations

import random
from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.chart import closure, cycle, reduction
from skillplan.domains.assembly import RandomOrder

COUNTS = st.integers(0, 12)


def covers(count: int, pairs: int, seed: int = 0) -> set[tuple[str, str]]:
    """Return what comes right before what."""
    order = RandomOrder(count, random.Random(seed).random, pairs)
    return {(str(a), str(b)) for a, after in order.covers().items() for b in after}


@given(count=COUNTS, share=st.floats(0, 1), seed=st.integers(0, 2**64))
def test_the_closure_holds_just_as_many_pairs(count, share, seed):
    """Any number from none to all, without a cycle, and nothing is said twice."""
    pairs = round(share * count * (count - 1) / 2)
    right_after = covers(count, pairs, seed)
    assert pairs == len(closure(right_after))
    assert () == cycle(right_after)
    assert right_after == reduction(right_after)


@given(count=st.integers(2, 9), seed=st.integers(0, 2**64))
def test_every_order_is_part_of_every_larger_one(count, seed):
    """From no pair to all, one more at a time."""
    most = count * (count - 1) // 2
    orders = [closure(covers(count, pairs, seed)) for pairs in range(most + 1)]
    assert all(smaller < larger for smaller, larger in pairwise(orders))


def test_any_two_elements_may_come_either_way_round():
    """No element is before another by its number; chains come up, and so do elements without."""
    drawn = [closure(covers(6, 5, seed)) for seed in range(200)]
    both_ways = {(str(a), str(b)) for a, b in combinations(range(6), 2)}
    both_ways |= {(b, a) for a, b in both_ways}
    assert both_ways == set().union(*drawn)
    heights = {1 + max(map(len, _chains(pairs))) for pairs in drawn}
    assert {2, 3} <= heights
    assert len({frozenset(pairs) for pairs in drawn}) > 190


def _chains(pairs: set[tuple[str, str]]) -> list[set[str]]:
    """Return, of every element that something follows, what is before it and itself."""
    return [{b for b, c in pairs if c == a} | {a} for a, _ in pairs]


@pytest.mark.parametrize(("count", "pairs"), [(0, 1), (3, 4), (3, -1)])
def test_more_pairs_than_there_are_is_an_error(count, pairs):
    """And so are fewer than none."""
    with pytest.raises(ValueError, match=f"{count} elements have from 0 to"):
        RandomOrder(count, random.random, pairs)
