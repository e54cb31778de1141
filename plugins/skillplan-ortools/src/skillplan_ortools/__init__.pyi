from .cp_sat import CpSatSolver as CpSatSolver
from .order_circuit import OrderCircuit as OrderCircuit
from .watched_search import WatchedSearch as WatchedSearch
from .whole_costs import START as START
from .whole_costs import WholeCosts as WholeCosts

__version__: str

__all__ = [
    "START",
    "CpSatSolver",
    "OrderCircuit",
    "WatchedSearch",
    "WholeCosts",
]
