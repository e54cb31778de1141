"""Account of a solved fleet: paths, parallel steps, and the simulator's check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.domains.domain import Account, Listing
from skillplan_swarmitfix.fleet.simulator import simulate
from skillplan_swarmitfix.job import Job

Move = tuple[str, int, int, int]
"""Robot, action, position before and after, both from 0."""


def fleet_account(job: Job, document: Mapping[str, Any]) -> Account:
    """Return every robot's path, and the steps in which swings can run side by side."""
    bench, robots = job.bench, job.robots
    alone = {name: int(bench.distances(goal)[start]) for name, (start, goal) in robots.items()}
    known: dict[str, Any] = {
        **document,
        "independent_bound_sum": sum(alone.values()),
        "independent_bound_max": max(alone.values()),
    }
    plan = job.plans.get(job.config.name)
    if plan is None:
        return Account(known)
    moves = _moves(job, {name: start for name, (start, _) in robots.items()}, plan)
    steps = parallel_steps(job, moves)
    swings_s = _swing_times(job, steps)
    steps_s = [max(times_s) for times_s in swings_s]
    fault = simulate(bench, robots, steps)
    known |= {
        "robots": [
            {
                "robot": name,
                "start": bench.name(start),
                "goal": bench.name(goal),
                "path": [
                    bench.name(start),
                    *(bench.name(after) for robot, _, _, after in moves if robot == name),
                ],
                "swings": sum(robot == name for robot, *_ in moves),
                "swings_alone": alone[name],
            }
            for name, (start, goal) in robots.items()
        ],
        "schedule": [
            [
                [robot, f"B{action}", bench.name(before), bench.name(after)]
                for robot, action, before, after in step
            ]
            for step in steps
        ],
        # Each step is as long as its longest swing.
        "swings_s": swings_s,
        "steps_s": steps_s,
        "parallel_makespan": len(steps),
        "parallel_s": sum(steps_s),
        "simulated": "valid" if fault is None else str(fault),
    }
    return Account(
        known,
        (_listing(job, known),),
        makespan_s=known["parallel_s"],
        parallel_steps=known["parallel_makespan"],
        parallel_bound=known["independent_bound_max"],
    )


def _moves(job: Job, places: dict[str, int], plan: Sequence[str]) -> list[Move]:
    """Return the moves of a plan of skills such as ``r1.B2``."""
    places, moves = dict(places), []
    for skill in plan:
        robot, _, action = skill.rpartition(".B")
        before = places[robot]
        after = int(job.bench.successors[before, int(action)])
        moves.append((robot, int(action), before, after))
        places[robot] = after
    return moves


def parallel_steps(job: Job, moves: Sequence[Move]) -> list[list[Move]]:
    """Return synchronous steps, each move as early as those before it allow.

    Two swings may run at once if they sweep no pin in common; a robot's own follow each other.
    """
    steps: list[list[Move]] = []
    free_from: dict[str, int] = {}
    last_swept: dict[int, int] = {}
    for robot, action, before, after in moves:
        swept = job.bench.swept_pins(before, action)
        step = max(
            [free_from.get(robot, 0), *(last_swept[pin] + 1 for pin in swept if pin in last_swept)]
        )
        free_from[robot] = step + 1
        last_swept.update(dict.fromkeys(swept, step))
        steps += [[] for _ in range(step + 1 - len(steps))]
        steps[step].append((robot, action, before, after))
    return steps


def _swing_times(job: Job, steps: Sequence[Sequence[Move]]) -> list[list[float]]:
    """Return the duration of each swing of each step [s]."""
    degrees, of_swing = job.bench.swing_deg, job.timings.of_swing
    return [
        [of_swing(int(degrees[before, action])) for _, action, before, _ in step] for step in steps
    ]


def _listing(job: Job, known: Mapping[str, Any]) -> Listing:
    rows = tuple(
        (
            entry["robot"],
            entry["start"],
            entry["goal"],
            " ".join(entry["path"]),
            str(entry["swings"]),
            str(entry["swings_alone"]),
        )
        for entry in known["robots"]
    )
    notes = (
        f"parallel   {known['parallel_makespan']} steps side by side, {known['parallel_s']:.1f} s "
        "if each waits for the longest swing of the one before; the farthest robot alone needs "
        f"{known['independent_bound_max']}",
        f"alone      {known['independent_bound_sum']} swings in all, if each had the bench for "
        "itself",
        f"simulated  {known['simulated']}",
    )
    columns = ("robot", "from", "to", "path", "swings", "alone")
    return Listing(f"{job.config.name}: {len(rows)} bases on one bench", columns, rows, notes)
