"""Learners by action mask and method: completion, cost against the proved optimum, steps to it.

Sets of cells, see `SETS`. Every learner has its defaults and the options named in `METHODS`. Two
tables are compared with: `lookup` acts at random and plans by uniform-cost search over the
transitions that it remembers; `r-max` plans as if every untried action reached the goal at no cost.
A run reports its best evaluated policy, as `skillplan train` does. Optima are proved; a random
board without a proof within `PROOF_S` is replaced by the next one.

Run from the repository: ``python benchmarks/learning_table.py FILE [--sets board,generated]``.
FILE has a JSON line for every finished cell, so an interrupted measurement continues there, several
processes can share it (``--methods``), and ``--show`` prints the tables. Set ``OMP_NUM_THREADS=1``.
The set ``baselines`` needs the extra `rl` of skillplan-torch.
"""

from __future__ import annotations

import argparse
import heapq
import json
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from skillplan.env.observation import Observation
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, INFEASIBLE
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.pipeline.solving import DEFAULT_SOLVER, make_model, make_solver, solve
from skillplan.records.result import Status
from skillplan.solvers.learning.network_policy import allowing, random_actions
from skillplan.solvers.stop import Stop
from skillplan.training.family_training import GeneratedFamily
from skillplan.training.policies import roll_out_greedily

BOARD = Path(__file__).parents[1] / "configs" / "inverter_board.yaml"
MASKS = ("none", "applicable", "feasible")
BOARD_SEED, GENERATED_SEED = 1000, 300
# Random boards: number, range of parts, and seed of the family.
BOARDS, SMALLEST, LARGEST, FAMILY_SEED = 20, 8, 20, 141
PROOF_S = 20.0
# Steps at the end of a training whose episodes count for its success.
LATEST_STEPS = 2_000
STRIDE_STEPS = 100
# Steps between evaluations of policies that are not followed while they are learned.
EVALUATION_STEPS = 500
# Relative deviation below which two costs are equal.
TOLERANCE = 1e-9
RANDOM_EPISODES = 1_000

METHODS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "plain": ("dqn", {}),
    "counts": ("dqn", {"exploration": "count"}),
    "imitation": ("dqn", {"imitation": 1.0}),
    "learned model": ("learned-model", {}),
    "lookup": ("lookup", {}),
    "r-max": ("r-max", {}),
    "ppo": ("ppo", {}),
    "ppo, counts": ("ppo", {"novelty": 3.0}),
    "ppo, imitation": ("ppo", {"imitation": 1.0}),
    "combined": (
        "dqn",
        {
            "exploration": "count",
            "branching": 0.9,
            "imitation": 1.0,
            "replay": "distinct",
            "clip_values": True,
        },
    ),
    "branching": ("dqn", {"branching": 0.9}),
    "distinct": ("dqn", {"replay": "distinct"}),
    "clipped": ("dqn", {"clip_values": True}),
    "dqn with planning": ("dqn", {"planning": True, "imitation": 1.0}),
    "ppo, scaled": ("ppo", {"scale_by_success": True}),
    "ppo with planning": ("ppo", {"planning": True, "imitation": 1.0}),
    # The default copies the target network after 10,000 steps for the first time.
    "SB3 DQN": (
        "sb3-dqn",
        {"target_update_interval": 500, "exploration_fraction": 0.6, "train_freq": 2},
    ),
    # The default roll-out is 2,048 steps long.
    "MaskablePPO": ("sb3-maskable-ppo", {"n_steps": 256}),
}
COLUMNS = ("plain", "counts", "imitation", "learned model", "lookup", "r-max")
ADDITIONS = ("branching", "distinct", "clipped", "dqn with planning", "ppo, scaled")
SETS = ("board", "generated", "ppo", "additions", "baselines")


@dataclass(frozen=True)
class Cell:
    """Runs of a method on a task.

    Parameters
    ----------
    task
        ``inverter_board``, or the options of `skillplan generate assembly`.
    """

    task: str
    method: str
    observation: str
    mask: str
    steps: int
    runs: int
    seed: int
    options: Mapping[str, Any]

    @property
    def key(self) -> str:
        """All figures, as they are stored."""
        return json.dumps(asdict(self), sort_keys=True)


