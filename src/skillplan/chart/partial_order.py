"""Relations of what comes before what: their closure, reduction and cycles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence


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
    """What comes before what in whatever number of steps, component by component.

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
        self._before = {component: frozenset(others) for component, others in before.items()}
        self._after = {component: frozenset(others) for component, others in after.items()}

    def before(self, component: str) -> frozenset[str]:
        """Return what comes before a component."""
        return self._before.get(component, frozenset())

    def after(self, component: str) -> frozenset[str]:
        """Return what comes after a component."""
        return self._after.get(component, frozenset())


def reduction(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the pairs that do not follow from others; those on a cycle all stay."""
    pairs = list(pairs)
    closed = closure(pairs)
    after: dict[str, set[str]] = {}
    for one, other in closed:
        after.setdefault(one, set()).add(other)

    def follows(one: str, other: str) -> bool:
        # Through a component strictly between the two, on no cycle with either.
        return (other, one) not in closed and any(
            (via, other) in closed and (via, one) not in closed and (other, via) not in closed
            for via in after[one]
        )

    return {(one, other) for one, other in pairs if not follows(one, other)}


def cycle(pairs: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return the shortest cycle: each comes before the next, ending with the first; or none.

    Of several of one length, it is the one of the component named first.
    """
    after: dict[str, list[str]] = {}
    for one, other in pairs:
        after.setdefault(one, []).append(other)
    shortest: tuple[str, ...] = ()
    for start in after:
        cycle_through = _cycle_through(start, after)
        if cycle_through and (not shortest or len(cycle_through) < len(shortest)):
            shortest = cycle_through
    return shortest


def _cycle_through(start: str, after: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return a shortest cycle through a component by breadth-first search, or none."""
    came: dict[str, str] = {}
    queue = [start]
    for one in queue:
        for other in after.get(one, ()):
            if other == start:
                found = [start, one] if one != start else [start]
                while one != start:
                    one = came[one]
                    found.append(one)
                return tuple(reversed(found)) if len(found) > 1 else (start, start)
            if other not in came:
                came[other] = one
                queue.append(other)
    return ()


def shortest_path(pairs: Iterable[tuple[str, str]], start: str, end: str) -> tuple[str, ...]:
    """Return the components on a shortest path from one to another, both included; or none."""
    after: dict[str, list[str]] = {}
    for before, later in pairs:
        after.setdefault(before, []).append(later)
    came = {start: start}
    queue = [start]
    for component in queue:
        for later in after.get(component, ()):
            if later not in came:
                came[later] = component
                queue.append(later)
    if end not in came or end == start:
        return ()
    path = [end]
    while path[-1] != start:
        path.append(came[path[-1]])
    return tuple(reversed(path))


def orderable(components: Iterable[str], pairs: Iterable[tuple[str, str]]) -> set[str]:
    """Return the components that are neither on a cycle nor after one."""
    closed = closure(pairs)
    stuck = {one for one, other in closed if one == other}
    return {
        component
        for component in components
        if component not in stuck and not any((one, component) in closed for one in stuck)
    }


def acyclic(
    pairs: Iterable[tuple[str, str]], order: Sequence[str]
) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """Return a relation without the pairs that close its cycles, and these.

    Parameters
    ----------
    pairs
        Of what comes before what.
    order
        All components; walks along pairs begin in this order.
    """
    places = {component: place for place, component in enumerate(order)}
    after: dict[str, list[str]] = {component: [] for component in order}
    for one, other in sorted(pairs, key=lambda pair: (places[pair[0]], places[pair[1]])):
        after[one].append(other)
    closing: set[tuple[str, str]] = set()
    done: set[str] = set()
    for start in order:
        path = [start] if start not in done else []
        left = {start: list(after[start])}
        while path:
            here = path[-1]
            if not left[here]:
                done.add(path.pop())
                continue
            there = left[here].pop(0)
            if there in path:
                closing.add((here, there))
            elif there not in done:
                path.append(there)
                left[there] = list(after[there])
    return {(one, other) for one in order for other in after[one]} - closing, closing
