"""Steps per second of `dqn` compared with Stable-Baselines3's DQN, on the paper's board.

Both get the rewards of Table II and one thread per process. `dqn` has its defaults, observation
`markov` and the applicable mask, and in one row the paper's observation without a mask, as
Stable-Baselines3 has. Settings take turns, are timed once warm, and are compared with
Stable-Baselines3's defaults in as many processes, and with its setting of equal updates per step.
Its runs learn one after another, `dqn`'s in groups of five, as in `skillplan train`. Budgets:
twice its steps per second with the defaults of both, 3 times at equal updates.

Stable-Baselines3 comes with the extra `rl` of skillplan-torch. `learning_table` compares results of
learners.

Run from the repository: ``python benchmarks/learning.py [--steps N] [--rounds N]``.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier
from pathlib import Path
from typing import Any

BASELINE = "stable-baselines3"
BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"
OBSERVATION = {"observation": "markov"}
BLIND = {"observation": "markov", "mask": "none"}
PAPER = {"observation": "paper", "mask": "none"}
BUDGET, EQUAL_BUDGET = 2.0, 3.0
# Updates a step that differ by less are the same.
ALIKE = 0.02
GROUP = 5
LEAST_STEPS = 1_000
STRIDE_STEPS = 100
# Untimed steps, for imports and compilation.
WARM_UP_STEPS = 200
# Time after which a process counts as hung [s].
PATIENCE_S = 3_600.0
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Setting:
    """A way to train runs.

    Parameters
    ----------
    name
        Name in the table.
    groups
        Number of runs of every group; groups are distributed over the processes.
    processes
        Number of processes, with equal numbers of groups.
    options
        Options of Stable-Baselines3's DQN; None for `dqn`.
    presentation
        Observation and mask.
    """

    name: str
    groups: tuple[int, ...]
    processes: int
    options: dict[str, int] | None = None
    presentation: Mapping[str, str] = field(default_factory=lambda: BLIND)

    @property
    def is_baseline(self) -> bool:
        """True for the setting that others are compared with."""
        return self.options == {}


@dataclass(frozen=True)
class Share:
    """Result of a process.

    Parameters
    ----------
    wall_s, cpu_s
        Wall and processor time [s].
    updates, learned_from
        Updates per environment step, and transitions in their batches.
    """

    wall_s: float
    cpu_s: float
    updates: float
    learned_from: float


class Clock:
    """Time since its construction."""

    def __init__(self) -> None:
        self._begin_s = time.perf_counter(), time.process_time()

    def read(self) -> tuple[float, float]:
        """Return wall and processor time [s]."""
        return time.perf_counter() - self._begin_s[0], time.process_time() - self._begin_s[1]


SETTINGS = (
    Setting("Stable-Baselines3, defaults", (1,), 1, {}),
    Setting("Stable-Baselines3, defaults", (1, 1), 2, {}),
    Setting("Stable-Baselines3, train_freq 2", (1,), 1, {"train_freq": 2, "gradient_steps": 1}),
    Setting("Stable-Baselines3, train_freq 1", (1,), 1, {"train_freq": 1, "gradient_steps": 1}),
    Setting("dqn, a run alone", (1,), 1, None, OBSERVATION),
    Setting("dqn, groups of five", (GROUP, GROUP), 1, None, OBSERVATION),
    Setting("dqn, groups of five", (GROUP, GROUP), 2, None, OBSERVATION),
    Setting("dqn, paper's bits, no mask", (GROUP, GROUP), 1, None, PAPER),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=f"Steps a second of dqn and of {BASELINE}.")
    parser.add_argument("--steps", type=int, default=5_000, help="environment steps of a run")
    parser.add_argument("--rounds", type=int, default=2, help="how often the settings take turns")
    args = parser.parse_args()
    if args.steps < LEAST_STEPS or args.rounds < 1:
        parser.error(f"it takes at least {LEAST_STEPS:,} steps and 1 round")
    rounds = [
        [run_turn(setting, args.steps, 100 * number) for setting in SETTINGS]
        for number in range(args.rounds)
    ]
    print_table(rounds, args.steps)


def run_turn(setting: Setting, steps: int, seed: int) -> list[Share]:
    """Return the results of all processes, which run at the same time.

    Parameters
    ----------
    setting
        The setting.
    steps
        Environment steps of a run.
    seed
        Seed of the first run; the others count up.
    """
    spawn = multiprocessing.get_context("spawn")
    os.environ.update(dict.fromkeys(THREADS, "1"))
    barrier = spawn.Barrier(setting.processes)
    started: list[tuple[multiprocessing.process.BaseProcess, Connection]] = []
    try:
        for index in range(setting.processes):
            here, there = spawn.Pipe(duplex=False)
            groups = setting.groups[index :: setting.processes]
            seeds = seed + index * sum(groups)
            process = spawn.Process(
                target=work,
                args=(there, barrier, setting, groups, steps, seeds),
                daemon=True,
            )
            process.start()
            there.close()
            started.append((process, here))
        return [receive(setting, here) for _, here in started]
    finally:
        for process, here in started:
            here.close()
            process.kill()
            process.join()


def receive(setting: Setting, pipe: Connection) -> Share:
    """Return the result of a process, or end the program with its error."""
    try:
        message: Share | str = pipe.recv()
    except EOFError:
        message = "its process has ended"
    if isinstance(message, str):
        sys.exit(f"{setting.name} cannot be timed: {message}")
    return message


def work(
    pipe: Connection,
    barrier: Barrier,
    setting: Setting,
    groups: tuple[int, ...],
    steps: int,
    seed: int,
) -> None:
    """Train groups one after another, once every process is warm; print their results.

    Parameters
    ----------
    pipe
        Receives the result or an error message.
    barrier
        Barrier at which all processes wait until they are warm.
    setting
        The setting.
    groups
        Number of runs of each group.
    steps
        Environment steps of a run.
    seed
        Seed of the first run; the others count up.
    """
    try:
        import torch

        torch.set_num_threads(1)
        train = train_dqn if setting.options is None else train_baseline
        train(setting, 1, WARM_UP_STEPS, seed)
        barrier.wait(PATIENCE_S)
        trained = []
        for runs in groups:
            trained.append(train(setting, runs, steps, seed))
            seed += runs
        pipe.send(
            Share(
                wall_s=sum(share.wall_s for share in trained),
                cpu_s=sum(share.cpu_s for share in trained),
                updates=statistics.mean(share.updates for share in trained),
                learned_from=statistics.mean(share.learned_from for share in trained),
            )
        )
    except Exception as error:
        barrier.abort()
        pipe.send(f"{type(error).__name__}: {error}")


def train_dqn(setting: Setting, runs: int, steps: int, seed: int) -> Share:
    """Train runs side by side, as `skillplan train` does."""
    from skillplan.env.skill_vector_env import SkillVectorEnv
    from skillplan.pipeline.setup import load_problem
    from skillplan.pipeline.solving import make_model, make_solver

    env = SkillVectorEnv(make_model(load_problem(BOARD).task), runs, **setting.presentation)
    learner = make_solver("dqn", setting.presentation)
    clock = Clock()
    training = learner.begin(env, range(seed, seed + runs), steps)
    while training.steps < steps:
        training.advance(min(STRIDE_STEPS, steps - training.steps))
        training.figures()
    wall_s, cpu_s = clock.read()
    options = learner.options
    often = learner.derived([model.task for model in env.models]).get("updates", options.updates)
    updates = often * max(0, steps - options.warm_up) / steps
    return Share(wall_s, cpu_s, updates, updates * options.batch)


def train_baseline(setting: Setting, runs: int, steps: int, seed: int) -> Share:
    """Train runs of Stable-Baselines3 one after another."""
    from stable_baselines3 import DQN

    env = board(setting.presentation)
    wall_s, cpu_s, updates = 0.0, 0.0, 0
    for run in range(runs):
        clock = Clock()
        learner = DQN("MlpPolicy", env, seed=seed + run, device="cpu", **(setting.options or {}))
        learner.learn(steps)
        took_s = clock.read()
        wall_s, cpu_s = wall_s + took_s[0], cpu_s + took_s[1]
        updates += learner._n_updates
    per_step = updates / (runs * steps)
    return Share(wall_s, cpu_s, per_step, per_step * learner.batch_size)


def board(presentation: Mapping[str, str]) -> Any:
    """Return the paper's board as a single environment."""
    import gymnasium

    return gymnasium.make("skillplan.env:skillplan/Task-v0", task=BOARD, **presentation)


