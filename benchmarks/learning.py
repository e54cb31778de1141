"""Deep Q-learning: steps a second against Stable-Baselines3's, on the paper's board.

Both get the rewards of Table II, with one thread a process. `dqn` has its defaults, which are the
observation `markov` and the applicable mask, and as a row of its own the paper's observation
without a mask; Stable-Baselines3's knows no mask. Settings take turns; each is timed once it is
warm, and compared with Stable-Baselines3's defaults in as many processes of the same round, and
with its setting of as many updates a step. Its runs learn one after another in a process, `dqn`'s
in groups of five side by side, as `skillplan train` has them. Budgets of the project: twice its
steps a second with the defaults of both, and 3 times at equal updates.

A transition learned from is one of a batch of an update.

Stable-Baselines3, and sb3-contrib for ``--boards``, are no part of the project: they are installed
apart, into a folder of their own, and share torch and Gymnasium with this interpreter.

Run from the repository: ``python benchmarks/learning.py [--steps N] [--rounds N] [--folder DIR]``.
With ``--boards`` it shows what learners come to on boards at random instead: `learning_boards`;
with ``--ablation`` what options of `dqn` are worth: `learning_ablation`.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Barrier
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import learning_ablation
import learning_baselines
import learning_boards

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
# What is imported or compiled on first use is not timed.
WARM_UP_STEPS = 200
# A process that does not get this far has hung.
PATIENCE_S = 3_600.0
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Setting:
    """How runs are trained.

    Parameters
    ----------
    name
        What the table calls it.
    groups
        Of how many runs every group is; groups are shared out among the processes.
    processes
        How many, all of which get as many groups.
    options
        Of Stable-Baselines3's DQN beside its defaults; None for `dqn` with its own.
    presentation
        What is observed, and what may be chosen.
    """

    name: str
    groups: tuple[int, ...]
    processes: int
    options: dict[str, int] | None = None
    presentation: Mapping[str, str] = field(default_factory=lambda: BLIND)

    @property
    def is_baseline(self) -> bool:
        """Whether others are compared with it."""
        return self.options == {}


@dataclass(frozen=True)
class Share:
    """What a process has trained.

    Parameters
    ----------
    wall_s, cpu_s
        Time that it took, and that of the processor.
    updates, learned_from
        Of an environment step: updates, and transitions in their batches.
    completing
        How many policies complete the task when followed greedily.
    """

    wall_s: float
    cpu_s: float
    updates: float
    learned_from: float
    completing: int


class Clock:
    """Time since it was made."""

    def __init__(self) -> None:
        self._begin_s = time.perf_counter(), time.process_time()

    def read(self) -> tuple[float, float]:
        """Return the time, and that of the processor [s]."""
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
    """Install what is compared with, and print the table."""
    parser = argparse.ArgumentParser(description=f"Steps a second of dqn and of {BASELINE}.")
    parser.add_argument("--steps", type=int, default=5_000, help="environment steps of a run")
    parser.add_argument("--rounds", type=int, default=2, help="how often the settings take turns")
    parser.add_argument("--folder", type=Path, help=f"where {BASELINE} is, or is installed")
    learning_boards.add_options(parser)
    learning_ablation.add_options(parser)
    args = parser.parse_args()
    if args.ablation:
        learning_ablation.show(args)
        return
    if args.steps < LEAST_STEPS or args.rounds < 1:
        parser.error(f"it takes at least {LEAST_STEPS:,} steps and 1 round")
    with ExitStack() as stack:
        folder = args.folder or Path(stack.enter_context(TemporaryDirectory()))
        if args.boards:
            learning_boards.show(args, folder)
            return
        learning_baselines.install(folder, learning_baselines.PACKAGES[:1])
        rounds: list[list[list[Share]]] = []
        for number in range(args.rounds):
            rounds.append([turn(setting, args.steps, 100 * number, folder) for setting in SETTINGS])
    table(rounds, args.steps)


def turn(setting: Setting, steps: int, seed: int, folder: Path) -> list[Share]:
    """Return what every process has trained, all at once.

    Parameters
    ----------
    setting
        How.
    steps
        Environment steps of a run.
    seed
        Of the first run; the others' count up.
    folder
        Where Stable-Baselines3 is.
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
                args=(there, barrier, setting, groups, steps, seeds, folder),
                daemon=True,
            )
            process.start()
            there.close()
            started.append((process, here))
        return [received(setting, here) for _, here in started]
    finally:
        for process, here in started:
            here.close()
            process.kill()
            process.join()


def received(setting: Setting, pipe: Connection) -> Share:
    """Return what a process says, or end the program with why it cannot."""
    try:
        said: Share | str = pipe.recv()
    except EOFError:
        said = "its process has ended"
    if isinstance(said, str):
        sys.exit(f"{setting.name} cannot be timed: {said}")
    return said


