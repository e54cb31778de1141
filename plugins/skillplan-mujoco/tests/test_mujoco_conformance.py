"""What every engine with a simulated arm owes, asked of MuJoCo."""

from __future__ import annotations

import random
from collections.abc import Iterator

from simulated import SLOW, mark_slow
from skillplan.task import Skill, State, Task
from skillplan.testing import SimulationSuite


@mark_slow(
    SLOW
    | {
        "test_a_reused_verdict_equals_a_fresh_one": "executions; answers in any order in every run",
        "test_what_it_grants_agrees_with_the_prediction": "executions; of one skill in every run",
    }
)
class TestConformance(SimulationSuite):
    engine = "mujoco"

    def queries(self, task: Task) -> Iterator[tuple[Skill, State]]:
        """A sample, as every question is a simulation."""
        yield from random.Random(4).sample(list(super().queries(task)), 6)
