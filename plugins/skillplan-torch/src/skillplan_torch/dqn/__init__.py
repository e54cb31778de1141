"""Deep Q-learning, as the solver `dqn`.

It holds what only this algorithm needs, and never what `ppo` needs as well.
"""

from skillplan_torch.dqn.solver import DqnSolver

__all__ = ["DqnSolver"]
