"""Learners on boards at random that no default was chosen on, and on all assemblies of configs/.

Boards have 8 to 20 parts, 1 to 4 tools and 0.1 to 0.5 of all pairs ordered; what can be picked but
not placed yet is a dead end. Every run has the defaults and the applicable mask. Deviations are
from the cheapest order that `auto` finds in `SEARCH_S` seconds, proved or not. Others are compared
with by `learning_baselines`, where skills have one outcome. Every board that is done is a line of
`--out`, and not done again. Called by ``python benchmarks/learning.py --boards``.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import learning_baselines
import numpy as np

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.pipeline.solving import make_model, solve
from skillplan.records import interval
from skillplan.solvers.learning.network_policy import allowing
from skillplan.solvers.stop import Stop
from skillplan.training.family_training import GeneratedFamily

CONFIGS = Path(__file__).parents[1] / "configs"
SMALLEST, LARGEST, COUNT = 8, 20, 20
RANDOM_EPISODES = 1_000
# Of the search for the cheapest order of a board.
SEARCH_S = 20.0
# Defaults were chosen on boards of the second; the tables are of the first.
SEEDS = {"held-out": 77, "tuning": 78}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of these tables."""
    boards = parser.add_argument_group("boards")
    boards.add_argument("--boards", action="store_true", help="learners on boards at random")
    boards.add_argument("--list", choices=sorted(SEEDS), default="held-out", help="which boards")
    boards.add_argument(
        "--learners",
        default=f"learned-model,dqn,ppo,{','.join(learning_baselines.MASKS)}",
        help="separated by commas",
    )
    boards.add_argument("--runs", type=int, default=10, help="of every learner on every board")
    boards.add_argument("--baseline-runs", type=int, default=3, help="of those compared with")
    boards.add_argument(
        "--board-steps", type=int, default=40_000, help="environment steps of a run"
    )
    boards.add_argument("--jobs", type=int, default=2, help="processes of a training")
    boards.add_argument("--configs", action="store_true", help="all assemblies of configs/, too")
    boards.add_argument("--minutes", type=float, default=60.0, help="no board is begun after that")
    boards.add_argument("--out", type=Path, help="a line for every board and learner")


def show(options: argparse.Namespace, baselines: Path) -> None:
    """Measure what is not there yet, and print all rows and what they come to.

    Parameters
    ----------
    options
        Of the command line.
    baselines
        Where those compared with are, or are installed.
    """
    done = read(options.out)
    until = time.monotonic() + 60.0 * options.minutes
    learners = options.learners.split(",")
    if any(learner in learning_baselines.MASKS for learner in learners):
        learning_baselines.install(baselines)
    rows: dict[str, list[dict[str, Any]]] = {learner: [] for learner in learners}
    print(
        f"{'board':34} {'learner':16} {'complete':>9} {'middle':>8} {'95 %':>18} {'median':>8} "
        f"{'greatest':>8} {'first':>7} {'seconds':>8} {'steps/s':>8} {'random':>7}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, task in tasks(options, Path(folder)):
            for learner in learners:
                runs = options.baseline_runs
                if learner not in learning_baselines.MASKS:
                    runs = options.runs
                elif not load_problem(str(task)).task.deterministic:
                    continue
                key = (name, learner, runs, options.board_steps)
                if key not in done:
                    if time.monotonic() > until:
                        continue
                    least = least_cost(name, task, done, options.out)
                    done[key] = measured(task, learner, runs, least, options, baselines)
                    keep(options.out, key, done[key])
                rows[learner].append(done[key])
                print(line(name, learner, done[key]), flush=True)
    for learner, found in rows.items():
        summary(learner, found)


def tasks(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, Path]]:
    """Yield the boards by name, as files."""
    family = GeneratedFamily(SMALLEST, LARGEST)
    for number, board in enumerate(family.boards(COUNT, SEEDS[options.list])):
        path = folder / f"{number}.yaml"
        path.write_text(board.text(), encoding="utf-8")
        yield f"{number}: {board.parts} parts, {board.tools} tools, {board.density}", path
    if options.configs:
        for path in sorted(CONFIGS.glob("*.yaml")):
            if path.read_text("utf-8").find("\nkind: assembly") >= 0:
                yield path.stem, path


def least_cost(name: str, task: Path, done: dict[Any, Any], out: Path | None) -> float:
    """Return the least cost of a task that is known."""
    key = ("cheapest", name)
    if key not in done:
        found = solve(
            load_problem(str(task)).task, "auto", Setup(), stop=Stop(time_limit_s=SEARCH_S)
        )
        if found.cost is None:
            sys.exit(f"{name}: no order is known after {SEARCH_S} s")
        done[key] = {"cost": found.cost, "status": found.status.value}
        keep(out, key, done[key])
    return float(done[key]["cost"])


