"""Swept convex hulls against axis-aligned boxes: seconds a check, a chart and a search take.

Every back end is queried about every applicable skill in every state that boxes lead to, at once
with a cold detector and again with a warm one; the model's own reuse of verdicts is left out.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from skillplan import Setup, load_problem, solve
from skillplan.chart.precedence_chart import derive_chart
from skillplan.checks.feasibility import Feasibility
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.testing import reachable_states

BOARD = "configs/inverter_board.yaml"
DETECTORS = ("aabb", "swept")
# The imports and the first hull of a process are not timed.
ROUNDS = 5


def checks_of(task: Task) -> list[tuple[Skill, State]]:
    """Return every applicable skill in every state that boxes lead to."""
    boxes: Any = registry.load("collision", "aabb")
    model = SkillModel(Feasibility(task, [boxes(task)]))
    return [
        (skill, state) for state in reachable_states(model) for skill in model.applicable(state)
    ]


def checking_s(detector: Any, checks: Iterable[tuple[Skill, State]]) -> float:
    """Return how long a detector takes for all checks [s]."""
    begin_s = time.perf_counter()
    for skill, state in checks:
        detector.check(skill, state)
    return time.perf_counter() - begin_s


def main() -> None:
    """Print a row for every detector, and the ratio of the two."""
    task = load_problem(BOARD).task
    checks = checks_of(task)
    print(f"{len(checks)} checks of {task.name}, best of {ROUNDS} rounds\n")
    columns = ("first [ms]", "checks/s", "again/s", "chart [ms]", "exact [ms]", "optimum")
    print(f"{'detector':12}" + "".join(f"{column:>12}" for column in columns))
    rows = []
    for name in DETECTORS:
        plugin: Any = registry.load("collision", name)
        rounds = []
        for _ in range(ROUNDS):
            detector = plugin(task)
            skills = {skill.name: (skill, state) for skill, state in reversed(checks)}
            first_s = checking_s(detector, skills.values()) / len(skills)
            cold_s = checking_s(plugin(task), checks) / len(checks)
            warm_s = checking_s(detector, checks) / len(checks)
            begin_s = time.perf_counter()
            derive_chart(Feasibility(task, [plugin(task)]))
            chart_s = time.perf_counter() - begin_s
            result = solve(task, "exact", Setup(collision=(name,), with_chart=False))
            rounds.append((first_s, cold_s, warm_s, chart_s, result.wall_s))
        best = [min(values) for values in zip(*rounds, strict=True)]
        rows.append(best)
        first_s, cold_s, warm_s, chart_s, exact_s = best
        cost = "-" if result.cost is None else f"{result.cost:.5f}"
        print(
            f"{name:12}{1e3 * first_s:12.3f}{1 / cold_s:12,.0f}{1 / warm_s:12,.0f}"
            f"{1e3 * chart_s:12.1f}{1e3 * exact_s:12.1f}{cost:>12}"
        )
    ratios = [other / one for one, other in zip(*rows, strict=True)]
    print("slower by   " + "".join(f"{ratio:12.1f}" for ratio in ratios))


if __name__ == "__main__":
    main()
