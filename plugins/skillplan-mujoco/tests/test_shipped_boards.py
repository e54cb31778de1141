"""Every assembly file that ships has a plan by geometry and by both engines, which execute it.

What one engine proves, the other executes as well; and both derive the same order.
"""

from __future__ import annotations

import functools
import math
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from skillplan.chart import closure, derive_chart
from skillplan.checks import introduce
from skillplan.pipeline import Setup, choose_variants, load_problem, make_feasibility, solve
from skillplan.records import Result
from skillplan.task import Skill, Task

ROOT = Path(__file__).parents[3]
CONFIGS = ROOT / "configs"
STARTER = ROOT / "src" / "skillplan" / "domains" / "assembly" / "starter.yaml"
CONTACTS = ("contact-pairs",)
ENGINES = ("pybullet", "mujoco")
BOARDS = {
    path.stem: path
    for path in (STARTER, *sorted([*CONFIGS.glob("*.yaml"), *ROOT.glob("examples/*.yaml")]))
    if "\nkind: assembly" in path.read_text("utf-8")
}
# Boards of which the whole suite has a plan by an engine: jaws, cups, screws, a press, feeders,
# zones and chance. All others are left to releases, new files too.
IN_WHOLE_SUITE = {
    "mujoco": (
        "starter",
        "battery_module",
        "cell_tools",
        "cell_zones",
        "fixture_cell",
        "inverter_board",
        "inverter_grasps",
        "inverter_ur5e",
        "relay_rail",
        "sensor_box",
        "sensor_stack",
    ),
    "pybullet": ("starter", "cell_tools"),
}
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
CHARTED = ("battery_module", "inverter_board", "inverter_ur5e", "relay_rail", "sensor_stack")

minutes = pytest.mark.release(
    reason="minutes of executions; plans of all boards in the whole suite"
)


@pytest.fixture(autouse=True)
def both_engines():
    """Both are there."""
    if sys.version_info >= (3, 12):
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")


def task_of(product: str) -> Task:
    return load_problem(BOARDS[product]).task


@functools.cache
def proved(product: str, engine: str) -> Result:
    """Return the optimum that an engine proves."""
    result = solve(task_of(product), setup=Setup(engine, CONTACTS, screening=True))
    # Where checks are expensive, no proof under chance is audited.
    status = "solved" if product == "inverter_grasps" else "optimal"
    assert result.status == status, result.reason
    return result


def plan_of(task: Task, result: Result) -> list[Skill]:
    """Return the skills of a result, each by the way that it takes."""
    skills = [task.skill(step.skill) for step in result.steps]
    return choose_variants(task, skills, (), [step.way for step in result.steps])


def assert_executed(product: str, result: Result, executing: str) -> None:
    """Assert that an engine executes a plan to its end, within half a millimetre and a degree.

    Screws are pressed with 3 N or more.
    """
    task = task_of(product)
    engine, *_ = introduce(Setup(executing, CONTACTS).back_ends(task))
    done = engine.perform(plan_of(task, result))
    assert done.failed is None, f"{done.failed.skill}: {done.failed.verdict.reason}"
    assert len(done.skills) == len(result.steps)
    assert max(arrival.offset_m for arrival in done.arrivals) < 0.0005
    assert max(item.tilt_rad for item in done.arrivals) < math.radians(1.0)
    pressed = [
        skill.verdict.evidence["sensed"]["fastening_force_n"]
        for skill in done.skills
        if skill.skill.startswith("fasten(")
    ]
    assert all(force_n >= 3.0 for force_n in pressed)


def executions() -> list[Any]:
    """Return every board with every engine."""
    whole = pytest.mark.slow(reason="a search by physics and its plan; the starter in every run")
    long = pytest.mark.release(
        reason="up to a minute; the same kinds of skills on other boards in the whole suite"
    )
    return [
        pytest.param(
            product,
            engine,
            marks=()
            if product == "starter" and engine == "mujoco"
            else (whole if product in IN_WHOLE_SUITE[engine] else long),
        )
        for product in BOARDS
        for engine in ENGINES
    ]


@pytest.mark.parametrize(("product", "engine"), executions())
def test_an_engine_finds_a_plan_of_every_board_and_executes_it(product, engine):
    assert_executed(product, proved(product, engine), engine)


@pytest.mark.slow(reason="a search by physics and its plan; another arm in every run")
@pytest.mark.parametrize("engine", ENGINES)
def test_a_ur5e_builds_the_board_that_init_writes(engine):
    task = load_problem(STARTER, changes={"robot.model": "ur5e"}).task
    result = solve(task, setup=Setup(engine, CONTACTS, screening=True))
    assert result.status == "optimal", result.reason
    created, *_ = introduce(Setup(engine, CONTACTS).back_ends(task))
    done = created.perform(plan_of(task, result))
    assert done.failed is None, f"{done.failed.skill}: {done.failed.verdict.reason}"


@pytest.mark.parametrize(
    "product",
    [
        pytest.param(
            product,
            marks=()
            if product == "starter"
            else pytest.mark.release(reason="proved where its expected figures are")
            if product not in IN_WHOLE_SUITE["mujoco"] or product.startswith("cell_")
            else pytest.mark.slow(reason="the starter in every run"),
        )
        for product in BOARDS
    ],
)
def test_swept_finds_a_plan_of_every_board(product):
    result = solve(task_of(product), setup=Setup(collision=("swept",)))
    assert result.status == "optimal", result.reason


@minutes
@pytest.mark.parametrize("product", PRODUCTS)
def test_both_engines_prove_the_same_cost(product):
    """Each by its own executions; the distance that swept hulls prove, too."""
    costs = [proved(product, engine).cost for engine in ENGINES]
    task = task_of(product)
    if not task.metric.is_duration:
        costs.append(solve(task, setup=Setup(collision=("swept",))).cost)
    assert costs == pytest.approx([costs[0]] * len(costs), abs=1e-9)


@minutes
@pytest.mark.parametrize("executing", ENGINES)
@pytest.mark.parametrize("product", PRODUCTS)
def test_a_plan_that_one_engine_proves_is_executed_by_the_other(product, executing):
    """To its end, within half a millimetre and a degree; screws are pressed with 3 N or more."""
    proving = next(engine for engine in ENGINES if engine != executing)
    assert_executed(product, proved(product, proving), executing)


@minutes
@pytest.mark.parametrize("product", CHARTED)
def test_both_engines_derive_the_chart_that_was_drawn_by_hand(product):
    """Without being told it: the same relation, which is that of the file."""
    task = task_of(product)
    bare = task.replace(chart=(), collision=())
    results = []
    for engine in ENGINES:
        with closing(make_feasibility(bare, Setup(engine, CONTACTS))) as checks:
            chart = derive_chart(checks)
        assert (dict(chart.impossible), dict(chart.conditional), chart.undecided) == ({}, {}, ())
        results.append(closure((relation.before, relation.after) for relation in chart.relations))
    assert results[0] == results[1] == closure((line.before, line.after) for line in task.chart)
