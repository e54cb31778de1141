"""What a search is likely to ask next, while it waits for a verdict.

It goes on as if what is not known were feasible: where geometry is asked first, most of what an
engine is asked about is.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from itertools import count
from typing import TypeVar

from skillplan.task.skill import Skill
from skillplan.task.state import State

Node = TypeVar("Node")
Ranked = tuple[tuple[int, ...], Node]
"""A node with the rank in which a search takes it, the least first."""

# So many nodes are looked at while the search waits for one verdict.
MOST_NODES = 256


def questions_ahead(
    node: Node,
    others: Iterable[Ranked[Node]],
    *,
    successors: Callable[[Node], Iterable[Ranked[Node]]],
    question: Callable[[Node], tuple[State, Skill]],
    expected: Callable[[State, Skill], bool | None],
) -> Iterator[tuple[State, Skill]]:
    """Yield what a search asks after the verdict on `node`, if that is feasible.

    Parameters
    ----------
    node
        What it waits for.
    others
        What else is open.
    successors
        Yields what follows a node.
    question
        Returns the state and the skill that lead to a node.
    expected
        Returns whether that is feasible as far as is known, else None.
    """
    queue: list[tuple[tuple[int, ...], int, Node]] = []

    added = count(0, -1)

    def add(ranked: Iterable[Ranked[Node]]) -> None:
        for rank, one in ranked:
            # Of equals the latest first, which is what the search has just made.
            heapq.heappush(queue, (rank, next(added), one))

    add(others)
    add(successors(node))
    for _ in range(MOST_NODES):
        if not queue:
            return
        *_, here = heapq.heappop(queue)
        asked = question(here)
        if expected(*asked) is None:
            yield asked
        # By now cheap back ends may have refused it.
        if expected(*asked) is not False:
            add(successors(here))
