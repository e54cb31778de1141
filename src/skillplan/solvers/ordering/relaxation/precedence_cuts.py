"""Precedence cuts and subtour elimination: separation by maximum flow, with lifting.

Balas, Fischetti and Pulleyblank, "The precedence-constrained asymmetric traveling salesman
polytope" (1995): where i comes before j, an order visits between them no predecessor of i and no
successor of j. So at least one arc leaves any set with i and without j, those nodes removed from
both sides. Separated as by Ascheuer, Juenger and Reinelt (2000).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]


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
