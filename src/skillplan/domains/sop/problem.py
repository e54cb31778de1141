"""A sequential ordering problem: schema of the cost matrix, precedence, faults, and task."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from skillplan.domains.domain import Strict
from skillplan.errors import Issue
from skillplan.files.schema_errors import shown
from skillplan.task.cost import NEVER, ConstantCost, TableCost
from skillplan.task.scene import Scene
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import Condition, Facts
from skillplan.task.task import Metric, Task

BEFORE = -1
"""Entry in row i and column j if j comes before i."""

MOST_NODES = 2000
MOST_COST = 2**40

_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}$"


def _check_name(name: str) -> str:
    if re.fullmatch(_NAME, name) is None:
        raise ValueError(
            f"{shown(name)} is not a name. Use letters, digits and '_.+-', at most 64."
        )
    return name


Entry = Annotated[int, Field(ge=BEFORE, le=MOST_COST)]


class SopConfig(Strict):
    """A sequential ordering problem, as TSPLIB defines it."""

    kind: Literal["sop"] = Field(description="the kind of task file")
    name: Annotated[str, AfterValidator(_check_name)] = Field(
        description="the task's name", json_schema_extra={"pattern": _NAME}
    )
    description: str = Field("", description="for people")
    costs: Annotated[list[list[Entry]], Field(min_length=2, max_length=MOST_NODES)] = Field(
        description="a row for each node: what going on to each one costs, or -1 where that one "
        "comes before it"
    )


class NodeOrder:
    """Precedence relation of a square matrix with entries `BEFORE`.

    Node 0 comes before all others even if their rows do not state it. Sets of nodes are integers
    with bit i for node i.

    Parameters
    ----------
    costs
        Shape (n, n); the diagonal is ignored.
    """

    def __init__(self, costs: Sequence[Sequence[int]]) -> None:
        self.direct = []
        for node, row in enumerate(costs):
            places = "".join(["1" if entry == BEFORE else "0" for entry in reversed(row)])
            own = 1 << node
            self.direct.append((int(places, 2) | (node > 0)) & ~own)

    @cached_property
    def sequence(self) -> list[int]:
        """Nodes in a topological order; nodes in or after a cycle are left out."""
        # In a closed relation, nodes with more predecessors come later.
        likely = sorted(range(len(self.direct)), key=lambda node: self.direct[node].bit_count())
        seen = 0
        for node in likely:
            if self.direct[node] & ~seen:
                return self._sorted()
            seen |= 1 << node
        return likely

    def _sorted(self) -> list[int]:
        """Return a topological order by counting predecessors down (Kahn's algorithm)."""
        after: list[list[int]] = [[] for _ in self.direct]
        for node, before in enumerate(self.direct):
            for other in list_nodes(before):
                after[other].append(node)
        waiting = [before.bit_count() for before in self.direct]
        free = [node for node, count in enumerate(waiting) if not count]
        for node in free:  # grows during the loop
            for other in after[node]:
                waiting[other] -= 1
                if not waiting[other]:
                    free.append(other)
        return free

    @cached_property
    def cycle(self) -> tuple[int, ...]:
        """A cycle with its lowest node first, each node before the next; may be empty."""
        rest = (1 << len(self.direct)) - 1
        for node in self.sequence:
            rest ^= 1 << node
        if not rest:
            return ()
        # Every remaining node has a remaining predecessor.
        path = [(rest & -rest).bit_length() - 1]
        seen = {path[0]: 0}
        while True:
            before = self.direct[path[-1]] & rest
            node = (before & -before).bit_length() - 1
            if node in seen:
                loop = path[seen[node] :][::-1]
                lowest = loop.index(min(loop))
                return (*loop[lowest:], *loop[:lowest])
            seen[node] = len(path)
            path.append(node)

    @cached_property
    def before(self) -> list[int]:
        """Predecessors of each node; the relation must have no cycle."""
        return self._closure[0]

    @cached_property
    def immediate(self) -> list[int]:
        """Direct predecessors of each node (transitive reduction); no cycle allowed."""
        return self._closure[1]

    @cached_property
    def _closure(self) -> tuple[list[int], list[int]]:
        before, immediate = list(self.direct), list(self.direct)
        for node in self.sequence:
            # Predecessors of a handled node are implied and need no look.
            rest, implied = self.direct[node], 0
            while rest:
                other = rest.bit_length() - 1
                implied |= before[other]
                rest &= ~(before[other] | 1 << other)
            before[node] |= implied
            immediate[node] &= ~implied
        return before, immediate


def list_nodes(members: int) -> list[int]:
    """Return the nodes of a set in ascending order."""
    return [node for node, digit in enumerate(bin(members)[:1:-1]) if digit == "1"]


# Greatest number of nodes named in a message.
_MOST_NAMED = 8


def find_issues(config: SopConfig) -> Iterator[Issue]:
    """Yield the faults of a matrix with their paths."""
    n = len(config.costs)
    ragged = [i for i, row in enumerate(config.costs) if len(row) != n]
    for i in ragged:
        message = (
            f"row {i} has {_format_count(len(config.costs[i]))}; in a matrix of {n} rows it has "
        )
        yield Issue(f"{message}{n}.", ("costs", i))
    if not ragged:
        yield from _find_order_faults(config)


def _find_order_faults(config: SopConfig) -> Iterator[Issue]:
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
            f"the order has a cycle: node {_format_path((*order.cycle, first))}. "
            f"Write a cost for one of these {BEFORE}."
        )
        yield Issue(message, ("costs", after, first))
        return
    early = [j for j in range(1, last) if not order.before[last] >> j & 1]
    if early:
        message = (
            f"node {last}, the last, must come after all others, but need not come after "
            f"{_format_nodes(early)}. Write {BEFORE} there in its row."
        )
        yield Issue(message, ("costs", last, early[0]))


