"""Which nodes come before which: closed under transitivity, and reduced to what says it all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from skillplan.domains.sop.schema import BEFORE


class NodeOrder:
    """The precedence relation of a square matrix with entries `BEFORE`.

    Node 0 comes before all others, whether their rows say so or not. Sets of nodes are whole
    numbers of which bit i stands for node i.

    Parameters
    ----------
    costs
        Shape (n, n); the diagonal does not count.

    Attributes
    ----------
    direct
        By node, those that its row puts before it.
    """

    def __init__(self, costs: Sequence[Sequence[int]]) -> None:
        self.direct = []
        for node, row in enumerate(costs):
            places = "".join(["1" if entry == BEFORE else "0" for entry in reversed(row)])
            own = 1 << node
            self.direct.append((int(places, 2) | (node > 0)) & ~own)

    @cached_property
    def sequence(self) -> list[int]:
        """The nodes in an order that keeps the relation, as far as there is no cycle.

        Nodes in a cycle, and those after one, are left out.
        """
        # Where the relation is closed, what has more before it comes later.
        likely = sorted(range(len(self.direct)), key=lambda node: self.direct[node].bit_count())
        seen = 0
        for node in likely:
            if self.direct[node] & ~seen:
                return self._sorted()
            seen |= 1 << node
        return likely

    def _sorted(self) -> list[int]:
        """Return the nodes that are in no cycle, and not after one, by counting down."""
        after: list[list[int]] = [[] for _ in self.direct]
        for node, before in enumerate(self.direct):
            for other in nodes_of(before):
                after[other].append(node)
        waiting = [before.bit_count() for before in self.direct]
        free = [node for node, count in enumerate(waiting) if not count]
        for node in free:  # which grows on the path
            for other in after[node]:
                waiting[other] -= 1
                if not waiting[other]:
                    free.append(other)
        return free

    @cached_property
    def cycle(self) -> tuple[int, ...]:
        """Nodes of which each comes before the next, and the last before the first; or none.

        The lowest of them stands first.
        """
        rest = (1 << len(self.direct)) - 1
        for node in self.sequence:
            rest ^= 1 << node
        if not rest:
            return ()
        # Every node that is left has one before it that is left, too.
        path = [(rest & -rest).bit_length() - 1]
        seen = {path[0]: 0}
        while True:
            before = self.direct[path[-1]] & rest
            node = (before & -before).bit_length() - 1
            if node in seen:
                found = path[seen[node] :][::-1]
                lowest = found.index(min(found))
                return (*found[lowest:], *found[:lowest])
            seen[node] = len(path)
            path.append(node)

    @cached_property
    def before(self) -> list[int]:
        """By node, all that come before it; of a relation without cycles."""
        return self._closure[0]

    @cached_property
    def immediate(self) -> list[int]:
        """By node, those before it with none between them and it; of one without cycles."""
        return self._closure[1]

    @cached_property
    def _closure(self) -> tuple[list[int], list[int]]:
        before, immediate = list(self.direct), list(self.direct)
        for node in self.sequence:
            # What is implied by one that was looked at need not be looked at.
            rest, implied = self.direct[node], 0
            while rest:
                other = rest.bit_length() - 1
                implied |= before[other]
                rest &= ~(before[other] | 1 << other)
            before[node] |= implied
            immediate[node] &= ~implied
        return before, immediate


def nodes_of(members: int) -> list[int]:
    """Return the nodes of a set, from the lowest."""
    return [node for node, digit in enumerate(bin(members)[:1:-1]) if digit == "1"]