def work(
    pipe: Connection,
    barrier: Barrier,
    setting: Setting,
    groups: tuple[int, ...],
    steps: int,
    seed: int,
    folder: Path,
) -> None:
    """Train groups one after another, once every process is warm; print their results.

    Parameters
    ----------
    pipe
        Takes what was trained, or why it could not be.
    barrier
        Where all processes wait until they are warm.
    setting
        How.
    groups
        How many runs each group has.
    steps
        Environment steps of a run.
    seed
        Of the first run; the others' count up.
    folder
        Where Stable-Baselines3 is.
    """
    try:
        import torch

        torch.set_num_threads(1)
        if setting.options is None:
            train = train_dqn
        else:
            sys.path.insert(0, str(folder))
            train = train_baseline
        train(setting, 1, WARM_UP_STEPS, seed)
        barrier.wait(PATIENCE_S)
        trained = []
        for runs in groups:
            trained.append(train(setting, runs, steps, seed))
            seed += runs
        pipe.send(
            Share(
                wall_s=sum(one.wall_s for one in trained),
                cpu_s=sum(one.cpu_s for one in trained),
                updates=statistics.mean(one.updates for one in trained),
                learned_from=statistics.mean(one.learned_from for one in trained),
                completing=sum(one.completing for one in trained),
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
    often = learner.derived([one.task for one in env.models]).get("updates", options.updates)
    updates = often * max(0, steps - options.warm_up) / steps
    policies = [training.learned(run).policy for run in range(runs)]
    completing = sum(
        completes(
            lambda seen, allowed, of=policy: int(of.greedy(seen[None], allowed[None])[0]),
            setting.presentation,
        )
        for policy in policies
    )
    return Share(wall_s, cpu_s, updates, updates * options.batch, completing)


def train_baseline(setting: Setting, runs: int, steps: int, seed: int) -> Share:
    """Train runs of Stable-Baselines3 one after another."""
    from stable_baselines3 import DQN

    env = board(setting.presentation)
    wall_s, cpu_s, updates, completing = 0.0, 0.0, 0, 0
    for run in range(runs):
        clock = Clock()
        learner = DQN("MlpPolicy", env, seed=seed + run, device="cpu", **(setting.options or {}))
        learner.learn(steps)
        took_s = clock.read()
        wall_s, cpu_s = wall_s + took_s[0], cpu_s + took_s[1]
        updates += learner._n_updates
        completing += completes(
            lambda seen, allowed, of=learner: int(of.predict(seen, deterministic=True)[0]),
            setting.presentation,
        )
    per_step = updates / (runs * steps)
    return Share(wall_s, cpu_s, per_step, per_step * learner.batch_size, completing)


def board(presentation: Mapping[str, str]) -> Any:
    """Return the paper's board as a single environment."""
    import gymnasium

    return gymnasium.make("skillplan.env:skillplan/Task-v0", task=BOARD, **presentation)


def completes(choose: Callable[[Any, Any], int], presentation: Mapping[str, str]) -> bool:
    """Return whether a policy completes the board, told what it observes and what is allowed."""
    env = board(presentation)
    seen, info = env.reset(seed=0)
    while True:
        allowed = info["action_mask"].astype(bool)
        seen, _, terminated, truncated, info = env.step(choose(seen, allowed))
        if terminated or truncated:
            return bool(terminated and info["verdict"] == "feasible")


def table(rounds: list[list[list[Share]]], steps: int) -> None:
    """Print what every setting came to: rates and ratios are medians of the rounds."""
    print(
        f"{f'runs of {steps:,} steps':31} {'runs':>4} {'processes':>9} {'steps/s':>8} "
        f"{'a process':>9} {'ratio':>6} {'lowest':>6} {'by CPU time':>11} {'alike':>6} "
        f"{'updates':>7} {'learned from':>12} {'complete':>9}"
    )
    for at, setting in enumerate(SETTINGS):
        base_at = next(
            i
            for i, one in enumerate(SETTINGS)
            if one.is_baseline and one.processes == setting.processes
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
        completing = sum(share.completing for turns in rounds for share in turns[at])
        print(
            f"{setting.name:31} {runs:4} {setting.processes:9} "
            f"{rate:8,.0f} {rate / setting.processes:9,.0f} "
            f"{statistics.median(ratios):6.2f} {min(ratios):6.2f} "
            f"{statistics.median(by_cpu):11.2f} {equal} {share.updates:7.2f} "
            f"{share.learned_from:12.1f} "
            f"{f'{completing} of {runs * len(rounds)}':>9}"
        )
    print(
        f"Updates and transitions learned from are those of a step; ratios are to {BASELINE}'s "
        f"defaults\nin as many processes, with a budget of {BUDGET:.0f}; alike, a process, to its "
        f"setting of as many updates, {EQUAL_BUDGET:.0f}."
    )


def rates(setting: Setting, shares: list[Share], steps: int) -> tuple[float, float]:
    """Return a setting's environment steps a second, and a second of a processor."""
    total = sum(setting.groups) * steps
    return total / max(share.wall_s for share in shares), total / sum(one.cpu_s for one in shares)


if __name__ == "__main__":
    main()
