from .claim_check import ORDERS as ORDERS
from .claim_check import STATES as STATES
from .claim_check import LeastCost as LeastCost
from .claim_check import find_bound_of_orders as find_bound_of_orders
from .claim_check import find_least_cost_of_orders as find_least_cost_of_orders
from .claim_check import find_least_cost_of_states as find_least_cost_of_states
from .fast_downward import PlannerAnswer as PlannerAnswer
from .fast_downward import check_with_planner as check_with_planner
from .referee import cross_examine as cross_examine
from .referee import find_counterexample as find_counterexample

__all__ = [
    "ORDERS",
    "STATES",
    "LeastCost",
    "PlannerAnswer",
    "check_with_planner",
    "cross_examine",
    "find_bound_of_orders",
    "find_counterexample",
    "find_least_cost_of_orders",
    "find_least_cost_of_states",
]
