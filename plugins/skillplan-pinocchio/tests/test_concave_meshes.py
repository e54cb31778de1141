"""Meshes that are not convex: exact triangles where they stand, pieces by CoACD where they move."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from concave_shapes import as_obj, channel, channel_boxes
from skillplan import load_problem
from skillplan.collision import decompose
from skillplan.task import Body, Box, Mesh, Pose
from skillplan_pinocchio import SweptDetector, make_pieces, make_standing_pieces, measure_distance

ORIGIN = (0.0, 0.0, 0.0)
TASK = """kind: assembly
name: channel
robot: {home_m: [0.4, 0.0], safe_height_m: 0.2}
tools: {cup: {type: suction, holder_m: [0.6, 0.3]}}
initial_tool: cup
parts:
  channel: {tool: cup, meshes: [{file: channel.obj}], start_m: [0.45, -0.25], goal_m: [0.5, 0.0]}
  board:
    tool: cup
    size_m: [0.08, 0.06, 0.004]
    start_m: [0.4, 0.3]
    goal_m: [0.5, 0.0]
    goal_on: channel
"""
WIDE = {"width_m": 0.36, "depth_m": 0.2, "height_m": 0.03}


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    """Return a board that belongs into a wide channel; its pieces are made once."""
    folder = tmp_path_factory.mktemp("channel")
    (folder / "channel.obj").write_text(as_obj(channel(**WIDE)))
    (folder / "task.yaml").write_text(TASK)
    (task,) = load_problem(str(folder / "task.yaml")).tasks
    return task


@pytest.mark.slow(reason="takes a mesh apart; its pieces move in every run")
def test_coacd_takes_a_channel_apart_and_says_how_well():
    """The same pieces whenever it is asked, with an error far below what its walls are thick."""
    from skillplan_pinocchio import convex_pieces

    mesh = channel()
    corners, faces = np.array(mesh.corners), np.array(mesh.faces)
    first, other = convex_pieces(corners, faces), convex_pieces(corners, faces)
    assert [piece.tolist() for piece, _ in first] == [piece.tolist() for piece, _ in other]
    decomposition = decompose(mesh)
    assert 3 <= len(decomposition.pieces) <= 8
    assert decomposition.error_m < 5e-4


@pytest.mark.slow(reason="takes a mesh apart in a process; the line by itself in every run")
def test_check_announces_on_stderr_what_takes_long_and_prints_one_document(tmp_path):
    (tmp_path / "channel.obj").write_text(as_obj(channel(**WIDE)))
    (tmp_path / "task.yaml").write_text(TASK)
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", "check", "task.yaml", "--format", "json"],
        cwd=tmp_path,
        env={**os.environ, "SKILLPLAN_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
    )
    assert done.stderr.startswith("skillplan: making convex pieces of 'channel', mesh 1 of 1")
    assert json.loads(done.stdout)["pieces"][0]["part"] == "channel"


def test_a_part_stands_as_its_triangles_and_moves_as_its_pieces(task):
    """Both within the same box."""
    body = task.scene.body("channel")
    assert isinstance(body.exact_shapes[0], Mesh)
    assert len(body.shapes) >= 3
    (standing,) = make_standing_pieces(body, Pose(ORIGIN))
    moving = make_pieces(body, Pose(ORIGIN))
    low = np.min([piece.low for piece in moving], axis=0)
    assert standing.low == pytest.approx(low, abs=1e-6)


def test_swept_lets_a_board_down_onto_the_floor_of_a_mesh_with_walls(task):
    """It is borne by the floor, and the arm keeps off the walls."""
    detector = SweptDetector(task)
    facts = task.facts
    state = facts.of("held(board)", "tool(cup)", "at(board.start)", "placed(channel)")
    assert detector.check(task.skill("place(board)"), state).is_feasible
    state = facts.of("held(board)", "tool(cup)", "at(board.start)", "at_start(channel)")
    verdict = detector.check(task.skill("place(board)"), state)
    assert verdict.reason == "board has nothing beneath it"
    state = facts.of("hand_free", "tool(cup)", "at(home)", "at_start(channel)", "at_start(board)")
    assert detector.check(task.skill("pick(channel)"), state).is_feasible


@given(
    st.tuples(*[st.floats(0.005, 0.04)] * 3),
    st.tuples(st.floats(-0.06, 0.06), st.floats(-0.05, 0.05), st.floats(-0.02, 0.07)),
    st.tuples(*[st.floats(-3.1, 3.1)] * 3),
)
@settings(max_examples=60, deadline=None)
def test_triangles_are_met_where_the_boxes_they_bound_are(size, place, turn):
    """What is not wholly inside; to the tolerance of contacts, without margins of coal."""
    channel_body = Body("channel", channel_boxes(), (), 1.0, surfaces=(channel(),))
    (triangles,) = make_standing_pieces(channel_body, Pose(ORIGIN))
    boxes = make_pieces(channel_body, Pose(ORIGIN))
    (moving,) = make_pieces(Body("it", (Box(size, ORIGIN),), (), 1.0), Pose.turned(place, turn))
    exact = measure_distance(moving, triangles).distance_m
    of_boxes = min(measure_distance(moving, box).distance_m for box in boxes)
    if of_boxes > 0:
        assert exact == pytest.approx(of_boxes, abs=1e-6)
    elif of_boxes < -6e-4:
        assert exact < -1e-4
