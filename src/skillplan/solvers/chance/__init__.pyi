from .adaptive_search import AdaptiveSearch as AdaptiveSearch
from .job_sets import CertainModel as CertainModel
from .job_sets import OrdersAhead as OrdersAhead
from .job_sets import compute_costs_to_go as compute_costs_to_go
from .job_sets import find_orders_ahead as find_orders_ahead
from .job_sets import list_feasible_sets as list_feasible_sets
from .job_values import JobValues as JobValues
from .job_values import Ways as Ways
from .job_values import compute_set_values as compute_set_values
from .job_values import relax_to_one_try as relax_to_one_try
from .job_values_solver import JobValuesSolver as JobValuesSolver
from .replan import ReplanSolver as ReplanSolver
from .retries import assume_retries as assume_retries
from .retries import refuse_retries as refuse_retries
from .retries import relax as relax

__all__ = [
    "AdaptiveSearch",
    "CertainModel",
    "JobValues",
    "JobValuesSolver",
    "OrdersAhead",
    "ReplanSolver",
    "Ways",
    "assume_retries",
    "compute_costs_to_go",
    "compute_set_values",
    "find_orders_ahead",
    "list_feasible_sets",
    "refuse_retries",
    "relax",
    "relax_to_one_try",
]
