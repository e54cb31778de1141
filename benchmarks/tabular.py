"""Solvers on arrays: time against SARSA in plain Python, paths of the policies, large lattices.

Budgets of the project, once compiled: 35,000 episodes of SARSA in 20 ms and of Monte Carlo in
30 ms, policy iteration in 1 ms, value iteration in 0.2 ms, all at the 78 positions of the bench;
SARSA 7 times as fast as in plain Python, though learners sample the task and plain Python has its
arrays; and a policy for 600 x 1301 positions in 0.2 s.
"""

from __future__ import annotations

import itertools
import random
import statistics
import sys
import time

import numpy as np
from timing import against_baseline

from skillplan.model.tabular_mdp import TabularMDP
from skillplan.pipeline.solving import make_model, make_solver
from skillplan.solvers.mdp.label_setting import compute_costs_to_go
from skillplan_swarmitfix.base.locomotion import BaseGrounding
from skillplan_swarmitfix.bench.bench import Bench

PITCH_M = 0.34
SWING_S = {60: 7.47, 120: 11.63, 180: 15.8}
BENCH = Bench(6, 13, PITCH_M)
GROUNDING = BaseGrounding(BENCH, SWING_S)
BUDGETS_MS = {
    "sarsa": 20.0,
    "monte-carlo": 30.0,
    "q-learning": None,
    "policy-iteration": 1.0,
    "value-iteration": 0.2,
}
SEEDS = 5
START = (
    "import sys; sys.argv=['']; "
    "from skillplan.solvers.learning.episode_kernels import random_bits; "
    "import numpy; random_bits(numpy.zeros(1, dtype=numpy.uint64))"
)


def main() -> None:
    """Print the tables."""
    plain_s = statistics.median(plain_sarsa_s(seed) for seed in range(3))
    print(f"SARSA, 35,000 episodes, plain Python: {1000 * plain_s:.0f} ms\n")
    solvers(plain_s)
    print()
    lattices()
    print()
    timing = against_baseline((sys.executable, "-c", START), runs=5)
    print(f"numba and one kernel from the cache: {timing.wall_s:.2f} s, {timing.ratio:.0f} x pass")


def solvers(plain_s: float) -> None:
    """Print how long the solvers take to all goals, and from which share of starts they are best.

    Parameters
    ----------
    plain_s
        Time of SARSA in plain Python [s].
    """
    print(
        f"{'78 goals':18} {'median [ms]':>12} {'p90 [ms]':>9} {'budget [ms]':>12} {'ratio':>8} "
        f"{'step-minimal starts, by seed':>30}"
    )
    for name, budget_ms in BUDGETS_MS.items():
        times_ms, shares = [], []
        for seed in range(SEEDS if name in ("sarsa", "monte-carlo", "q-learning") else 1):
            found = [solved(name, goal, seed) for goal in range(BENCH.n_positions)]
            times_ms += [1000 * learning_s for learning_s, _ in found]
            shares.append(statistics.mean(share for _, share in found))
        median_ms = statistics.median(times_ms)
        budget = "-" if budget_ms is None else f"{budget_ms:.1f}"
        print(
            f"{name:18} {median_ms:12.3f} {np.quantile(times_ms, 0.9):9.3f} {budget:>12} "
            f"{1000 * plain_s / median_ms:8.0f}   {' '.join(f'{100 * s:.2f}%' for s in shares)}"
        )


def solved(name: str, goal: int, seed: int) -> tuple[float, float]:
    """Return the time [s] of a solver, and from which share of starts its paths are shortest."""
    model = make_model(GROUNDING.task("", (goal + 1) % BENCH.n_positions, goal))
    solution = make_solver(name, {}).solve(model, seed=seed)
    assert solution.policy is not None
    fewest = BENCH.distances(goal)
    minimal = 0
    for start in range(BENCH.n_positions):
        here, steps = start, 0
        while here != goal and steps < fewest[start]:
            action = int(solution.policy[GROUNDING.states[here]].name[1:])
            here, steps = int(BENCH.successors[here, action]), steps + 1
        minimal += here == goal
    return solution.trace["learning_s"], minimal / BENCH.n_positions


def lattices() -> None:
    """Print how the time of a policy to one goal grows with the bench."""
    print(f"{'rows x cols':>12} {'positions':>10} {'[ms]':>8} {'[ns] a position':>16}")
    for rows, cols in ((6, 13), (75, 163), (150, 325), (300, 651), (600, 1301)):
        bench = Bench(rows, cols, PITCH_M)
        goal = np.zeros(bench.n_positions, dtype=np.bool_)
        goal[bench.n_positions // 2] = True
        offsets = np.arange(bench.n_positions + 1) * bench.actions
        successors = bench.successors.ravel()
        times_s = []
        for _ in range(8):
            begin_s = time.perf_counter()
            compute_costs_to_go(offsets, successors, goal)
            times_s.append(time.perf_counter() - begin_s)
        wall_s = statistics.median(times_s[1:])
        print(
            f"{rows:5} x {cols:<4} {bench.n_positions:10,} {1e3 * wall_s:8.2f} "
            f"{1e9 * wall_s / bench.n_positions:16.0f}"
        )


def plain_sarsa_s(seed: int, episodes: int = 35_000) -> float:
    """Return the time [s] of SARSA as in the paper's Table 2, on lists in plain Python."""
    mdp = TabularMDP.from_model(make_model(GROUNDING.task("", 65, 41)))
    offsets, successors, rewards = mdp.rows.tolist(), mdp.successors.tolist(), mdp.rewards.tolist()
    goal = mdp.goal.tolist()
    q = [[0.0] * (end - begin) for begin, end in itertools.pairwise(offsets)]
    starts = [state for state, values in enumerate(q) if values]
    rng = random.Random(seed)

    def choose(state: int) -> int:
        values = q[state]
        return rng.randrange(len(values)) if rng.random() < 0.1 else values.index(max(values))

    begin_s = time.perf_counter()
    for _ in range(episodes):
        state = starts[rng.randrange(len(starts))]
        action = choose(state)
        for _ in range(1_000):
            row = offsets[state] + action
            following = successors[row]
            ahead, next_action = 0.0, -1
            if not goal[following]:
                next_action = choose(following)
                ahead = q[following][next_action]
            q[state][action] += 0.1 * (rewards[row] + 0.999 * ahead - q[state][action])
            if goal[following]:
                break
            state, action = following, next_action
    return time.perf_counter() - begin_s


if __name__ == "__main__":
    main()
