from .conflict import explain_conflict as explain_conflict
from .hypothetical_state import HypotheticalStates as HypotheticalStates
from .partial_order import ClosedRelation as ClosedRelation
from .partial_order import break_cycles as break_cycles
from .partial_order import closure as closure
from .partial_order import cycle as cycle
from .partial_order import find_orderable as find_orderable
from .partial_order import reduction as reduction
from .precedence_chart import Alternatives as Alternatives
from .precedence_chart import DerivedChart as DerivedChart
from .precedence_chart import derive_chart as derive_chart
from .precedence_chart import simplify_conditions as simplify_conditions
from .precedence_query import Relation as Relation
from .whole_order import Conflict as Conflict
from .whole_order import Order as Order
from .whole_order import find_order as find_order

__all__ = [
    "Alternatives",
    "ClosedRelation",
    "Conflict",
    "DerivedChart",
    "HypotheticalStates",
    "Order",
    "Relation",
    "break_cycles",
    "closure",
    "cycle",
    "derive_chart",
    "explain_conflict",
    "find_order",
    "find_orderable",
    "reduction",
    "simplify_conditions",
]