class Episode(NamedTuple):
    """An episode of a run, or an evaluation that took no steps.

    Parameters
    ----------
    run, step
        Index of the run, and its steps at the end of the episode.
    cost
        Cost; None if the task was not completed.
    """

    run: int
    step: int
    cost: float | None


@dataclass
class Trained:
    """What the runs of a cell did.

    Parameters
    ----------
    costs
        Cost of every run's reported policy; None if it does not complete the task.
    episodes, evaluations
        Episodes of the training, and evaluations beside it.
    """

    costs: list[float | None]
    episodes: list[Episode]
    evaluations: list[Episode] = field(default_factory=list)


def main() -> None:
    """Measure the cells that FILE lacks, and print the tables."""
    parser = argparse.ArgumentParser(description="Learners by action mask and method.")
    parser.add_argument("file", type=Path, help="JSON lines of the results")
    parser.add_argument("--sets", default="board,generated", help=f"of {', '.join(SETS)}")
    parser.add_argument("--masks", default=",".join(MASKS), help="masks, separated by commas")
    parser.add_argument("--methods", help="names, separated by commas; default: all of a set")
    parser.add_argument("--boards", type=int, default=BOARDS, help="number of random boards")
    parser.add_argument("--show", action="store_true", help="measure nothing")
    args = parser.parse_args()
    results = read(args.file)
    names = args.sets.split(",")
    if unknown := [name for name in names if name not in SETS]:
        parser.error(f"--sets {','.join(unknown)}: known are {', '.join(SETS)}")
    if not args.show:
        measure(args, names, results)
    print_tables(results)


def measure(args: argparse.Namespace, sets: Sequence[str], results: dict[str, Any]) -> None:
    """Measure cells in order, and append each to the file."""
    for name in sets:
        for cell in cells_of(name, args, results):
            # Other processes may measure into the same file.
            results.update(read(args.file))
            chosen = args.methods is None or cell.method in args.methods.split(",")
            if cell.key in results or cell.mask not in args.masks.split(",") or not chosen:
                continue
            begin_s = time.process_time()
            trained = train(cell)
            seconds = time.process_time() - begin_s
            row = summarise(cell, trained, known_optimum(cell.task, args.file, results)["cost"])
            results[cell.key] = append(args.file, cell.key, {**row, "cpu_s": round(seconds, 1)})
            print(
                f"{cell.task}: {cell.method}, {cell.observation}, {cell.mask}, {seconds:.0f} s",
                flush=True,
            )


def cells_of(name: str, args: argparse.Namespace, results: dict[str, Any]) -> Iterator[Cell]:
    """Yield the cells of a set, in the order of their worth."""
    if name == "generated":
        boards = list(proved_boards(args, results))
        for mask in ("applicable", "none", "feasible"):
            # Runs without a mask are long, and end alike.
            steps, runs = (20_000, 1) if mask == "none" else (10_000, 3)
            for method in COLUMNS:
                for board in boards:
                    yield cell(board, method, "markov", mask, steps, runs, GENERATED_SEED)
        return
    rows: dict[str, tuple[Sequence[str], Sequence[str]]] = {
        "board": ((*COLUMNS, "combined"), ("markov", "paper")),
        "ppo": (("ppo", "ppo, counts", "ppo, imitation", "ppo with planning"), ("markov", "paper")),
        "additions": (ADDITIONS, ("markov",)),
        "baselines": (("MaskablePPO", "SB3 DQN"), ("markov",)),
    }
    methods, observations = rows[name]
    for method in methods:
        for observation in observations:
            for mask in MASKS:
                # SB3's DQN knows no mask; MaskablePPO without one is PPO.
                if (method == "SB3 DQN" and mask != "none") or (
                    method == "MaskablePPO" and mask == "none"
                ):
                    continue
                steps = 20_000 if mask == "none" else 5_000
                yield cell("inverter_board", method, observation, mask, steps, 10, BOARD_SEED)


