"""The step limit of an assembly whose file gives none: enough for every order."""

from __future__ import annotations

import math

from skillplan.domains.assembly.schema import AssemblyConfig

MOST_STEPS = 100_000
"""The greatest step limit that a file may give."""

# A part may stay where it lies, however often it is tried, this rarely.
_LEFT_LYING = 1e-3


def step_limit_of(config: AssemblyConfig) -> int:
    """Return the most skills that a sequence may have, as given or else enough for every order.

    That is a pick and a place for every part, a fastening for every screw, and a tool change
    before each of them and at the end, where there is more than one tool. A part whose grasp may
    fail is tried so often that it is left lying once in 1,000 times.
    """
    if config.step_limit is not None:
        return config.step_limit
    skills_of_a_change = 2 if config.tool_change.style == "separate" else 1
    components = len(config.parts) + len(config.screws)
    changes = components + 1 if len(config.tools) > 1 else 1
    picks = sum(_tries(part.grasp_failure) for part in config.parts.values())
    count = picks + components + changes * skills_of_a_change
    return min(count, MOST_STEPS)


def _tries(failure: float) -> int:
    """Return how many grasps leave a part lying once in 1,000 times at most."""
    return 1 if not failure else max(1, math.ceil(math.log(_LEFT_LYING) / math.log(failure) - 1e-9))
