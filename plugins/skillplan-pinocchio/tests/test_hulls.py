"""The outline of the hand, against the meshes that pybullet brings along."""

import math

import coal
import numpy as np
import pytest

from skillplan.physics import find_opening_m
from skillplan.robots import panda_hand
from skillplan.task import Box, Robot, Tool, ToolKind
from skillplan_pinocchio import ConvexPiece, build_hand_parts

AT = (0.0, 0.0, 0.3)
GRIPPER = Tool("gripper", "tool(gripper)", AT)
CUP = Tool("cup", "tool(cup)", AT, kind=ToolKind.SUCTION)
DRIVER = Tool("driver", "tool(driver)", AT, kind=ToolKind.SCREWDRIVER)
ROBOT = Robot("panda", (0.0, 0.0, 0.0), 0.855, 0.15, {}, (GRIPPER, CUP, DRIVER))


def pieces(tool, opening_m=0.0, tip=(0.0, 0.0, 0.0), yaw_rad=0.0):
    """Return the pieces of what is at the end of the arm, by the names of its parts."""
    return {part.name: part.at(tip, yaw_rad) for part in build_hand_parts(ROBOT, tool, opening_m)}


def tip_frame(depths_m, along_m, across_m):
    """Return points given in the frame of the hand in that of its tip."""
    return np.column_stack([along_m, across_m, panda_hand.TIP_M - depths_m])


def outside_m(points, piece):
    """Return how far the farthest point stands out of a piece [m]."""
    speck = coal.Sphere(1e-6)
    still = coal.Transform3s()
    return max(
        coal.distance(
            speck,
            coal.Transform3s(np.eye(3), point),
            piece.hull,
            still,
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        for point in points
    )


def volume_m3(points):
    """Return the volume of the convex hull of points."""
    return ConvexPiece(np.asarray(points)).hull.computeVolume()


def test_the_hand_encloses_the_published_mesh_and_is_not_much_larger(mesh_corners):
    """Within a millimetre; whichever way round it is, by less than 3 % of its volume."""
    mesh = mesh_corners("hand")
    corners = tip_frame(mesh[:, 2], mesh[:, 1], mesh[:, 0])
    for hand, turn in zip(pieces(GRIPPER)["the hand"], (1, -1), strict=True):
        assert outside_m(corners * (turn, turn, 1), hand) < 1e-3
        assert volume_m3(corners) < hand.hull.computeVolume() < 1.03 * volume_m3(corners)


@pytest.mark.parametrize("opening_m", [0.0, 0.03, 0.08])
def test_the_fingers_enclose_the_published_mesh_and_are_not_much_larger(mesh_corners, opening_m):
    """However far they are open, both of them."""
    mesh = mesh_corners("finger")
    # Where the fingers are fixed to the hand.
    depths_m = mesh[:, 2] + 0.0584
    right, left = pieces(GRIPPER, opening_m)["a finger"]
    for finger, side in ((right, 1), (left, -1)):
        along_m = side * (mesh[:, 1] + opening_m / 2)
        corners = tip_frame(depths_m, along_m, side * mesh[:, 0])
        assert outside_m(corners, finger) < 1e-3
        assert volume_m3(corners) < finger.hull.computeVolume() * 1.1
        assert finger.hull.computeVolume() < 1.25 * volume_m3(corners)


def test_jaws_are_as_far_apart_as_they_are_open():
    """Measured between the faces of the fingers."""
    right, left = pieces(GRIPPER, 0.05)["a finger"]
    assert right.low[0] - left.high[0] == pytest.approx(0.05)


@pytest.mark.parametrize("tool", [GRIPPER, CUP, DRIVER], ids=lambda tool: tool.name)
def test_the_tip_is_the_lowest_point_of_whatever_is_attached(tool):
    """And nothing of it ends below the flange."""
    low_m = [piece.low[2] for parts in pieces(tool).values() for piece in parts]
    high_m = [piece.high[2] for parts in pieces(tool).values() for piece in parts]
    assert min(low_m) == pytest.approx(0.0, abs=1e-12)
    assert max(high_m) >= panda_hand.TIP_M - 1e-12


def test_the_closing_axis_follows_the_yaw():
    """Jaws that close along y are apart along y."""
    right, left = pieces(GRIPPER, 0.05, (0.5, 0.1, 0.2), math.pi / 2)["a finger"]
    assert right.low[1] - left.high[1] == pytest.approx(0.05)
    assert (right.low[2], left.low[2]) == pytest.approx((0.2, 0.2))
    assert (right.low[0] + right.high[0]) / 2 == pytest.approx(0.5)


def test_an_envelope_takes_the_place_of_a_tool_of_common_size():
    """Of a cup or driver; the gripper is the hand of the arm itself."""
    box = Box((0.05, 0.04, 0.1), (0.0, 0.0, 0.05))
    driver = Tool("driver", "tool(driver)", AT, box, ToolKind.SCREWDRIVER)
    (piece,) = pieces(driver)["driver"]
    assert piece.high == pytest.approx((0.025, 0.02, 0.1))
    gripper = Tool("gripper", "tool(gripper)", AT, box)
    assert set(pieces(gripper)) == {"a finger", "the hand"}


def test_without_a_tool_the_arm_ends_at_its_flange():
    """Unless the task knows of no tools at all: then it has its hand."""
    assert pieces(None) == {}
    bare = Robot("panda", (0.0, 0.0, 0.0), 0.855, 0.15, {})
    assert {part.name for part in build_hand_parts(bare, None, 0.0)} == {"a finger", "the hand"}


@pytest.mark.parametrize(("opening_m", "expected"), [(None, 0.08), (0.05, 0.05), (0.2, 0.08)])
def test_jaws_open_as_the_task_says_but_no_wider_than_the_hand(opening_m, expected):
    """80 mm at most."""
    assert find_opening_m(Tool("gripper", "tool(gripper)", AT, opening_m=opening_m)) == expected
    assert find_opening_m(None) == panda_hand.OPENING_M


def test_a_fine_cone_has_a_hull_that_contains_it_and_is_hardly_wider():
    """The tip of a cone of 400 sides has more neighbours than coal stores."""
    turns = 2 * np.pi * np.arange(400) / 400
    rim = np.stack([0.01 * np.cos(turns), 0.01 * np.sin(turns), np.zeros(400)], axis=1)
    cone = ConvexPiece(np.vstack([rim, [0.0, 0.0, 0.02]]))
    points, triangles = cone.surface
    faces = points[triangles]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    outwards = np.sign(np.einsum("fi,fi->f", normals, faces[:, 0] - [0.0, 0.0, 0.005]))
    normals *= outwards[:, None]
    offsets = np.einsum("fi,fi->f", normals, faces[:, 0])
    assert (cone.corners @ normals.T - offsets).max() < 1e-9
    assert np.linalg.norm(points[:, :2], axis=1).max() < 0.0101
    assert points[:, 2].max() < 0.0201
