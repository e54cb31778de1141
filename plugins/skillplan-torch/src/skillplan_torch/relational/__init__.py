"""A network that carries over from board to board, learned from what every choice costs.

It holds what only this algorithm needs; what the network sees and how it answers is the core's.
"""

from skillplan_torch.relational.solver import RelationalSolver

__all__ = ["RelationalSolver"]
