"""The schema of a sequential ordering problem: a matrix of costs that says the order, too."""

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
"""The entry in row i and column j that says that j comes before i."""

MOST_NODES = 2000
MOST_COST = 2**40

_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.+-]{0,63}$"


def _named(name: str) -> str:
    if re.fullmatch(_NAME, name) is None:
        raise ValueError(
            f"{shown(name)} is not a name. Use letters, digits and '_.+-', at most 64."
        )
    return name


Entry = Annotated[int, Field(ge=BEFORE, le=MOST_COST)]


class SopConfig(Strict):
    """A sequential ordering problem, as TSPLIB defines it."""

    kind: Literal["sop"] = Field(description="the kind of task file")
    name: Annotated[str, AfterValidator(_named)] = Field(
        description="the task's name", json_schema_extra={"pattern": _NAME}
    )
    description: str = Field("", description="for people")
    costs: Annotated[list[list[Entry]], Field(min_length=2, max_length=MOST_NODES)] = Field(
        description="a row for each node: what going on to each one costs, or -1 where that one "
        "comes before it"
    )


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


WEIGHT = Metric("weight", "", decimals=0)
"""The weights of a TSPLIB file have no unit."""


def sop_task(config: SopConfig, sha256: str) -> Task:
    """Return the task of a faultless matrix.

    Node 0 is where one starts; every other has a skill ``visit(J)``, which needs what comes
    right before it and is done once.

    Parameters
    ----------
    config
        The matrix, shape (n, n).
    sha256
        Hash of the content, in hexadecimal.
    """
    n = len(config.costs)
    stands = tuple(f"at({node})" for node in range(n))
    done = tuple(f"visited({node})" for node in range(1, n))
    facts = Facts((*stands, *done), exclusive=(stands,))
    # The bits of `at(J)` and of `visited(J)`, which node 0 does not have.
    at = [1 << node for node in range(n)]
    visited = [0, *(1 << n - 1 + node for node in range(1, n))]
    places = facts.state((1 << n) - 1)
    order = NodeOrder(config.costs)
    nothing = ConstantCost(0.0)
    skills = []
    for node, column in enumerate(_costs_to(config, order)):
        if node == 0:
            continue
        own = facts.state(visited[node])
        needed = facts.state(sum(visited[other] for other in nodes_of(order.immediate[node])))
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


def _costs_to(config: SopConfig, order: NodeOrder) -> list[list[int]]:
    """Return by node what coming from each other costs, `NEVER` where the order rules it out.

    One cannot come from what comes after, nor from what comes before with something between.
    """
    columns = [list(column) for column in zip(*config.costs, strict=True)]
    for node, before in enumerate(order.before):
        columns[node][node] = NEVER
        # What the rows say is in the columns already: there, -1 means the same.
        for other in nodes_of(before & ~order.direct[node]):
            columns[other][node] = NEVER
        for other in nodes_of(before & ~order.immediate[node]):
            columns[node][other] = NEVER
    return columns
