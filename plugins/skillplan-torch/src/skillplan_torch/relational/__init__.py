"""A policy for boards of any size, learned from the costs of all choices on small boards."""

from skillplan_torch.relational.solver import RelationalSolver

__all__ = ["RelationalSolver"]
