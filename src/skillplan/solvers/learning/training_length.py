"""How long a training is where nobody says it: by the number of skills of what is learned on.

What a run has to find out is what every skill costs after every other one, so that its length
grows with their pairs.
"""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.task.task import Task

# Of a pair of skills; under chance outcomes are to be seen often, and of a family many layouts.
_STEPS_A_PAIR, _STEPS_A_PAIR_BY_CHANCE = 20, 160
_ROUND = 1_000
_LEAST, _MOST = 2_000, 200_000


def usual_steps(tasks: Sequence[Task], factor: float = 1.0) -> int:
    """Return how many environment steps a run has, in whole thousands.

    Parameters
    ----------
    tasks
        What is learned on: one task, or the layouts of a family; at least one.
    factor
        How many times as many as usual a learner takes, > 0.
    """
    certain = len(tasks) == 1 and tasks[0].deterministic
    a_pair = _STEPS_A_PAIR if certain else _STEPS_A_PAIR_BY_CHANCE
    pairs = max(len(task.skills) for task in tasks) ** 2
    rounded = round(factor * a_pair * pairs / _ROUND) * _ROUND
    return min(_MOST, max(_LEAST, rounded))
