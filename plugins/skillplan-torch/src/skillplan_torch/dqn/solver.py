"""The solver `dqn`."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.solvers.learning.learner import Learner, Training
from skillplan_torch.dqn.options import DqnOptions
from skillplan_torch.dqn.training import DqnTraining


class DqnSolver(Learner):
    """Learn the value of every action; keep the best policy that an episode has evaluated."""

    name = "dqn"

    Options = DqnOptions
    options: DqnOptions

    @property
    def hidden_layers(self) -> tuple[int, ...]:
        """Units of every hidden layer."""
        return (self.options.width,) * self.options.layers

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training that is yet to do its first step."""
        return DqnTraining(self.options, env, seeds, steps)
