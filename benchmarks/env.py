"""Environments: steps a second of many at once, against a plain loop over single ones.

Both do the same episodes of the paper's board, and must get the same rewards. Budget of the
project: 100,000 steps a second, once what is tried has been tried before.

A second table has the vector environments of Stable-Baselines3: ours by `Sb3VecEnv`, and single
environments in its own two. Masks are read in every step, as MaskablePPO does.
"""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from skillplan.env.sb3_vec_env import Sb3VecEnv
from skillplan.env.skill_env import SkillEnv
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.pipeline.setup import load_problem
from skillplan.pipeline.solving import make_model

BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"
BUDGET_PER_S = 100_000
STEPS = 3_000
ROUNDS = 7
# Of the vector environments of Stable-Baselines3.
SB3_ENVS, SB3_STEPS, SB3_ROUNDS = 8, 500, 3
# Of the actions so many are not looked up in the mask: episodes end in every manner.
WILD = 0.05


def main() -> None:
    """Print the table."""
    print(
        f"{'envs':>6} {'[us] a call':>12} {'steps/s':>12} {'plain loop':>12} {'ratio':>7} "
        f"{'budget':>12}"
    )
    for count in (1, 5, 10, 50, 250):
        vectorised_per_s, plain_per_s = steps_per_s(count)
        budget = f"{vectorised_per_s / BUDGET_PER_S:.1f} x" if count > 1 else "-"
        print(
            f"{count:6} {1e6 * count / vectorised_per_s:12.1f} {vectorised_per_s:12,.0f} "
            f"{plain_per_s:12,.0f} {vectorised_per_s / plain_per_s:7.1f} {budget:>12}"
        )
    print(f"\n{f'{SB3_ENVS} envs in Stable-Baselines3':28} {'steps/s':>12} {'ratio':>7}")
    rates = sb3_steps_per_s()
    for name, per_s in rates.items():
        print(f"{name:28} {per_s:12,.0f} {per_s / rates['DummyVecEnv']:7.1f}")


def single() -> SkillEnv:
    """Return an environment of the board."""
    return SkillEnv(make_model(load_problem(BOARD).task))


def sb3_steps_per_s() -> dict[str, float]:
    """Return the steps a second of every vector environment by name; medians of taken turns."""
    several: dict[str, VecEnv] = {
        "DummyVecEnv": DummyVecEnv([single] * SB3_ENVS),
        "SubprocVecEnv": SubprocVecEnv([single] * SB3_ENVS),
        "Sb3VecEnv": Sb3VecEnv(SkillVectorEnv(make_model(load_problem(BOARD).task), SB3_ENVS)),
    }
    for envs in several.values():
        envs.seed(0)
        envs.reset()
        time_masked_steps(envs)
    rounds = [
        {name: SB3_ENVS * SB3_STEPS / time_masked_steps(envs) for name, envs in several.items()}
        for _ in range(SB3_ROUNDS)
    ]
    for envs in several.values():
        envs.close()
    return {name: statistics.median(rates[name] for rates in rounds) for name in several}


def time_masked_steps(envs: VecEnv) -> float:
    """Return the time of steps with allowed actions, by chance [s]."""
    rng = np.random.default_rng(0)
    begin_s = time.perf_counter()
    for _ in range(SB3_STEPS):
        masks = np.stack(envs.env_method("action_masks"))
        envs.step(np.argmax(rng.random(masks.shape) * masks, axis=1))
    return time.perf_counter() - begin_s


def steps_per_s(count: int) -> tuple[float, float]:
    """Return the steps a second of so many environments at once, and of a plain loop; medians.

    The two take turns, so that a drifting machine does not decide.
    """
    task = load_problem(BOARD).task
    env = SkillVectorEnv(make_model(task), count)
    actions = some_actions(env)
    single = SkillEnv(make_model(task))
    looped = actions[:, 0]
    plain(single, looped)
    figures = []
    for _ in range(ROUNDS):
        rewards, wall_s = vectorised(env, actions)
        plain_rewards, plain_s = plain(single, looped)
        assert rewards == plain_rewards, "the two did not get the same rewards"
        figures.append((actions.size / wall_s, looped.size / plain_s))
    fast, slow = zip(*figures, strict=True)
    return statistics.median(fast), statistics.median(slow)


def some_actions(env: SkillVectorEnv) -> NDArray[np.int64]:
    """Return actions for every step and environment, shape (steps, count), mostly allowed ones."""
    rng = np.random.default_rng(0)
    _, infos = env.reset(seed=0)
    taken = []
    for _ in range(STEPS):
        masks = infos["action_mask"] | (rng.random(env.num_envs) < WILD)[:, None]
        taken.append(np.argmax(rng.random(masks.shape) * masks, axis=1))
        *_, infos = env.step(taken[-1])
    return np.array(taken)


def vectorised(env: SkillVectorEnv, actions: NDArray[np.int64]) -> tuple[list[float], float]:
    """Return the first environment's reward of every step, and the time of all [s]."""
    env.reset(seed=0)
    begin_s = time.perf_counter()
    found = [env.step(chosen)[1] for chosen in actions]
    wall_s = time.perf_counter() - begin_s
    return [float(rewards[0]) for rewards in found], wall_s


def plain(env: SkillEnv, actions: NDArray[np.int64]) -> tuple[list[float], float]:
    """Return a single environment's reward of every step, and the time of all [s]."""
    chosen = actions.tolist()
    env.reset(seed=0)
    rewards = []
    begin_s = time.perf_counter()
    for action in chosen:
        _, reward, terminated, truncated, _ = env.step(action)
        rewards.append(reward)
        if terminated or truncated:
            env.reset()
    return rewards, time.perf_counter() - begin_s


if __name__ == "__main__":
    main()
