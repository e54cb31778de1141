"""Label setting: shortest paths from all states of a deterministic model to a goal, compiled.

States are settled in order of cost: breadth first if all steps cost the same, else by Dijkstra's
algorithm ("A note on two problems in connexion with graphs", 1959). It works on arrays alone and
supports lattices far larger than an enumerated model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.kernels import compiled

Integers = NDArray[np.int32]

# Sums are integers of a unit >= 1e-12, so the order of summation breaks no tie.
_FINEST = 1e-12
_LARGEST_SUM = 2.0**62


@dataclass(frozen=True, slots=True)
class CostsToGo:
    """The shortest path to the goal from every state: its cost, and its first row.

    Parameters
    ----------
    costs
        Least cost, infinite without a path, shape (n,).
    ties
        Least sum of tie weights among the shortest paths, shape (n,).
    chosen
        Row to take, the lowest among equals; -1 at goals and without a path, shape (n,).
    """

    costs: NDArray[np.float64]
    ties: NDArray[np.float64]
    chosen: NDArray[np.int32]


def compute_costs_to_go(
    rows: NDArray[Any],
    successors: NDArray[Any],
    goal: NDArray[np.bool_],
    costs: NDArray[np.float64] | None = None,
    ties: NDArray[np.float64] | None = None,
) -> CostsToGo:
    """Return the shortest paths to the nearest goal; ties go to the least tie weight.

    Time and memory grow linearly with the number of rows if all cost the same.

    Parameters
    ----------
    rows
        Rows of state i are ``rows[i]`` to ``rows[i + 1]``, shape (n + 1,).
    successors
        Successor of each row, -1 for none, shape (m,), m < 2 ** 31.
    goal
        True for goals, shape (n,); their rows are ignored.
    costs
        Cost of each row, >= 0, shape (m,); None for 1 each.
    ties
        Tie weight of each row, >= 0, shape (m,); None for no weights.

    Raises
    ------
    ValueError
        If an array has the wrong length, there are too many rows, or a cost is negative or not
        finite.
    """
    n, m = len(goal), len(successors)
    if len(rows) != n + 1 or rows[-1] != m:
        raise ValueError("The rows do not fit the states and successors.")
    if m >= 2**31:
        raise ValueError(f"There are {m:,} rows; at most {2**31 - 1:,} can be held.")
    for weights in (costs, ties):
        if weights is not None and (
            len(weights) != m or not np.isfinite(weights).all() or (weights < 0).any()
        ):
            raise ValueError("Every row needs a finite weight >= 0.")
    rows = np.ascontiguousarray(rows, dtype=np.int32)
    successors = np.ascontiguousarray(successors, dtype=np.int32)
    step = 1.0
    if costs is not None and m:
        step = float(costs[0])
    uniform = costs is None or (step > 0 and bool((costs == step).all()))
    cost_units, cost_unit = _convert_to_units(None if uniform else costs, n)
    tie_units, tie_unit = _convert_to_units(ties, n)
    settle = _search_breadth_first if uniform else _run_dijkstra
    cost_sums, tie_sums, chosen = settle(rows, successors, goal, cost_units, tie_units)
    away = cost_sums < 0
    return CostsToGo(
        np.where(away, np.inf, cost_sums * (step if uniform else cost_unit)),
        np.where(away, np.inf, tie_sums * tie_unit),
        chosen,
    )


def _convert_to_units(
    weights: NDArray[np.float64] | None, n: int
) -> tuple[NDArray[np.int64], float]:
    """Return weights as integers with room for n summands, and the unit."""
    if weights is None or not len(weights):
        return np.empty(0, dtype=np.int64), 0.0
    unit = max(_FINEST, float(weights.max()) * (n + 1) / _LARGEST_SUM)
    return np.rint(weights / unit).astype(np.int64), unit


@compiled
def _reverse_arcs(
    rows: Integers, successors: Integers, n: int
) -> tuple[Integers, Integers, Integers]:
    """Return the rows into each state, grouped by state, and the state of each row."""
    m = len(successors)
    begins = np.zeros(n + 2, dtype=np.int32)
    for row in range(m):
        if successors[row] >= 0:
            begins[successors[row] + 2] += 1
    for state in range(1, n + 1):
        begins[state + 1] += begins[state]
    into = np.empty(begins[n + 1], dtype=np.int32)
    owners = np.empty(m, dtype=np.int32)
    for state in range(n):
        for row in range(rows[state], rows[state + 1]):
            owners[row] = state
            following = successors[row]
            if following >= 0:
                into[begins[following + 1]] = row
                begins[following + 1] += 1
    return begins, into, owners


@compiled
def _search_breadth_first(
    rows: Integers,
    successors: Integers,
    goal: NDArray[np.bool_],
    costs: NDArray[np.int64],
    ties: NDArray[np.int64],
) -> tuple[NDArray[Any], NDArray[np.int64], Integers]:
    """Settle states by number of steps; `costs` is ignored.

    All states of one distance are settled before the first of the next, so a state's tie weight is
    final before it is passed on.
    """
    n = len(goal)
    begins, into, owners = _reverse_arcs(rows, successors, n)
    steps = np.full(n, -1, dtype=np.int32)
    sums = np.zeros(n if len(ties) else 0, dtype=np.int64)
    chosen = np.full(n, -1, dtype=np.int32)
    queue = np.empty(n, dtype=np.int32)
    end = 0
    for state in range(n):
        if goal[state]:
            steps[state] = 0
            queue[end] = state
            end += 1
    head = 0
    while head < end:
        following = queue[head]
        head += 1
        distance = steps[following] + 1
        for at in range(begins[following], begins[following + 1]):
            row = into[at]
            state = owners[row]
            if steps[state] < 0:
                steps[state] = distance
                queue[end] = state
                end += 1
            elif steps[state] != distance:
                continue
            if len(ties):
                total = ties[row] + sums[following]
                if chosen[state] >= 0 and total > sums[state]:
                    continue
                if chosen[state] < 0 or total < sums[state]:
                    sums[state] = total
                    chosen[state] = row
                    continue
            if chosen[state] < 0 or row < chosen[state]:
                chosen[state] = row
    if not len(ties):
        sums = np.zeros(n, dtype=np.int64)
    return steps, sums, chosen


@compiled
def _is_before(first: int, other: int, costs: NDArray[np.int64], ties: NDArray[np.int64]) -> bool:
    """Return True if heap entry `first` comes before `other`."""
    if costs[first] != costs[other]:
        return bool(costs[first] < costs[other])
    return bool(ties[first] < ties[other])


@compiled
def _run_dijkstra(
    rows: Integers,
    successors: Integers,
    goal: NDArray[np.bool_],
    costs: NDArray[np.int64],
    ties: NDArray[np.int64],
) -> tuple[NDArray[Any], NDArray[np.int64], Integers]:
    """Settle states by cost, then tie weight, from a binary heap of states.

    Only a settled state relaxes the cost of an unsettled one, so the chosen rows never form a
    cycle,
    even at zero cost.
    """
    n = len(goal)
    begins, into, owners = _reverse_arcs(rows, successors, n)
    cost = np.full(n, -1, dtype=np.int64)
    tie = np.zeros(n, dtype=np.int64)
    chosen = np.full(n, -1, dtype=np.int32)
    settled = np.zeros(n, dtype=np.bool_)
    heap = np.empty(n, dtype=np.int32)
    place = np.full(n, -1, dtype=np.int32)
    size = 0
    for state in range(n):
        if goal[state]:
            cost[state] = 0
            heap[size], place[state] = state, size
            size += 1
    while size:
        following = heap[0]
        settled[following] = True
        size -= 1
        if size:
            # The last entry sinks from the top.
            moved, at = heap[size], 0
            while True:
                child = 2 * at + 1
                if child >= size:
                    break
                if child + 1 < size and _is_before(heap[child + 1], heap[child], cost, tie):
                    child += 1
                if not _is_before(heap[child], moved, cost, tie):
                    break
                heap[at], place[heap[child]] = heap[child], at
                at = child
            heap[at], place[moved] = moved, at
        for index in range(begins[following], begins[following + 1]):
            row = into[index]
            state = owners[row]
            if settled[state]:
                continue
            total = costs[row] + cost[following]
            total_tie = tie[following]
            if len(ties):
                total_tie += ties[row]
            if cost[state] == total and tie[state] == total_tie:
                chosen[state] = min(chosen[state], row)
                continue
            if cost[state] >= 0 and (
                total > cost[state] or (total == cost[state] and total_tie > tie[state])
            ):
                continue
            cost[state], tie[state], chosen[state] = total, total_tie, row
            at = place[state]
            if at < 0:
                at = size
                size += 1
            while at and _is_before(state, heap[(at - 1) // 2], cost, tie):
                parent = heap[(at - 1) // 2]
                heap[at], place[parent] = parent, at
                at = (at - 1) // 2
            heap[at], place[state] = state, at
    return cost, tie, chosen
