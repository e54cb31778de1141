from .bellman_solver import BellmanSolver as BellmanSolver
from .bellman_solver import build_rewards as build_rewards
from .label_setting import compute_costs_to_go as compute_costs_to_go
from .policy_iteration import PolicyIterationSolver as PolicyIterationSolver
from .value_iteration import ValueIterationSolver as ValueIterationSolver

__all__ = [
    "BellmanSolver",
    "PolicyIterationSolver",
    "ValueIterationSolver",
    "build_rewards",
    "compute_costs_to_go",
]
