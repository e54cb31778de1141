"""Faults of a cost matrix that a schema cannot see: its shape, and the order that it demands."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from skillplan.domains.sop.node_order import NodeOrder
from skillplan.domains.sop.schema import BEFORE, SopConfig
from skillplan.errors import Issue

# Of the nodes that a message is about, so many are named.
_MOST_NAMED = 8


def issues(config: SopConfig) -> Iterator[Issue]:
    """Yield every fault, each with the path of its entry."""
    n = len(config.costs)
    ragged = [i for i, row in enumerate(config.costs) if len(row) != n]
    for i in ragged:
        message = f"row {i} has {_counted(len(config.costs[i]))}; in a matrix of {n} rows it has "
        yield Issue(f"{message}{n}.", ("costs", i))
    if not ragged:
        yield from _order_faults(config)


def _order_faults(config: SopConfig) -> Iterator[Issue]:
    costs, last = config.costs, len(config.costs) - 1
    faultless = True
    for j in (j for j in range(1, last + 1) if costs[0][j] == BEFORE):
        faultless = False
        message = f"node {j} cannot come before node 0, where one starts. Write a cost, >= 0."
        yield Issue(message, ("costs", 0, j))
    for i in (i for i in range(1, last) if costs[i][last] == BEFORE):
        faultless = False
        message = f"node {last}, the last, cannot come before node {i}. Write a cost, >= 0."
        yield Issue(message, ("costs", i, last))
    if not faultless:
        return
    order = NodeOrder(costs)
    if order.cycle:
        first, *others = order.cycle
        after = others[0] if others else first
        message = (
            f"the order has a cycle: node {_path((*order.cycle, first))}. "
            f"Write a cost for one of these {BEFORE}."
        )
        yield Issue(message, ("costs", after, first))
        return
    early = [j for j in range(1, last) if not order.before[last] >> j & 1]
    if early:
        message = (
            f"node {last}, the last, must come after all others, but need not come after "
            f"{_some(early)}. Write {BEFORE} there in its row."
        )
        yield Issue(message, ("costs", last, early[0]))


def _path(nodes: Iterable[int]) -> str:
    texts = [str(node) for node in nodes]
    if len(texts) > 2 * _MOST_NAMED:
        texts = [*texts[:_MOST_NAMED], "...", *texts[-_MOST_NAMED:]]
    return " before ".join(texts)


def _some(nodes: list[int]) -> str:
    shown = ", ".join(str(node) for node in nodes[:_MOST_NAMED])
    rest = f" and {len(nodes) - _MOST_NAMED} more" if len(nodes) > _MOST_NAMED else ""
    return f"node{'s' if len(nodes) > 1 else ''} {shown}{rest}"


def _counted(entries: int) -> str:
    return f"{entries} {'entry' if entries == 1 else 'entries'}"
