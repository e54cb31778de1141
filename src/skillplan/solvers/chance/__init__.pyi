from .adaptive_search import AdaptiveSearch as AdaptiveSearch
from .job_sets import CertainModel as CertainModel
from .job_sets import OrdersAhead as OrdersAhead
from .job_sets import costs_to_go as costs_to_go
from .job_sets import feasible_sets as feasible_sets
from .job_sets import orders_ahead as orders_ahead
from .job_values import JobValues as JobValues
from .job_values import Ways as Ways
from .job_values import tried_once as tried_once
from .job_values import values_of_sets as values_of_sets
from .job_values_solver import JobValuesSolver as JobValuesSolver
from .replan import ReplanSolver as ReplanSolver
from .retries import relaxed as relaxed
from .retries import retried as retried
from .retries import why_not_retried as why_not_retried

__all__ = [
    "AdaptiveSearch",
    "CertainModel",
    "JobValues",
    "JobValuesSolver",
    "OrdersAhead",
    "ReplanSolver",
    "Ways",
    "costs_to_go",
    "feasible_sets",
    "orders_ahead",
    "relaxed",
    "retried",
    "tried_once",
    "values_of_sets",
    "why_not_retried",
]
