"""What no posture of the arm reaches, ``check`` tells of, at the key that is to change."""

import itertools
import math
from pathlib import Path

import pytest

from skillplan.physics import find_downward_ring
from skillplan.pipeline import load_problem, obstacles, preview_problem
from skillplan.robots import ARMS
from skillplan.task import Robot
from skillplan_pinocchio import ArmModel, Unreachable, iterate_elbows

# Arms whose region was measured.
RINGED = ("panda", "ur5e")
CONFIGS = Path(__file__).parents[3] / "configs"

PILLAR = """kind: assembly
name: pillar
robot: {home_m: [0.4, 0.0]}
tools: {gripper: {holder_m: [0.3, 0.4], opening_m: 0.08}}
initial_tool: gripper
parts:
  pillar:
    tool: gripper
    size_m: [0.04, 0.04, 0.15]
    grasp: GRASP
    start_m: [0.45, -0.2]
    goal_m: [0.70, 0.2]
"""


def warnings(folder: Path, grasp: str) -> list[str]:
    path = folder / "pillar.yaml"
    path.write_text(PILLAR.replace("GRASP", grasp), "utf-8")
    return [line.removeprefix(f"{path}:") for line in preview_problem(load_problem(path)).warnings]


def test_a_grasp_that_the_arm_cannot_reach_is_told_of_with_its_place(tmp_path):
    """Jaws would fit, but the arm would have to come from behind; no solver is needed to say so."""
    (message,) = warnings(tmp_path, "{approach: [-1, 0, 0]}")
    assert message.startswith(
        "10:12: parts.pillar.grasp: by swept pick(pillar) and place(pillar) are never feasible: "
    )
    assert message.endswith(" Give another grasp (approach, closing_axis, at_m), or move the part.")


@pytest.mark.parametrize("grasp", ["{closing_axis: y}", "[{approach: [-1, 0, 0]}, {}]", "auto"])
def test_nothing_is_told_of_where_some_grasp_is_within_reach(tmp_path, grasp):
    """Of several grasps one is enough."""
    assert warnings(tmp_path, grasp) == []


def assert_points_down_all_over(name: str, steps: int, turns: int) -> None:
    """A posture is found on a lattice over the ring's section, its borders included."""
    model, hand = ARMS[name]
    arm = ArmModel.of(Robot("arm", (0.0, 0.0, 0.0), 1.0, 0.2, {}, (), model, hand=hand))
    ring = find_downward_ring(model)
    assert ring is not None
    share = [number / steps for number in range(steps + 1)]
    for out, up, turn in itertools.product(share, share, range(turns)):
        away_m = ring.near_m + out * (ring.far_m - ring.near_m)
        height_m = ring.low_m + up * (ring.high_m - ring.low_m) - hand.tip_m
        bearing = 2.4 * turn
        tip = (away_m * math.cos(bearing), away_m * math.sin(bearing), height_m)
        result = iterate_elbows(arm, tip, bearing + turn * math.pi / turns)
        assert any(not isinstance(posture, Unreachable) for posture in result), tip


@pytest.mark.parametrize("name", RINGED)
def test_where_the_arm_surely_points_down_a_posture_does(name):
    """However the hand is turned about the vertical."""
    assert_points_down_all_over(name, 2, 2)


@pytest.mark.slow(reason="1,800 postures an arm; 18 in every run")
@pytest.mark.parametrize("name", RINGED)
def test_so_it_does_on_a_finer_lattice(name):
    assert_points_down_all_over(name, 14, 8)


@pytest.mark.slow(reason="every file by swept; boards that need none in every run")
@pytest.mark.parametrize(
    "path",
    [path for path in sorted(CONFIGS.glob("*.yaml")) if "swarmitfix" not in path.name],
    ids=lambda path: path.stem,
)
def test_what_surely_is_in_reach_swept_has_nothing_to_say_of(path, monkeypatch):
    """Asked of all skills, it warns of the same."""
    problem = load_problem(path)
    result = preview_problem(problem).warnings
    monkeypatch.setattr(obstacles, "is_surely_reached", lambda *_: False)
    assert preview_problem(problem).warnings == result
