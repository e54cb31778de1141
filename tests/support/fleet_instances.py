"""Several bases on small benches, and breadth-first searches that know nothing but pins."""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from itertools import combinations

from skillplan.task import Task
from skillplan_swarmitfix import Bench, fleet_task

SWING_S = {60: 7.47, 120: 11.63, 180: 15.80, 240: 19.97, 300: 24.13}
Robots = dict[str, tuple[int, int]]
Places = tuple[int, ...]


def apart(bench: Bench, count: int, rng: random.Random) -> list[int]:
    """Return positions without a common pin, drawn evenly one after another."""
    for _ in range(1_000):
        results: list[int] = []
        used: set[int] = set()
        for position in rng.sample(range(bench.n_positions), bench.n_positions):
            legs = set(bench.legs[position].tolist())
            if not legs & used:
                results.append(position)
                used |= legs
                if len(results) == count:
                    return results
    raise AssertionError(f"{count} bases do not fit on {bench.rows} x {bench.cols}")


def random_robots(bench: Bench, count: int, seed: int) -> Robots:
    """Return robots with random starts and goals."""
    rng = random.Random(seed)
    starts, goals = apart(bench, count, rng), apart(bench, count, rng)
    return {f"r{i + 1}": ends for i, ends in enumerate(zip(starts, goals, strict=True))}


def task_of(bench: Bench, robots: Mapping[str, tuple[int, int]], **more: int) -> Task:
    """Return the task of some robots."""
    return fleet_task(bench, robots, SWING_S, name="fleet", **more)


def pin_steps(bench: Bench, places: Places) -> Iterator[tuple[int, Places]]:
    """Yield the number of swings, and what follows, of every step that keeps pins apart."""

    def extend(i: int, used: frozenset[int], swings: int, ends: Places) -> Iterator:
        if i == len(places):
            yield swings, ends
            return
        for action, end in enumerate(bench.successors[places[i]].tolist()):
            if end >= 0:
                pins = bench.swept_pins(places[i], action)
                if not pins & used:
                    yield from extend(i + 1, used | pins, swings + bool(action), (*ends, end))

    return extend(0, frozenset(), 0, ())


def fewest(bench: Bench, robots: Robots, *, at_once: bool) -> int | None:
    """Return the fewest parallel steps, or else swings one after another; None for no way."""
    start = tuple(start for start, _ in robots.values())
    goal = tuple(goal for _, goal in robots.values())
    level, seen, count = {start}, {start}, 0
    while level:
        if goal in level:
            return count
        level = {
            to
            for places in level
            for swings, to in pin_steps(bench, places)
            if (at_once or swings == 1) and to not in seen
        }
        seen |= level
        count += 1
    return None


def pins_are_disjoint(bench: Bench, places: Places) -> bool:
    """Whether bases at these positions share no pin."""
    legs = [set(bench.legs[place].tolist()) for place in places]
    return not any(first & other for first, other in combinations(legs, 2))