def print_table(rounds: list[list[list[Share]]], steps: int) -> None:
    """Print a row for every setting; rates and ratios are medians over the rounds."""
    print(
        f"{f'runs of {steps:,} steps':31} {'runs':>4} {'processes':>9} {'steps/s':>8} "
        f"{'a process':>9} {'ratio':>6} {'lowest':>6} {'by CPU time':>11} {'alike':>6} "
        f"{'updates':>7} {'learned from':>12}"
    )
    for at, setting in enumerate(SETTINGS):
        base_at = next(
            i
            for i, other in enumerate(SETTINGS)
            if other.is_baseline and other.processes == setting.processes
        )
        rate = statistics.median(rates(setting, turns[at], steps)[0] for turns in rounds)
        ratios, by_cpu = zip(
            *(
                (own / base, own_cpu / base_cpu)
                for (own, own_cpu), (base, base_cpu) in (
                    (
                        rates(setting, turns[at], steps),
                        rates(SETTINGS[base_at], turns[base_at], steps),
                    )
                    for turns in rounds
                )
            ),
            strict=True,
        )
        runs, share = sum(setting.groups), rounds[0][at][0]
        alike = [
            own / rates(other, turns[i], steps)[0] * other.processes / setting.processes
            for turns in rounds
            for own in (rates(setting, turns[at], steps)[0],)
            for i, other in enumerate(SETTINGS)
            if other.options and abs(turns[i][0].updates - share.updates) < ALIKE
        ]
        equal = f"{statistics.median(alike):6.2f}" if alike else f"{'-':>6}"
        print(
            f"{setting.name:31} {runs:4} {setting.processes:9} "
            f"{rate:8,.0f} {rate / setting.processes:9,.0f} "
            f"{statistics.median(ratios):6.2f} {min(ratios):6.2f} "
            f"{statistics.median(by_cpu):11.2f} {equal} {share.updates:7.2f} "
            f"{share.learned_from:12.1f}"
        )
    print(
        f"Updates and transitions are per step; ratios are to {BASELINE}'s defaults\nin as many "
        f"processes, budget {BUDGET:.0f}; alike, per process, to its setting of equal updates, "
        f"budget {EQUAL_BUDGET:.0f}."
    )


def rates(setting: Setting, shares: list[Share], steps: int) -> tuple[float, float]:
    """Return environment steps per second of wall and of processor time."""
    total = sum(setting.groups) * steps
    return total / max(share.wall_s for share in shares), total / sum(
        share.cpu_s for share in shares
    )


if __name__ == "__main__":
    main()