def cell(
    task: str, method: str, observation: str, mask: str, steps: int, runs: int, seed: int
) -> Cell:
    """Return a cell with the options of its method."""
    return Cell(task, method, observation, mask, steps, runs, seed, METHODS[method][1])


def proved_boards(args: argparse.Namespace, results: dict[str, Any]) -> Iterator[str]:
    """Yield random boards whose optimum is proved, as options of `generate assembly`."""
    count = 0
    for board in GeneratedFamily(SMALLEST, LARGEST).boards(3 * BOARDS, FAMILY_SEED):
        if count == args.boards:
            return
        name = (
            f"--parts {board.parts} --density {board.density} --tools {board.tools} "
            f"--seed {board.seed}"
        )
        if known_optimum(name, args.file, results)["proved"]:
            count += 1
            yield name


def known_optimum(name: str, file: Path, results: dict[str, Any]) -> dict[str, Any]:
    """Return the cost of a task's best plan, if it is proved, and random episodes' success."""
    key = json.dumps({"optimum": name, "limit_s": PROOF_S})
    if key not in results:
        model = model_of(name)
        plan = solve(model.task, DEFAULT_SOLVER, Setup(), stop=Stop(time_limit_s=PROOF_S))
        proved = plan.status is Status.OPTIMAL
        row = {"cost": plan.cost, "proved": proved, "skills": len(model.task.skills)}
        results[key] = append(file, key, {**row, "random": random_share(model)})
    known: dict[str, Any] = results[key]
    return known


@cache
def model_of(name: str) -> SkillModel:
    """Return the model of a task of `Cell`."""
    if name == "inverter_board":
        return make_model(load_problem(str(BOARD)).task)
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/board.yaml"
        command = [sys.executable, "-m", "skillplan", "generate", "assembly", *name.split()]
        subprocess.run([*command, "--out", path], check=True, capture_output=True)
        return make_model(load_problem(path).task)


def random_share(model: SkillModel) -> float:
    """Return the share of episodes of random applicable actions that complete the task."""
    env = SkillVectorEnv(model, 1)
    generator, completed, episodes = np.random.default_rng(0), 0, 0
    _, infos = env.reset(seed=0)
    while episodes < RANDOM_EPISODES:
        _, _, _, _, infos = env.step(random_actions(infos["action_mask"], generator.random(1)))
        episodes += int(infos["end"][0] != GOES_ON)
        completed += int(infos["end"][0] == COMPLETE)
    return completed / RANDOM_EPISODES


def train(cell: Cell) -> Trained:
    """Train the runs of a cell."""
    learner = METHODS[cell.method][0]
    if learner.startswith("sb3"):
        return train_sb3(cell)
    model = model_of(cell.task)
    env = SkillVectorEnv(model, cell.runs, observation=cell.observation, mask=cell.mask)
    if learner in ("lookup", "r-max"):
        return train_table(cell, model, env)
    presentation = {"observation": cell.observation, "mask": cell.mask}
    solver: Any = make_solver(learner, presentation | dict(cell.options))
    training = solver.begin(env, range(cell.seed, cell.seed + cell.runs), cell.steps)
    episodes = []
    while training.steps < cell.steps:
        ended = training.advance(min(STRIDE_STEPS, cell.steps - training.steps))
        training.figures()
        episodes += [
            Episode(episode.run, episode.step, episode.cost if episode.success else None)
            for episode in ended
        ]
    seen = Observation.of(model.task, cell.observation)
    costs = [
        roll_out_greedily(model, seen, training.learned(run).policy, cell.mask).cost
        for run in range(cell.runs)
    ]
    return Trained(costs, episodes)


