"""Relations of what comes before what: their closure, reduction and circles."""

from __future__ import annotations

from collections.abc import Iterable
from graphlib import CycleError, TopologicalSorter


def closure(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the transitive closure of a relation."""
    after: dict[str, set[str]] = {}
    for one, other in pairs:
        after.setdefault(one, set()).add(other)
    closed = set()
    for start in after:
        todo, seen = list(after[start]), set()
        while todo:
            node = todo.pop()
            if node not in seen:
                seen.add(node)
                todo += after.get(node, ())
        closed |= {(start, node) for node in seen}
    return closed


class ClosedRelation:
    """What comes before what in whatever number of steps, element by element.

    Parameters
    ----------
    pairs
        Closed by transitivity.
    """

    def __init__(self, pairs: Iterable[tuple[str, str]]) -> None:
        before: dict[str, set[str]] = {}
        after: dict[str, set[str]] = {}
        for one, other in pairs:
            before.setdefault(other, set()).add(one)
            after.setdefault(one, set()).add(other)
        self._before = {element: frozenset(others) for element, others in before.items()}
        self._after = {element: frozenset(others) for element, others in after.items()}

    def before(self, element: str) -> frozenset[str]:
        """Return what comes before an element."""
        return self._before.get(element, frozenset())

    def after(self, element: str) -> frozenset[str]:
        """Return what comes after an element."""
        return self._after.get(element, frozenset())


def reduction(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the pairs that do not follow from others; those on a circle all stay."""
    pairs = list(pairs)
    closed = closure(pairs)
    after: dict[str, set[str]] = {}
    for one, other in closed:
        after.setdefault(one, set()).add(other)

    def follows(one: str, other: str) -> bool:
        # By way of an element strictly between the two, on no circle with either.
        return (other, one) not in closed and any(
            (via, other) in closed and (via, one) not in closed and (other, via) not in closed
            for via in after[one]
        )

    return {(one, other) for one, other in pairs if not follows(one, other)}


def circle(pairs: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return elements each of which comes before the next, ending with the first; or none."""
    before: dict[str, list[str]] = {}
    for one, other in pairs:
        before.setdefault(other, []).append(one)
    try:
        TopologicalSorter(before).prepare()
    except CycleError as error:
        return tuple(error.args[1])
    return ()
