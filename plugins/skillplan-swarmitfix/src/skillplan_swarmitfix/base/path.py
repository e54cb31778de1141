"""Paths of the base: the positions that a plan of swings leads through."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan_swarmitfix.bench.bench import Bench

BaseStep = tuple[int, int, int]
"""Action, position before, position after."""
BasePath = tuple[BaseStep, ...]


def along(bench: Bench, start: int, skills: Sequence[str]) -> BasePath:
    """Return the path of a plan (policy to path conversion; paper, section 4.1.3).

    Parameters
    ----------
    bench
        The lattice.
    start
        Position at the start.
    skills
        Names of skills of a base task, such as ``B2``; staying adds no step.

    Raises
    ------
    ValueError
        If a swing leads off the bench.
    """
    path: list[BaseStep] = []
    here = start
    for skill in skills:
        action = int(skill.removeprefix("B"))
        after = int(bench.successors[here, action])
        if after < 0:
            raise ValueError(f"{skill} leads off the bench from {bench.name(here)}.")
        if action:
            path.append((action, here, after))
        here = after
    return tuple(path)
