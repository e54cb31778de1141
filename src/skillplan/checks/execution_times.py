"""How long skills take, as back ends tell: each time asked once, and bounds before any is asked."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import reduce
from operator import or_

from skillplan.checks.single_check import execution_time_s, least_execution_time_s, tells_time
from skillplan.checks.ways import Ways
from skillplan.errors import BackEndError
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# A bound and a time may differ by so much through rounding, as a fraction or in seconds.
_ROUNDING = 1e-9


class ExecutionTimes:
    """Times of skills, asked once for every place that robots stand at and tool that they hold.

    Parameters
    ----------
    task
        The task whose skills take time.
    back_ends
        The first that tells a time counts. Those that only screen are not asked: what a skill
        takes must not depend on whether it was screened.
    ways
        Of skills that have several.

    Attributes
    ----------
    basis
        Bits of the facts that a time may depend on, besides the route that a skill takes.
    told
        How many times back ends have told: each one trajectory of a skill from a place.
    """

    def __init__(self, task: Task, back_ends: Iterable[BackEnd], ways: Ways) -> None:
        self._ways = ways
        self._timers = tuple(one for one in back_ends if tells_time(type(one)) and not one.screens)
        self.basis = _stand_bits(task) if self._timers else 0
        self.told = 0
        self._all_bits = task.facts.all_bits
        self._durations_s: dict[tuple[str, int], float | None] = {}
        self._least_s: dict[tuple[str, int, int], float] = {}
        self._masks: dict[str, int] = {}

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the back ends that may tell times."""
        return tuple(one.name for one in self._timers)

    def duration_s(self, skill: Skill, state: State) -> float | None:
        """Return how long the first back end that knows says a skill takes [s], or None.

        Parameters
        ----------
        skill
            With one motion: of a skill with several ways, the skill by the way that is taken.
        state
            Where it starts.

        Raises
        ------
        BackEndError
            If a back end raises, says what is no time, or less than its own bound.
        """
        key = (skill.name, state.bits & self.basis)
        if key not in self._durations_s:
            self._durations_s[key] = self._asked(skill, state)
        return self._durations_s[key]

    def least_s(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the times of a skill where some facts are known [s].

        Infinite where nobody tells any. Asks for no time. Of a skill with several ways the least,
        as which one is taken may depend on the state.

        Raises
        ------
        BackEndError
            If a back end raises, or says what is no time.
        """
        if skill.ways:
            ways = (one.skill for one in self._ways.of(skill))
            return min(self.least_s(one, true_bits, false_bits) for one in ways)
        mask = self._masks.get(skill.name)
        if mask is None:
            # Facts that choose a route count, too: those are all that a skill's own routes name.
            routes = () if skill.motion is None else skill.motion.routes
            mask = reduce(or_, (route.when.bits for route in routes), self.basis)
            self._masks[skill.name] = mask
        key = (skill.name, true_bits & mask, false_bits & mask)
        if key not in self._least_s:
            self._least_s[key] = min(
                (least_execution_time_s(one, skill, *key[1:]) for one in self._timers),
                default=math.inf,
            )
        return self._least_s[key]

    def _asked(self, skill: Skill, state: State) -> float | None:
        for back_end in self._timers:
            said_s = execution_time_s(back_end, skill, state)
            if said_s is None:
                continue
            self.told += 1
            bits = state.bits
            least_s = least_execution_time_s(back_end, skill, bits, self._all_bits & ~bits)
            if said_s < least_s - _ROUNDING * max(1.0, said_s):
                raise BackEndError(
                    f"Back end {back_end.name!r} says that {skill.name} takes {said_s!r} s in "
                    f"{state}, and {least_s!r} s at least."
                )
            return said_s
        return None


def _stand_bits(task: Task) -> int:
    """Return the bits of the facts that say where robots stand and which tools they hold."""
    names = {fact for robot in task.scene.robots for fact in robot.places}
    names |= {tool.fact for robot in task.scene.robots for tool in robot.tools}
    names |= set(task.places)
    bits = 0
    for name in names & set(task.facts.names):
        bits |= task.facts.bit(name)
    return bits
