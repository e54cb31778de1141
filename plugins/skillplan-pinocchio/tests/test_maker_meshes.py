"""Shapes of links and hands against the meshes that their makers publish, from either side.

Those of the Panda are in `pybullet_data`. Those of the UR5e come with the wheel robosuite, which is
no dependency of ours: the tests are skipped where it is not installed.
"""

import importlib.util
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from skillplan.robots import PANDA, PANDA_HAND, UR5E
from skillplan.task import Pose
from skillplan_pinocchio import ConvexPiece, SurfacePiece

# Where a mesh of the wheel is in the frame of its joint: turned by roll, pitch and yaw, then moved
# along z [m]. Its model is of the same arm in other frames.
QUARTER = np.pi / 2
UR5E_FRAMES = {
    "base": (0.0, (0.0, 0.0, np.pi)),
    "shoulder": (0.1625, (0.0, 0.0, np.pi)),
    "upperarm": (0.138, (QUARTER, 0.0, -QUARTER)),
    "forearm": (0.007, (QUARTER, 0.0, -QUARTER)),
    "wrist1": (0.0063, (QUARTER, 0.0, 0.0)),
    "wrist2": (0.0, (0.0, 0.0, 0.0)),
    "wrist3": (0.0007, (QUARTER, 0.0, 0.0)),
}
OF_THE_UR5E = "the wheel robosuite, with the meshes of the UR5e, is not installed"


@pytest.fixture(scope="module")
def panda_mesh(panda_files):
    """Return a function from a link's name to its collision mesh: corners [m], and faces."""

    def read(name):
        rows = (panda_files / "meshes" / "collision" / f"{name}.obj").read_text("utf-8")
        lines = [row.split() for row in rows.splitlines() if row[:2] in ("v ", "f ")]
        corners = [[float(x) for x in row[1:4]] for row in lines if row[0] == "v"]
        faces = [[int(x.split("/")[0]) - 1 for x in row[1:]] for row in lines if row[0] == "f"]
        fans = [(face[0], *two) for face in faces for two in pairwise(face[1:])]
        return np.array(corners), np.array(fans)

    return read


def ur5e_mesh(name):
    """Return a link's collision mesh in the frame of its joint: corners [m], and faces."""
    spec = importlib.util.find_spec("robosuite")
    if spec is None or spec.origin is None:
        pytest.skip(OF_THE_UR5E)
    folder = Path(spec.origin).parent / "models" / "assets" / "robots" / "ur5e" / "meshes"
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    corners = np.fromfile(folder / f"{name}.stl", kind, offset=84)["corners"].reshape(-1, 3)
    along_m, turned = UR5E_FRAMES[name]
    frame = np.array(Pose.turned((0.0, 0.0, 0.0), turned).rotation)
    placed = corners.astype(float) @ frame.T + (0.0, 0.0, along_m)
    return placed, np.arange(len(placed)).reshape(-1, 3)


def spread(corners, faces, apart_m):
    """Return corners, and points spread over a surface about so far apart [m]."""
    triangles = corners[faces]
    sides = triangles[:, 1:] - triangles[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    rng = np.random.default_rng(1)
    count = int(areas.sum() / 2 / apart_m**2)
    picked = rng.choice(len(faces), count, p=areas / areas.sum())
    shares = np.sort(rng.random((count, 2)), axis=1)
    shares = np.stack([shares[:, 0], shares[:, 1] - shares[:, 0]], axis=1)
    inner = triangles[picked, 0] + np.einsum("pi,pij->pj", shares, sides[picked])
    return np.concatenate([corners, inner])


def farthest_m(points, shapes):
    """Return how far the farthest point is from the nearest of some shapes of coal [m]."""
    point, still, request = coal.Sphere(1e-9), coal.Transform3s(), coal.DistanceRequest()
    worst = 0.0
    for item in points:
        placed = coal.Transform3s(np.eye(3), item)
        gaps = (
            coal.distance(point, placed, shape, still, request, coal.DistanceResult())
            for shape in shapes
        )
        worst = max(worst, min(gaps))
    return worst


def beyond(points, pieces):
    """Return the points that are in no piece."""
    for piece in pieces:
        planes = ConvexHull(piece).equations
        points = points[(points @ planes[:, :3].T + planes[:, 3]).max(axis=1) > 1e-9]
    return points


def inside_m(mesh, pieces, apart_m=0.004):
    """Return how far the mesh stands out of some pieces at most [m]."""
    out = beyond(spread(*mesh, apart_m), pieces)
    return farthest_m(out, [ConvexPiece(piece).hull for piece in pieces])


def outside_m(mesh, pieces, apart_m=0.006):
    """Return how far some pieces stand out of the mesh at most [m]."""
    points = []
    for number, piece in enumerate(pieces):
        hull = ConvexHull(piece)
        others = [other for index, other in enumerate(pieces) if index != number]
        points.append(beyond(spread(hull.points, hull.simplices, apart_m), others))
    return farthest_m(np.concatenate(points), [SurfacePiece(*mesh).hull])


def corners_of(shapes):
    return [np.array(shape.corners_m) for shape in shapes]


@pytest.mark.parametrize("link", range(8))
def test_the_shapes_of_a_panda_link_are_close_to_its_mesh(link, panda_mesh):
    """Outside it by 5 mm at most, inside by 1 mm."""
    mesh, pieces = panda_mesh(f"link{link}"), corners_of(PANDA.shapes[link])
    assert inside_m(mesh, pieces) < 0.001
    assert outside_m(mesh, pieces) < 0.005


@pytest.mark.parametrize("link", range(7), ids=UR5E_FRAMES)
def test_the_shapes_of_a_ur5e_link_are_close_to_its_mesh(link):
    """Outside it by 5 mm at most, inside by 1 mm."""
    mesh, pieces = ur5e_mesh(list(UR5E_FRAMES)[link]), corners_of(UR5E.shapes[link])
    assert inside_m(mesh, pieces) < 0.001
    assert outside_m(mesh, pieces) < 0.005


def test_a_jaw_of_the_panda_is_close_to_its_mesh(panda_mesh):
    """To half a millimetre either way."""
    corners, faces = panda_mesh("finger")
    # Of the mesh y is the closing axis, and z ends at the tip.
    x, y, z = corners.T
    mesh = np.column_stack([y, x, 0.05385 - z]), faces
    assert inside_m(mesh, [np.array(PANDA_HAND.jaw[0])], 0.001) < 5e-4
    assert outside_m(mesh, [np.array(PANDA_HAND.jaw[0])], 0.0015) < 5e-4


def test_the_body_of_the_pandas_hand_is_close_to_its_mesh_whichever_way_round_it_is(panda_mesh):
    """To half a millimetre either way; the second piece is the body turned by half a turn."""
    corners, faces = panda_mesh("hand")
    mesh = corners[:, [1, 0, 2]]
    for piece, turn in zip(PANDA_HAND.body, (1, -1), strict=True):
        placed = mesh * (turn, turn, 1), faces
        assert inside_m(placed, [np.array(piece)], 0.003) < 5e-4
        assert outside_m(placed, [np.array(piece)], 0.004) < 5e-4
