from .claim_check import ORDERS as ORDERS
from .claim_check import STATES as STATES
from .claim_check import LeastCost as LeastCost
from .claim_check import least_cost_of_orders as least_cost_of_orders
from .claim_check import least_cost_of_states as least_cost_of_states
from .fast_downward import PlannerAnswer as PlannerAnswer
from .fast_downward import planner_claims as planner_claims
from .referee import counterexample as counterexample
from .referee import cross_examine as cross_examine

__all__ = [
    "ORDERS",
    "STATES",
    "LeastCost",
    "PlannerAnswer",
    "counterexample",
    "cross_examine",
    "least_cost_of_orders",
    "least_cost_of_states",
    "planner_claims",
]
