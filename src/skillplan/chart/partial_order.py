"""Precedence relations: their closure, reduction and cycles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence


def closure(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the transitive closure of a relation."""
    after: dict[str, set[str]] = {}
    for first, second in pairs:
        after.setdefault(first, set()).add(second)
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
    """A transitive relation, by component.

    Parameters
    ----------
    pairs
        Pairs, closed by transitivity.
    """

    def __init__(self, pairs: Iterable[tuple[str, str]]) -> None:
        before: dict[str, set[str]] = {}
        after: dict[str, set[str]] = {}
        for first, second in pairs:
            before.setdefault(second, set()).add(first)
            after.setdefault(first, set()).add(second)
        self._before = {component: frozenset(others) for component, others in before.items()}
        self._after = {component: frozenset(others) for component, others in after.items()}

    def before(self, component: str) -> frozenset[str]:
        """Return the predecessors of a component."""
        return self._before.get(component, frozenset())

    def after(self, component: str) -> frozenset[str]:
        """Return the successors of a component."""
        return self._after.get(component, frozenset())


def reduction(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the pairs that others do not imply; pairs on a cycle are kept."""
    pairs = list(pairs)
    closed = closure(pairs)
    after: dict[str, set[str]] = {}
    for first, second in closed:
        after.setdefault(first, set()).add(second)

    def follows(first: str, second: str) -> bool:
        # A component between the two, on no cycle with either, implies the pair.
        return (second, first) not in closed and any(
            (via, second) in closed and (via, first) not in closed and (second, via) not in closed
            for via in after[first]
        )

    return {(first, second) for first, second in pairs if not follows(first, second)}


def cycle(pairs: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Return the shortest cycle, its first component repeated at the end, or none.

    Of several with equal length, the cycle of the component that comes first.
    """
    after: dict[str, list[str]] = {}
    for first, second in pairs:
        after.setdefault(first, []).append(second)
    shortest: tuple[str, ...] = ()
    for start in after:
        cycle_through = _cycle_through(start, after)
        if cycle_through and (not shortest or len(cycle_through) < len(shortest)):
            shortest = cycle_through
    return shortest


def _cycle_through(start: str, after: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
    """Return a shortest cycle through a component, by breadth-first search, or none."""
    came: dict[str, str] = {}
    queue = [start]
    for component in queue:
        for successor in after.get(component, ()):
            if successor == start:
                path = [start, component] if component != start else [start]
                while component != start:
                    component = came[component]
                    path.append(component)
                return tuple(reversed(path)) if len(path) > 1 else (start, start)
            if successor not in came:
                came[successor] = component
                queue.append(successor)
    return ()


def find_shortest_path(pairs: Iterable[tuple[str, str]], start: str, end: str) -> tuple[str, ...]:
    """Return the components on a shortest path between two, both included, or none."""
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


def find_orderable(components: Iterable[str], pairs: Iterable[tuple[str, str]]) -> set[str]:
    """Return the components that are neither on a cycle nor after one."""
    closed = closure(pairs)
    stuck = {first for first, second in closed if first == second}
    return {
        component
        for component in components
        if component not in stuck and not any((first, component) in closed for first in stuck)
    }


def break_cycles(
    pairs: Iterable[tuple[str, str]], order: Sequence[str]
) -> tuple[set[tuple[str, str]], set[tuple[str, str]]]:
    """Return a relation without the pairs that close its cycles, and these pairs.

    Parameters
    ----------
    order
        All components; the depth-first walks start in this order.
    """
    places = {component: place for place, component in enumerate(order)}
    after: dict[str, list[str]] = {component: [] for component in order}
    for first, second in sorted(pairs, key=lambda pair: (places[pair[0]], places[pair[1]])):
        after[first].append(second)
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
    return {(first, second) for first in order for second in after[first]} - closing, closing
