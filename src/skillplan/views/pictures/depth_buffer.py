"""Solids drawn pixel by pixel, so that what is nearer hides what is behind it, exactly."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.task.pose import Point as Point3
from skillplan.task.pose import Pose
from skillplan.task.scene import Body
from skillplan.views.pictures.drawing import Point
from skillplan.views.pictures.outlines import corners_of, faces_of
from skillplan.views.pictures.solid_view import View, normal_of

Bytes = NDArray[np.uint8]
Colour = tuple[int, int, int]

# How much darker a face is on which no light falls.
_SHADE = 0.5


class DepthBuffer:
    """An image with the depth of each of its pixels.

    Parameters
    ----------
    width, height
        Of the image [px].
    paper
        Its colour where nothing is drawn.
    """

    def __init__(self, width: int, height: int, paper: Colour) -> None:
        self.pixels: Bytes = np.full((height, width, 3), paper, dtype=np.uint8)
        self._depths = np.full((height, width), -np.inf)

    def copy(self) -> DepthBuffer:
        """Return one that is drawn on apart from this one."""
        made = DepthBuffer.__new__(DepthBuffer)
        made.pixels, made._depths = self.pixels.copy(), self._depths.copy()
        return made

    def add(
        self,
        view: View,
        pixels: Callable[[Point3], Point],
        body: Body,
        pose: Pose,
        colour: Colour,
    ) -> None:
        """Draw a body.

        Parameters
        ----------
        view
            From where it is looked at.
        pixels
            Where a point of the world is in the image.
        body, pose
            What stands where.
        colour
            Of its faces in full light.
        """
        for shape in body.exact_shapes:
            corners = [pose.apply(corner) for corner in corners_of(shape)]
            seen = np.array([(*pixels(corner), view.depth(corner)) for corner in corners])
            for face in faces_of(shape):
                normal = normal_of([corners[index] for index in face])
                if view.depth(normal) <= 1e-9:
                    continue
                shade = 1 - _SHADE * (1 - max(0.0, view.lit(normal)))
                lit = np.array(colour) * shade
                for second, third in pairwise(face[1:]):
                    self._triangle(seen[[face[0], second, third]], lit)

    def _triangle(self, corners: NDArray[np.float64], colour: NDArray[np.float64]) -> None:
        """Draw a triangle of corners x, y [px] and depth, shape (3, 3)."""
        height, width = self._depths.shape
        low = np.maximum(np.floor(corners[:, :2].min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(corners[:, :2].max(axis=0)).astype(int) + 1, (width, height))
        if (low >= high).any():
            return
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners.tolist()
        twice = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(twice) < 1e-9:
            return
        x = np.arange(low[0], high[0])[None, :] + 0.5
        y = np.arange(low[1], high[1])[:, None] + 0.5
        second = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / twice
        third = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / twice
        depth = az + second * (bz - az) + third * (cz - az)
        where = (slice(low[1], high[1]), slice(low[0], high[0]))
        # A hair's breadth beyond the edges, so that no gap is left between neighbours.
        within = (second >= -1e-6) & (third >= -1e-6) & (second + third <= 1 + 1e-6)
        nearer = within & (depth > self._depths[where])
        self._depths[where][nearer] = depth[nearer]
        self.pixels[where][nearer] = colour
