"""Rasterisation of triangles with a depth buffer, compiled once per machine by numba.

Nearness is the inverse depth, which is linear over a picture of a plane. Kernels release the
interpreter lock, so a simulation continues on another thread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numba
import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

# Contents of a pixel other than bodies, which have numbers from 1 on.
NOTHING, TABLE, PLACE, SHADE = -1, 0, -2, -3
# Near limit of drawn surfaces [m].
_NEAR_M = 0.03
# Ambient light, light of the lamp, and light of the camera.
_EVERYWHERE, _LAMP, _CAMERA = 0.52, 0.40, 0.14
_SHADE = 0.80


def compile_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function on its first call, with numba's cache if it is writable."""
    try:
        return cast("Callable[P, R]", numba.njit(cache=True, nogil=True)(function))
    except RuntimeError as error:
        if "cache" not in str(error):
            raise
        return cast("Callable[P, R]", numba.njit(nogil=True)(function))


@compile_kernel
def compute_corner_normals(across: Any, places: Any, order: Any, smooth: float) -> Any:
    """Return unit normals of the corners of triangles, shape (3 n, 3).

    Parameters
    ----------
    across
        Normals of the triangles with twice their area as length, shape (n, 3).
    places
        Number of the point at each corner, shape (3 n,).
    order
        Corners sorted by their points, shape (3 n,).
    smooth
        Minimum cosine between triangles that share a normal.
    """
    normals = np.zeros((len(places), 3))
    sizes = np.sqrt((across * across).sum(axis=1))
    begin = 0
    while begin < len(order):
        end = begin
        while end < len(order) and places[order[end]] == places[order[begin]]:
            end += 1
        for corner in order[begin:end]:
            own = corner // 3
            for other in order[begin:end]:
                its = other // 3
                cosine = (across[own] * across[its]).sum() / (sizes[own] * sizes[its])
                if cosine >= smooth:
                    normals[corner] += across[its]
            normals[corner] /= np.sqrt((normals[corner] * normals[corner]).sum())
        begin = end
    return normals


@compile_kernel
def draw_ground(
    eye: Any, axes: Any, focal: float, half_m: float, colour: Any, discs: Any, buffers: Any
) -> None:
    """Draw the background: sky, table, and discs on it.

    Parameters
    ----------
    eye
        Position of the camera [m].
    axes
        Axes of the camera: right, up, and into the picture, shape (3, 3).
    focal
        Focal length [pixels].
    half_m
        Half the side of the table [m].
    colour
        Colour of the table, 0 to 255.
    discs
        Centre, radius [m] and colour of each disc, shape (n, 6).
    buffers
        Colours, nearness and contents of the pixels.
    """
    image, near, shown = buffers
    height, width = near.shape
    for row in range(height):
        up = (height / 2 - row - 0.5) / focal
        sky = 248.0 - 14.0 * row / height
        for column in range(width):
            right = (column + 0.5 - width / 2) / focal
            ray = axes[2] + right * axes[0] + up * axes[1]
            image[row, column, 0], image[row, column, 1] = sky - 4.0, sky - 1.0
            image[row, column, 2] = sky + 3.0
            near[row, column], shown[row, column] = 0.0, NOTHING
            if ray[2] >= 0.0 or eye[2] <= 0.0:
                continue
            depth = -eye[2] / ray[2]
            x, y = eye[0] + depth * ray[0], eye[1] + depth * ray[1]
            if abs(x) > half_m or abs(y) > half_m:
                continue
            near[row, column], shown[row, column] = 1.0 / depth, TABLE
            image[row, column] = colour
            for disc in discs:
                if (x - disc[0]) ** 2 + (y - disc[1]) ** 2 <= disc[2] ** 2:
                    shown[row, column] = PLACE
                    image[row, column] = disc[3:6]


