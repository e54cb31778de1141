"""Proximal policy optimisation, as the solver `ppo`.

It holds what only this algorithm needs, and never what `dqn` needs as well.
"""

from skillplan_torch.ppo.solver import PpoSolver

__all__ = ["PpoSolver"]