class Memory:
    """Transitions of a run by observation and mask, of which the latest counts.

    Parameters
    ----------
    generator
        Source of the order in which actions are tried.
    """

    GOAL, FAILED = -1, -2

    def __init__(self, generator: random.Random) -> None:
        self._generator = generator
        self._numbers: dict[bytes, int] = {}
        self._untried: list[list[int]] = []
        self._outcomes: list[dict[int, tuple[int, float]]] = []

    def number(self, observation: Any, mask: Any) -> int:
        """Return the number of what is observed."""
        key = observation.tobytes() + mask.tobytes()
        if key not in self._numbers:
            self._numbers[key] = len(self._numbers)
            actions = np.flatnonzero(mask).tolist()
            self._generator.shuffle(actions)
            self._untried.append(actions)
            self._outcomes.append({})
        return self._numbers[key]

    def add(self, before: int, action: int, after: int, cost: float) -> None:
        """Remember a transition."""
        if action not in self._outcomes[before]:
            self._untried[before].remove(action)
        self._outcomes[before][action] = after, cost

    def plan(self, start: int, optimistic: bool) -> list[int]:
        """Return the cheapest known actions to the goal; none if no way is known.

        Parameters
        ----------
        optimistic
            True if an untried action reaches the goal at no cost.
        """
        costs, arrivals = {start: 0.0}, dict[int, tuple[int, int]]()
        queue = [(0.0, start)]
        while queue:
            cost, at = heapq.heappop(queue)
            untried = self._untried[at] if optimistic and at >= 0 else []
            if at == self.GOAL or untried:
                actions = untried[-1:]
                while at != start:
                    at, action = arrivals[at]
                    actions.append(action)
                return actions[::-1]
            if cost > costs[at]:
                continue
            for action, (after, step_cost) in self._outcomes[at].items():
                if after != self.FAILED and cost + step_cost < costs.get(after, np.inf):
                    costs[after], arrivals[after] = cost + step_cost, (at, action)
                    heapq.heappush(queue, (cost + step_cost, after))
        return []


def train_table(cell: Cell, model: SkillModel, env: SkillVectorEnv) -> Trained:
    """Train runs of a table; `r-max` follows its plans, `lookup` acts at random."""
    seeds = range(cell.seed, cell.seed + cell.runs)
    generators = [random.Random(seed) for seed in seeds]
    memories = [Memory(generator) for generator in generators]
    plans, spent = [list[int]() for _ in seeds], [0.0 for _ in seeds]
    trained, begin = Trained([], []), list[int]()
    observations, infos = env.reset(seed=list(seeds))
    for step in range(1, cell.steps + 1):
        masks = allowing(infos["action_mask"])
        at = [
            memory.number(*row) for memory, *row in zip(memories, observations, masks, strict=True)
        ]
        begin = begin or at
        uniforms = np.array([generator.random() for generator in generators])
        actions = random_actions(masks, uniforms)
        if cell.method == "r-max":
            for run, memory in enumerate(memories):
                plans[run] = plans[run] or memory.plan(at[run], optimistic=True)
                if plans[run]:
                    actions[run] = plans[run].pop(0)
        observations, _, _, _, infos = env.step(actions)
        final_masks = allowing(infos["final_mask"])
        for run, (memory, end) in enumerate(zip(memories, infos["end"].tolist(), strict=True)):
            spent[run] += float(infos["cost"][run])
            known = {COMPLETE: Memory.GOAL, INFEASIBLE: Memory.FAILED}.get(end)
            if known is None:
                known = memory.number(infos["final_obs"][run], final_masks[run])
            if end != GOES_ON:
                cost = spent[run] if end == COMPLETE else None
                trained.episodes.append(Episode(run, step, cost))
                spent[run], plans[run] = 0.0, []
            memory.add(at[run], int(actions[run]), known, float(infos["cost"][run]))
        if step % EVALUATION_STEPS == 0 or step == cell.steps:
            for run, memory in enumerate(memories):
                cost = replayed_cost(model, memory.plan(begin[run], optimistic=False))
                trained.evaluations.append(Episode(run, step, cost))
    trained.costs = [cheapest(trained.evaluations, run) for run in range(cell.runs)]
    return trained


def replayed_cost(model: SkillModel, actions: Sequence[int]) -> float | None:
    """Return the cost of a plan; None if it does not complete the task."""
    result = replay(model, [model.task.skills[action] for action in actions])
    return result.cost if result.complete else None


