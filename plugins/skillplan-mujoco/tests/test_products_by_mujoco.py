"""What one engine proves, another executes to its end; and both derive the same order.

Of every product in `configs` that a simulated arm puts together, in both directions.
"""

from __future__ import annotations

import functools
import math
import sys
from contextlib import closing
from pathlib import Path

import pytest

from skillplan.chart.partial_order import closure
from skillplan.chart.precedence_chart import derive_chart
from skillplan.checks.single_check import introduce
from skillplan.pipeline.run import make_feasibility, solve
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.pipeline.taken_ways import by_ways
from skillplan.records.result import Result
from skillplan.task.skill import Skill
from skillplan.task.task import Task

CONFIGS = Path(__file__).parents[3] / "configs"
CONTACTS = ("contact-pairs",)
ENGINES = ("pybullet", "mujoco")
PRODUCTS = (
    "battery_module",
    "drawer_module",
    "gear_unit",
    "inverter_board",
    "inverter_time",
    "inverter_ur5e",
    "mini_pc",
    "relay_rail",
    "sensor_stack",
)
# Those of which every relation is executed in minutes.
CHARTED = (
    "battery_module",
    "inverter_board",
    "inverter_ur5e",
    "relay_rail",
    "sensor_stack",
)

pytestmark = pytest.mark.release(reason="minutes of executions; small products in the whole suite")


@pytest.fixture(autouse=True)
def both_engines() -> None:
    """Both are there."""
    if sys.version_info >= (3, 12):
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")


def task_of(product: str) -> Task:
    return load_problem(CONFIGS / f"{product}.yaml").task


@functools.cache
def proved(product: str, engine: str) -> Result:
    """Return the optimum that an engine proves."""
    result = solve(task_of(product), setup=Setup(engine, CONTACTS, screening=True))
    assert result.status == "optimal", result.reason
    return result


def plan_of(task: Task, result: Result) -> list[Skill]:
    """Return the skills of a result, each by the way that it takes."""
    skills = [task.skill(step.skill) for step in result.steps]
    return by_ways(task, skills, (), [step.way for step in result.steps])


@pytest.mark.parametrize("product", PRODUCTS)
def test_both_engines_prove_the_same_cost(product: str) -> None:
    """Each by its own executions."""
    costs = [proved(product, engine).cost for engine in ENGINES]
    assert costs[0] == pytest.approx(costs[1], abs=1e-9)


@pytest.mark.parametrize("executing", ENGINES)
@pytest.mark.parametrize("product", PRODUCTS)
def test_a_plan_that_one_engine_proves_is_executed_by_the_other(
    product: str, executing: str
) -> None:
    """To its end, within half a millimetre and a degree; screws are pressed with 3 N or more."""
    proving = next(engine for engine in ENGINES if engine != executing)
    task = task_of(product)
    result = proved(product, proving)
    engine, *_ = introduce(Setup(executing, CONTACTS).back_ends(task))
    done = engine.perform(plan_of(task, result))
    assert done.failed is None, f"{done.failed.skill}: {done.failed.verdict.reason}"
    assert len(done.skills) == len(result.steps)
    assert max(one.offset_m for one in done.arrivals) < 0.0005
    assert max(one.tilt_rad for one in done.arrivals) < math.radians(1.0)
    pressed = [
        one.verdict.evidence["sensed"]["fastening_force_n"]
        for one in done.skills
        if one.skill.startswith("fasten(")
    ]
    assert all(force_n >= 3.0 for force_n in pressed)


@pytest.mark.parametrize("product", CHARTED)
def test_both_engines_derive_the_chart_that_was_drawn_by_hand(product: str) -> None:
    """Without being told it: the same relation, which is that of the file."""
    task = task_of(product)
    bare = task.replace(chart=(), collision=())
    found = []
    for engine in ENGINES:
        with closing(make_feasibility(bare, Setup(engine, CONTACTS))) as checks:
            chart = derive_chart(checks)
        assert (dict(chart.impossible), dict(chart.conditional), chart.undecided) == ({}, {}, ())
        found.append(closure((one.before, one.after) for one in chart.relations))
    assert found[0] == found[1] == closure((line.before, line.after) for line in task.chart)
