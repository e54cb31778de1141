"""Small orderings drawn at random, and what enumeration says of them."""

from __future__ import annotations

import itertools
import math
import random

import numpy as np
from hypothesis import strategies as st

from skillplan.solvers.ordering import NO_FAMILY, OrderingInstance

KINDS = ("whole", "real", "few", "zero", "even", "large", "spread")
"""How costs are drawn: whole numbers, real ones, three values (ties), none, a step of 6, about a
thousand million, and far apart."""


def cost_of(kind, rng):
    """Return one cost of a kind."""
    return float(
        {
            "whole": lambda: rng.randrange(100),
            "real": lambda: rng.uniform(0, 2),
            "few": lambda: rng.choice([0, 1, 1, 2]),
            "zero": lambda: 0,
            "even": lambda: 4 + 6 * rng.randrange(8),
            "large": lambda: 10**9 + rng.randrange(10**9),
            "spread": lambda: rng.choice([rng.uniform(0, 1), rng.uniform(0, 1), 1e6]),
        }[kind]()
    )


def instance_of(n, seed, *, kind="whole", forbidden=0.0, density=0.2, families=0):
    """Return a random instance of n nodes; the inner ones are numbered in no feasible order.

    Parameters
    ----------
    n
        Number of nodes, >= 2.
    seed
        Of the draw.
    kind
        How costs are drawn, one of `KINDS`.
    forbidden
        The share of arcs that nobody can take.
    density
        The share of pairs of inner nodes that are ordered, before closing the relation.
    families
        How many there are, to go between which costs 50 more; the last node may be of none. 0
        where all nodes are alike.
    """
    rng = random.Random(f"{n} {seed} {kind} {forbidden} {density}")
    costs = np.array(
        [
            [math.inf if rng.random() < forbidden else cost_of(kind, rng) for _ in range(n)]
            for _ in range(n)
        ]
    )
    inner = rng.sample(range(1, n - 1), n - 2)
    before = np.zeros((n, n), dtype=np.bool_)
    for first, other in itertools.combinations(inner, 2):
        before[first, other] = rng.random() < density
    if not families:
        return OrderingInstance(costs, before)
    of = np.array([rng.randrange(families) for _ in range(n)])
    if rng.random() < 0.5:
        of[-1] = NO_FAMILY
    some = of != NO_FAMILY
    costs[(of[:, None] != of) & some[:, None] & some] += 50.0
    return OrderingInstance(costs, before, of)


@st.composite
def orderings(draw, least=2, most=9, kinds=KINDS):
    """Draw an instance, which may have no order at all."""
    return instance_of(
        draw(st.integers(least, most)),
        draw(st.integers(0, 2**32)),
        kind=draw(st.sampled_from(kinds)),
        forbidden=draw(st.sampled_from([0.0, 0.0, 0.1, 0.3, 0.6])),
        density=draw(st.sampled_from([0.0, 0.1, 0.3, 0.6])),
        families=draw(st.sampled_from([0, 0, 2, 3])),
    )


def all_orders(instance):
    """Return every feasible order with its cost, costliest last: permutations, one by one."""
    n = instance.n
    pairs = np.argwhere(instance.before)
    results = []
    for inner in itertools.permutations(range(1, n - 1)):
        order = np.array((0, *inner, n - 1))
        place = np.empty(n, dtype=np.int64)
        place[order] = np.arange(n)
        if (place[pairs[:, 0]] < place[pairs[:, 1]]).all():
            cost = math.fsum(instance.costs[order[:-1], order[1:]])
            if cost < 1e15:
                results.append((cost, tuple(int(node) for node in order)))
    return sorted(results)


def least_cost(instance):
    """Return the least cost of an order, inf where there is none: by the sets already visited."""
    n = instance.n
    needed = [sum(1 << int(i) for i in np.nonzero(instance.before[:, j])[0]) for j in range(n)]
    layer = {(1, 0): 0.0}
    for _ in range(n - 1):
        following = {}
        for (done, last), cost in layer.items():
            for node in range(1, n):
                arc = instance.costs[last, node]
                if done >> node & 1 or needed[node] & ~done or arc >= 1e15:
                    continue
                key = (done | 1 << node, node)
                if cost + arc < following.get(key, math.inf):
                    following[key] = cost + arc
        layer = following
    return min(layer.values(), default=math.inf)


def arcs_of(order):
    """Return the tails and the heads of the arcs of an order."""
    nodes = np.asarray(order)
    return nodes[:-1], nodes[1:]


class StopAfter:
    """Says stop from the k-th question on."""

    def __init__(self, polls):
        self.polls = polls

    def __call__(self):
        self.polls -= 1
        return self.polls < 0
