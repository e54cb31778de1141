"""Planning with action schemas learned from steps, alone or as an addition to other learners."""

from skillplan.solvers.learned_model.planned_episodes import PlannedEpisodes
from skillplan.solvers.learned_model.solver import LearnedModelSolver, can_model

__all__ = ["LearnedModelSolver", "PlannedEpisodes", "can_model"]
