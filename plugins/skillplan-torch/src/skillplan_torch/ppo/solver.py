"""The solver `ppo`."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.solvers.learning.learner import Learner, Training
from skillplan_torch.ppo.options import PpoOptions
from skillplan_torch.ppo.training import PpoTraining


class PpoSolver(Learner):
    """Learn the probability of every action; keep the best policy that was evaluated."""

    name = "ppo"

    Options = PpoOptions
    options: PpoOptions

    @property
    def hidden_layers(self) -> tuple[int, ...]:
        """Units of every hidden layer."""
        return (self.options.width,) * self.options.layers

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training that is yet to do its first step."""
        return PpoTraining(self.options, env, seeds, steps)
