"""Trajectories by toppra against one trapezoid a path: seconds of the plan, and of computing.

The paths are those of the inverter board's optimal plan, checked by swept hulls. The trapezoid is
the best that gives the parameter of a path constant acceleration, constant speed and constant
deceleration: of a joint's acceleration a share is kept for the bends of the path. Run from the
repository: ``python benchmarks/trajectories.py``.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np

from skillplan import Setup, load_problem, solve
from skillplan.records.result import Result
from skillplan.task.task import Task
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.swept import SweptDetector
from skillplan_pinocchio.timing.trajectory import JointLimits, find_fastest_trajectory

BOARD = "configs/inverter_board.yaml"
SWEPT = Setup(collision=("swept",), with_chart=False)
SHARES = tuple(step / 40 for step in range(1, 40))
ROUNDS = 5
SAMPLES = 1_000

Timing = Callable[[JointPath], float]


def paths_of(task: Task, result: Result) -> list[tuple[JointPath, int]]:
    """Return the paths of a plan, in order, each with how often it is run through in turn."""
    paths = SweptDetector(task).paths
    state = task.initial
    _, here = paths.stand(state)
    assert here is not None
    found = []
    for step in result.steps:
        skill = task.skill(step.skill)
        for motion in paths.motions(skill, state):
            down = motion.elbows[0].strokes.down[0]
            found += [(JointPath([here, down.nodes[0]]), 1), (down, 2)]
            here = down.nodes[0]
        state = skill.prediction.apply(state)
    return found


def trapezoid_s(path: JointPath, limits: JointLimits) -> float:
    """Return how long the best trapezoid of the path's parameter takes [s]."""
    steepest = path.steepest
    # The second derivative changes evenly between nodes, so that it is greatest at one.
    bends = path.derivatives(np.linspace(0.0, 1.0, len(path.nodes)))[1]
    sharpest = np.abs(bends).max(axis=0)
    if float(steepest.max()) <= 1e-9:
        return 0.0
    top_gain = np.array(limits.acceleration_rad_per_s2)
    speed = float((np.array(limits.speed_rad_per_s) / np.maximum(steepest, 1e-12)).min())
    bend = float((top_gain / np.maximum(sharpest, 1e-12)).min())
    gain = float((top_gain / np.maximum(steepest, 1e-12)).min())
    return min(
        _ramps_s(min(speed, math.sqrt(share * bend)), (1 - share) * gain) for share in SHARES
    )


def _ramps_s(speed_per_s: float, acceleration_per_s2: float) -> float:
    if speed_per_s**2 >= acceleration_per_s2:
        return 2 / math.sqrt(acceleration_per_s2)
    return 1 / speed_per_s + speed_per_s / acceleration_per_s2


def measured(paths: list[tuple[JointPath, int]], timing: Timing) -> tuple[float, float, float]:
    """Return the time of the paths [s], and the median and most CPU time that one took [s]."""
    cpu_s = []
    for _ in range(ROUNDS):
        took_s = []
        for path, _ in paths:
            begin_s = time.process_time()
            timing(path)
            took_s.append(time.process_time() - begin_s)
        cpu_s.append(took_s)
    best = [min(values) for values in zip(*cpu_s, strict=True)]
    total_s = sum(times * timing(path) for path, times in paths)
    return total_s, statistics.median(best), sum(best)


def most_used(path: JointPath, limits: JointLimits) -> float:
    """Return the most that toppra's run uses of a limit of speed or acceleration, at samples."""
    run = find_fastest_trajectory(path, limits)
    samples = [run.at(time_s) for time_s in np.linspace(0.0, run.duration_s, SAMPLES).tolist()]
    speeds = np.abs([speed for _, speed, _ in samples]) / limits.speed_rad_per_s
    gains = np.abs([gain for _, _, gain in samples]) / limits.acceleration_rad_per_s2
    return float(max(speeds.max(), gains.max()))


def main() -> None:
    """Print a row for either way of timing, and their ratio."""
    task = load_problem(BOARD).task
    result = solve(task, "exact", SWEPT)
    assert result.makespan_s is not None
    limits = JointLimits.of(task.scene.robots[0].model).scaled(
        SweptDetector.Options().speed_fraction
    )
    paths = paths_of(task, result)
    ways: dict[str, Timing] = {
        "trapezoid": lambda path: trapezoid_s(path, limits),
        "toppra": lambda path: find_fastest_trajectory(path, limits).duration_s,
    }
    found = {name: measured(paths, timing) for name, timing in ways.items()}
    resting_s = result.makespan_s - found["toppra"][0]
    print(
        f"{len(result.steps)} skills of {task.name}, {len(paths)} paths, best of {ROUNDS} rounds\n"
    )
    columns = ("moving [s]", "plan [s]", "CPU/path [ms]", "CPU/plan [ms]")
    print(f"{'timing':12}" + "".join(f"{column:>15}" for column in columns))
    for name, (moving_s, path_s, all_s) in found.items():
        row = (moving_s, moving_s + resting_s, 1e3 * path_s, 1e3 * all_s)
        print(f"{name:12}" + "".join(f"{value:15.3f}" for value in row))
    one, other = found.values()
    print(f"\nthe arm moves for {other[0] / one[0]:.3f} of the trapezoids' time")
    share = max(most_used(path, limits) for path, _ in paths)
    print(f"of a limit at most {share:.6f} is used at {SAMPLES} samples a path")


if __name__ == "__main__":
    main()
