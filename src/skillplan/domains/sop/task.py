"""From a matrix of costs and precedence to its task.

Sequential ordering (Escudero 1988): the cheapest path through all nodes, from the first to the
last, on which some come before others. A state says what has been visited and where one stands.
"""

from __future__ import annotations

from skillplan.domains.sop.node_order import NodeOrder, nodes_of
from skillplan.domains.sop.schema import SopConfig
from skillplan.task.condition import Condition
from skillplan.task.cost import ConstantCost
from skillplan.task.cost_table import NEVER, TableCost
from skillplan.task.scene import Scene
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import Facts
from skillplan.task.task import Metric, Task

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
