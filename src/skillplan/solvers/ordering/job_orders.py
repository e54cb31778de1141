"""Conversion between a sequencing problem and an ordering of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skillplan.model.sequencing import SequencingProblem
from skillplan.solvers.ordering.instance import (
    NO_FAMILY,
    Integers,
    OrderingInstance,
    closed_relation,
)


@dataclass(frozen=True)
class JobOrders:
    """Orders of jobs as orders of nodes: node 0 is the initial state, node j + 1 is job j.

    Where no job comes after all others, a node without cost is appended at the end.

    Parameters
    ----------
    problem
        Jobs, costs and precedence; at least one job.

    Attributes
    ----------
    instance
        The ordering of the nodes.

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
        last = _last(before)
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
        instance = OrderingInstance(costs, relation, _families(problem, nodes, n))
        object.__setattr__(self, "instance", instance)

    def jobs(self, order: Integers) -> tuple[int, ...]:
        """Return an order of nodes as an order of jobs."""
        known = len(self._nodes)
        return tuple(int(self._nodes[node - 1]) for node in order if 0 < node <= known)

    def nodes(self, order: Sequence[int]) -> Integers:
        """Return an order of all jobs as an order of nodes."""
        place = np.empty(len(self._nodes), dtype=np.int64)
        place[self._nodes] = np.arange(1, len(self._nodes) + 1)
        inner = place[np.asarray(order, dtype=np.int64)]
        end = [self.instance.n - 1] if len(inner) + 2 == self.instance.n else []
        return np.concatenate(([0], inner, end)).astype(np.int64)


def _families(problem: SequencingProblem, nodes: Integers, n: int) -> Integers | None:
    """Return the family of each of n nodes; None where nothing is done between any jobs.

    Jobs, and the initial state, are of one family where nothing has to be done between them, as
    where they need the same tool.
    """
    if not problem.paths:
        return None
    near = np.zeros((n, n), dtype=np.bool_)
    inner = slice(1, len(nodes) + 1)
    near[inner, inner] = np.isfinite(problem.costs[np.ix_(nodes, nodes)])
    near[0, inner] = np.isfinite(problem.first[nodes])
    place = {int(job): node for node, job in enumerate(nodes, start=1)} | {-1: 0}
    for one, other in problem.paths:
        near[place[one], place[other]] = False
    near |= near.T
    np.fill_diagonal(near, True)
    # The least node that a node is linked to names its family; an end that is no job has none.
    families: Integers = closed_relation(near).argmax(axis=1)
    families[len(nodes) + 1 :] = NO_FAMILY
    return families


def _last(before: np.ndarray[tuple[int, int], np.dtype[np.bool_]]) -> int | None:
    """Return the job that comes after all others, if there is one."""
    closed = closed_relation(before)
    found = np.nonzero(closed.sum(axis=0) == len(closed) - 1)[0]
    return int(found[0]) if len(found) else None
