"""Joint angles for reachable random poses: how many are found, how near, in what time.

Poses are those of the tip at joint angles drawn evenly within the limits, the same in every run:
``python benchmarks/inverse_kinematics.py 10000``. Times are of one core, and also in terms of
pinocchio's forward kinematics of the same poses.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from skillplan.robots.catalogue import PANDA, UR5E
from skillplan_pinocchio.kinematics.numeric_inverse import NumericInverse, Unreached
from skillplan_pinocchio.kinematics.serial_arm import SerialArm, Vector
from skillplan_pinocchio.kinematics.ur_inverse import UrInverse

Solve = Callable[[Any], list[Vector]]
# A solution is this near, in position [m] and rotation [rad].
ACCURACY = 1e-6


def timed(call: Callable[[Any], Any], questions: list[Any]) -> tuple[list[Any], list[float]]:
    """Return answers, and how long each took [s]."""
    answers, spent_s = [], []
    for question in questions:
        begin_s = time.perf_counter()
        answers.append(call(question))
        spent_s.append(time.perf_counter() - begin_s)
    return answers, spent_s


def numeric(arm: SerialArm) -> Solve:
    """Return the solver of any arm, as one that gives a list."""
    inverse = NumericInverse(arm)

    def solve(target: Any) -> list[Vector]:
        found = inverse.solve(target)
        return [] if isinstance(found, Unreached) else [found]

    return solve


def residual(arm: SerialArm, joints: Vector, target: Any) -> float:
    """Return how far a posture is from a pose, in metres or radians, whichever is more."""
    here = arm.tip(joints)
    return float(
        max(
            np.linalg.norm(here.translation - target.translation),
            np.linalg.norm(pin.log3(here.rotation.T @ target.rotation)),
        )
    )


def row(name: str, arm: SerialArm, solve: Solve, count: int) -> bool:
    """Print a row; return whether all that was found is at its pose, within the limits."""
    rng = np.random.default_rng(7)
    postures = list(rng.uniform(arm.low_rad, arm.high_rad, (count, arm.model.nq)))
    targets, forward_s = timed(arm.tip, postures)
    answers, spent_s = timed(solve, targets)
    worst = 0.0
    for found, target in zip(answers, targets, strict=True):
        for joints in found:
            within = (joints >= arm.low_rad).all() and (joints <= arm.high_rad).all()
            worst = max(worst, residual(arm, joints, target) if within else np.inf)
    solved = sum(bool(found) for found in answers) / count
    each = sum(len(found) for found in answers) / max(1, sum(bool(found) for found in answers))
    median_s = statistics.median(spent_s)
    print(
        f"{name:18}{solved:10.2%}{each:10.1f}{worst:12.1e}{1e3 * median_s:14.3f}"
        f"{1e3 * np.quantile(spent_s, 0.99):12.3f}{median_s / statistics.median(forward_s):14.0f}"
    )
    return worst < ACCURACY


def main() -> int:
    """Print a row for every arm and solver; return 1 if an answer is wrong."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(f"{count} reachable poses of each arm\n")
    columns = (f"{'solved':>10}", f"{'postures':>10}", f"{'residual':>12}")
    columns += (f"{'median [ms]':>14}", f"{'99 % [ms]':>12}", f"{'x forward':>14}")
    print(f"{'arm, solver':18}" + "".join(columns))
    panda, ur5e = SerialArm(PANDA), SerialArm(UR5E)
    return int(
        not all(
            [
                row("Panda, numeric", panda, numeric(panda), count),
                row("UR5e, numeric", ur5e, numeric(ur5e), count),
                row("UR5e, closed form", ur5e, UrInverse(ur5e).solve, count),
            ]
        )
    )


if __name__ == "__main__":
    sys.exit(main())
