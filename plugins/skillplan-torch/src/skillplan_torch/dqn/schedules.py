"""How exploration, imitation and learning rate of deep Q-learning change over a training."""

from __future__ import annotations

from skillplan_torch.dqn.options import DqnOptions

_BONUS, _MASKED_BONUS = 1.0, 5.0
# Over this share of the steps the best return comes in.
_IMITATION_RAMP = 0.05


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
        bonus = _BONUS if options.mask == "none" else _MASKED_BONUS
        self._bonus_at_first = bonus if options.bonus is None else options.bonus

    def optimism(self, steps: int) -> float:
        """Return 1 while exploration is in full swing, then less, and 0 in the end."""
        done = steps / self._total / self._options.explore_until
        return min(1.0, max(0.0, 2.0 * (1.0 - done)))

    def imitation(self, steps: int) -> float:
        """Return 0 at first, then more, and 1 in the end."""
        first = self._options.imitate_from
        return min(1.0, max(0.0, (steps / self._total - first) / _IMITATION_RAMP))

    def exploration(self, steps: int) -> float:
        """Return the bonus, the temperature or epsilon."""
        options = self._options
        done = min(1.0, steps / self._total / options.explore_until)
        if options.exploration == "count":
            return self._bonus_at_first * self.optimism(steps)
        if options.exploration == "epsilon":
            return options.epsilon + (options.epsilon_end - options.epsilon) * done
        fall: float = (options.temperature_end / options.temperature) ** done
        return options.temperature * fall

    def branches(self, steps: int) -> bool:
        """Whether episodes that begin may leave the policy."""
        return steps < self._options.branch_until * self._total

    def learning_rate(self, steps: int) -> float:
        """Return the step size of Adam."""
        options = self._options
        done = max(0.0, steps / self._total - options.decay_from) / (1 - options.decay_from)
        done = min(1.0, done)
        fall: float = (options.learning_rate_end / options.learning_rate) ** done
        return options.learning_rate * fall
