from .fast_downward import PlannerAnswer as PlannerAnswer
from .planner_claims import planner_claims as planner_claims
from .referee import counterexample as counterexample
from .referee import cross_examine as cross_examine
from .second_proof import ORDERS as ORDERS
from .second_proof import STATES as STATES
from .second_proof import LeastCost as LeastCost
from .second_proof import least_cost_of_orders as least_cost_of_orders
from .second_proof import least_cost_of_states as least_cost_of_states

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