@compile_kernel
def _compute_span(points: Any, area: float, row: int, low: int, high: int) -> tuple[int, int]:
    """Return the first and last column of a triangle in a row of pixels."""
    y = row + 0.5
    for begin in range(3):
        ax, ay = points[begin, 0], points[begin, 1]
        bx, by = points[(begin + 1) % 3, 0], points[(begin + 1) % 3, 1]
        # A point p is inside if (b - a) x (p - a) has the sign of the area.
        slope = -(by - ay) * area
        rest = ((bx - ax) * (y - ay) + (by - ay) * ax) * area
        if slope > 0.0:
            low = max(low, int(np.ceil(-rest / slope - 0.5)))
        elif slope < 0.0:
            high = min(high, int(np.floor(-rest / slope - 0.5)))
        elif rest < 0.0:
            high = low - 1
    return low, high


@compile_kernel
def _project(
    corners: Any, frame: Any, focal: float, width: int, height: int, points: Any, nearness: Any
) -> bool:
    """Project the corners of a triangle; return False if one is too near."""
    for corner in range(3):
        x, y, z = corners[corner]
        depth = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z + frame[2, 3]
        if depth < _NEAR_M:
            return False
        right = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z + frame[0, 3]
        up = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z + frame[1, 3]
        points[corner, 0] = width / 2 + focal * right / depth
        points[corner, 1] = height / 2 - focal * up / depth
        nearness[corner] = 1.0 / depth
    return True


@compile_kernel
def _compute_area(points: Any) -> float:
    """Return twice the signed area of a triangle."""
    abx, aby = points[1, 0] - points[0, 0], points[1, 1] - points[0, 1]
    acx, acy = points[2, 0] - points[0, 0], points[2, 1] - points[0, 1]
    return float(abx * acy - aby * acx)


@compile_kernel
def _compute_bounds(points: Any, width: int, height: int) -> tuple[int, int, int, int]:
    """Return the first and last row and column that a triangle can cover."""
    first = max(0, int(np.ceil(points[:, 1].min() - 0.5)))
    last = min(height - 1, int(np.floor(points[:, 1].max() - 0.5)))
    left = max(0, int(np.ceil(points[:, 0].min() - 0.5)))
    right = min(width - 1, int(np.floor(points[:, 0].max() - 0.5)))
    return first, last, left, right


@compile_kernel
def _compute_brightness(normal: Any, frame: Any, lamp: Any) -> float:
    """Return the brightness of a surface with a normal."""
    x, y, z = normal
    right = frame[0, 0] * x + frame[0, 1] * y + frame[0, 2] * z
    up = frame[1, 0] * x + frame[1, 1] * y + frame[1, 2] * z
    deep = frame[2, 0] * x + frame[2, 1] * y + frame[2, 2] * z
    lit = max(0.0, right * lamp[0] + up * lamp[1] + deep * lamp[2])
    return float(_EVERYWHERE + _LAMP * lit + _CAMERA * max(0.0, -deep))


