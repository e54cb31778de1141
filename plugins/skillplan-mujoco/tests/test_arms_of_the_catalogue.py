"""Every arm of the catalogue stacks two parts: planned by swept, executed by both engines."""

import numpy as np
import pytest

from skillplan import Setup, TaskError, load_problem, solve
from skillplan.checks import introduce
from skillplan.robots import ARMS
from thinned import release_case, slow_case

# Within reach of the smallest arm, and not too near for large ones but one.
BOARD = """kind: assembly
name: two-parts
robot: {model: ARM, home_m: [0.42, 0.0], base_m: [BACK, 0.0, 0.0]}
tools: {gripper: {mass_kg: MASS, holder_m: [0.35, 0.3], opening_m: 0.08}}
initial_tool: gripper
parts:
  base: {tool: gripper, mass_kg: 0.1, size_m: [0.06, 0.06, 0.03], start_m: [0.42, -0.13],
    goal_m: [0.42, 0.11]}
  lid: {tool: gripper, mass_kg: 0.05, size_m: [0.05, 0.05, 0.03], start_m: [0.43, -0.01],
    goal_m: [0.42, 0.11], goal_on: base}
"""
BACK_M = {"m710ic_45m": -0.5, "m710ic_50": -0.5}
CONTACTS = ("contact-pairs",)
# Each has joints and shapes of the same kind as another arm.
SIBLINGS = ("fr3", "iiwa14", "m710ic_45m", "m710ic_50", "ur10e", "ur20", "ur30", "ur3e", "xarm7")


def cases(left_to_releases=()):
    """Return all arms: one in every run, the others in the whole suite or before a release."""
    return [
        arm
        if arm == "xarm6"
        else release_case(arm, reason="executions; an arm of its kind in the whole suite")
        if arm in left_to_releases
        else slow_case(arm, reason="one arm in every run")
        for arm in sorted(ARMS)
    ]


def load(folder, arm, tool_kg=0.73):
    path = folder / "two_parts.yaml"
    board = BOARD.replace("ARM", arm).replace("BACK", str(BACK_M.get(arm, 0.0)))
    path.write_text(board.replace("MASS", str(tool_kg)), "utf-8")
    return load_problem(path).task


def prove(task):
    """Return the skills of the plan that swept proves; the parts' geometry decides the cost."""
    result = solve(task, "exact", Setup(collision=("swept",)))
    assert result.status == "optimal", result.reason
    assert result.cost == pytest.approx(0.61083, abs=5e-6)
    return [task.skill(step.skill) for step in result.steps]


@pytest.mark.parametrize("arm", cases())
def test_swept_proves_the_board(arm, tmp_path):
    prove(load(tmp_path, arm))


@pytest.mark.slow(reason="two executions; other plans are executed in every run")
@pytest.mark.parametrize("arm", cases(SIBLINGS))
def test_both_engines_execute_the_plan_that_swept_proves(arm, tmp_path):
    task = load(tmp_path, arm)
    plan = prove(task)
    for engine in ("pybullet", "mujoco"):
        created, *_ = introduce(Setup(engine, CONTACTS).back_ends(task))
        done = created.perform(plan)
        assert done.failed is None, f"{engine}: {done.failed.skill}: {done.failed.verdict.reason}"


@pytest.mark.parametrize("arm", sorted(ARMS))
def test_a_part_and_a_tool_heavier_than_the_payload_are_refused(arm, tmp_path):
    """The part weighs 0.1 kg."""
    payload_kg = ARMS[arm][0].payload_kg
    load(tmp_path, arm, payload_kg - 0.11)
    with pytest.raises(TaskError, match=rf"the arm carries, {payload_kg:g} kg"):
        load(tmp_path, arm, payload_kg - 0.09)


def place_block(engine, folder, text):
    """Return what an engine did to pick and place the block of a task."""
    path = folder / "block.yaml"
    path.write_text(text, "utf-8")
    task = load_problem(path).task
    created, *_ = introduce(Setup(engine, ()).back_ends(task))
    return created.perform([task.skill("pick(block)"), task.skill("place(block)")])