def _format_path(nodes: Iterable[int]) -> str:
    texts = [str(node) for node in nodes]
    if len(texts) > 2 * _MOST_NAMED:
        texts = [*texts[:_MOST_NAMED], "...", *texts[-_MOST_NAMED:]]
    return " before ".join(texts)


def _format_nodes(nodes: list[int]) -> str:
    shown = ", ".join(str(node) for node in nodes[:_MOST_NAMED])
    rest = f" and {len(nodes) - _MOST_NAMED} more" if len(nodes) > _MOST_NAMED else ""
    return f"node{'s' if len(nodes) > 1 else ''} {shown}{rest}"


def _format_count(entries: int) -> str:
    return f"{entries} {'entry' if entries == 1 else 'entries'}"


WEIGHT = Metric("weight", "", decimals=0)
"""Weights of TSPLIB files have no unit."""


def build_task(config: SopConfig, sha256: str) -> Task:
    """Return the task of a matrix without faults (Escudero 1988).

    A plan is the cheapest path through all nodes that respects the order. Node 0 is the start.
    Every
    other node has a skill ``visit(J)``, done once after the direct predecessors of J.

    Parameters
    ----------
    config
        Matrix of shape (n, n).
    """
    n = len(config.costs)
    stands = tuple(f"at({node})" for node in range(n))
    done = tuple(f"visited({node})" for node in range(1, n))
    facts = Facts((*stands, *done), exclusive=(stands,))
    # Bits of `at(J)` and `visited(J)`; node 0 has no `visited`.
    at = [1 << node for node in range(n)]
    visited = [0, *(1 << n - 1 + node for node in range(1, n))]
    places = facts.state((1 << n) - 1)
    order = NodeOrder(config.costs)
    nothing = ConstantCost(0.0)
    skills = []
    for node, column in enumerate(_compute_costs(config, order)):
        if node == 0:
            continue
        own = facts.state(visited[node])
        needed = facts.state(sum(visited[other] for other in list_nodes(order.immediate[node])))
        there = facts.state(visited[node] | at[node])
        skills.append(
            Skill(
                name=f"visit({node})",
                kind="visit",
                agents=("robot",),
                precondition=Condition(needed, own),
                outcomes=(Outcome(1.0, there, facts.state(places.bits ^ at[node])),),
                cost=TableCost(places, tuple(column)),
                duration_s=nothing,
                parameters={"node": str(node)},
            )
        )
    return Task(
        name=config.name,
        kind=config.kind,
        facts=facts,
        skills=tuple(skills),
        initial=facts.state(at[0]),
        goal=Condition(facts.state(sum(visited)), facts.none),
        metric=WEIGHT,
        step_limit=n - 1,
        scene=Scene((), ()),
        operations={str(node): f"visited({node})" for node in range(1, n)},
        sha256=sha256,
    )


def _compute_costs(config: SopConfig, order: NodeOrder) -> list[list[int]]:
    """Return the costs to each node from every other node, `NEVER` if the order excludes the arc.

    An arc is excluded from successors, and from predecessors with a node in between.
    """
    columns = [list(column) for column in zip(*config.costs, strict=True)]
    for node, before in enumerate(order.before):
        columns[node][node] = NEVER
        # Entries of the rows are in the columns already, where -1 means the same.
        for other in list_nodes(before & ~order.direct[node]):
            columns[other][node] = NEVER
        for other in list_nodes(before & ~order.immediate[node]):
            columns[node][other] = NEVER
    return columns
