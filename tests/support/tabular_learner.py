"""A learner that is small, quick and exact: Q-learning in a table, handed over as a network.

A hidden unit stands for every state that was met: it is 1 there and 0 everywhere else.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import Field

from skillplan.env import SkillVectorEnv
from skillplan.model import SkillModel
from skillplan.pipeline import registry
from skillplan.solvers import (
    End,
    Episode,
    Learned,
    Learner,
    LearnerOptions,
    NetworkPolicy,
    Snapshot,
    Solution,
    Training,
)

SUPPORT = Path(__file__).parent
# What the environment's numbers mean.
ENDS: tuple[End | None, ...] = (None, "complete", "infeasible", "out-of-time")


class TabularOptions(LearnerOptions):
    """How it learns, and how it may be made to misbehave."""

    alpha: float = Field(default=0.5, gt=0, le=1, description="step size [-]")
    gamma: float = Field(default=0.99, ge=0, lt=1, description="discount factor [-]")
    epsilon: float = Field(default=0.2, ge=0, le=1, description="share of random actions [-]")
    fails: str = Field(default="", description="RUN@STEP: this run cannot go on [-]")
    raises: str = Field(default="", description="SEED@STEP: with this seed it raises [-]")
    dies: str = Field(default="", description="SEED@STEP: its process is killed [-]")
    pause_s: float = Field(default=0.0, ge=0, description="slept in every step [s]")


class _Run:
    """The table of one run, and its episode under way."""

    def __init__(self, seed: int, width: int, actions: int) -> None:
        self.seed = seed
        self.width, self.actions = width, actions
        self.chance = np.random.Generator(np.random.PCG64(seed))
        self.rows: dict[bytes, int] = {}
        self.keys = np.zeros((0, width), dtype=np.float32)
        self.q = np.zeros((0, actions), dtype=np.float64)
        self.best: tuple[np.ndarray, np.ndarray, float, int] | None = None
        self.begin()

    def begin(self) -> None:
        self.done: list[int] = []
        self.cost, self.reward, self.greedy = 0.0, 0.0, True

    def row(self, observed: np.ndarray) -> int:
        key = observed.tobytes()
        if key not in self.rows:
            self.rows[key] = len(self.rows)
            self.keys = np.vstack([self.keys, observed[None]])
            self.q = np.vstack([self.q, np.zeros((1, self.actions))])
        return self.rows[key]


def network(keys: np.ndarray, q: np.ndarray) -> NetworkPolicy:
    """Return the network that has a table's values where it was visited, and 0 elsewhere."""
    ones = keys.sum(axis=1)
    return NetworkPolicy(
        ((2 * keys - 1).T.astype(np.float32), q.astype(np.float32)),
        ((1 - ones).astype(np.float32), np.zeros(q.shape[1], dtype=np.float32)),
    )


