from .bellman_solver import BellmanSolver as BellmanSolver
from .label_setting import costs_to_go as costs_to_go
from .policy_iteration import PolicyIterationSolver as PolicyIterationSolver
from .tabular_solver import learner_rewards as learner_rewards
from .value_iteration import ValueIterationSolver as ValueIterationSolver

__all__ = [
    "BellmanSolver",
    "PolicyIterationSolver",
    "ValueIterationSolver",
    "costs_to_go",
    "learner_rewards",
]
