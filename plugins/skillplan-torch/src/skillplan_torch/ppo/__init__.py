"""Proximal policy optimisation, as the solver `ppo`."""

from skillplan_torch.ppo.learner import PpoSolver

__all__ = ["PpoSolver"]
