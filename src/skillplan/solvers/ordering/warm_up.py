"""Compile the kernels of the ordering search ahead of their first use.

Compiling all of them takes half a minute, once per machine. So that no user's first search waits
for it, ``skillplan warm-up``, a step of ``make``'s installation, calls this; what it compiles is
kept where `solvers.compiled` says.
"""

from __future__ import annotations

import numpy as np

from skillplan.solvers.ordering.instance import NO_ARC, OrderingInstance
from skillplan.solvers.ordering.portfolio import METHODS, OrderingSearch
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation
from skillplan.solvers.ordering.relaxation.pair_relaxation import PairRelaxation

_NODES = 16
_WORK = 1_000_000


def warm_up() -> None:
    """Search a small instance by each method in turn, which compiles what any search calls."""
    instance = _instance()
    for method in METHODS:
        OrderingSearch(instance, (method,), rounds=1).run()
    # Costs of one direction only are searched by other moves.
    one_way = OrderingInstance(np.triu(instance.costs) + 1.0, instance.before)
    OrderingSearch(one_way, ("local-search",), rounds=1).run()
    # A search turns to this only where the others do not soon prove its optimum.
    relaxation = CutRelaxation(instance, instance.costs < NO_ARC)
    PairRelaxation(relaxation).run(_WORK, np.inf, lambda: False, lambda duals: None)


def _instance() -> OrderingInstance:
    """Return places on a grid, some before others; the relaxation alone does not prove them."""
    nodes = np.arange(_NODES)
    x, y = 7 * nodes % 31, 11 * nodes**2 % 31
    costs = np.abs(x[:, None] - x) + np.abs(y[:, None] - y) + 0.0
    before = np.zeros((_NODES, _NODES), dtype=np.bool_)
    before[[1, 2, 3, 5, 6], [4, 4, 9, 8, 10]] = True
    return OrderingInstance(costs, before)
