"""Random fleets on the 6 x 13 bench: how many are solved, how fast, and how near to the bounds.

Starts are drawn evenly one after another among the positions that share no pin with those drawn
before, and goals likewise. Every schedule is followed by the simulator, in steps and in seconds.

Run from the repository: ``python benchmarks/fleet.py [INSTANCES] [swings|makespan] [ROUNDS]``.
"""

from __future__ import annotations

import random
import statistics
import sys
from typing import Any

from skillplan import solve
from skillplan_swarmitfix.bench.bench import Bench, Timings
from skillplan_swarmitfix.fleet.simulator import FleetSwing, simulate, simulate_timed
from skillplan_swarmitfix.fleet.task import fleet_task
from skillplan_swarmitfix.multiagent.fleet import FleetSolver

BENCH = Bench(6, 13, 0.34)


def apart(count: int, rng: random.Random) -> list[int]:
    """Return positions without a common pin."""
    while True:
        found: list[int] = []
        used: set[int] = set()
        for position in rng.sample(range(BENCH.n_positions), BENCH.n_positions):
            legs = set(BENCH.legs[position].tolist())
            if not legs & used and len(found) < count:
                found.append(position)
                used |= legs
        if len(found) == count:
            return found


def instance(count: int, seed: int) -> dict[str, tuple[int, int]]:
    """Return robots with random starts and goals."""
    rng = random.Random(seed)
    ends = zip(apart(count, rng), apart(count, rng), strict=True)
    return {f"r{number}": pair for number, pair in enumerate(ends, start=1)}


def faults(robots: dict[str, tuple[int, int]], trace: dict[str, Any]) -> list[str]:
    """Return what the simulator has against a schedule, in steps and in seconds."""

    def numbers(robot: str, action: str, start: str, end: str) -> tuple[str, int, int, int]:
        return robot, int(action[1:]), BENCH.position(start), BENCH.position(end)

    steps = [[numbers(*swing) for swing in step] for step in trace["schedule"]]
    timed = [
        FleetSwing(*numbers(*names), start_s, end_s)
        for start_s, end_s, *names in trace["timetable"]
    ]
    found = (simulate(BENCH, robots, steps), simulate_timed(BENCH, robots, timed))
    return [str(fault) for fault in found if fault is not None]


def main() -> None:
    """Print a row for every number of bases."""
    instances = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    objective = sys.argv[2] if len(sys.argv) > 2 else "swings"
    rounds = {"rounds": int(sys.argv[3])} if len(sys.argv) > 3 else {}
    options = FleetSolver.Options.model_validate({"objective": objective, **rounds})
    columns = ("solved", "optimal", "median s", "p95 s", "swings", "/ bound", "steps", "/ bound")
    print("bases " + " ".join(f"{column:>9}" for column in columns) + "  invalid")
    for count in range(2, 9):
        walls_s, swings, steps, over_sum, over_max = [], [], [], [], []
        optimal = invalid = 0
        for seed in range(instances):
            robots = instance(count, seed)
            task = fleet_task(BENCH, robots, Timings().swing_s, name=f"fleet-{count}-{seed}")
            result = solve(task, FleetSolver(options), seed=seed)
            if result.cost is None:
                continue
            trace = dict(result.trace)
            invalid += bool(faults(robots, trace))
            optimal += result.status == "optimal"
            walls_s.append(result.wall_s)
            swings.append(result.cost)
            steps.append(trace["parallel_makespan"])
            over_sum.append(result.cost / max(1, trace["independent_bound_sum"]))
            over_max.append(trace["parallel_makespan"] / max(1, trace["independent_bound_max"]))
        p95_s = sorted(walls_s)[max(0, round(0.95 * len(walls_s)) - 1)]
        print(
            f"{count:5} {len(walls_s):6}/{instances:<2} {optimal:9} "
            f"{statistics.median(walls_s):9.4f} {p95_s:9.4f} {statistics.mean(swings):9.1f} "
            f"{statistics.mean(over_sum):9.3f} {statistics.mean(steps):9.1f} "
            f"{statistics.mean(over_max):9.3f} {invalid:8}"
        )


if __name__ == "__main__":
    main()
