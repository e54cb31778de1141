"""Deep Q-learning, as the solver `dqn`."""

from skillplan_torch.dqn.learner import DqnSolver

__all__ = ["DqnSolver"]
