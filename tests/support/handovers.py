"""Boards with their best plans, handed over to exporters."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from skillplan.exporters import Handover
from skillplan.model import replay
from skillplan.pipeline import Setup, load_problem, make_handover, make_model, solve
from skillplan.task import Task

CONFIGS = Path(__file__).parents[2] / "configs"
BY_CHART = Setup(collision=("precedence",))


def solved(task: Task, setup: Setup = BY_CHART) -> Handover:
    """Return a task with its proved optimum."""
    model = make_model(task, setup)
    result = solve(task, "auto", setup)
    assert result.gap == 0, result.reason
    return make_handover(model, setup, replay(model, [task.skill(s.skill) for s in result.steps]))


@cache
def best(name: str) -> Handover:
    """Return a config with its proved optimum."""
    return solved(load_problem(CONFIGS / f"{name}.yaml").task)
