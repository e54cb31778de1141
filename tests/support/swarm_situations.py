"""One base on the bench of the paper, and how short its ways are."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from skillplan.task import Skill, State, Task
from skillplan_swarmitfix import BaseGrounding, BasePath, Bench, Timings

# Table 3 of the paper: from C66 to these goals, one after the other, in so many steps.
HOME = 66
GOALS = (42, 29, 17, 17, 17, 17, 37, 37, 37, 60, 60, 34, 18, 17, 15, 15)
MAKESPANS = (2, 1, 1, 0, 0, 0, 4, 0, 0, 3, 0, 2, 2, 1, 1, 0)
SWING_S = {60: 7.47, 120: 11.63, 180: 15.8}


@cache
def grounding(rows: int = 6, cols: int = 13) -> BaseGrounding:
    """Return what the tasks of one bench share."""
    return BaseGrounding(Bench(rows, cols, 0.34), SWING_S)


def base_task(start: int, goal: int, rows: int = 6, cols: int = 13) -> Task:
    """Return the task of walking between two positions, numbered from 1 as in the paper."""
    return grounding(rows, cols).task(f"C{start}-C{goal}", start - 1, goal - 1)


def legs_of_table_3() -> list[tuple[int, int, int]]:
    """Return start, goal and steps of the sixteen sequences of Table 3."""
    return list(zip((HOME, *GOALS), GOALS, MAKESPANS, strict=False))


def minimal_starts(policy: Mapping[State, Skill], goal: int) -> float:
    """Return from which share of the positions a policy takes the fewest steps to a goal."""
    bench, states = grounding().bench, grounding().states
    fewest = bench.distances(goal - 1)
    minimal = 0
    for start in range(bench.n_positions):
        here, steps = start, 0
        while here != goal - 1 and steps < fewest[start]:
            here = int(bench.successors[here, int(policy[states[here]].name[1:])])
            steps += 1
        minimal += here == goal - 1
    return minimal / bench.n_positions


def shortest_way(bench: Bench, start: int, goal: int) -> BasePath:
    """Return a fastest of the ways of fewest swings, by dynamic programming over distances."""
    timings = Timings()
    distances = bench.distances(goal)
    best: dict[int, tuple[int, BasePath]] = {goal: (0, ())}
    for here in sorted(range(bench.n_positions), key=lambda i: int(distances[i])):
        ways = []
        for action, after in enumerate(bench.successors[here].tolist()):
            if after >= 0 and distances[after] == distances[here] - 1:
                swing_s = timings.of_swing(int(bench.swing_deg[here, action]))
                time_ns, way = best[after]
                ways.append((round(swing_s * 1e9) + time_ns, ((action, here, after), *way)))
        if ways:
            best[here] = min(ways)
    return best[start][1]
