"""A network that learns from what `replan` does and then from what comes of it: `imitate`.

It holds what only this algorithm needs; the teacher is a solver of the core.
"""

from skillplan_torch.imitation.solver import ImitateSolver

__all__ = ["ImitateSolver"]
