from .conflict import conflict_lines as conflict_lines
from .partial_order import ClosedRelation as ClosedRelation
from .partial_order import acyclic as acyclic
from .partial_order import closure as closure
from .partial_order import cycle as cycle
from .partial_order import orderable as orderable
from .partial_order import reduction as reduction
from .precedence_chart import Alternatives as Alternatives
from .precedence_chart import DerivedChart as DerivedChart
from .precedence_chart import derive_chart as derive_chart
from .precedence_chart import simplest as simplest
from .precedence_query import Relation as Relation

__all__ = [
    "Alternatives",
    "ClosedRelation",
    "DerivedChart",
    "Relation",
    "acyclic",
    "closure",
    "conflict_lines",
    "cycle",
    "derive_chart",
    "orderable",
    "reduction",
    "simplest",
]
