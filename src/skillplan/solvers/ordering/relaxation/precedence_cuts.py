"""Precedence cuts and subtour elimination: separation by maximum flow, with lifting.

Balas, Fischetti and Pulleyblank, "The precedence-constrained asymmetric traveling salesman
polytope" (1995): if i comes before j, an order visits between them no predecessor of i and no
successor of j. So at least one arc leaves any set with i and without j, with those nodes removed
from both sides. Separated as by Ascheuer, Juenger and Reinelt (2000).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skillplan.solvers.kernels import compiled
from skillplan.solvers.ordering.instance import (
    NO_FAMILY,
    Booleans,
    Floats,
    Integers,
    OrderingInstance,
)

# Cuts that are nearly tight are included, as lifting may violate them.
_TIGHT = 1.3


@compiled
def _flow(
    source: int,
    sink: int,
    barred: Booleans,
    first: Integers,
    target: Integers,
    twin: Integers,
    left: Floats,
    reached: Integers,
    queue: Integers,
    stamp: int,
    enough: float,
) -> float:
    """Augment the flow from source to sink up to a limit (breadth first, Edmonds-Karp).

    `reached` holds the stamp of the last search.
    """
    total = 0.0
    while True:
        head, tail = 0, 1
        queue[0] = source
        reached[source] = stamp
        came = queue[len(reached) :]
        flow = False
        while head < tail and not flow:
            node = queue[head]
            head += 1
            for arc in range(first[node], first[node + 1]):
                other = target[arc]
                if left[arc] > 1e-9 and reached[other] != stamp and not barred[other]:
                    reached[other] = stamp
                    came[other] = arc
                    if other == sink:
                        flow = True
                        break
                    queue[tail] = other
                    tail += 1
        if not flow:
            return total
        amount = np.inf
        node = sink
        while node != source:
            arc = came[node]
            amount = min(amount, left[arc])
            node = target[twin[arc]]
        node = sink
        while node != source:
            arc = came[node]
            left[arc] -= amount
            left[twin[arc]] += amount
            node = target[twin[arc]]
        total += amount
        if total >= enough:
            return total
        stamp += 1


@compiled
def _network(
    nodes: int, tails: Integers, heads: Integers
) -> tuple[Integers, Integers, Integers, Integers]:
    """Return a network for `_flow` with reverse arcs, and the index of each arc in it."""
    m = len(tails)
    degree = np.zeros(nodes + 1, dtype=np.int64)
    for a in range(m):
        degree[tails[a] + 1] += 1
        degree[heads[a] + 1] += 1
    first = np.cumsum(degree)
    free = first[:nodes].copy()
    target = np.empty(2 * m, dtype=np.int64)
    twin = np.empty(2 * m, dtype=np.int64)
    place = np.empty(m, dtype=np.int64)
    for a in range(m):
        tail, other = free[tails[a]], free[heads[a]]
        free[tails[a]] += 1
        free[heads[a]] += 1
        target[tail], target[other] = heads[a], tails[a]
        twin[tail], twin[other] = other, tail
        place[a] = tail
    return first, target, twin, place


@compiled
def separate(
    tails: Integers,
    heads: Integers,
    values: Floats,
    before: Booleans,
    pairs: Integers,
    violation: float,
    most: int,
) -> tuple[Booleans, Booleans]:
    """Separate violated cuts: return sets with at least one arc from the first to the second.

    Parameters
    ----------
    tails, heads, values
        Arcs of the fractional order and their values in (0, 1], shape (m,).
    before
        The closed relation, shape (n, n).
    pairs
        Pairs of nodes to separate for, the first before the second, shape (p, 2).

    Returns
    -------
    tuple
        Sets to leave and to enter, shape (k, n) each.
    """
    n = len(before)
    m = len(tails)
    first, target, twin, place = _network(n, tails, heads)
    full = np.zeros(2 * m)
    full[place] = values
    leave = np.zeros((most, n), dtype=np.bool_)
    reach = np.zeros((most, n), dtype=np.bool_)
    barred = np.zeros(n, dtype=np.bool_)
    reached = np.zeros(n, dtype=np.int64)
    queue = np.zeros(2 * n + 1, dtype=np.int64)
    count = 0
    for p in range(len(pairs)):
        if count == most:
            break
        i, j = pairs[p, 0], pairs[p, 1]
        for node in range(n):
            barred[node] = before[node, i] or before[j, node]
        left = full.copy()
        reached[:] = 0
        flow = _flow(i, j, barred, first, target, twin, left, reached, queue, 1, _TIGHT)
        if flow >= _TIGHT:
            continue
        # The last search stamped the side of i highest.
        stamp = reached[i]
        side = reached == stamp
        _lift(side, barred, before, i, j)
        cut = 0.0
        for a in range(m):
            tail, head = tails[a], heads[a]
            if side[tail] and not side[head] and not barred[tail] and not barred[head]:
                cut += values[a]
        if cut > 1.0 - violation:
            continue
        for node in range(n):
            leave[count, node] = side[node] and not barred[node]
            reach[count, node] = not side[node] and not barred[node]
        count += 1
    return leave[:count], reach[:count]


@compiled
def _lift(side: Booleans, barred: Booleans, before: Booleans, i: int, j: int) -> None:
    """Lift a cut: bar predecessors and successors of other nodes that it separates as well."""
    n = len(before)
    sources = np.empty(n, dtype=np.int64)
    sinks = np.empty(n, dtype=np.int64)
    sources[0], sinks[0] = i, j
    many, several = 1, 1
    for node in range(n):
        if node in (i, j) or barred[node]:
            continue
        if side[node]:
            fits = True
            for k in range(several):
                if not before[node, sinks[k]]:
                    fits = False
                    break
            if fits:
                sources[many] = node
                many += 1
                for other in range(n):
                    if before[other, node]:
                        barred[other] = True
        else:
            fits = True
            for k in range(many):
                if not before[sources[k], node]:
                    fits = False
                    break
            if fits:
                sinks[several] = node
                several += 1
                for other in range(n):
                    if before[node, other]:
                        barred[other] = True


def select_pairs(before: Booleans) -> tuple[Integers, Integers]:
    """Return the pairs to separate for: with the first or the last node, and the others.

    Pairs with few nodes in between come first; shape (pairs, 2) both.
    """
    n = len(before)
    inner = np.arange(1, n - 1)
    core = np.concatenate(
        (
            np.stack((np.zeros_like(inner), inner), axis=1),
            np.stack((inner, np.full_like(inner, n - 1)), axis=1),
        )
    )
    rest = np.argwhere(before[1:-1, 1:-1]) + 1
    between = before.astype(np.float32) @ before.astype(np.float32)
    near = np.argsort(between[rest[:, 0], rest[:, 1]], kind="stable")
    return core, np.ascontiguousarray(rest[near])


@compiled
def separate_between(
    tails: Integers,
    heads: Integers,
    values: Floats,
    earlier: Floats,
    pairs: Integers,
    violation: float,
) -> tuple[Booleans, Booleans, Floats]:
    """Separate cuts between nodes with a fractional precedence.

    The fraction by which i comes before j has to flow from i to j. The flow through any other node
    is
    at most the fraction by which that node comes between.

    Parameters
    ----------
    tails, heads, values
        Arcs of the fractional order and their values in (0, 1], shape (m,).
    earlier
        Fraction by which one node comes before another, in [0, 1], shape (n, n).
    pairs
        Pairs of nodes to separate for, shape (p, 2).

    Returns
    -------
    tuple
        Entered and left nodes on the side of i, shape (p, n) each, and the violation of the cut, 0
        for
        none, shape (p,).
    """
    n = len(earlier)
    m = len(tails)
    # Every node is split into entry and exit; the flow through it lies in between.
    starts = np.concatenate((tails + n, np.arange(n)))
    ends = np.concatenate((heads, np.arange(n) + n))
    first, target, twin, place = _network(2 * n, starts, ends)
    full = np.zeros(2 * len(starts))
    barred = np.zeros(2 * n, dtype=np.bool_)
    reached = np.zeros(2 * n, dtype=np.int64)
    queue = np.zeros(4 * n + 1, dtype=np.int64)
    arrive = np.zeros((len(pairs), n), dtype=np.bool_)
    depart = np.zeros((len(pairs), n), dtype=np.bool_)
    violated = np.zeros(len(pairs))
    for p in range(len(pairs)):
        i, j = pairs[p, 0], pairs[p, 1]
        enough = earlier[i, j] - violation
        if enough <= 0.0:
            continue
        full[:] = 0.0
        full[place[:m]] = values
        for node in range(n):
            full[place[m + node]] = min(earlier[i, node], earlier[node, j])
        reached[:] = 0
        flow = _flow(i + n, j, barred, first, target, twin, full, reached, queue, 1, enough)
        if flow >= enough:
            continue
        side = reached == reached[i + n]
        arrive[p] = side[:n]
        depart[p] = side[n:]
        violated[p] = earlier[i, j] - flow
    return arrive, depart, violated


# Greatest number of sets in one count; above it, the count so far is the bound.
_MOST_SETS = 4_000


class SetUpCut(NamedTuple):
    """A lower bound on the number of some arcs in every order.

    Parameters
    ----------
    number
        Lower bound, >= 1.
    """

    arcs: Booleans
    number: int


def find_set_up_cuts(instance: OrderingInstance) -> list[SetUpCut]:
    """Return the cuts of all families, and of each family against the others together.

    An instance without families has no such cuts.
    """
    families = instance.families
    cuts: list[SetUpCut] = []
    if families is None:
        return cuts
    named = np.unique(families[families != NO_FAMILY])
    splits = [families]
    if len(named) > 2:
        splits += [
            np.where(families == NO_FAMILY, NO_FAMILY, families == family) for family in named
        ]
    for split in splits:
        number = count_changes(split, instance.before)
        if number:
            of_some = split != NO_FAMILY
            apart = split[:, None] != split
            cuts.append(SetUpCut(apart & of_some[:, None] & of_some, number))
    return cuts


def count_changes(families: Integers, before: Booleans) -> int:
    """Return a lower bound on the number of changes between families.

    It is the least number itself, unless too many sets of nodes would have to be enumerated.

    Parameters
    ----------
    families
        Family of every node, shape (n,); the last may have `NO_FAMILY`, and follows any.
    before
        True if node i must come before node j, shape (n, n).
    """
    nodes = range(len(families))
    needs = [sum(1 << int(i) for i in np.nonzero(before[:, j])[0]) for j in nodes]
    named = sorted({int(family) for family in families} - {NO_FAMILY})
    able = {own: [j for j in nodes if families[j] in (own, NO_FAMILY)] for own in named}
    full = (1 << len(families)) - 1
    first = int(families[0])
    layer = {first: [_extend_set(0, able[first], needs)]}
    changes = looked = 0
    while not any(done == full for sets in layer.values() for done in sets):
        following: dict[int, list[int]] = {}
        for own, sets in layer.items():
            for other in named:
                if other != own:
                    grown = [_extend_set(done, able[other], needs) for done in sets]
                    looked += len(grown)
                    following.setdefault(other, []).extend(grown)
        changes += 1
        if looked > _MOST_SETS:
            break
        layer = {own: _select_maximal(sets) for own, sets in following.items()}
    return changes


def _extend_set(done: int, able: list[int], needs: list[int]) -> int:
    """Return a set of nodes with all nodes that can follow without another change."""
    while True:
        more = done
        for node in able:
            if needs[node] & ~more == 0:
                more |= 1 << node
        if more == done:
            return done
        done = more


def _select_maximal(sets: list[int]) -> list[int]:
    """Return the maximal sets."""
    kept: list[int] = []
    for members in sorted(set(sets), key=int.bit_count, reverse=True):
        if not any(members & ~other == 0 for other in kept):
            kept.append(members)
    return kept


@compiled
def _add(before: Booleans, first: int, other: int) -> bool:
    """Add a pair to a closed relation and close it again; return True if it has no cycle."""
    n = len(before)
    for i in range(n):
        if i != first and not before[i, first]:
            continue
        for j in range(n):
            if j == other or before[other, j]:
                if i == j or before[j, i]:
                    return False
                before[i, j] = True
    return True


@compiled
def _join(before: Booleans, i: int, j: int) -> int:
    """Let j come right after i; return 1 for added pairs, 0 for none, -1 for a cycle."""
    n = len(before)
    added = 0
    if not before[i, j]:
        if not _add(before, i, j):
            return -1
        added = 1
    for k in range(n):
        if k != i and before[k, j] and not before[k, i]:
            if not _add(before, k, i):
                return -1
            added = 1
        if k != j and before[i, k] and not before[j, k]:
            if not _add(before, j, k):
                return -1
            added = 1
    return added


@compiled
def propagate(arcs: Booleans, before: Booleans) -> bool:
    """Remove arcs that no order of the remaining arcs takes, in place.

    Parameters
    ----------
    arcs
        Arcs, shape (n, n); changed in place.
    before
        The closed relation, shape (n, n); changed in place.

    Returns
    -------
    bool
        False if no order is left.
    """
    n = len(arcs)
    changed = True
    while changed:
        changed = False
        for i in range(n - 1):
            choices, only = 0, -1
            for j in range(n):
                if arcs[i, j]:
                    choices += 1
                    only = j
            if choices == 0:
                return False
            if choices == 1:
                joined = _join(before, i, only)
                if joined < 0:
                    return False
                changed = changed or joined > 0
        for j in range(1, n):
            choices, only = 0, -1
            for i in range(n):
                if arcs[i, j]:
                    choices += 1
                    only = i
            if choices == 0:
                return False
            if choices == 1:
                joined = _join(before, only, j)
                if joined < 0:
                    return False
                changed = changed or joined > 0
        for i in range(n - 1):
            for j in range(1, n):
                if not arcs[i, j]:
                    continue
                gone = before[j, i]
                if not gone and before[i, j]:
                    for k in range(n):
                        if before[i, k] and before[k, j]:
                            gone = True
                            break
                if gone:
                    arcs[i, j] = False
                    changed = True
    return True