@compile_kernel
def draw_solid(
    corners: Any,
    normals: Any,
    frame: Any,
    colour: Any,
    lamp: Any,
    number: int,
    focal: float,
    buffers: Any,
) -> None:
    """Draw a surface.

    Parameters
    ----------
    corners, normals
        Corners and normals of its triangles in its frame, shape (n, 3, 3).
    frame
        Pose in the camera's frame: right, up, and into the picture, shape (3, 4).
    colour
        Colour, 0 to 255.
    lamp
        Direction of the light in the camera's frame.
    number
        Number of the surface in the pixels' contents.
    focal
        Focal length [pixels].
    buffers
        Colours, nearness and contents of the pixels.
    """
    image, near, shown = buffers
    height, width = near.shape
    points, nearness, light = np.empty((3, 2)), np.empty(3), np.empty(3)
    for triangle in range(len(corners)):
        if not _project(corners[triangle], frame, focal, width, height, points, nearness):
            continue
        area = _compute_area(points)
        # Rows count downwards, so anticlockwise triangles have a negative area.
        if area >= 0.0:
            continue
        first, last, left, right = _compute_bounds(points, width, height)
        if first > last:
            continue
        abx, aby = points[1, 0] - points[0, 0], points[1, 1] - points[0, 1]
        acx, acy = points[2, 0] - points[0, 0], points[2, 1] - points[0, 1]
        for corner in range(3):
            light[corner] = _compute_brightness(normals[triangle, corner], frame, lamp)
        for row in range(first, last + 1):
            low, high = _compute_span(points, area, row, left, right)
            dy = row + 0.5 - points[0, 1]
            for column in range(low, high + 1):
                dx = column + 0.5 - points[0, 0]
                b = (dx * acy - dy * acx) / area
                c = (abx * dy - aby * dx) / area
                a = 1.0 - b - c
                value = a * nearness[0] + b * nearness[1] + c * nearness[2]
                if value <= near[row, column]:
                    continue
                near[row, column], shown[row, column] = value, number
                bright = a * light[0] + b * light[1] + c * light[2]
                image[row, column, 0] = min(255.0, colour[0] * bright)
                image[row, column, 1] = min(255.0, colour[1] * bright)
                image[row, column, 2] = min(255.0, colour[2] * bright)


@compile_kernel
def shade(
    corners: Any, frame: Any, sun: Any, camera: Any, focal: float, image: Any, shown: Any
) -> None:
    """Darken the table in the shadow of a surface; call it after all surfaces are drawn.

    Parameters
    ----------
    corners
        Corners of its triangles in its frame, shape (n, 3, 3).
    frame
        Pose in the world, shape (3, 4).
    sun
        Direction of the light in the world.
    camera
        Pose of the world in the camera's frame, shape (3, 4).
    focal
        Focal length [pixels].
    image, shown
        Colours and contents of the pixels.
    """
    height, width = shown.shape
    points, nearness, at = np.empty((3, 2)), np.empty(3), np.empty((3, 3))
    for triangle in range(len(corners)):
        for corner in range(3):
            x, y, z = corners[triangle, corner]
            at[corner] = frame[:, 3] + frame[:, 0] * x + frame[:, 1] * y + frame[:, 2] * z
            # Project along the light down to the table.
            at[corner] -= max(at[corner, 2], 0.0) / sun[2] * sun
            at[corner, 2] = 0.0
        if not _project(at, camera, focal, width, height, points, nearness):
            continue
        area = _compute_area(points)
        # One of the two sides of a body is enough.
        if area >= 0.0:
            continue
        first, last, left, right = _compute_bounds(points, width, height)
        for row in range(first, last + 1):
            low, high = _compute_span(points, area, row, left, right)
            for column in range(low, high + 1):
                if shown[row, column] == TABLE or shown[row, column] == PLACE:
                    shown[row, column] = SHADE
                    for channel in range(3):
                        image[row, column, channel] *= _SHADE


@compile_kernel
def smooth_edges(image: Any, shown: Any) -> Any:
    """Return the picture as bytes, blended along edges between contents."""
    height, width = shown.shape
    picture = np.empty((height, width, 3), np.uint8)
    for row in range(height):
        for column in range(width):
            own = shown[row, column]
            if (
                0 < row < height - 1
                and 0 < column < width - 1
                and (
                    shown[row, column - 1] != own
                    or shown[row, column + 1] != own
                    or shown[row - 1, column] != own
                    or shown[row + 1, column] != own
                )
            ):
                for channel in range(3):
                    around = image[row, column - 1, channel] + image[row, column + 1, channel]
                    around += image[row - 1, column, channel] + image[row + 1, column, channel]
                    picture[row, column, channel] = (
                        3.0 * image[row, column, channel] + around
                    ) / 7.0
            else:
                for channel in range(3):
                    picture[row, column, channel] = image[row, column, channel]
    return picture
