"""Precedence cuts and subtour elimination: separation by maximum flow, with lifting.

Balas, Fischetti and Pulleyblank, "The precedence-constrained asymmetric traveling salesman
polytope" (1995): where i comes before j, an order visits between them no predecessor of i and no
successor of j. So at least one arc leaves any set with i and without j, those nodes removed from
both sides. Separated as by Ascheuer, Juenger and Reinelt (2000).
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

# Cuts that are nearly tight are considered, too: once lifted they may be violated.
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
    """Augment the flow from source to sink until it is enough (breadth first, Edmonds-Karp).

    `reached` holds the stamp of the last search.
    """
    total = 0.0
    while True:
        head, tail = 0, 1
        queue[0] = source
        reached[source] = stamp
        came = queue[len(reached) :]
        found = False
        while head < tail and not found:
            node = queue[head]
            head += 1
            for arc in range(first[node], first[node + 1]):
                other = target[arc]
                if left[arc] > 1e-9 and reached[other] != stamp and not barred[other]:
                    reached[other] = stamp
                    came[other] = arc
                    if other == sink:
                        found = True
                        break
                    queue[tail] = other
                    tail += 1
        if not found:
            return total
        least = np.inf
        node = sink
        while node != source:
            arc = came[node]
            least = min(least, left[arc])
            node = target[twin[arc]]
        node = sink
        while node != source:
            arc = came[node]
            left[arc] -= least
            left[twin[arc]] += least
            node = target[twin[arc]]
        total += least
        if total >= enough:
            return total
        stamp += 1


@compiled
def _network(
    nodes: int, tails: Integers, heads: Integers
) -> tuple[Integers, Integers, Integers, Integers]:
    """Return a network for `_flow`, with reverse arcs, and the index of each arc in it."""
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
        one, other = free[tails[a]], free[heads[a]]
        free[tails[a]] += 1
        free[heads[a]] += 1
        target[one], target[other] = heads[a], tails[a]
        twin[one], twin[other] = other, one
        place[a] = one
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
    """Separate violated cuts: return sets between which at least one arc must go.

    Parameters
    ----------
    tails, heads, values
        The arcs of the fractional order and how much of each is taken, in (0, 1], shape (m,).
    before
        The closed relation, shape (n, n).
    pairs
        Pairs of nodes to separate for, the first before the second, shape (p, 2).
    violation
        Least violation of a cut.
    most
        How many cuts at most.

    Returns
    -------
    tuple
        Sets to leave and to reach, shape (k, n) each.
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
            one, other = tails[a], heads[a]
            if side[one] and not side[other] and not barred[one] and not barred[other]:
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
    """Lift a cut: bar the predecessors and successors of further nodes between which it holds."""
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


def pairs_of(before: Booleans) -> tuple[Integers, Integers]:
    """Return the pairs to separate for: with the first or the last node, and the others.

    The others with few nodes in between come first; shape (pairs, 2) both.
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
    """Separate cuts between nodes of which one precedes the other only fractionally.

    As much as i comes before j has to flow from i to j, and through any other node no more than
    this node comes between the two.

    Parameters
    ----------
    tails, heads, values
        The arcs of the fractional order and how much of each is taken, in (0, 1], shape (m,).
    earlier
        Fraction by which one node comes before another, in [0, 1], shape (n, n).
    pairs
        Pairs of nodes to separate for, shape (p, 2).
    violation
        Least violation of a cut.

    Returns
    -------
    tuple
        The nodes that are reached and those that are left on the side of i, shape (p, n) each,
        and the violation of the cut, 0 where there is none, shape (p,).
    """
    n = len(earlier)
    m = len(tails)
    # Every node twice, where it is reached and where it is left; what flows through lies between.
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


# Sets looked at for one count; where there are more, the count so far is the bound.
_MOST_SETS = 4_000


class SetUpCut(NamedTuple):
    """Every order takes at least so many of some arcs.

    Parameters
    ----------
    arcs
        Shape (n, n).
    least
        At least 1.
    """

    arcs: Booleans
    least: int


def set_up_cuts(instance: OrderingInstance) -> list[SetUpCut]:
    """Return the cuts of all families, and of each against all others together.

    An instance without families has none.
    """
    families = instance.families
    found: list[SetUpCut] = []
    if families is None:
        return found
    named = np.unique(families[families != NO_FAMILY])
    splits = [families]
    if len(named) > 2:
        splits += [np.where(families == NO_FAMILY, NO_FAMILY, families == one) for one in named]
    for split in splits:
        least = least_changes(split, instance.before)
        if least:
            of_some = split != NO_FAMILY
            apart = split[:, None] != split
            found.append(SetUpCut(apart & of_some[:, None] & of_some, least))
    return found


def least_changes(families: Integers, before: Booleans) -> int:
    """Return a lower bound on how often an order goes from one family to another.

    It is the least number itself, unless very many sets of nodes would have to be looked at.

    Parameters
    ----------
    families
        Of every node, shape (n,); the last may have `NO_FAMILY`, and follows any.
    before
        True if node i must come before node j, shape (n, n).
    """
    nodes = range(len(families))
    needs = [sum(1 << int(i) for i in np.nonzero(before[:, j])[0]) for j in nodes]
    named = sorted({int(family) for family in families} - {NO_FAMILY})
    able = {one: [j for j in nodes if families[j] in (one, NO_FAMILY)] for one in named}
    full = (1 << len(families)) - 1
    first = int(families[0])
    layer = {first: [_all_done(0, able[first], needs)]}
    changes = looked = 0
    while not any(done == full for sets in layer.values() for done in sets):
        following: dict[int, list[int]] = {}
        for one, sets in layer.items():
            for other in named:
                if other != one:
                    grown = [_all_done(done, able[other], needs) for done in sets]
                    looked += len(grown)
                    following.setdefault(other, []).extend(grown)
        changes += 1
        if looked > _MOST_SETS:
            break
        layer = {one: _largest(sets) for one, sets in following.items()}
    return changes


def _all_done(done: int, able: list[int], needs: list[int]) -> int:
    """Return a set of nodes with all that can be done after it without another change."""
    while True:
        more = done
        for node in able:
            if needs[node] & ~more == 0:
                more |= 1 << node
        if more == done:
            return done
        done = more


def _largest(sets: list[int]) -> list[int]:
    """Return the sets that lie in no other."""
    kept: list[int] = []
    for one in sorted(set(sets), key=int.bit_count, reverse=True):
        if not any(one & ~other == 0 for other in kept):
            kept.append(one)
    return kept


@compiled
def _add(before: Booleans, one: int, other: int) -> bool:
    """Add a pair to a closed relation and close it again; return whether it has no cycle."""
    n = len(before)
    for i in range(n):
        if i != one and not before[i, one]:
            continue
        for j in range(n):
            if j == other or before[other, j]:
                if i == j or before[j, i]:
                    return False
                before[i, j] = True
    return True


@compiled
def _join(before: Booleans, i: int, j: int) -> int:
    """Let j come right after i; return 1 where pairs were added, 0 where not, -1 for a cycle."""
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
        The arcs, shape (n, n); changed in place.
    before
        The closed relation, shape (n, n); changed in place.

    Returns
    -------
    bool
        False where no order is left.
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
