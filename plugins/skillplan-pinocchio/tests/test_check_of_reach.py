"""What no posture of the arm reaches, ``check`` tells of, at the key that is to change."""

from pathlib import Path

import pytest

from skillplan.pipeline.preview import preview
from skillplan.pipeline.setup import load_problem

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
    return [line.removeprefix(f"{path}:") for line in preview(load_problem(path)).warnings]


def test_a_grasp_that_the_arm_cannot_reach_is_told_of_with_its_place(tmp_path: Path) -> None:
    """Jaws would fit, but the arm would have to come from behind; no solver is needed to say so."""
    (told,) = warnings(tmp_path, "{approach: [-1, 0, 0]}")
    assert told.startswith(
        "10:12: parts.pillar.grasp: by swept pick(pillar) and place(pillar) are never feasible: "
    )
    assert told.endswith(" Give another grasp (approach, closing_axis, at_m), or move the part.")


@pytest.mark.parametrize("grasp", ["{closing_axis: y}", "[{approach: [-1, 0, 0]}, {}]", "auto"])
def test_nothing_is_told_of_where_some_grasp_is_within_reach(tmp_path: Path, grasp: str) -> None:
    """Of several grasps one is enough."""
    assert warnings(tmp_path, grasp) == []