HEAVY = """kind: assembly
name: heavy
robot: {model: ur20, home_m: [0.8, -0.1], safe_height_m: 0.5}
tools: {cup: {type: suction, holder_m: [0.5, 0.7], cup_diameter_m: 0.1, mass_kg: 1.0}}
initial_tool: cup
parts:
  block: {tool: cup, mass_kg: 18.0, size_m: [0.2, 0.1, 0.6], start_m: [1.0, 0.3],
    goal_m: [-0.2, -0.9]}
"""


@pytest.mark.slow(reason="an execution in each engine")
@pytest.mark.parametrize("engine", ["pybullet", "mujoco"])
def test_the_drives_of_an_arm_know_the_inertia_of_a_heavy_load(engine, tmp_path):
    """A wrist of 0.06 kg m2 swings a load of 1.4 kg m2; it lagged by 12 mm without touching."""
    done = place_block(engine, tmp_path, HEAVY)
    assert done.failed is None, done.failed.verdict.reason


SLOT = """kind: assembly
name: slot
robot: {model: m710ic_50, home_m: [0.9, -0.1], safe_height_m: 0.5}
tools: {cup: {type: suction, holder_m: [0.5, 0.9], cup_diameter_m: 0.1, mass_kg: 1.0}}
initial_tool: cup
parts:
  left: {fixed: true, size_m: [0.05, 0.1, 0.1], goal_m: [0.6749, -0.5]}
  right: {fixed: true, size_m: [0.05, 0.1, 0.1], goal_m: [0.9251, -0.5]}
  block: {tool: cup, mass_kg: 18.0, size_m: [0.2, 0.1, 0.6], start_m: [1.0, 0.5],
    goal_m: [0.8, -0.5], insert_along: [[0.0, -1.0, 0.0]],
    fits: {left: {drawn_m: 0.0001, play_m: 0.0001, outside_m: 0.0}}}
"""


@pytest.mark.slow(reason="an execution")
def test_a_heavy_arm_on_the_springs_of_a_fit_does_not_lag(tmp_path):
    """Springs alone accelerated its inertia: it lagged by 1.2 mm, turned and pressed with 9 N."""
    done = place_block("mujoco", tmp_path, SLOT)
    evidence = done.skills[-1].verdict.evidence
    assert evidence["sensed"]["insertion_force_n"] < 1.0
    assert np.linalg.norm(evidence["offset_mm"]) < 0.1


BESIDE_THE_TIP = """kind: assembly
name: beside-the-tip
robot: {model: m710ic_50, home_m: [0.61, 0.0], safe_height_m: 0.6}
tools: {jaws: {model: robotiq_2f85, holder_m: [-0.266, 0.635], force_n: 129.0}}
initial_tool: jaws
parts:
  near: {fixed: true, size_m: [0.1, 0.05, 0.1], goal_m: [0.6, 0.3749]}
  far: {fixed: true, size_m: [0.1, 0.05, 0.1], goal_m: [0.6, 0.5251]}
  block: {tool: jaws, mass_kg: 4.0, size_m: [0.08, 0.1, 0.15], start_m: [1.2, 0.24],
    goal_m: [0.6, 0.45], insert_along: [[1.0, 0.0, 0.0]], insert_m: 0.12,
    grasp: {type: jaws, closing_axis: x, width_m: 0.08, depth_m: 0.015, at_m: [0.0, 0.03]},
    fits: {near: {drawn_m: 0.0001, play_m: 0.0001, outside_m: 0.0}}}
"""


@pytest.mark.slow(reason="an execution")
def test_a_heavy_arm_stands_before_it_goes_into_a_fit_on_springs(tmp_path):
    """It went on to swing there: it tilted by 0.06 degrees, and touched a wall with 0.6 N."""
    done = place_block("mujoco", tmp_path, BESIDE_THE_TIP)
    evidence = done.skills[-1].verdict.evidence
    assert evidence["sensed"]["insertion_force_n"] < 0.1
