"""Stable-Baselines3's DQN and sb3-contrib's MaskablePPO, to be compared with.

Neither is a part of the project: both are installed apart, into a folder of their own, and share
torch and Gymnasium with this interpreter. They have their own defaults and our observations; a
policy is followed greedily every `EVALUATION_STEPS` steps, and the cheapest that completes counts,
as of ours. DQN knows no mask.
"""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

VERSION = "2.9.2"
PACKAGES = ("stable-baselines3", "sb3-contrib")
MASKS = {"sb3-dqn": "none", "sb3-maskable-ppo": "applicable"}
EVALUATION_STEPS = 500


class Trained(NamedTuple):
    """What a run came to.

    Parameters
    ----------
    cost
        Of the cheapest policy that completes the task; None without one.
    seconds
        That it learned for, evaluations included.
    """

    cost: float | None
    seconds: float


def install(folder: Path, packages: Sequence[str] = PACKAGES) -> None:
    """Install what is compared with into a folder, without what it shares with this interpreter."""
    where = ("--no-deps", "--upgrade", "--target", str(folder))
    command = (sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    for package in packages:
        if (folder / f"{package.replace('-', '_')}-{VERSION}.dist-info").is_dir():
            continue
        wanted = f"{package}=={VERSION}"
        done = subprocess.run((*command, *where, wanted), capture_output=True, text=True)
        if done.returncode:
            said = (done.stderr.strip() or "pip says nothing").splitlines()[-1]
            sys.exit(f"{wanted} cannot be installed into {folder}: {said}")


def trained(
    task: Path, learner: str, runs: int, steps: int, jobs: int, folder: Path
) -> list[Trained]:
    """Train runs.

    Parameters
    ----------
    task
        A file, whose skills have one outcome each.
    learner
        One of `MASKS`.
    runs, steps, jobs
        How many, how long, and in how many processes.
    folder
        Where both are installed.
    """
    spawn = multiprocessing.get_context("spawn")
    with spawn.Pool(jobs) as pool:
        return pool.map(partial(_trained, task, learner, steps, folder), range(runs), chunksize=1)


def _trained(task: Path, learner: str, steps: int, folder: Path, seed: int) -> Trained:
    sys.path.insert(0, str(folder))
    import gymnasium
    import torch
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import DQN
    from stable_baselines3.common.callbacks import BaseCallback

    torch.set_num_threads(1)

    class Masked(gymnasium.Wrapper[Any, Any, Any, Any]):
        """Knows what is allowed, by the name that MaskablePPO asks for."""

        allowed: Any = None

        def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
            seen, info = self.env.reset(**options)
            self.allowed = allowing_any(info)
            return seen, info

        def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
            seen, reward, terminated, truncated, info = self.env.step(action)
            self.allowed = allowing_any(info)
            return seen, reward, terminated, truncated, info

        def action_masks(self) -> Any:
            return self.allowed

    def made() -> Masked:
        name = "skillplan.env:skillplan/Task-v0"
        return Masked(gymnasium.make(name, task=task, observation="markov", mask=MASKS[learner]))

    judge, best = made(), None

    class Evaluation(BaseCallback):
        """Follows the policy now and then."""

        def _on_step(self) -> bool:
            nonlocal best
            # MaskablePPO learns from whole roll-outs, and does more steps than it is told.
            if self.num_timesteps <= steps and self.num_timesteps % EVALUATION_STEPS == 0:
                cost = followed(self.model)
                best = cost if best is None or (cost is not None and cost < best) else best
            return True

    def followed(model: Any) -> float | None:
        (seen, _), cost = judge.reset(seed=0), 0.0
        more = {"action_masks": judge.action_masks()} if learner != "sb3-dqn" else {}
        while True:
            action, _ = model.predict(seen, deterministic=True, **more)
            seen, _, terminated, truncated, info = judge.step(action)
            cost += info["cost"]
            if terminated or truncated:
                return cost if terminated and info["verdict"] == "feasible" else None
            more = {"action_masks": judge.action_masks()} if more else {}

    kind = DQN if learner == "sb3-dqn" else MaskablePPO
    model = kind("MlpPolicy", made(), seed=seed, device="cpu")
    begun_s = time.perf_counter()
    model.learn(steps, callback=Evaluation())
    return Trained(best, time.perf_counter() - begun_s)


def allowing_any(info: dict[str, Any]) -> Any:
    """Return what is allowed; everything where nothing is, where an episode fails whatever is done.

    MaskablePPO cannot draw from nothing.
    """
    mask = info["action_mask"].astype(bool)
    return mask if mask.any() else ~mask
