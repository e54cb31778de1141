"""Set-up cuts: how often every order has to go from one family of nodes to another.

Jobs with one tool are a family. Precedence makes an order come back to a family that it has left
before; a linear relaxation comes back with a fraction of a tool only, and pays a fraction. The
least number of changes is found exactly: after a given sequence of families it is best to have
done all jobs that this sequence allows, so that a breadth-first search over such sets counts the
changes. It is a bound on the sum of the arcs between families.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from skillplan.solvers.ordering.instance import NO_FAMILY, Booleans, Integers, OrderingInstance

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
        Whether node i must come before node j, shape (n, n).
    """
    nodes = range(len(families))
    needs = [sum(1 << int(i) for i in np.nonzero(before[:, j])[0]) for j in nodes]
    named = sorted({int(one) for one in families} - {NO_FAMILY})
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
