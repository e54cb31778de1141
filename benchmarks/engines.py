"""Two engines on the same questions: CPU seconds of checks, steps a second, cold searches.

Rounds of both take turns, and the least of each counts, so that what else the machine does bears on
neither alone. Run from the repository: ``python benchmarks/engines.py``, with names of engines
behind it for others than pybullet and mujoco.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

from skillplan import Setup, load_problem, solve
from skillplan.checks.single_check import introduce
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

BOARD = "configs/inverter_board.yaml"
ENGINES = ("pybullet", "mujoco")
DETECTOR = "contact-pairs"
ROUNDS = 5
SEARCHES = 3

Query = tuple[Skill, State]


def queries_of(task: Task) -> list[Query]:
    """Return the skills of the best plan, each with the state in which it is executed."""
    state, queries = task.initial, []
    for step in solve(task, "exact").steps:
        skill = task.skill(step.skill)
        queries.append((skill, state))
        state = skill.prediction.apply(state)
    return queries


def checking_s(task: Task, engine: str, queries: Sequence[Query]) -> tuple[float, int]:
    """Return the CPU seconds in which a fresh engine answers, and its simulation steps."""
    back_ends = Setup(engine, (DETECTOR,)).back_ends(task)
    introduce(back_ends)
    begin_s = time.process_time()
    verdicts = [back_end.check(*query) for query in queries for back_end in back_ends]
    took_s = time.process_time() - begin_s
    assert all(verdict.is_feasible for verdict in verdicts)
    return took_s, sum(verdict.evidence.get("steps", 0) for verdict in verdicts)


def search_s(task: Task, engine: str) -> float:
    """Return the CPU seconds of an exact search that knows nothing."""
    begin_s = time.process_time()
    result = solve(task, "exact", Setup(engine, (DETECTOR,)), cache=VerdictCache())
    took_s = time.process_time() - begin_s
    assert result.status.value == "optimal", result.status
    return took_s


def least(engines: Sequence[str], rounds: int, measure: Callable[[str], float]) -> dict[str, float]:
    """Return the least that each engine took [s], in rounds that take turns."""
    took = [{engine: measure(engine) for engine in engines} for _ in range(rounds)]
    return {engine: min(one[engine] for one in took) for engine in engines}


def main() -> None:
    """Print both tables."""
    engines = tuple(sys.argv[1:]) or ENGINES
    loaded = load_problem(BOARD).task
    queries = queries_of(loaded)
    steps = {engine: checking_s(loaded, engine, queries)[1] for engine in engines}
    checks = least(engines, ROUNDS, lambda engine: checking_s(loaded, engine, queries)[0])
    first = engines[0]
    print(f"{len(queries)} checks of the best plan, CPU seconds, least of {ROUNDS} rounds\n")
    print(f"{'engine':12}{'s':>9}{'steps/s':>10}{'share':>8}")
    for engine, took_s in checks.items():
        speed = steps[engine] / took_s
        print(f"{engine:12}{took_s:9.3f}{speed:10,.0f}{took_s / checks[first]:8.2f}")
    # Without the hand-made chart, so that feasibility comes from the engine alone.
    task = loaded.replace(chart=(), collision=())
    searches = least(engines, SEARCHES, lambda engine: search_s(task, engine))
    print(f"\nexact search, cold, CPU seconds, least of {SEARCHES}\n")
    print(f"{'engine':12}{'s':>9}{'share':>8}")
    for engine, took_s in searches.items():
        print(f"{engine:12}{took_s:9.3f}{took_s / searches[first]:8.2f}")


if __name__ == "__main__":
    main()
