"""Physics in the loop: what a simulated check costs, how few are needed, how well the arm moves.

Ratios are to figures of the same run: executions to those that a cache by state and skill would
need, simulated checks to swept hulls. Run from the repository: ``python benchmarks/physics.py``.
"""

from __future__ import annotations

import statistics
import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from skillplan import Setup, load_problem, solve
from skillplan.checks.single_check import introduce
from skillplan.checks.verdict_cache import DiskVerdictCache
from skillplan.model.enumeration import enumerate_feasibility
from skillplan.pipeline import registry
from skillplan.pipeline.solving import make_feasibility
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

BOARD = "configs/inverter_board.yaml"
PHYSICS = Setup(physics="pybullet", collision=("contact-pairs",), with_chart=False)
SWEPT = Setup(collision=("swept",), with_chart=False)
STEPS_PER_S = 240
ROUNDS = 3
STIFFNESSES_PER_S2 = (150.0, 400.0, 1000.0, 2500.0, 6000.0)
# Its arm has no payload on the approach and meets nothing.
MOVE = "pick(switch_1)"

Query = tuple[Skill, State]


def queries_of(task: Task) -> list[Query]:
    """Return the skills of the best plan, each with the state in which it is executed."""
    state, queries = task.initial, []
    for step in solve(task, "exact").steps:
        skill = task.skill(step.skill)
        queries.append((skill, state))
        state = skill.prediction.apply(state)
    return queries


def back_ends_of(task: Task, setup: Setup) -> list[Any]:
    """Return fresh back ends that know of each other."""
    made = setup.back_ends(task)
    introduce(made)
    return made


def checking_s(task: Task, setup: Setup, queries: list[Query]) -> tuple[float, int]:
    """Return the CPU time that fresh back ends take to answer [s], and simulation steps."""
    made = back_ends_of(task, setup)
    begin_s = time.process_time()
    verdicts = [back_end.check(*query) for query in queries for back_end in made]
    took_s = time.process_time() - begin_s
    assert all(verdict.is_feasible for verdict in verdicts)
    return took_s, sum(verdict.evidence.get("steps", 0) for verdict in verdicts)


def print_checks(task: Task, queries: list[Query]) -> None:
    """Print the speed of the simulator and of a check, beside swept hulls."""
    checking_s(task, PHYSICS, queries[:2])
    checking_s(task, SWEPT, queries[:2])
    simulated = [checking_s(task, PHYSICS, queries) for _ in range(ROUNDS)]
    swept_s = statistics.median(checking_s(task, SWEPT, queries)[0] for _ in range(ROUNDS))
    physics_s = statistics.median(took_s for took_s, _ in simulated)
    (steps,) = {steps for _, steps in simulated}
    engine = back_ends_of(task, PHYSICS)[0]
    begin_s = time.process_time()
    performance = engine.perform([skill for skill, _ in queries])
    performing_s = time.process_time() - begin_s
    whole = round(performance.simulated_s * STEPS_PER_S)
    print(f"{len(queries)} skills of the best plan, CPU seconds, median of {ROUNDS} rounds\n")
    print(f"{'simulation with logging':40}{'steps':>8}{'s':>9}{'steps/s':>9}")
    for label, count, took_s in (
        ("checks, each in a world of its own", steps, physics_s),
        ("the whole plan in one world", whole, performing_s),
    ):
        print(f"{label:40}{count:8,}{took_s:9.3f}{count / took_s:9,.0f}")
    print(f"\n{'checks':40}{'s each':>8}{'per s':>9}{'ratio':>9}")
    for label, took_s in (("pybullet and contact-pairs", physics_s), ("swept, cold", swept_s)):
        each_s = took_s / len(queries)
        print(f"{label:40}{each_s:8.4f}{1 / each_s:9.1f}{physics_s / took_s:9.1f}")


def print_whole_board(task: Task) -> None:
    """Print what it takes to know everything that can be reached, with one process and two."""
    print("\ncomplete feasibility     jobs       s  executions  by state and skill    ratio")
    for jobs in (1, 2):
        begin_s = time.perf_counter()
        with closing(make_feasibility(task, PHYSICS, jobs=jobs)) as feasibility:
            counts = enumerate_feasibility(feasibility)
        took_s = time.perf_counter() - begin_s
        ratio = counts.executions_by_state / counts.executions
        print(
            f"{task.name:24} {jobs:4} {took_s:7.1f} {counts.executions:11,} "
            f"{counts.executions_by_state:19,} {ratio:8.1f}"
        )


def print_search(task: Task) -> None:
    """Print exact search with nothing known, and with what that left on disk."""
    print("\nexact search             cache       s   checks      cost  status")
    for name, setup in (("physics", PHYSICS), ("swept", SWEPT)):
        with TemporaryDirectory() as folder:
            for cache in ("cold", "warm") if name == "physics" else ("cold",):
                begin_s = time.perf_counter()
                result = solve(task, "exact", setup, cache=DiskVerdictCache(Path(folder)))
                took_s = time.perf_counter() - begin_s
                cost = "-" if result.cost is None else f"{result.cost:.5f}"
                print(
                    f"{name:24} {cache:5} {took_s:7.2f} {result.checks:8} {cost:>9}  "
                    f"{result.status.value}"
                )


def print_accuracy(task: Task) -> None:
    """Print how far the tip is from where it is to be at the end of its approach."""
    plugin: Any = registry.load("physics", "pybullet")
    skill = task.skill(MOVE)
    print(f"\n{'end of a move down, ' + MOVE:40} error [mm]")
    trials: list[tuple[str, dict[str, Any]]] = [
        (f"operational space, {stiffness:6,.0f} 1/s2", {"stiffness_per_s2": stiffness})
        for stiffness in STIFFNESSES_PER_S2
    ]
    trials.append(("position control", {"control": "position"}))
    for label, options in trials:
        verdict = plugin(task, plugin.Options(**options)).check(skill, task.initial)
        sensed = verdict.evidence.get("sensed", {})
        error = f"{1000 * sensed['tip_error_m']:.3f}" if "tip_error_m" in sensed else "-"
        print(f"{label:40} {error:>10}  {verdict.reason}".rstrip())


def main() -> None:
    """Print all tables."""
    loaded = load_problem(BOARD).task
    queries = queries_of(loaded)
    # Without the hand-made chart, so that feasibility comes from back ends alone.
    task = loaded.replace(chart=(), collision=())
    print_checks(task, queries)
    print_whole_board(task)
    print_search(task)
    print_accuracy(task)


if __name__ == "__main__":
    main()
