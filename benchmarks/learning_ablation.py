"""What options of `dqn` are worth: tables with one of them changed at a time.

Three rows of trials: the boards that defaults are chosen on, few steps each, where differences
still show; `inverter_grasps`, whose grasps fail by chance, where nothing can be planned; and the
paper's board with the paper's observation and no mask. A policy is followed greedily, and costs as
much more than the cheapest that is known as the table says; one that does not complete counts
for `MISSED`. Called by ``python benchmarks/learning.py --ablation``.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import learning_boards

from skillplan.env.observation import Observation
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.pipeline.setup import load_problem
from skillplan.pipeline.solving import make_model, make_solver
from skillplan.training.policies import roll_out_greedily

STRIDE_STEPS = 100
# Above the cheapest, of a policy that does not complete the task.
MISSED = 1.0
VARIANTS: Mapping[str, Mapping[str, Any]] = {
    "defaults": {},
    "plans": {"planning": True},
    "plans and imitation": {"planning": True, "imitation": 1.0},
    "narrow plans and imitation": {"planning": True, "imitation": 1.0, "plan_width": 4},
    "imitation": {"imitation": 1.0},
    "distinct transitions": {"replay": "distinct"},
    "values clipped": {"clip_values": True},
    "no random actions": {"epsilon": 0.0, "epsilon_end": 0.0},
    "branching": {"branching": 0.9},
    "half an update a step": {"updates": 0.5},
    "an update a step": {"updates": 1.0},
    "lower learning rate in the end": {"learning_rate_end": 1e-6, "decay_from": 0.4},
    "no floor of steps": {"step_floor": 1e6},
    "discount 0.99": {"gamma": 0.99},
    "the last cost does not count": {"count_last_cost": False},
    "counts": {"exploration": "count"},
    "fewer random actions": {"epsilon": 0.1},
    "exploring to the end": {"explore_until": 1.0},
    "batches of 32": {"batch": 32},
    "batches of 128": {"batch": 128},
    "a target that follows faster": {"target_rate": 0.1},
    "a memory of a thousand": {"capacity": 1_000},
    "no warm-up": {"warm_up": 1},
    "two layers": {"layers": 2},
    "64 units": {"width": 64},
}


@dataclass(frozen=True)
class Trial:
    """A task on which a variant is tried.

    Parameters
    ----------
    name
        Of the task.
    kind
        Of the column it counts for.
    task
        Its file.
    runs, steps
        How many, and how long.
    observation, mask
        Of the learner.
    """

    name: str
    kind: str
    task: Path
    runs: int
    steps: int
    observation: str = "markov"
    mask: str = "applicable"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of these tables."""
    ablation = parser.add_argument_group("ablation")
    ablation.add_argument("--ablation", action="store_true", help="dqn with one option changed")
    ablation.add_argument("--variants", help="names, separated by commas; default: all")


def show(options: argparse.Namespace) -> None:
    """Measure what is not in `--out` yet, and print a row for every variant."""
    done = learning_boards.read(options.out)
    names = options.variants.split(",") if options.variants else list(VARIANTS)
    unknown = ", ".join(name for name in names if name not in VARIANTS)
    if unknown:
        sys.exit(f"--variants {unknown}: known are {', '.join(VARIANTS)}")
    print(f"{'variant':34} {'boards':>25} {'grasps':>25} {'no mask':>25} {'seconds':>8}")
    with tempfile.TemporaryDirectory() as folder:
        trials = list(all_trials(Path(folder)))
        for name in names:
            rows: dict[str, list[float]] = {}
            took_s = 0.0
            for trial in trials:
                changed = json.dumps(VARIANTS[name], sort_keys=True)
                key = ("ablation", name, changed, trial.name, trial.runs, trial.steps)
                if key not in done:
                    least = learning_boards.least_cost(trial.name, trial.task, done, options.out)
                    done[key] = tried(trial, VARIANTS[name], least)
                    learning_boards.keep(options.out, key, done[key])
                rows.setdefault(trial.kind, []).extend(done[key]["above"])
                took_s += done[key]["seconds"]
            print(f"{name:34} {' '.join(map(column, rows.values()))} {took_s:8.0f}", flush=True)


def column(above: list[float]) -> str:
    """Return how many policies complete, their mean and median above the cheapest."""
    completed = sum(one < MISSED for one in above)
    mean, median = 100 * statistics.mean(above), 100 * statistics.median(above)
    return f"{completed:3} of {len(above):3} {mean:6.2f}% {median:5.2f}%"


def all_trials(folder: Path) -> Iterator[Trial]:
    """Yield what every variant is tried on."""
    options = argparse.Namespace(list="tuning", configs=False)
    for name, task in learning_boards.tasks(options, folder):
        yield Trial(name, "boards", task, runs=2, steps=2_000)
    grasps = learning_boards.CONFIGS / "inverter_grasps.yaml"
    yield Trial("inverter_grasps", "grasps", grasps, runs=4, steps=20_000)
    board = learning_boards.CONFIGS / "inverter_board.yaml"
    yield Trial("inverter_board", "no mask", board, 5, 5_000, "paper", "none")


def tried(trial: Trial, changed: Mapping[str, Any], least: float) -> dict[str, Any]:
    """Train runs of a variant side by side, and return how far above the least they end."""
    model = make_model(load_problem(str(trial.task)).task)
    presentation = {"observation": trial.observation, "mask": trial.mask}
    env = SkillVectorEnv(model, trial.runs, **presentation)
    learner = make_solver("dqn", presentation | dict(changed))
    begun_s = time.perf_counter()
    training = learner.begin(env, range(trial.runs), trial.steps)
    while training.steps < trial.steps:
        training.advance(min(STRIDE_STEPS, trial.steps - training.steps))
        training.figures()
    took_s = time.perf_counter() - begun_s
    seen = Observation.of(model.task, trial.observation)
    above = []
    for run in range(trial.runs):
        policy = training.learned(run).policy
        cost = roll_out_greedily(model, seen, policy, trial.mask).cost
        above.append(MISSED if cost is None else max(0.0, cost / least - 1.0))
    return {"above": above, "seconds": took_s}


if __name__ == "__main__":
    raise SystemExit("Call it by: python benchmarks/learning.py --ablation")
