"""The software painter: solids drawn pixel by pixel, so that nearer ones hide those behind them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from skillplan.task.pose import Point as Point3
from skillplan.task.pose import Pose
from skillplan.task.scene import Body
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan.views.figures.figure_style import INK, PAPER

Point = tuple[float, float]
Points = NDArray[np.float64]
Bytes = NDArray[np.uint8]

OVERSAMPLING = 2
"""Pixels of a painted image per pixel of the picture, along each side."""

_SIDES = 24
_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
_ELEVATION = math.radians(26)
AZIMUTHS_DEG = (-58, -32, -122, -148, 32, 58, 122, 148)
# Direction to the light: right, up, towards the eye; and the loss of a face without light.
_LIGHT, _SHADE = np.array([-0.3, 0.51, 0.80]), 0.5
# An edge is drawn where normals differ by more than 30 deg or depths by this many pixels.
_CREASE, _STEP_PX = math.cos(math.radians(30)), 8.0
# Number of candidate pixels that are tested at once.
_MOST_PIXELS = 4_000_000


def get_corners(shape: Shape) -> list[Point3]:
    """Return the corners of a shape in its body's frame [m]; a cylinder has 24 sides."""
    if isinstance(shape, Box):
        (x, y, z), (sx, sy, sz) = shape.centre, shape.size
        return [
            (x + i * sx / 2, y + j * sy / 2, z + k * sz / 2)
            for k in (-1, 1)
            for j in (-1, 1)
            for i in (-1, 1)
        ]
    if isinstance(shape, Cylinder):
        radius_m = shape.diameter_m / 2
        x, y, z = shape.centre
        return [
            (
                x + radius_m * math.cos(2 * math.pi * side / _SIDES),
                y + radius_m * math.sin(2 * math.pi * side / _SIDES),
                z + end * shape.height_m / 2,
            )
            for end in (-1, 1)
            for side in range(_SIDES)
        ]
    return list(shape.corners)


def get_faces(shape: Shape) -> list[tuple[int, ...]]:
    """Return the faces of a shape as indices of corners, anticlockwise from outside."""
    if isinstance(shape, Box):
        return list(_FACES)
    if isinstance(shape, Cylinder):
        sides = [
            (k, (k + 1) % _SIDES, _SIDES + (k + 1) % _SIDES, _SIDES + k) for k in range(_SIDES)
        ]
        bottom, top = tuple(reversed(range(_SIDES))), tuple(range(_SIDES, 2 * _SIDES))
        return [*sides, bottom, top]
    return list(shape.faces)


def place_corners(body: Body, pose: Pose) -> Points:
    """Return the corners of a body's true shapes in the world [m], shape (n, 3)."""
    corners = [corner for shape in body.drawn_shapes for corner in get_corners(shape)]
    return np.asarray(np.array(corners) @ np.array(pose.rotation).T + np.array(pose.position))


def find_outlines(body: Body, pose: Pose) -> list[tuple[Point, ...]]:
    """Return the outline of each of a body's convex shapes from above [m]."""
    hulls = []
    shank = () if body.shank is None else (body.shank.shape,)
    for shape in (*body.shapes, *shank):
        points = [pose.apply(corner)[:2] for corner in get_corners(shape)]
        hulls.append(find_hull([(round(x, 6), round(y, 6)) for x, y in points]))
    return [outline for outline in hulls if len(outline) > 2]