def measured(
    task: Path,
    learner: str,
    runs: int,
    least: float,
    options: argparse.Namespace,
    baselines: Path,
) -> dict[str, Any]:
    """Train runs of a learner, and return what they came to."""
    steps = options.board_steps
    if learner in learning_baselines.MASKS:
        trained_runs = learning_baselines.trained(
            task, learner, runs, steps, options.jobs, baselines
        )
        costs = [one.cost for one in trained_runs]
        seconds = sum(one.seconds for one in trained_runs) / options.jobs
        first = [None] * runs
    else:
        document = trained(task, learner, runs, options)
        costs = [one["cost"] for one in document["runs"]]
        seconds, first = document["wall_s"], [one["completed_step"] for one in document["runs"]]
    return {
        "deviations": [None if one is None else round(one / least - 1.0, 9) + 0.0 for one in costs],
        "first": first,
        "random": random_share(task),
        "seconds": seconds,
        "steps_per_s": runs * steps / seconds,
    }


def trained(task: Path, learner: str, runs: int, options: argparse.Namespace) -> dict[str, Any]:
    """Train runs of a learner of ours, and return the document of the command."""
    command = [sys.executable, "-m", "skillplan", "train", str(task), "--solver", learner]
    command += ["--runs", str(runs), "--steps", str(options.board_steps)]
    command += ["--jobs", str(options.jobs), "--no-cache", "--format", "json"]
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [*command, "--out", f"{folder}/run"], capture_output=True, text=True, check=False
        )
    if done.returncode not in (0, 1):
        sys.exit(f"{task.name}, {learner}: {done.stderr.strip()}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def random_share(task: Path) -> float:
    """Return the share of episodes of allowed actions at random that complete a task."""
    env = SkillVectorEnv(make_model(load_problem(str(task)).task), 1)
    generator, completed, episodes = np.random.default_rng(0), 0, 0
    _, infos = env.reset(seed=0)
    while episodes < RANDOM_EPISODES:
        allowed = np.flatnonzero(allowing(infos["action_mask"])[0])
        _, _, _, _, infos = env.step(generator.choice(allowed, 1))
        episodes += int(infos["end"][0] != GOES_ON)
        completed += int(infos["end"][0] == COMPLETE)
    return completed / RANDOM_EPISODES


def line(name: str, learner: str, row: dict[str, Any]) -> str:
    """Return a row of the table."""
    deviations = [one for one in row["deviations"] if one is not None]
    first = [one for one in row["first"] if one is not None]
    middle = interval.interquartile_mean(deviations)
    parts = [f"{'-':>8}", f"{'-':>18}", f"{'-':>8}", f"{'-':>8}"]
    if middle is not None:
        between = "-"
        if middle.low is not None and middle.high is not None:
            between = f"{100 * middle.low:.2f} to {100 * middle.high:.2f}%"
        parts = [f"{100 * middle.value:7.2f}%", f"{between:>18}"]
        parts += [f"{100 * figure(deviations):7.2f}%" for figure in (statistics.median, max)]
    begun = f"{statistics.median(first):7,.0f}" if first else f"{'-':>7}"
    return (
        f"{name:34} {learner:16} {len(deviations):3} of {len(row['deviations']):2} "
        f"{' '.join(parts)} {begun} {row['seconds']:8.1f} {row['steps_per_s']:8,.0f} "
        f"{100 * row['random']:6.2f}%"
    )


def summary(learner: str, rows: list[dict[str, Any]]) -> None:
    """Print on how many boards nine of ten runs complete, and the deviations of all runs."""
    of = [len(row["deviations"]) for row in rows]
    completed = [sum(one is not None for one in row["deviations"]) for row in rows]
    enough = sum(many >= 0.9 * runs for many, runs in zip(completed, of, strict=True))
    deviations = [one for row in rows for one in row["deviations"] if one is not None]
    whole = interval.share(sum(completed), sum(of))
    middle = interval.interquartile_mean(deviations)
    if whole is None:
        return
    print(
        f"{learner}: 9 of 10 runs complete {enough} of {len(rows)} boards; "
        f"{sum(completed)} of {sum(of)} runs (95 %: {percent(whole.low)} to {percent(whole.high)})"
    )
    if middle is not None:
        print(
            f"    above the cheapest, over all runs: interquartile mean {percent(middle.value)} "
            f"(95 %: {percent(middle.low)} to {percent(middle.high)}), median "
            f"{percent(statistics.median(deviations))}, greatest {percent(max(deviations))}"
        )


def percent(value: float | None) -> str:
    """Return a share in words."""
    return "-" if value is None else f"{100 * value:.2f} %"


def read(path: Path | None) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Return what was measured before."""
    if path is None or not path.exists():
        return {}
    lines = map(json.loads, path.read_text("utf-8").splitlines())
    return {tuple(one["key"]): one["row"] for one in lines}


def keep(path: Path | None, key: tuple[Any, ...], row: dict[str, Any]) -> None:
    """Add a row to the file."""
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": key, "row": row}, allow_nan=False) + "\n")