class TabularTraining(Training):
    """Runs side by side, each with a table and random numbers of its own."""

    def __init__(self, env: SkillVectorEnv, seeds: Sequence[int], options: TabularOptions) -> None:
        self.steps, self.failed = 0, {}
        self._env, self._options = env, options
        width, actions = len(env.features), int(env.single_action_space.n)
        self.runs = [_Run(seed, width, actions) for seed in seeds]
        self._observed, infos = env.reset(seed=list(seeds))
        self._mask = infos["action_mask"]

    def advance(self, steps: int) -> list[Episode]:
        ended = []
        for _ in range(steps):
            self.steps += 1
            self._misbehave()
            ended += self._step()
        return ended

    def figures(self) -> list[dict[str, float]]:
        return [{"states": float(len(run.rows)), "not_finite": float("nan")} for run in self.runs]

    def learned(self, run: int) -> Learned:
        item = self.runs[run]
        last = network(item.keys, item.q)
        if item.best is None:
            return Learned(last)
        keys, q, cost, step = item.best
        return Learned(last, network(keys, q), cost, step)

    def snapshot(self) -> Snapshot:
        arrays: dict[str, Any] = {}
        notes: dict[str, Any] = {"steps": self.steps, "env": self._env.state(), "runs": []}
        notes["failed"] = {str(run): why for run, why in self.failed.items()}
        for index, run in enumerate(self.runs):
            arrays |= {f"keys_{index}": run.keys, f"q_{index}": run.q}
            if run.best is not None:
                arrays |= {f"best_keys_{index}": run.best[0], f"best_q_{index}": run.best[1]}
            notes["runs"].append(
                {
                    "seed": run.seed,
                    "chance": run.chance.bit_generator.state,
                    "episode": [run.done, run.cost, run.reward, run.greedy],
                    "best": None if run.best is None else list(run.best[2:]),
                }
            )
        return Snapshot(arrays, notes)

    def restore(self, snapshot: Snapshot) -> None:
        arrays, notes = snapshot.arrays, snapshot.notes
        if len(notes["runs"]) != len(self.runs):
            raise ValueError("This is the snapshot of another number of runs.")
        self.steps = notes["steps"]
        self.failed = {int(run): why for run, why in notes["failed"].items()}
        for index, (run, message) in enumerate(zip(self.runs, notes["runs"], strict=True)):
            run.chance.bit_generator.state = message["chance"]
            run.keys, run.q = arrays[f"keys_{index}"], arrays[f"q_{index}"]
            run.rows = {key.tobytes(): row for row, key in enumerate(run.keys)}
            run.done, run.cost, run.reward, run.greedy = message["episode"]
            if message["best"] is not None:
                tables = arrays[f"best_keys_{index}"], arrays[f"best_q_{index}"]
                run.best = (*tables, *message["best"])
        self._observed, infos = self._env.restore(notes["env"])
        self._mask = infos["action_mask"]

    def _misbehave(self) -> None:
        options = self._options
        if options.pause_s:
            time.sleep(options.pause_s)
        for index, run in enumerate(self.runs):
            if options.fails == f"{index}@{self.steps}":
                self.failed[index] = "its values are not finite"
            if options.raises == f"{run.seed}@{self.steps}":
                raise RuntimeError("no memory left")
            cause = os.environ.get("TABULAR_DIES_WHILE")
            if cause and self.steps == 350 and run.seed == 5 and os.path.exists(cause):
                os.unlink(cause)
                os.kill(os.getpid(), signal.SIGKILL)
            if options.dies == f"{run.seed}@{self.steps}":
                os.kill(os.getpid(), signal.SIGKILL)

    def _step(self) -> list[Episode]:
        rows, actions = [], []
        for place, run in enumerate(self.runs):
            row = run.row(self._observed[place])
            allowed = np.flatnonzero(self._mask[place])
            allowed = allowed if len(allowed) else np.arange(run.actions)
            if run.chance.random() < self._options.epsilon:
                run.greedy = False
                actions.append(int(run.chance.choice(allowed)))
            else:
                actions.append(int(allowed[np.argmax(run.q[row, allowed])]))
            rows.append(row)
        observed, rewards, ends, _, infos = self._env.step(np.array(actions))
        ended = []
        for place, run in enumerate(self.runs):
            following = run.row(infos["final_obs"][place])
            allowed = infos["final_mask"][place] == 1
            goes_on = not ends[place] and allowed.any()
            later = run.q[following, allowed].max() if goes_on else 0.0
            target = rewards[place] + self._options.gamma * later
            run.q[rows[place], actions[place]] += self._options.alpha * (
                target - run.q[rows[place], actions[place]]
            )
            run.done.append(actions[place])
            run.cost += float(infos["cost"][place])
            run.reward += float(rewards[place])
            if infos["end"][place]:
                if place not in self.failed:
                    end = ENDS[infos["end"][place]]
                    assert end is not None
                    ended.append(self._ended(place, run, end))
                run.begin()
        self._observed, self._mask = observed, infos["action_mask"]
        return ended

    def _ended(self, place: int, run: _Run, end: End) -> Episode:
        if end == "complete" and run.greedy and (run.best is None or run.cost < run.best[2]):
            run.best = (run.keys.copy(), run.q.copy(), run.cost, self.steps)
        done = tuple(run.done)
        return Episode(place, self.steps, end, done, run.cost, run.reward, run.greedy)


class TabularLearner(Learner):
    """Learn in a table."""

    name = "tabular"
    Options = TabularOptions
    options: TabularOptions

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Give up: this one is for training."""
        return Solution()

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> TabularTraining:
        """Begin."""
        return TabularTraining(env, seeds, self.options)

    def resume(
        self, env: SkillVectorEnv, seeds: Sequence[int], steps: int, snapshot: Snapshot
    ) -> TabularTraining:
        """Go on."""
        training = self.begin(env, seeds, steps)
        training.restore(snapshot)
        return training


@contextmanager
def learner_installed(folder: Path, patch: pytest.MonkeyPatch) -> Iterator[str]:
    """Put the learner on the path, here and in child processes; yield its name."""
    info = folder / "tabular_learner-1.5.dist-info"
    info.mkdir(parents=True)
    info.joinpath("METADATA").write_text(
        "Metadata-Version: 2.1\nName: tabular-learner\nVersion: 1.5\nRequires-Dist: numpy>=2\n"
    )
    info.joinpath("entry_points.txt").write_text(
        "[skillplan.solver]\ntabular = tabular_learner:TabularLearner\n"
    )
    patch.syspath_prepend(str(folder))
    patch.setenv("PYTHONPATH", os.pathsep.join([str(folder), str(SUPPORT)]), prepend=os.pathsep)
    registry.refresh()
    try:
        yield "tabular"
    finally:
        registry.refresh()