def cheapest(evaluations: Sequence[Episode], run: int) -> float | None:
    """Return the lowest cost of a run's evaluations; None if none completed the task."""
    costs = [
        evaluation.cost
        for evaluation in evaluations
        if evaluation.run == run and evaluation.cost is not None
    ]
    return min(costs, default=None)


def train_sb3(cell: Cell) -> Trained:
    """Train runs of Stable-Baselines3's DQN or sb3-contrib's MaskablePPO.

    The policy is evaluated every `EVALUATION_STEPS` steps, and the cheapest evaluation counts.
    """
    import gymnasium
    import torch
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import DQN
    from stable_baselines3.common.callbacks import BaseCallback

    torch.set_num_threads(1)
    masked = METHODS[cell.method][0] == "sb3-maskable-ppo"
    trained = Trained([], [])

    def make() -> Any:
        return gymnasium.make(
            "skillplan/Task-v0", task=BOARD, observation=cell.observation, mask=cell.mask
        )

    class Recorder(gymnasium.Wrapper[Any, Any, Any, Any]):
        """Records the episodes of the training."""

        steps, cost = 0, 0.0

        def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
            observation, reward, terminated, truncated, info = self.env.step(action)
            self.steps, self.cost = self.steps + 1, self.cost + info["cost"]
            # A roll-out may exceed the steps of the training.
            if (terminated or truncated) and self.steps <= cell.steps:
                completed = terminated and info["verdict"] == "feasible"
                cost = self.cost if completed else None
                trained.episodes.append(Episode(run, self.steps, cost))
            if terminated or truncated:
                self.cost = 0.0
            return observation, float(reward), terminated, truncated, info

        def action_masks(self) -> Any:
            return usable(self.env)

    def usable(env: Any) -> Any:
        # MaskablePPO cannot draw from an empty mask; any action fails there.
        return allowing(env.unwrapped.action_masks()[None])[0]

    judge = make()

    class Evaluation(BaseCallback):
        def _on_step(self) -> bool:
            if self.num_timesteps <= cell.steps and self.num_timesteps % EVALUATION_STEPS == 0:
                (observation, _), spent = judge.reset(seed=0), 0.0
                terminated = truncated = False
                while not (terminated or truncated):
                    extra = {"action_masks": usable(judge)} if masked else {}
                    action, _ = self.model.predict(observation, deterministic=True, **extra)
                    observation, _, terminated, truncated, info = judge.step(action)
                    spent += info["cost"]
                completed = terminated and info["verdict"] == "feasible"
                trained.evaluations.append(
                    Episode(run, self.num_timesteps, spent if completed else None)
                )
            return True

    for run in range(cell.runs):
        algorithm: Any = MaskablePPO if masked else DQN
        options = {"seed": cell.seed + run, "device": "cpu", **cell.options}
        algorithm("MlpPolicy", Recorder(make()), **options).learn(cell.steps, Evaluation())
        trained.costs.append(cheapest(trained.evaluations, run))
    return trained


def summarise(cell: Cell, trained: Trained, optimum: float) -> dict[str, Any]:
    """Return the figures of every run as JSON values."""
    late = [
        episode.cost is not None
        for episode in trained.episodes
        if episode.step > cell.steps - LATEST_STEPS
    ]
    arrivals: list[list[int]] = [[] for _ in range(cell.runs)]
    for episode in (*trained.episodes, *trained.evaluations):
        if episode.cost is not None and episode.cost <= optimum * (1.0 + TOLERANCE):
            arrivals[episode.run].append(episode.step)
    return {
        "above": [None if cost is None else cost / optimum - 1.0 for cost in trained.costs],
        "optimum_step": [min(steps, default=None) for steps in arrivals],
        "late_episodes": len(late),
        "late_successes": sum(late),
    }


def read(file: Path) -> dict[str, Any]:
    """Return the results in a file, by key."""
    if not file.exists():
        return {}
    rows = map(json.loads, file.read_text("utf-8").splitlines())
    return {row["key"]: row["result"] for row in rows}


