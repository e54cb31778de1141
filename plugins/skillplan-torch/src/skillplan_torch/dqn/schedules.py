"""How exploration, imitation and learning rate of deep Q-learning change over a training."""

from __future__ import annotations

from skillplan_torch.dqn.options import DqnOptions

# Episodes leave the policy until this share of the steps.
_BRANCHING_UNTIL = 0.88
# After this share of the steps imitation sets in, over that one.
_IMITATION_FROM, _IMITATION_RAMP = 0.65, 0.05


class Schedules:
    """Functions of the steps done so far.

    Parameters
    ----------
    options
        Of the solver.
    total
        Over how many steps they run; after that they stay at their end.
    """

    def __init__(self, options: DqnOptions, total: int) -> None:
        self._options, self._total = options, total

    def imitation(self, steps: int) -> float:
        """Return 0 at first, then more, and 1 in the end."""
        return min(1.0, max(0.0, (steps / self._total - _IMITATION_FROM) / _IMITATION_RAMP))

    def epsilon(self, steps: int) -> float:
        """Return the probability of an action at random."""
        options = self._options
        done = min(1.0, steps / self._total / options.explore_until)
        return options.epsilon + (options.epsilon_end - options.epsilon) * done

    def bonus(self, steps: int) -> float:
        """Return what the value of an untried action is raised by; values are about -1 to 4."""
        done = steps / self._total / self._options.explore_until
        return min(1.0, max(0.0, 2.0 * (1.0 - done)))

    def branches(self, steps: int) -> bool:
        """Whether episodes that begin may leave the policy."""
        return steps < _BRANCHING_UNTIL * self._total

    def learning_rate(self, steps: int) -> float:
        """Return the step size of Adam."""
        options = self._options
        done = max(0.0, steps / self._total - options.decay_from) / (1 - options.decay_from)
        done = min(1.0, done)
        fall: float = (options.learning_rate_end / options.learning_rate) ** done
        return options.learning_rate * fall
