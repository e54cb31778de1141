"""One policy on boards it was not trained on: all configs, generated ones of 12 to 24 parts.

For each: whether the greedy policy completes the board with the applicable mask, how far it is
from the best known cost (under chance: the expected costs), and the processor time of an answer.
Beside it the nearest element that nothing must come before, by the same way of acting: what is
gained by learning.

Every board whose best cost is known is a line of `--known`, and not searched again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from skillplan.model.policy_value import evaluate_policy, roll_out
from skillplan.model.replay import replay
from skillplan.pipeline.setup import load_problem
from skillplan.pipeline.solving import make_model, solve
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.training.family_training import GeneratedFamily, read_policy
from skillplan_torch.relational.elements import ELEMENT_FEATURES, ElementGraph
from skillplan_torch.relational.network import ElementChoice, NetworkSize, RelationalNetwork

CONFIGS = Path(__file__).parents[1] / "configs"


@dataclass(frozen=True)
class Trial:
    """What became of a policy on a board: its cost, None where it fails, and ms of an answer."""

    cost: float | None
    answer_ms: float


class NearestFirst(RelationalNetwork):
    """Scores without learning: the cheapest to come to of what waits for nothing."""

    def scores(self, graph: ElementGraph) -> np.ndarray:
        """Return minus what coming there costs more, and much less where something is to wait."""
        come, waits = (graph.features[:, one] for one in (1, 2))
        return np.asarray(-come - 1000.0 * waits, dtype=np.float32)


def main() -> None:
    """Print a line for every board, and of each group how many were completed."""
    options = parsed()
    learned = read_policy(options.run).policy
    assert ELEMENT_FEATURES[2] == "something must come before it that is not done"
    size = NetworkSize()
    zeros = {name: np.zeros(shape, np.float32) for name, shape in size.shapes().items()}
    known = Known(options.known, options.time_limit)
    print(f"{'board':46} {'best':>9} {'':7} {'policy':>8} {'nearest':>8} {'ms':>6}")
    for tasks in (configs(), GeneratedFamily(12, 24).tasks(options.boards, options.seed)):
        rows = []
        for task in tasks:
            best, proved = known.best(task)
            trials = [tried(one, task) for one in (learned, NearestFirst(size, zeros))]
            above = [None if one.cost is None else one.cost / best - 1 for one in trials]
            rows.append(above)
            shown = " ".join(f"{'fails' if one is None else f'{one:.2%}':>8}" for one in above)
            said = "proved" if proved else "found"
            print(f"{task.name:46} {best:9.5f} {said:7} {shown} {trials[0].answer_ms:6.2f}")
        for name, column in zip(("policy", "nearest"), zip(*rows, strict=True), strict=True):
            whole = [one for one in column if one is not None]
            print(
                f"{name}: {len(whole)} of {len(column)} completed, median {median(whole):.2%}, "
                f"greatest {max(whole):.2%}"
            )


def parsed() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("run", type=Path, help="of train --family generated:A-B")
    parser.add_argument("--boards", type=int, default=20, help="generated boards")
    parser.add_argument("--seed", type=int, default=7, help="of those")
    parser.add_argument("--time-limit", type=float, default=40.0, help="of each search [s]")
    parser.add_argument("--known", type=Path, default=Path("carrying_over.jsonl"))
    return parser.parse_args()


def configs() -> Iterator[Task]:
    """Yield the boards of the repository."""
    for path in sorted(CONFIGS.glob("*.yaml")):
        problem = load_problem(path)
        if problem.kind == "assembly":
            yield problem.task


class Known:
    """The best costs known, kept in a file.

    Parameters
    ----------
    path
        The file, which need not be there.
    time_limit_s
        Of a search for one that it does not hold [s].
    """

    def __init__(self, path: Path, time_limit_s: float) -> None:
        self._path, self._time_limit_s = path, time_limit_s
        lines = path.read_text("utf-8").splitlines() if path.exists() else []
        self._known = {
            one["sha256"]: (one["cost"], one["proved"]) for one in map(json.loads, lines)
        }

    def best(self, task: Task) -> tuple[float, bool]:
        """Return the best cost known, and whether it is proved to be the least."""
        if task.sha256 not in self._known:
            found = solve(task, "auto", stop=Stop(time_limit_s=self._time_limit_s))
            if found.cost is None:
                raise SystemExit(f"{task.name}: no plan was found in {self._time_limit_s} s.")
            self._known[task.sha256] = (found.cost, found.status.value == "optimal")
            record = {"sha256": task.sha256, "cost": found.cost}
            record["proved"] = found.status.value == "optimal"
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record) + "\n")
        return self._known[task.sha256]


def tried(network: RelationalNetwork, task: Task) -> Trial:
    """Follow a policy greedily on a board."""
    model = make_model(task)
    with closing(model.feasibility):
        choose = ElementChoice(network, model)
        times_s: list[float] = []
        timed = timing(choose, times_s)
        if task.deterministic:
            found = replay(model, roll_out(model, timed))
            cost = found.cost if found.complete else None
        else:
            cost = evaluate_policy(model, timed).cost
    return Trial(cost, 1000 * sum(times_s) / max(1, len(times_s)))


def timing(choose: Callable[[State], Skill], times_s: list[float]) -> Callable[[State], Skill]:
    """Return the same choice that notes the processor time of every answer."""

    def timed(state: State) -> Skill:
        begin_s = time.process_time()
        skill = choose(state)
        times_s.append(time.process_time() - begin_s)
        return skill

    return timed


if __name__ == "__main__":
    main()