def append(file: Path, key: str, result: dict[str, Any]) -> dict[str, Any]:
    """Append a result to a file, and return it."""
    with file.open("a", encoding="utf-8") as lines:
        lines.write(json.dumps({"key": key, "result": result}, allow_nan=False) + "\n")
    return result


def print_tables(results: Mapping[str, Any]) -> None:
    """Print the rows of the board, of all random boards together, and each of these."""
    lines = [(json.loads(key), result) for key, result in results.items()]
    cells = [(Cell(**key), result) for key, result in lines if "method" in key]
    optima = {key["optimum"]: result for key, result in lines if "optimum" in key}
    on_board = [row for row in cells if row[0].task == "inverter_board"]
    on_random = [row for row in cells if row[0].task != "inverter_board"]
    for observation in ("paper", "markov"):
        rows = [row for row in on_board if row[0].observation == observation]
        print_rows(f"inverter_board, {observation}", rows)
    print_rows("random boards, markov", on_random)
    print("\n| parts | density | tools | seed | optimum | random |", " | ".join(COLUMNS), "|")
    print("|--:|--:|--:|--:|--:|--:|" + "--:|" * len(COLUMNS))
    for name in optima:
        if name == "inverter_board":
            continue
        board = " | ".join(name.split()[1::2])
        if not optima[name]["proved"]:
            print(f"| {board} | not proved |" + " |" * (1 + len(COLUMNS)))
            continue
        by_method = {
            cell.method: result
            for cell, result in on_random
            if cell.task == name and cell.mask == "applicable"
        }
        columns = [
            summary(by_method[method]["above"]) if method in by_method else "not run"
            for method in COLUMNS
        ]
        shown = [f"{optima[name]['cost']:.5f} m", f"{100 * optima[name]['random']:.1f} %"]
        print(f"| {board} | {' | '.join(shown + columns)} |")


def print_rows(title: str, rows: Sequence[tuple[Cell, dict[str, Any]]]) -> None:
    """Print a row for every mask and method, over the runs of all boards."""
    print(f"\n{title}\n")
    print(
        "| mask | steps | method | boards | complete | exact | within 1 % | greatest | "
        f"last {LATEST_STEPS:,} | steps to the optimum |\n|---|--:|---|--:|--:|--:|--:|--:|--:|--:|"
    )
    groups: dict[tuple[str, int, str], list[dict[str, Any]]] = {}
    for cell, result in sorted(rows, key=rank):
        groups.setdefault((cell.mask, cell.steps, cell.method), []).append(result)
    for (mask, steps, method), cells in groups.items():
        columns = " | ".join(figures(cells))
        print(f"| `{mask}` | {steps:,} | {method} | {len(cells)} | {columns} |")


def summary(above: Sequence[float | None]) -> str:
    """Return how many runs complete a board, and their median deviation."""
    values = [value for value in above if value is not None]
    if not values:
        return f"0 of {len(above)}"
    median = 100 * max(0.0, statistics.median(values))
    return f"{len(values)} of {len(above)}, {median:.2f} %"


def rank(row: tuple[Cell, Any]) -> tuple[str, int, int]:
    """Return the place of a cell in a table."""
    cell = row[0]
    return cell.observation, MASKS.index(cell.mask), list(METHODS).index(cell.method)


def figures(results: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the columns of a row, over all runs of all results."""
    runs = sum(len(result["above"]) for result in results)
    above = [value for result in results for value in result["above"] if value is not None]
    steps = [step for result in results for step in result["optimum_step"] if step is not None]
    late = sum(result["late_episodes"] for result in results)
    successes = sum(result["late_successes"] for result in results)
    return [
        f"{len(above)} of {runs}",
        str(sum(value <= TOLERANCE for value in above)),
        str(sum(value <= 0.01 for value in above)),
        f"{100 * max(0.0, *above):.2f} %" if above else "-",
        f"{100 * successes / late:.1f} %" if late else "-",
        f"{statistics.median(steps):,.0f} ({min(steps):,} to {max(steps):,}), {len(steps)}"
        if steps
        else "-",
    ]


if __name__ == "__main__":
    main()