def find_hull(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return the corners of the convex hull of points (Andrew's monotone chain)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return tuple(ordered)

    def half(points: Iterable[Point]) -> list[Point]:
        chain: list[Point] = []
        for point in points:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        return chain[:-1]

    return (*half(ordered), *half(reversed(ordered)))


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@dataclass(frozen=True)
class Camera:
    """A parallel projection from above and from one side onto an area of a picture.

    Parameters
    ----------
    azimuth
        Direction of the eye about the vertical [rad].
    scale
        Scale of the picture [px/m].
    left, top
        Offset of the world's origin in the picture [px].
    """

    azimuth: float
    scale: float = 1.0
    left: float = 0.0
    top: float = 0.0

    @property
    def axes(self) -> Points:
        """Directions in the world: to the right, up, and towards the eye, shape (3, 3)."""
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        level, steep = math.cos(_ELEVATION), math.sin(_ELEVATION)
        return np.array(
            ((-s, c, 0), (-c * steep, -s * steep, level), (c * level, s * level, steep))
        )

    def project(self, points: Sequence[Point3] | Points) -> Points:
        """Return points as x to the right, y down, and nearness to the eye [px], shape (n, 3)."""
        right, up, near = (self.scale * np.asarray(points, dtype=np.float64) @ self.axes.T).T
        return np.stack([self.left + right, self.top - up, near], axis=1)

    def pixel(self, point: Point3 | Points) -> Point:
        """Return the place of a point in the picture [px]."""
        x, y, _ = self.project(np.array([point]))[0].tolist()
        return (x, y)

    def fitted(
        self,
        points: Sequence[Point3] | Points,
        room: tuple[float, float, float, float],
        least_px: float,
    ) -> tuple[Camera, float]:
        """Return the camera that shows points in the middle of an area, and its height.

        Parameters
        ----------
        points
            At least two points [m].
        room
            Left, top, width and largest height of the area [px].
        least_px
            Smallest height of the area.
        """
        seen = Camera(self.azimuth).project(points)[:, :2]
        low, (wide, tall) = seen.min(axis=0), np.ptp(seen, axis=0)
        left, top, width, height = room
        scale = min(width / wide, height / tall)
        used_px = max(scale * tall, least_px)
        left += (width - scale * wide) / 2 - scale * low[0]
        top += (used_px - scale * tall) / 2 - scale * low[1]
        return Camera(self.azimuth, scale, left, top), float(used_px)


class SolidPainter:
    """An image of solids that keeps the depth and the nearest triangle of each pixel.

    Parameters
    ----------
    width_px, height_px
        Size of the picture; the image is `OVERSAMPLING` times larger.
    """

    def __init__(self, camera: Camera, width_px: float, height_px: float) -> None:
        shape = (round(height_px) * OVERSAMPLING, round(width_px) * OVERSAMPLING)
        self.camera = camera
        self._depths = np.full(shape, -np.inf, dtype=np.float32)
        self._triangles = np.full(shape, -1, dtype=np.int32)
        # Body, unit normal in the frame of the camera, and colour of each triangle. The last
        # entry, which the index -1 selects, is the background.
        self._bodies = np.array([-1])
        self._normals = np.zeros((1, 3))
        self._colours: Points = np.array([to_rgb(PAPER)])

    @property
    def bodies(self) -> NDArray[np.int64]:
        """Number of the body at each pixel, -1 for none, shape (h, w)."""
        return np.asarray(self._bodies[self._triangles])

    def copy(self) -> SolidPainter:
        """Return an independent copy."""
        twin = copy(self)
        twin._depths, twin._triangles = self._depths.copy(), self._triangles.copy()
        return twin

    def add(self, body: Body, pose: Pose, colour: str, number: int = 0) -> int:
        """Draw a body.

        Parameters
        ----------
        colour
            Colour of its faces in full light.
        number
            Number of the body in `bodies`, >= 0.

        Returns
        -------
        int
            Number of pixels that the body covers without other bodies in front of it.
        """
        return self.add_triangles(place_corners(body, pose), _triangulate(body), colour, number)

    def add_triangles(
        self, corners: Points, triangles: NDArray[np.int64], colour: str, number: int
    ) -> int:
        """Draw triangles, given by indices of corners [m]; other parameters as of `add`."""
        seen = self.camera.project(corners) * OVERSAMPLING
        normals = _compute_normals(corners, triangles) @ self.camera.axes.T
        front = normals[:, 2] > 1e-9
        normals, first = normals[front], len(self._bodies) - 1
        lit = 1 - _SHADE * (1 - np.maximum(0.0, normals @ _LIGHT))
        colours = np.array(to_rgb(colour)) * lit[:, None]
        self._bodies = np.insert(self._bodies, -1, np.full(len(normals), number))
        self._normals = np.concatenate([self._normals[:-1], normals, self._normals[-1:]])
        self._colours = np.concatenate([self._colours[:-1], colours, self._colours[-1:]])
        covered = np.zeros(self._depths.size, dtype=bool)
        for pixels, depths, members in self._rasterize(seen[triangles[front]]):
            covered[pixels] = True
            nearer = depths > self._depths.reshape(-1)[pixels]
            # The nearest comes last: of several assignments to a pixel the last counts.
            order = np.flatnonzero(nearer)[np.argsort(depths[nearer], kind="stable")]
            self._depths.reshape(-1)[pixels[order]] = depths[order]
            self._triangles.reshape(-1)[pixels[order]] = first + members[order]
        return int(np.count_nonzero(covered))

    def _rasterize(
        self, triangles: Points
    ) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.int64]]]:
        """Yield pixels with depths and triangles, triangles of similar size at once.

        Parameters
        ----------
        triangles
            Corners: x, y and depth [px], shape (n, 3, 3).
        """
        height, width = self._depths.shape
        low = np.maximum(np.floor(triangles[:, :, :2].min(axis=1)), 0).astype(int)
        high = np.ceil(triangles[:, :, :2].max(axis=1)).astype(int) + 1
        sizes = np.minimum(high, (width, height)) - low
        a, b, c = (
            triangles[:, 0],
            triangles[:, 1] - triangles[:, 0],
            triangles[:, 2] - triangles[:, 0],
        )
        twice = b[:, 0] * c[:, 1] - c[:, 0] * b[:, 1]
        valid = (sizes > 0).all(axis=1) & (np.abs(twice) > 1e-9)
        powers = np.ceil(np.log2(np.maximum(sizes, 1))).astype(int)
        for power in np.unique(powers[valid], axis=0):
            members = np.flatnonzero(valid & (powers == power).all(axis=1))
            across, down = (2**power).tolist()
            step = max(1, _MOST_PIXELS // (across * down))
            for k in (members[begin : begin + step] for begin in range(0, len(members), step)):
                columns = low[k, 0, None, None] + np.arange(across)[None, None, :]
                rows = low[k, 1, None, None] + np.arange(down)[None, :, None]
                u, v = columns + 0.5 - a[k, 0, None, None], rows + 0.5 - a[k, 1, None, None]
                (b0, b1, b2), (c0, c1, c2) = b[k].T[..., None, None], c[k].T[..., None, None]
                # Barycentric coordinates of the second and the third corner.
                second = (u * c1 - v * c0) / twice[k, None, None]
                third = (v * b0 - u * b1) / twice[k, None, None]
                # A hair's breadth beyond the edges leaves no gap between neighbours.
                within = (second >= -1e-6) & (third >= -1e-6) & (second + third <= 1 + 1e-6)
                within &= (columns < width) & (rows < height)
                depths = (a[k, 2, None, None] + second * b2 + third * c2)[within]
                member, row, column = np.nonzero(within)
                pixels = (low[k, 1][member] + row) * width + low[k, 0][member] + column
                yield pixels, depths.astype(np.float32), k[member]

    def image(self, opacity: float = 1.0) -> Bytes:
        """Return the image with thin edges, transparent without bodies, shape (h, w, 4)."""
        opaque = np.where(self._bodies >= 0, opacity, 0.0)
        shades = np.round(255 * np.column_stack([self._colours, opaque])).astype(np.uint8)
        image: Bytes = shades[self._triangles]
        ink = np.round(255 * np.array([*to_rgb(INK), opacity])).astype(np.uint8)
        for here, there in ((np.s_[:-1, :], np.s_[1:, :]), (np.s_[:, :-1], np.s_[:, 1:])):
            change = np.nonzero(self._triangles[here] != self._triangles[there])
            a, b = self._triangles[here][change], self._triangles[there][change]
            depth_a, depth_b = self._depths[here][change], self._depths[there][change]
            edge = self._bodies[a] != self._bodies[b]
            edge |= ~(np.abs(depth_a - depth_b) <= _STEP_PX)
            edge |= np.einsum("ij,ij->i", self._normals[a], self._normals[b]) < _CREASE
            # The edge belongs to the nearer pixel.
            for side, nearer in ((here, depth_a >= depth_b), (there, depth_a < depth_b)):
                rows, columns = (index[edge & nearer] for index in change)
                image[side][rows, columns] = ink
        return image


def _triangulate(body: Body) -> NDArray[np.int64]:
    """Return the triangles of a body's true shapes as indices of its corners, shape (n, 3)."""
    triangles: list[tuple[int, int, int]] = []
    first = 0
    for shape in body.drawn_shapes:
        for a, *others in get_faces(shape):
            triangles += [(first + a, first + b, first + c) for b, c in pairwise(others)]
        first += len(get_corners(shape))
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _compute_normals(corners: Points, triangles: NDArray[np.int64]) -> Points:
    """Return the outward unit normals of triangles, shape (n, 3)."""
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / np.maximum(lengths, 1e-15))


def choose_camera(solids: Sequence[tuple[Body, Pose]]) -> Camera:
    """Return the camera, not yet fitted, from which the least of some bodies is hidden."""
    meshes = [(place_corners(body, pose), _triangulate(body)) for body, pose in solids]
    cameras = [Camera(math.radians(degrees)) for degrees in AZIMUTHS_DEG]
    return min(cameras, key=lambda camera: round(_measure_hidden(camera, meshes), 2))


def _measure_hidden(camera: Camera, meshes: Sequence[tuple[Points, NDArray[np.int64]]]) -> float:
    """Return the sum over bodies of the squared share that others hide."""
    points = np.concatenate([corners for corners, _ in meshes])
    small, _ = camera.fitted(points, (0.0, 0.0, 160.0, 160.0), 0.0)
    painter = SolidPainter(small, 160.0, 160.0)
    covered = [painter.add_triangles(*mesh, INK, number) for number, mesh in enumerate(meshes)]
    visible = np.bincount(painter.bodies.reshape(-1) + 1, minlength=len(meshes) + 1)[1:]
    hidden = 1 - visible / np.maximum(covered, 1)
    return float(np.square(hidden).sum())
