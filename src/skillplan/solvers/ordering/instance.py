"""The sequential ordering problem as arrays for compiled solvers.

Escudero (1988): the cheapest path from the first node through all others to the last that respects
a precedence relation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan.model.sequencing import SequencingProblem

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

# Cost of a forbidden arc, and greatest cost of an arc.
NO_ARC = 1e15
MOST = 2.0**40
# Family of the last node if it has none.
NO_FAMILY = -1
# Integers up to this sum remain distinct despite the rounding errors of bounds.
_EXACT = 1e9


@dataclass(frozen=True)
class OrderingInstance:
    """Nodes 0 to n - 1 to be ordered, from 0 to n - 1.

    Parameters
    ----------
    costs
        Cost from node i to node j, shape (n, n), in [0, `MOST`]; inf for a forbidden arc. The
        diagonal
        is ignored.
    before
        True if node i must come before node j, shape (n, n); its transitive closure is computed.
    families
        Family of every node, shape (n,), such as the tool of its job; the last may have
        `NO_FAMILY`.
        None if there is one family. Families do not affect orders; they improve bounds if changes
        between them are expensive.

    Attributes
    ----------
    costs
        Costs with `NO_ARC` for every arc that no order can take.
    before
        The transitive closure, with node 0 before all and node n - 1 after all.
    step, offset
        Every order costs `offset` plus a multiple of `step`; the step is 0 if costs are not
        integers,
        or very large.

    Raises
    ------
    ValueError
        If the shapes do not fit, there are fewer than two nodes, a cost is out of range, the
        relation
        has a cycle, or a node but the last has no family.
    """

    costs: Floats
    before: Booleans
    families: Integers | None = None
    step: float = field(init=False)
    offset: float = field(init=False)

    def __post_init__(self) -> None:
        n = len(self.costs)
        if n < 2 or self.costs.shape != (n, n) or self.before.shape != (n, n):
            raise ValueError(f"An ordering of n = {n} nodes needs n >= 2 and (n, n) arrays.")
        if self.families is not None:
            alone = self.families[:-1] == NO_FAMILY
            if self.families.shape != (n,) or alone.any():
                raise ValueError("Every node but the last needs a family.")
        before = self.before.copy()
        before[0, 1:] = before[:-1, n - 1] = True
        before = close_relation(before)
        if before.diagonal().any():
            raise ValueError("The precedence relation has a cycle.")
        arcs = _find_arcs(before) & (self.costs < np.inf)
        used = self.costs[arcs]
        if used.size and not (used.min() >= 0 and used.max() <= MOST):
            raise ValueError(f"Costs must be in [0, {MOST:g}].")
        costs = np.where(arcs, self.costs, NO_ARC)
        object.__setattr__(self, "before", before)
        object.__setattr__(self, "costs", np.ascontiguousarray(costs, dtype=np.float64))
        step, offset = _find_lattice(self.costs)
        object.__setattr__(self, "step", step)
        object.__setattr__(self, "offset", offset)

    @property
    def n(self) -> int:
        """Number of nodes."""
        return len(self.costs)

    def cost(self, order: Integers) -> float:
        """Return the cost of an order of all nodes."""
        return float(self.costs[order[:-1], order[1:]].sum())

    def feasible(self, order: Integers) -> bool:
        """Return True if an order contains every node once and respects precedence."""
        if sorted(order.tolist()) != list(range(self.n)):
            return False
        ranked = self.before[np.ix_(order, order)]
        return not np.tril(ranked).any() and self.cost(order) < NO_ARC

    def rounded_up(self, bound: float) -> float:
        """Return the least possible cost of an order at or above a bound.

        A tolerance covers the rounding errors of bounds.
        """
        if not self.step:
            return bound
        steps = np.ceil((bound - self.offset) / self.step - 1e-6)
        return float(self.offset + max(0.0, steps) * self.step)

    def cutoff(self, cost: float) -> float:
        """Return the bound at which no order is cheaper than this cost."""
        if cost == np.inf:
            return cost
        if not self.step:
            return cost - 1e-10 * max(1.0, abs(cost))
        return cost - self.step * (1 - 1e-5)


def close_relation(before: Booleans) -> Booleans:
    """Return the transitive closure of a relation, shape (n, n)."""
    closed = before.copy()
    for via in range(len(closed)):
        closed[closed[:, via]] |= closed[via]
    return closed


def _find_arcs(before: Booleans) -> Booleans:
    """Return the arcs that an order may take: none against precedence, none that skips a node."""
    count = before.astype(np.float32)
    between = (count @ count) > 0.5
    arcs: Booleans = ~before.T & ~(before & between)
    arcs[:, 0] = arcs[-1, :] = False
    np.fill_diagonal(arcs, False)
    return arcs


def _find_lattice(costs: Floats) -> tuple[float, float]:
    """Return the step and the offset of the costs of orders."""
    left = costs[:-1, 1:]
    used = left < NO_ARC
    whole = (left[used] == np.rint(left[used])).all()
    if not whole or len(costs) * left[used].max(initial=0.0) > _EXACT:
        return 0.0, 0.0
    rows = np.where(used, left, MOST).min(axis=1)
    left = left - rows[:, None]
    columns = np.where(used, left, MOST).min(axis=0)
    left = (left - columns)[used].astype(np.int64)
    step = float(np.gcd.reduce(left)) if left.size else 0.0
    return (step, float(rows.sum() + columns.sum())) if step else (1.0, 0.0)


@dataclass(frozen=True)
class JobOrders:
    """Conversion between orders of jobs and of nodes: node 0 is the start, node j + 1 is job j.

    If no job comes after all others, a final node without cost is appended.

    Parameters
    ----------
    problem
        Jobs, costs and precedence; at least one job.

    Attributes
    ----------
    instance
        Ordering of the nodes.

    Raises
    ------
    ValueError
        If there is no job, a cost is too large, or the precedence has a cycle.
    """

    problem: SequencingProblem
    instance: OrderingInstance = field(init=False)
    _nodes: Integers = field(init=False, repr=False)

    def __post_init__(self) -> None:
        problem = self.problem
        jobs = len(problem.jobs)
        before = np.zeros((jobs, jobs), dtype=np.bool_)
        if problem.precedence:
            pairs = np.array(sorted(problem.precedence))
            before[pairs[:, 0], pairs[:, 1]] = True
        last = _find_last(before)
        nodes = np.array([job for job in range(jobs) if job != last], dtype=np.int64)
        if last is not None:
            nodes = np.append(nodes, last)
        inner = len(nodes)
        n = inner + 1 + (last is None)
        costs = np.full((n, n), np.inf)
        costs[0, 1 : inner + 1] = problem.first[nodes]
        costs[1 : inner + 1, 1 : inner + 1] = problem.costs[np.ix_(nodes, nodes)]
        if last is None:
            costs[1 : inner + 1, n - 1] = 0.0
        relation = np.zeros((n, n), dtype=np.bool_)
        relation[1 : inner + 1, 1 : inner + 1] = before[np.ix_(nodes, nodes)]
        object.__setattr__(self, "_nodes", nodes)
        instance = OrderingInstance(costs, relation, _find_families(problem, nodes, n))
        object.__setattr__(self, "instance", instance)

    def jobs(self, order: Integers) -> tuple[int, ...]:
        """Convert an order of nodes to an order of jobs."""
        known = len(self._nodes)
        return tuple(int(self._nodes[node - 1]) for node in order if 0 < node <= known)

    def nodes(self, order: Sequence[int]) -> Integers:
        """Convert an order of all jobs to an order of nodes."""
        place = np.empty(len(self._nodes), dtype=np.int64)
        place[self._nodes] = np.arange(1, len(self._nodes) + 1)
        inner = place[np.asarray(order, dtype=np.int64)]
        end = [self.instance.n - 1] if len(inner) + 2 == self.instance.n else []
        return np.concatenate(([0], inner, end)).astype(np.int64)


def _find_families(problem: SequencingProblem, nodes: Integers, n: int) -> Integers | None:
    """Return the family of each of n nodes; None if no pair of jobs needs a set-up.

    Jobs, and the initial state, are of one family if they need no set-up between them, for example
    because they need the same tool.
    """
    if not problem.paths:
        return None
    near = np.zeros((n, n), dtype=np.bool_)
    inner = slice(1, len(nodes) + 1)
    near[inner, inner] = np.isfinite(problem.costs[np.ix_(nodes, nodes)])
    near[0, inner] = np.isfinite(problem.first[nodes])
    place = {int(job): node for node, job in enumerate(nodes, start=1)} | {-1: 0}
    for linked, other in problem.paths:
        near[place[linked], place[other]] = False
    near |= near.T
    np.fill_diagonal(near, True)
    # The lowest linked node names the family; a final node without job has none.
    families: Integers = close_relation(near).argmax(axis=1)
    families[len(nodes) + 1 :] = NO_FAMILY
    return families


def _find_last(before: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> int | None:
    """Return the job that comes after all others, if one exists."""
    closed = close_relation(before)
    last_jobs = np.nonzero(closed.sum(axis=0) == len(closed) - 1)[0]
    return int(last_jobs[0]) if len(last_jobs) else None
