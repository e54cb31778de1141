"""A detector of tests that tells how long skills take, with a bound as tight as is wished."""

import random
from functools import reduce
from operator import or_

from skillplan.collision import PrecedenceDetector


class Clock(PrecedenceDetector):
    """The chart, and times drawn by skill, place and tool.

    Attributes
    ----------
    tightness
        From 0, where the bound of a skill is that of the least that it can take, to 1, where it is
        the time itself.
    stands
        Bits of the facts that say where robots stand and which tools they hold.
    asked
        Skills timed, with the bits of place and tool.
    """

    name = "clock"
    tightness = 0.5
    seed = 0

    def __init__(self, task, options=None):
        super().__init__(task, options)
        robots = task.scene.robots
        places = {fact for robot in robots for fact in robot.places}
        places |= {tool.fact for robot in robots for tool in robot.tools}
        self.stands = reduce(or_, map(task.facts.bit, places), 0)
        self.asked = []

    def duration_s(self, skill, state):
        """Return the time from where the robot stands, with the tool that it holds."""
        self.asked.append((skill.name, state.bits & self.stands))
        return self._least(skill) + self._more(skill, state.bits)

    def least_duration_s(self, skill, true_bits, false_bits):
        """Return part of the time where place and tool are known; else what it takes anywhere."""
        if (true_bits | false_bits) & self.stands != self.stands:
            return self._least(skill)
        return self._least(skill) + self.tightness * self._more(skill, true_bits)

    def _least(self, skill):
        return round(random.Random(f"{self.seed} {skill.name}").uniform(0.5, 2.0), 9)

    def _more(self, skill, bits):
        key = f"{self.seed} {skill.name} {bits & self.stands}"
        return round(random.Random(key).uniform(0.0, 3.0), 9)


def clock(task, tightness=0.5, seed=0):
    """Return a clock of a task."""
    timer = Clock(task)
    timer.tightness, timer.seed = tightness, seed
    return timer
