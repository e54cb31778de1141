"""AND/OR precedence, sub-assemblies and locks follow from what blocks what."""

from __future__ import annotations

import pytest

import skillplan_cad as cad
from cad_fixtures import of_fixture, pen, relation_by_hand

# Two links of a chain in a box without a lid, and a lid on it.
CHAIN = {
    "+x": {"box": "a b", "a": "b box", "b": "a box"},
    "+y": {"box": "a b", "a": "b box", "b": "a box"},
    "+z": {"box": "a b lid", "a": "b lid", "b": "a lid"},
}


def count_orders(precedence, may_stand=lambda parts: True):
    """Return the number of orders in which parts can be added one at a time."""
    counts = {precedence.everything: 1}
    for _ in range(len(precedence.names) - 1):
        smaller = {}
        for present, count in counts.items():
            for part in cad.list_members(present):
                left = present & ~(1 << part)
                if precedence.is_free(part, present) and may_stand(left):
                    smaller[left] = smaller.get(left, 0) + count
        counts = smaller
    return sum(counts.values())


def test_the_pen_comes_together_in_114_orders_of_which_22_stay_connected():
    relation = pen()
    precedence, touches = cad.derive_precedence(relation), cad.find_touching(relation)
    assert count_orders(precedence) == 114
    assert count_orders(precedence, lambda parts: cad.is_connected(parts, touches)) == 22


def test_a_part_goes_where_all_that_blocks_it_that_way_is_absent():
    precedence = cad.derive_precedence(pen())
    body, button = 4, 5
    assert not precedence.is_free(body, precedence.everything)
    assert precedence.list_free_directions(body, cad.encode_set([body, button])) == (1,)
    assert precedence.list_free_directions(button, precedence.everything) == (0,)


def test_minimal_alternatives_ask_for_nothing_that_another_does_without():
    precedence = cad.derive_precedence(pen())
    for part in range(len(precedence.names)):
        minimal = precedence.list_minimal(part)
        assert minimal
        for item in minimal:
            subsets = [o for o in precedence.alternatives[part] if not o.blockers & ~item.blockers]
            assert [o.blockers for o in subsets] == [item.blockers]


@pytest.mark.parametrize(
    "name", ["bracket", "mirrored", "nested", "dovetail", "eight", "fastened", "threads"]
)
def test_fixtures_that_come_apart_leave_no_core(name):
    precedence = cad.derive_precedence(of_fixture(name))
    assert precedence.find_core().bit_count() == 1


def test_a_group_that_only_moves_as_one_is_a_subassembly():
    relation = relation_by_hand(["box", "a", "b", "lid"], CHAIN)
    precedence = cad.derive_precedence(relation)
    groups = cad.find_groups(relation, precedence, fixed=1)
    assert cad.list_names(groups.core, precedence) == ("box", "a", "b")
    assert [cad.list_names(subassembly, precedence) for subassembly in groups.subassemblies] == [
        ("a", "b")
    ]
    assert relation.directions[groups.splits[0].direction] == (0.0, 0.0, 1.0)


def is_locked(lock, relation):
    """Return whether rounds of a lock are closed walks along blockings through all its parts."""
    parts, matrix = set(cad.list_members(lock.parts)), relation.matrix
    return len(lock.rounds) == len(relation.directions) and all(
        set(walk) == parts
        and all(matrix[n, part, by] for part, by in zip(walk, (*walk[1:], walk[0]), strict=True))
        for n, walk in enumerate(lock.rounds)
    )


def test_what_is_locked_comes_with_a_proof_that_can_be_checked():
    relation = relation_by_hand(["box", "a", "b", "lid"], CHAIN)
    (lock,) = cad.find_groups(relation, cad.derive_precedence(relation), fixed=1).locks
    assert cad.list_names(lock.parts, cad.derive_precedence(relation)) == ("a", "b")
    assert is_locked(lock, relation)
    assert not is_locked(lock, pen())


@pytest.mark.parametrize("name", ["l_slot", "bayonet", "interlocked"])
def test_pairs_that_no_straight_move_takes_apart_are_locked(name):
    relation = of_fixture(name)
    (lock,) = cad.find_groups(relation, cad.derive_precedence(relation)).locks
    assert list(cad.list_members(lock.parts)) == [0, 1]
    assert is_locked(lock, relation)


def test_a_pair_past_which_a_path_was_found_locks_nothing():
    relation = of_fixture("l_slot")
    waived = frozenset({("key", "body"), ("body", "key")})
    assert cad.derive_precedence(relation, waived).find_core().bit_count() == 1
