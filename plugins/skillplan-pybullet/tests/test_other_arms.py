"""Arms beside the Panda: the same tasks by any arm that is described."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from situations import assembly
from skillplan.checks import introduce
from skillplan.pipeline import Setup, load_problem, solve
from skillplan.robots import PANDA_HAND, UR5E, Hand
from skillplan.task import Pose, Task
from skillplan.testing import lid_content
from skillplan_pybullet import PybulletEngine
from skillplan_simulation import ContactPairsDetector
from thinned import release_case, slow_case

# It looks along -x where its joints are at home.
TURNED = Pose.upright((0.0, 0.0, 0.0), math.pi).orientation
STRAIGHT_M = ((0.0, 0.006, 0.0, 0.01), (0.06, 0.006, 0.0, 0.01))
OTHER = Hand(0.06, 0.14, 30.0, STRAIGHT_M, PANDA_HAND.body_m)
LEANING = Pose.turned((0.0, 0.1, 0.2), (0.3, 0.0, 3.0))


def by_ur5e(task: Task, **changes) -> Task:
    """Return a task whose arm is a UR5e."""
    (robot,) = task.scene.robots
    other = replace(robot, **({"model": UR5E, "base_orientation": TURNED} | changes))
    return replace(task, scene=replace(task.scene, robots=(other,)))


def lid() -> Task:
    """Return the task of a lid with a screw."""
    content = lid_content()
    part = content["parts"]["lid"] | {"start_m": [0.45, -0.15]}
    del part["goal_on"]
    content["parts"] = {"lid": part}
    content["chart"] = [{"before": "lid", "after": ["screw"]}]
    return assembly(content)


def performed(task: Task, plan, **options):
    engine = PybulletEngine(task, PybulletEngine.Options(**options))
    introduce([engine, ContactPairsDetector(task)])
    perform = engine.perform([task.skill(name) for name in plan])
    assert perform.failed is None, perform.failed.verdict.reason
    for arrival in perform.arrivals:
        assert arrival.offset_m < 0.0005, arrival
        assert arrival.tilt_rad < math.radians(1), arrival
    return perform


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="the Panda's hand"),
        slow_case({"hand": OTHER}, id="another hand", reason="two others in every run"),
        pytest.param(
            {"base": LEANING.position, "base_orientation": LEANING.orientation},
            id="a base that leans",
        ),
    ],
)
def test_a_ur5e_picks_a_part(changes):
    task = by_ur5e(lid(), **changes)
    verdict = PybulletEngine(task).check(task.skill("pick(lid)"), task.initial)
    assert verdict.is_feasible, verdict.reason


@pytest.mark.slow(reason="a plan of four skills; one skill in every run")
@pytest.mark.parametrize("control", ["osc", "position"])
def test_a_ur5e_screws_a_lid_on(control):
    performed(
        by_ur5e(lid()),
        ("pick(lid)", "place(lid)", "load(screwdriver)", "fasten(screw)"),
        control=control,
    )


# The boards beyond the paper's, executed: what the files' charts allow can be done.


CONFIGS = Path(__file__).parents[3] / "configs"
PHYSICS = Setup(physics="pybullet", collision=("contact-pairs",))


@pytest.mark.parametrize(
    "name",
    [
        release_case(
            "battery_module", reason="half a minute of executions; by swept hulls in every run"
        ),
        release_case("relay_rail", reason="minutes of executions"),
    ],
)
def test_physics_proves_the_optimum_of_the_chart(name):
    """Asked about what comes up on the way to the proof: 49 and 167 executions."""
    task = load_problem(CONFIGS / f"{name}.yaml").task
    simulated, drawn = solve(task, setup=PHYSICS), solve(task)
    assert simulated.status == "optimal"
    assert simulated.cost == pytest.approx(drawn.cost)
    assert [s.action for s in simulated.steps] == [s.action for s in drawn.steps]


@pytest.mark.release(reason="executions of a board with uncertain grasps")
def test_physics_gives_the_expected_cost_of_the_chart():
    """By the outcome in which the grasp holds; no proof is audited where checks are expensive."""
    task = load_problem(CONFIGS / "inverter_grasps.yaml").task
    simulated = solve(task, "value-iteration", PHYSICS)
    assert simulated.status == "solved"
    assert simulated.cost == pytest.approx(solve(task, "value-iteration").cost)
