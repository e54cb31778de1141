"""Convex pieces that a task file gives for a mesh: what a part moves as."""

import json

import pytest

import skillplan
from skillplan.cli import run

BOARD = """\
kind: assembly
name: channel-on-plate
robot: {home_m: [0.3, 0.0], safe_height_m: 0.2}
tools:
  gripper: {opening_m: 0.080, holder_m: [0.5, 0.3]}
  cup: {type: suction, holder_m: [0.6, 0.3]}
initial_tool: gripper
parts:
  plate: {tool: cup, size_m: [0.10, 0.16, 0.02], start_m: [0.3, 0.2], goal_m: [0.5, 0.0]}
  channel:
    tool: gripper
    meshes: [{file: channel.obj, pieces: pieces.obj}]
    start_m: [0.4, -0.2]
    goal_m: [0.5, 0.0]
    goal_on: plate
"""
# A floor and two walls, of 5 mm each.
BOXES = (
    ((-0.015, 0.015), (-0.01, 0.01), (0.0, 0.005)),
    ((-0.015, -0.010), (-0.01, 0.01), (0.0, 0.020)),
    ((0.010, 0.015), (-0.01, 0.01), (0.0, 0.020)),
)
FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
PROFILE = ((-15, 20), (-15, 0), (15, 0), (15, 20), (10, 20), (10, 5), (-10, 5), (-10, 20))
"""Of the channel, x and z [mm]."""


def boxes_text(boxes):
    """Return boxes as OBJ, each with corners of its own."""
    lines = []
    for number, (xs, ys, zs) in enumerate(boxes):
        lines += [f"v {x} {y} {z}" for x in xs for y in ys for z in zs]
        lines += ["f " + " ".join(str(8 * number + corner + 1) for corner in f) for f in FACES]
    return "\n".join(lines) + "\n"


def channel_text():
    """Return the closed surface of the channel as OBJ."""
    corners = [(x / 1e3, y, z / 1e3) for y in (-0.01, 0.01) for x, z in PROFILE]
    sides = [(i, i + 8, (i + 1) % 8 + 8, (i + 1) % 8) for i in range(8)]
    ends = [(0, 1, 6, 7), (1, 2, 5, 6), (2, 3, 4, 5)]
    ends += [tuple(corner + 8 for corner in reversed(end)) for end in ends]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in sides + ends]
    return "\n".join(lines) + "\n"


@pytest.fixture
def board(tmp_path):
    """A task file whose channel brings three pieces along."""
    (tmp_path / "channel.obj").write_text(channel_text())
    (tmp_path / "pieces.obj").write_text(boxes_text(BOXES))
    path = tmp_path / "board.yaml"
    path.write_text(BOARD)
    return path


def test_check_says_as_how_many_pieces_a_part_moves_and_how_far_they_are_off(board, capsys):
    """No plugin takes it apart."""
    assert run(["check", str(board), "--format", "json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)["pieces"]
    assert result["part"] == "channel"
    assert result["pieces"] == 3
    assert result["outside_mm"] == pytest.approx(0, abs=1e-3)
    assert result["missing_mm"] == pytest.approx(0, abs=1e-3)


def test_other_pieces_are_another_task(board):
    """Its hash says so, as verdicts that are kept depend on them."""
    first = skillplan.load_problem(board).sha256
    (board.parent / "pieces.obj").write_text(boxes_text((BOXES[1], BOXES[0], BOXES[2])))
    assert skillplan.load_problem(board).sha256 != first
