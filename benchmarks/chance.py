"""Grasps that fail, on boards of 12, 16 and 20 parts: replanning against bound and optimum.

A third of the parts is missed with a probability of 0.1 to 0.4. For each board: what `replan` costs
on average, exactly, and the 95 % interval of the mean of 2,000 roll-outs; the proved lower bound of
the deterministic relaxation; the least expected cost by `job-values`, and by value iteration where
that many states can be held; and how long an answer takes, new plans included, of a policy that has
planned for no state yet.

Every board that is done is a line of `--out`, and not done again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from skillplan.domains.assembly.board_generator import BoardGenerator
from skillplan.errors import ModelTooLarge, SearchStopped
from skillplan.model.policy_value import evaluate_policy, sample_policy
from skillplan.pipeline.setup import load_problem
from skillplan.pipeline.solving import make_model, make_solver
from skillplan.solvers.chance.adaptive_search import AdaptiveSearch
from skillplan.solvers.chance.replan import Replanning, orders_ahead
from skillplan.solvers.chance.retries import assume_retries
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

SIZES = ((12, 0.0), (16, 0.1), (20, 0.2), (20, 0.1), (20, 0.0))
TOOLS = 3
FAILURES = (0.1, 0.4)
FAILING_SHARE = 1 / 3


def main() -> None:
    """Print a line for every board."""
    options = parsed()
    done = {}
    if options.out.exists():
        lines = map(json.loads, options.out.read_text("utf-8").splitlines())
        done = {tuple(line["board"]): line for line in lines}
    print(
        f"{'parts':>5} {'density':>7} {'seed':>4} {'states':>9} {'bound':>9} {'replan':>9} "
        f"{'95 % of 2,000 roll-outs':>23} {'gap':>7} {'optimum':>9} {'above':>7} "
        f"{'replan [s]':>10} {'jobs [s]':>8} {'VI [s]':>7} {'mean [ms]':>9} {'first [ms]':>10}"
    )
    for parts, density in SIZES:
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            key = (parts, density, seed)
            if key not in done:
                done[key] = {"board": key, **measured(board(*key), options)}
                with options.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(done[key]) + "\n")
            print(shown(key, done[key]), flush=True)


def parsed() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("chance.jsonl"), help="lines of JSON")
    parser.add_argument("--seeds", type=int, default=3, help="boards of each size")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--time-limit", type=float, default=300.0, help="of each solver [s]")
    parser.add_argument("--max-states", type=int, default=1_000_000, help="for value iteration")
    return parser.parse_args()


def board(parts: int, density: float, seed: int) -> Task:
    """Return a board with grasps that may fail."""
    generator = BoardGenerator(
        parts, density, TOOLS, seed, failures=FAILURES, failing_share=FAILING_SHARE
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "board.yaml"
        path.write_text(generator.text(), "utf-8")
        return load_problem(path).task


def measured(task: Task, options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of a board."""
    model = make_model(task)
    solver = make_solver("replan", {}, Stop(time_limit_s=options.time_limit))
    begin_s = time.perf_counter()
    found = solver.solve(model)
    figures: dict[str, Any] = {
        "bound": found.lower_bound,
        "replan_s": time.perf_counter() - begin_s,
        "sampled": found.trace.get("expected_cost"),
        "policy_states": found.trace.get("policy_states"),
        "sets": found.trace.get("sets"),
    }
    policy = found.policy
    if policy is None:
        return figures | {"reason": found.trace.get("reason")}
    figures["replan"] = evaluate_policy(model, policy.get).cost
    return figures | answer_times(task) | by_sets(task, options) | optimum(task, options)


def by_sets(task: Task, options: argparse.Namespace) -> dict[str, Any]:
    """Return the least expected cost by values over sets of jobs, with its policy followed."""
    model = make_model(task)
    begin_s = time.perf_counter()
    solver = make_solver("job-values", {}, Stop(time_limit_s=options.time_limit))
    found = solver.solve(model)
    spent_s = time.perf_counter() - begin_s
    cost = None if found.policy is None else evaluate_policy(model, found.policy.get).cost
    return {"by_sets": cost, "by_sets_bound": found.lower_bound, "by_sets_s": spent_s}


def answer_times(task: Task) -> dict[str, float]:
    """Return what an answer takes, first and on average over 200 roll-outs [ms], memory empty."""
    model, certain = make_model(task), assume_retries(task)
    ahead = orders_ahead(model, certain, 1_200_000, Stop())
    search = AdaptiveSearch(model, certain, Stop(), 10_000_000, ahead=ahead)
    timed = _Timed(Replanning(search, model, lookahead=True).get)
    steps = 0
    for seed in range(200):
        sample = sample_policy(model, timed, seed, 1)
        steps += 0 if sample is None else round(sample.steps)
    first, total = timed.times_s[0], sum(timed.times_s)
    return {
        "first_ms": 1000 * first,
        "mean_ms": 1000 * (total - first) / (steps - 1),
        "longest_ms": 1000 * max(timed.times_s[1:]),
    }


class _Timed:
    """A policy whose answers are timed; an answer asked for again takes no time."""

    def __init__(self, choose: Callable[[State], Skill | None]) -> None:
        self._choose = choose
        self.times_s: list[float] = []

    def __call__(self, state: State) -> Skill | None:
        begin_s = time.perf_counter()
        skill = self._choose(state)
        self.times_s.append(time.perf_counter() - begin_s)
        return skill


def optimum(task: Task, options: argparse.Namespace) -> dict[str, Any]:
    """Return the least expected cost by value iteration, or that there are too many states."""
    solver = make_solver(
        "value-iteration",
        {"max_states": options.max_states},
        Stop(time_limit_s=options.time_limit),
    )
    begin_s = time.perf_counter()
    try:
        found = solver.solve(make_model(task))
    except ModelTooLarge:
        return {"optimum": None, "states": f">{options.max_states:,}"}
    except SearchStopped:
        return {"optimum": None, "states": "time"}
    return {
        "optimum": found.lower_bound if found.proved else None,
        "states": found.trace["states"],
        "vi_s": time.perf_counter() - begin_s,
    }


def shown(key: tuple[int, float, int], line: dict[str, Any]) -> str:
    """Return the figures of a board as a line of the table."""
    cost, bound, best, sampled = (
        line.get(one) for one in ("replan", "bound", "by_sets", "sampled")
    )
    low, high = (None, None) if not sampled else sampled.get("ci95", (None, None))
    gap = None if cost is None or bound is None else 100 * (cost - bound) / cost
    above = None if cost is None or best is None else 100 * (cost - best) / best
    words = [
        f"{key[0]:5} {key[1]:7} {key[2]:4} {line.get('states', '-')!s:>9}",
        f"{text(bound, 5):>9} {text(cost, 5):>9} {text(low, 5):>11} {text(high, 5):>11}",
        f"{text(gap, 2):>5} % {text(best, 5):>9} {text(above, 2):>5} %",
        f"{text(line['replan_s'], 2):>10} {text(line.get('by_sets_s'), 2):>8} "
        f"{text(line.get('vi_s'), 1):>7}",
        f"{text(line.get('mean_ms'), 3):>9} {text(line.get('first_ms'), 1):>10}",
    ]
    return " ".join(words)


def text(figure: float | None, decimals: int) -> str:
    """Return a figure for people; a dash for none."""
    return "-" if figure is None else f"{figure:.{decimals}f}"


if __name__ == "__main__":
    main()
