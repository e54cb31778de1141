"""The solver `ppo`."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.solvers.learning.learner import Training
from skillplan_torch.network_learner import NetworkLearner
from skillplan_torch.ppo.options import PpoOptions
from skillplan_torch.ppo.training import PpoTraining


class PpoSolver(NetworkLearner):
    """Learn action probabilities, with model-based planning; keep the best evaluated policy."""

    name = "ppo"

    Options = PpoOptions
    options: PpoOptions
    steps_factor = 2.0

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training that is yet to do its first step."""
        options = self.options.model_copy(update=self.derived([one.task for one in env.models]))
        return PpoTraining(options, env, seeds, steps)
