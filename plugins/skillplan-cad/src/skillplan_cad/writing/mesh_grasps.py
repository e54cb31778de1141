"""Find places on the true mesh where jaws or a suction cup hold an upright part.

Jaws close on two patches opposite each other, seen by rays along the closing direction. A cup
stands on a level face without holes, seen by rays from above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from skillplan.physics.linear_motions import SHANK_DIAMETER_M
from skillplan.robots.arm_description import Hand
from skillplan.task.pose import DOWN
from skillplan.task.scene import find_cup_height_m
from skillplan_cad.blocking.ray_mesh import RayMesh, RayView
from skillplan_cad.product import GRAVITY_M_PER_S2, Part, Points, Vector

Floats = NDArray[np.float64]
Entry = dict[str, Any]

_FRICTION = 0.6
# Distance of a surface from a jaw's face at which it still bears the jaw [m].
_NEAR_M = 1.5e-4
# Usual clearance of open jaws on either side of a part, and that of a jaw from other material [m].
OPEN_M = 4e-3
"""Usual clearance of open jaws on either side of a part [m]."""
_CLEAR_M = 5e-4
# Play between jaws and part at the widest opening; and clearance of fingertips above the bottom of
# a part [m], the latter at most a share of its height.
_PLAY_M, _ABOVE_M, _ABOVE_SHARE = 4e-3, 1e-3, 0.25
# Pitch of rays: finest, and most of them along a side of the part.
_FINEST_M, _MOST_RAYS = 5e-4, 72
# Depths of the fingertips below the highest point between the jaws [m].
_DEPTHS_M = (0.002, 0.003, 0.005, 0.008, 0.012, 0.018, 0.026, 0.036)
# Number of walls along a ray between which jaws may close.
_MOST_SPANS = 4
# Number of positions of the hand across the closing direction.
_COLUMNS = 13
# Play of closed jaws in a hole, and distance up to which the wall of a round one meets a jaw [m].
_INNER_PLAY_M, _ROUND_M = 2e-3, 5e-4
# Least area of each jaw in a hole [m2].
_INNER_M2 = 1e-6
# Depths of the fingertips in a hole below the top of the part [m], and drawback of such a grasp.
_INNER_DEPTHS_M, _INNER_COST_M = (0.003, 0.005, 0.002), 4e-3
# Least area of each jaw on the part [m2], and share of a hand's friction that may be used.
_LEAST_M2, _LOAD_SHARE = 4e-7, 0.5
# Height of a hand's axis above the table at which a hand from the side clears it [m].
_SIDE_MARGIN_M = 4e-3
_DEPTH_CLASSES_M = (0.005, 0.0125)
# Number of grasps of a part, and distance between two of them [m].
_MOST_GRASPS, _MOST_INNER, _APART_M = 6, 2, 6e-3
# Least distance of a grasp at an end of a part from its centre of mass [m].
_END_M = 0.03
# Cosine between a face and a closing direction, and share of the surface worth a direction.
_ALONG, _WORTH = 0.999, 0.02
# Cosine between an axis and a face that turns the part flush with jaws, share of the surface, and
# depth behind the outermost point as a share of the extent.
_TURNS, _SMALL, _OUTER = 0.985, 0.002, 0.1
_ALMOST = 1e-6
# Unevenness of a face below a cup, and width of the face around it [m], at most a share of its
# diameter; pixels are as wide, or wider for a large part.
_EVEN_M, _RIM_M, _RIM_SHARE = 1e-4, 5e-4, 1 / 12
_MOST_PIXELS, _BELOW_M = 400, -1e3
# Pressure below a cup, and factor of safety on its force.
_VACUUM_PA, _CUP_SAFETY = 6e4, 1.5
# Least diameter of a cup that follows a part which hangs at one side of it [m].
_LEAST_BELLOWS_M = 0.006


@dataclass(frozen=True, slots=True)
class JawGrasp:
    """A grasp between jaws.

    Parameters
    ----------
    entry
        The grasp as in a task file.
    cost
        Distance from the centre of mass and other drawbacks [m]; lower is better.
    area_m2
        Area of the jaw with less material on it.
    grip_n
        Force of each jaw at which friction just bears weight and moments of the part, or its weight
        twice [N].
    """

    entry: Entry
    cost: float
    area_m2: float
    grip_n: float
    tip_m: tuple[float, float, float]


class GraspFinder:
    """Searches the grasps of one part.

    Parameters
    ----------
    local
        Vertices of the upright part, relative to the centre of its bottom [m].
    centre_m
        Centre of mass in that frame [m].
    """

    def __init__(self, part: Part, local: Points, centre_m: Floats) -> None:
        self._local, self._centre_m = local, centre_m
        self._mass_kg = part.mass_kg
        # Force of each jaw at which friction bears twice the weight [N].
        self._bears_twice_n = part.mass_kg * GRAVITY_M_PER_S2 / _FRICTION
        self._fields: dict[bytes, _Field] = {}
        self._mesh = RayMesh(replace(part, vertices_m=local), np.zeros(3))
        corners = local[part.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self._areas = np.linalg.norm(across, axis=1) / 2
        self._middles = corners.mean(axis=1)
        self._is_plane = np.ones(len(self._areas), dtype=bool)
        for face in part.faces:
            self._is_plane[face.triangles] = face.kind in ("plane", "free")
        self._normals = across / np.maximum(2 * self._areas, 1e-30)[:, None]

    def find_cup_place(self, diameter_m: float) -> tuple[float, float] | None:
        """Return the place of a suction cup on the top next to the centre of mass, x y [m]."""
        low, high = self._local[:, :2].min(axis=0), self._local[:, :2].max(axis=0)
        if float((high - low).min()) < diameter_m:
            return None
        bears = compute_cup_force_n(diameter_m) / _CUP_SAFETY / self._mass_kg / GRAVITY_M_PER_S2
        if bears < 1:
            return None
        rim_m = min(_RIM_M, _RIM_SHARE * diameter_m)
        pitch_m = max(rim_m, float((high - low).max()) / _MOST_PIXELS)
        # The frame of the picture is outside the part.
        xs, ys = (np.arange(low[k] - pitch_m / 2, high[k] + pitch_m, pitch_m) for k in (0, 1))
        plan = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
        seen = RayView(self._mesh, np.eye(3)).trace_heights(plan * 1e3).high / 1e3
        heights = np.where(np.isfinite(seen), seen, _BELOW_M).reshape(len(xs), len(ys))
        uneven = ndimage.maximum_filter(heights, 3) - ndimage.minimum_filter(heights, 3) > _EVEN_M
        uneven |= heights == _BELOW_M
        to_edge_m = pitch_m * ndimage.distance_transform_edt(~uneven)
        shank = 2 * int(np.ceil((max(SHANK_DIAMETER_M, diameter_m) / 2 + _RIM_M) / pitch_m)) + 1
        above_m = ndimage.maximum_filter(heights, shank) - heights
        below_shank_m = find_cup_height_m(diameter_m) - _RIM_M
        fits = (to_edge_m >= diameter_m / 2 + rim_m) & (above_m <= below_shank_m)
        distance = np.hypot(*(plan - self._centre_m[:2]).T).reshape(fits.shape)
        if diameter_m < _LEAST_BELLOWS_M:
            # Its lip peels off a part that hangs at one side of it.
            fits &= diameter_m / 2 + distance <= bears * diameter_m / 2
        if not fits.any():
            return None
        # A high face first, because a cup in a pocket is close to walls.
        cost = np.where(fits, distance + (float(self._local[:, 2].max()) - heights), np.inf)
        best = plan[int(np.argmin(cost))]
        centre = self._centre_m[:2]
        cell = np.abs(best - centre).max() <= pitch_m / 2
        x, y = centre if cell else best
        return round(float(x), 5) + 0.0, round(float(y), 5) + 0.0

    def list_sides(self) -> list[tuple[float, float, float]]:
        """Return level directions of a hand: the axes, and along faces, as those of a hexagon."""
        x, y, z = np.eye(3)
        sides = [x, -x, y, -y]
        for closing in self._list_closings((0.0, 0.0, -1.0)):
            along = np.cross(z, closing)
            for side in (along, -along):
                if all(float(side @ other) < _ALONG for other in sides):
                    sides.append(side)
        return [(float(x) + 0.0, float(y) + 0.0, float(z) + 0.0) for x, y, z in sides]

    def find_jaw_grasps(
        self,
        hand: Hand,
        approaches: Sequence[tuple[float, float, float]],
        sunk_m: float,
        raised_m: float = 0.0,
        clearance_m: float = OPEN_M,
        *,
        at_ends: bool = False,
        at_top: bool = False,
        walls_m: Mapping[Vector, float] | None = None,
    ) -> list[JawGrasp]:
        """Return the best grasps from some sides, the best first.

        Parameters
        ----------
        approaches
            Directions in which the hand points.
        sunk_m
            Height up to which other parts enclose the part at its goal [m]: fingers stay above it
            if they can.
        raised_m
            Height of the part's bottom at its start [m].
        clearance_m
            Clearance of open jaws on each side of the part [m].
        at_ends
            Return the outermost grasps of both ends of a long part, one of each closing direction,
            in no particular order, instead.
        at_top
            Return the shallowest grasp of each side and closing direction instead.
        walls_m
            The same as `sunk_m` for level hands, by the direction in which they point.
        """
        jaws = _Jaws(hand, clearance_m)
        depths_m = {DOWN: sunk_m, **(walls_m or {})}
        candidates = [
            grasp
            for approach in approaches
            for closing in self._list_closings(approach)
            for grasp in self._search(
                jaws, np.array(approach), closing, depths_m.get(approach, -np.inf), raised_m
            )
        ]
        if at_ends:
            return self._choose_ends(candidates)
        # The best of each side, closing direction and depth first: a neighbour may be in the way of
        # deep fingers, and a rim in the way of shallow ones.
        candidates.sort(key=lambda grasp: (at_top * grasp.entry["depth_m"], grasp.cost))
        best: dict[tuple[Any, ...], JawGrasp] = {}
        for grasp in candidates:
            best.setdefault(_classify(grasp)[: 2 if at_top else None], grasp)
        if at_top:
            return [*best.values()]
        chosen = list(best.values())[:_MOST_GRASPS]
        for grasp in candidates:
            if len(chosen) < _MOST_GRASPS and all(_differ(grasp, other) for other in chosen):
                chosen.append(grasp)
        return sorted(chosen, key=lambda grasp: grasp.cost)

    def _choose_ends(self, candidates: Sequence[JawGrasp]) -> list[JawGrasp]:
        """Return the outermost grasps of both ends that are far from the centre of mass."""
        outermost: dict[tuple[Any, ...], tuple[float, JawGrasp]] = {}
        for grasp in candidates:
            away = np.subtract(grasp.tip_m, self._centre_m)[:2]
            distance_m = float(np.abs(away).max())
            end = int(np.argmax(np.abs(away))), bool(away.max() > -away.min())
            key = str(grasp.entry["closing_axis"]), *end
            known = outermost.get(key)
            if distance_m > _END_M and (
                known is None or (-distance_m, grasp.cost) < (-known[0], known[1].cost)
            ):
                outermost[key] = distance_m, grasp
        return [grasp for _, grasp in outermost.values()]

    def find_inner_grasps(
        self, hand: Hand, approaches: Sequence[tuple[float, float, float]]
    ) -> list[JawGrasp]:
        """Return grasps of jaws that open in a hole, at most one of each side and direction."""
        best: dict[str, JawGrasp] = {}
        for approach in approaches:
            height_m = float(np.ptp(self._local @ approach))
            most_m = height_m - min(_ABOVE_M, _ABOVE_SHARE * height_m)
            depths_m = [depth_m for depth_m in _INNER_DEPTHS_M if depth_m <= most_m]
            for closing in self._list_closings(approach):
                field = self._trace(np.array(approach), closing)
                centre = field.frame @ self._centre_m
                for depth_m in depths_m:
                    for column in field.list_columns(float(centre[0])):
                        for patch in field.find_holes(column, field.top_m - depth_m, hand):
                            grasp = self._hold_inside(hand, field, patch, depth_m)
                            side = f"{approach} {closing}"
                            if grasp is not None and (
                                side not in best or grasp.cost < best[side].cost - _ALMOST
                            ):
                                best[side] = grasp
        return sorted(best.values(), key=lambda grasp: grasp.cost)[: _MOST_INNER * len(approaches)]

    def _hold_inside(
        self, hand: Hand, field: _Field, patch: _Patch, depth_m: float
    ) -> JawGrasp | None:
        """Return the grasp of jaws that press on a patch from inside; None if it slips."""
        centre, approach = field.frame @ self._centre_m, -field.frame[1]
        away, across = patch.centre_m - centre, patch.across_m
        grip_n = self._compute_grip_n(patch, away, approach)
        if grip_n > _LOAD_SHARE * hand.force_n:
            return None
        if abs(away[0]) <= field.cell_m[0] / 2 + _ALMOST:
            across = float(centre[0])
        point = across * field.frame[0] + patch.middle_m * field.frame[2]
        point = point + (field.top_m - depth_m) * field.frame[1]
        entry = _format(approach, field.frame[2], point, patch.width_m, depth_m)
        # The task's own shapes give the width, between which the jaws are centred.
        del entry["width_m"]
        tip_m = (float(point[0]), float(point[1]), float(point[2]))
        cost = float(abs(away[0]) + abs(away[2]) + _INNER_COST_M)
        return JawGrasp(
            {**entry, "hold": "inner"}, cost, patch.area_m2, max(grip_n, self._bears_twice_n), tip_m
        )

    def _list_closings(self, approach: tuple[float, float, float]) -> Iterator[Floats]:
        """Yield directions across an approach that large faces look along, and the axes."""
        out = -np.array(approach)
        listed: list[Floats] = []
        level = (np.abs(self._normals @ out) < 1 - _ALONG) & self._is_plane
        whole = float(self._areas.sum())
        normals, areas = self._normals[level], self._areas[level].copy()
        while len(areas) and areas.max() > 0 and len(listed) < 4:
            along = np.abs(normals @ normals[int(np.argmax(areas))]) > _ALONG
            if areas[along].sum() < _WORTH * whole:
                areas[along] = 0.0
                continue
            closing = normals[int(np.argmax(areas))]
            closing = closing - (closing @ out) * out
            listed.append(_turn_forwards(closing / np.linalg.norm(closing)))
            areas[along] = 0.0
        normals, areas, middles = self._normals[level], self._areas[level], self._middles[level]
        for axis in np.eye(3):
            if abs(axis @ out) > _ALMOST or any(abs(axis @ a) > _ALONG for a in listed):
                continue
            heights, extents = middles @ axis, self._local @ axis
            depths = np.minimum(extents.max() - heights, heights - extents.min())
            near = (np.abs(normals @ axis) > _TURNS) & (depths < _OUTER * float(np.ptp(extents)))
            if areas[near].sum() > _SMALL * whole:
                # Jaws along the axis would turn the part until this face is flush with them.
                face = normals[near][int(np.argmax(areas[near]))]
                face = _turn_forwards(face - (face @ out) * out)
                face /= np.linalg.norm(face)
                is_straight = (np.abs(normals[near] @ axis) > 1 - _ALMOST).any()
                is_level = abs(out[2]) > 0.5 or abs(face[2]) < _ALMOST
                axis = face if is_level and not is_straight else axis
            if not any(abs(axis @ a) > _ALONG for a in listed):
                listed.append(axis)
        # A hand from the side whose jaws close upright would be in the table.
        yield from (c for c in listed if abs(out[2]) > 0.5 or abs(c[2]) < _ALMOST)

    def _search(
        self, jaws: _Jaws, approach: Floats, closing: Floats, sunk_m: float, raised_m: float
    ) -> Iterator[JawGrasp]:
        """Yield the grasps of jaws that close in one direction, with the best of each depth."""
        hand = jaws.hand
        field = self._trace(approach, closing)
        centre = field.frame @ self._centre_m
        from_top = approach[2] < -0.5
        lowest_m = min(_ABOVE_M, _ABOVE_SHARE * float(np.ptp(self._local[:, 2])))
        for column in field.list_columns(float(centre[0])):
            for tip in field.list_tips(column):
                for patch in field.find_patches(column, tip, jaws):
                    across = patch.across_m
                    if abs(across - centre[0]) <= field.cell_m[0] / 2 + _ALMOST:
                        across = float(centre[0])
                    point = across * field.frame[0] + tip * field.frame[1]
                    point = point + patch.middle_m * closing
                    if from_top and point[2] < lowest_m:
                        continue
                    if not from_top and point[2] + raised_m < hand.half_width_m + _SIDE_MARGIN_M:
                        continue
                    away = patch.centre_m - centre
                    grip_n = self._compute_grip_n(patch, away, approach)
                    if grip_n > _LOAD_SHARE * hand.force_n:
                        continue
                    cost = abs(away[0]) + abs(away[2]) + 0.3 * abs(away[1])
                    cost += abs(across - patch.centre_m[0])
                    cost += 2e-3 / (1e-3 + np.sqrt(patch.area_m2)) * 1e-2
                    cost += 0.02 * (float(-point @ approach) < sunk_m + _ABOVE_M)
                    yield JawGrasp(
                        _format(approach, closing, point, patch.width_m, field.top_m - tip),
                        float(cost),
                        patch.area_m2,
                        max(grip_n, self._bears_twice_n),
                        (float(point[0]), float(point[1]), float(point[2])),
                    )

    def _trace(self, approach: Floats, closing: Floats) -> _Field:
        """Return the field of two directions; hands share it."""
        key = np.concatenate([approach, closing]).tobytes()
        if key not in self._fields:
            self._fields[key] = _Field.trace(self._mesh, self._local, approach, closing)
        return self._fields[key]

    def _compute_grip_n(self, patch: _Patch, away_m: Floats, approach: Floats) -> float:
        """Return the force of each jaw at which friction just bears a part at rest [N].

        Friction of soft patches as in Howe and Cutkosky (1996).

        Parameters
        ----------
        away_m
            Way from the centre of mass to the patches in the frame of the field, shape (3,).
        """
        across_m, out_m, along_m = away_m.tolist()
        # Gravity pulls along `out` of a hand from above, else across it.
        twist_m, tilt_m = (across_m, along_m) if approach[2] < -0.5 else (out_m, 0.0)
        soft_m = _FRICTION * patch.reach_m
        stiff_m = soft_m + patch.reach_m + _FRICTION * patch.width_m / 2
        share = math.hypot(1 / _FRICTION, twist_m / soft_m, tilt_m / stiff_m)
        return self._mass_kg * GRAVITY_M_PER_S2 / 2 * share


@dataclass(frozen=True, slots=True)
class _Jaws:
    """A hand and the clearance of its open jaws on each side of a part [m]."""

    hand: Hand
    clearance_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Patch:
    """Material between two jaws.

    Parameters
    ----------
    across_m, middle_m
        Position of the hand's axis across the closing direction and along it [m].
    centre_m
        Centre of both patches in the frame of the field [m], shape (3,).
    reach_m
        Mean distance of the patch from its centre [m].
    """

    across_m: float
    middle_m: float
    width_m: float
    centre_m: Floats
    area_m2: float
    reach_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """Spans of material along rays in the closing direction.

    Parameters
    ----------
    frame
        Directions across, out of the part towards the hand, and closing, one per row.
    across_m, out_m
        Positions of the rays, shapes (columns,) and (rows,).
    begins, ends
        Spans of material [m], shape (columns, rows, spans), padded with infinity.
    """

    frame: Floats
    across_m: Floats
    out_m: Floats
    begins: Floats
    ends: Floats
    top_m: float
    cell_m: tuple[float, float]

    @classmethod
    def trace(cls, mesh: RayMesh, local: Points, approach: Floats, closing: Floats) -> _Field:
        """Trace the rays."""
        frame = np.stack([np.cross(closing, approach), -approach, closing])
        placed = local @ frame.T
        low, high = placed.min(axis=0), placed.max(axis=0)
        axes = []
        for axis in (0, 1):
            extent = float(high[axis] - low[axis])
            count = int(np.clip(np.ceil(extent / _FINEST_M), 3, _MOST_RAYS))
            axes.append(low[axis] + extent * (np.arange(count) + 0.5) / count)
        view = RayView(mesh, np.stack([frame[0], frame[1], frame[2]]))
        plan = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        begins, ends = (np.sort(rows, axis=1) / 1e3 for rows in view.trace_crossings(plan * 1e3))
        spans = max(1, int(np.isfinite(begins).sum(axis=1).max(initial=1)))
        shape = (len(axes[0]), len(axes[1]), -1)
        cell = tuple(float(a[1] - a[0]) for a in axes)
        return cls(
            frame,
            axes[0],
            axes[1],
            begins[:, :spans].reshape(shape),
            ends[:, :spans].reshape(shape),
            float(high[1]),
            (cell[0], cell[1]),
        )

    def list_columns(self, centre_m: float) -> Sequence[int]:
        """Return columns to try for the hand's axis: at the centre of mass, and evenly spread."""
        count = len(self.across_m)
        near = int(np.argmin(np.abs(self.across_m - centre_m)))
        spread = np.linspace(0, count - 1, min(count, _COLUMNS)).round().astype(int)
        return sorted({near, *spread.tolist()})

    def list_tips(self, column: int) -> list[float]:
        """Return positions of the fingertips along `out` to try in a column [m]."""
        rows = np.flatnonzero(np.isfinite(self.begins[column, :, 0]))
        if not len(rows):
            return []
        top = self.out_m[rows[-1]] + self.cell_m[1] / 2
        bottom = self.out_m[rows[0]] - self.cell_m[1] / 2
        thick = top - bottom
        # Lengths of parts are round, too: fingertips would end on faces of neighbours.
        round_m = {depth - _CLEAR_M for depth in _DEPTHS_M if depth < thick}
        depths = round_m | {thick / 2, 0.7 * thick}
        return [float(top - depth) for depth in sorted(depths)]

    def find_patches(self, column: int, tip: float, jaws: _Jaws) -> Iterator[_Patch]:
        """Yield the patches on which jaws with their tips at a height close, by layer."""
        half_m, length_m = jaws.hand.jaw_half_width_m, jaws.hand.jaw_m[-1][0]
        rows = (self.out_m > tip) & (self.out_m < tip + length_m)
        columns = np.abs(self.across_m - self.across_m[column]) <= half_m
        if not rows.any():
            return
        some = _slice(columns), _slice(rows)
        begins, ends = self.begins[some], self.ends[some]
        inner = np.flatnonzero(rows)
        row = inner[min(1, len(inner) - 1)]
        own = [
            (float(begin), float(end))
            for begin, end in zip(self.begins[column, row], self.ends[column, row], strict=True)
            if np.isfinite(begin) and np.isfinite(end)
        ][:_MOST_SPANS]
        for first, (begin, _) in enumerate(own):
            # Jaws may close on one wall, or on several from outside, as on a ring.
            for _, end in own[first:]:
                between = (begin, end)
                patch = self._close(column, tip, jaws, begins, ends, between, rows, columns)
                if patch is not None:
                    yield patch

    def find_holes(self, column: int, tip: float, hand: Hand) -> Iterator[_Patch]:
        """Yield the patches on which jaws press outwards in a hole that begins at the top."""
        rows = self.out_m > tip
        if not rows.any():
            # Rays of a large part are wide apart.
            return
        columns = np.abs(self.across_m - self.across_m[column]) <= hand.jaw_half_width_m
        begins, ends = self.begins[columns][:, rows], self.ends[columns][:, rows]
        thick_m = 2 * hand.jaw_thickness_m(self.top_m - tip)
        cell_m2 = self.cell_m[0] * self.cell_m[1]
        first = int(np.flatnonzero(rows)[0])
        mine = self.begins[column, first], self.ends[column, first]
        for end, begin in zip(mine[1][:_MOST_SPANS], mine[0][1 : _MOST_SPANS + 1], strict=False):
            if not np.isfinite(begin):
                return
            middle = (end + begin) / 2
            below = np.where(ends <= middle, ends, -np.inf).max(axis=2)
            above = np.where(begins >= middle, begins, np.inf).min(axis=2)
            is_open = ~((begins < middle) & (ends > middle)).any()
            left, right = float(below.max()), float(above.min())
            width = right - left
            if not (is_open and np.isfinite([below, above]).all()):
                continue
            if not thick_m + _INNER_PLAY_M <= width <= thick_m + hand.opening_m:
                continue
            touches = below >= left - _ROUND_M, above <= right + _ROUND_M
            area_m2 = min(float(mask.sum()) for mask in touches) * cell_m2
            if area_m2 < _INNER_M2:
                continue
            across, out = float(self.across_m[column]), (tip + self.top_m) / 2
            centre = np.array([across, out, (left + right) / 2])
            reach_m = max(hand.jaw_half_width_m / 2, 5e-4)
            yield _Patch(across, float(centre[2]), width, centre, area_m2, reach_m)

    def _close(
        self,
        column: int,
        tip: float,
        jaws: _Jaws,
        begins: Floats,
        ends: Floats,
        between: tuple[float, float],
        rows: NDArray[np.bool_],
        columns: NDArray[np.bool_],
    ) -> _Patch | None:
        """Return the patch of jaws that close about a stretch of material, or None."""
        inwards = min(_CLEAR_M, (between[1] - between[0]) / 4)
        around = (begins <= between[1] - inwards) & (ends >= between[0] + inwards)
        if not around.any():
            return None
        left = float(begins[around].min())
        right = float(ends[around].max())
        width = right - left
        if not _CLEAR_M < width <= jaws.hand.opening_m - _PLAY_M:
            return None
        touches = [around & (begins <= left + _NEAR_M), around & (ends >= right - _NEAR_M)]
        self._drop_slopes(touches, rows, columns, (left, right))
        cell = self.cell_m[0] * self.cell_m[1]
        areas = [float(mask.any(axis=2).sum()) * cell for mask in touches]
        if min(areas) < _LEAST_M2:
            return None
        places = np.stack(
            np.meshgrid(self.across_m[columns], self.out_m[rows], indexing="ij"), axis=-1
        )
        spots = [places[mask.any(axis=2)] for mask in touches]
        middles = [spot.mean(axis=0) for spot in spots]
        most_m = max(2e-3, 0.25 * jaws.hand.jaw_half_width_m)
        if float(np.abs(middles[0] - middles[1]).max()) > most_m:
            return None
        if not self._is_clear(column, tip, jaws, left, right):
            return None
        centre = (middles[0] + middles[1]) / 2
        reach = min(
            float(np.linalg.norm(s - m, axis=1).mean()) for s, m in zip(spots, middles, strict=True)
        )
        return _Patch(
            float(self.across_m[column]),
            (left + right) / 2,
            width,
            np.array([centre[0], centre[1], (left + right) / 2]),
            min(areas),
            max(reach, 5e-4),
        )

    def _drop_slopes(
        self,
        touches: Sequence[NDArray[np.bool_]],
        rows: NDArray[np.bool_],
        columns: NDArray[np.bool_],
        sides: tuple[float, float],
    ) -> None:
        """Remove touches of the borders of jaws on slopes, along which they slip off."""
        across, along = np.flatnonzero(columns), np.flatnonzero(rows)
        borders = ((1, 0, 1, along[0] - 1), (0, 0, 1, across[0] - 1), (0, -1, -2, across[-1] + 1))
        for axis, border, inner, outside in borders:
            kept = along if axis == 0 else across
            # A single row does not show whether a face is upright; a single column is as wide as
            # a jaw.
            is_single = touches[0].shape[axis] == 1
            if not 0 <= outside < self.begins.shape[axis] or (is_single and axis == 0):
                continue
            line = (kept, outside) if axis else (outside, kept)
            begins, ends = self.begins[line], self.ends[line]
            for mask, side, sign in zip(touches, sides, (-1, 1), strict=True):
                at = side + sign * _NEAR_M
                is_wider = (np.isfinite(begins) & (begins <= at) & (ends >= at)).any(axis=1)
                slips = is_wider & (is_single or ~np.any(mask.take(inner, axis), axis=1))
                where = (border, slips) if axis == 0 else (slips, border)
                mask[where] = False

    def _is_clear(self, column: int, tip: float, jaws: _Jaws, left: float, right: float) -> bool:
        """Return True if open jaws and the hand's body above them meet no material."""
        middle, hand = (left + right) / 2, jaws.hand
        open_m = min(right - left + 2 * jaws.clearance_m, hand.opening_m)
        begin_m, end_m = middle - open_m / 2, middle + open_m / 2
        above = self.out_m - tip
        for lower, upper in pairwise(hand.jaw_m):
            half, behind = max(lower[1], upper[1]), max(lower[3], upper[3])
            # Fingertips clear what lies beneath them, too.
            lowest_m = lower[0] if lower[0] else _ALMOST - _CLEAR_M
            rows = _slice((above >= lowest_m) & (above <= upper[0] + self.cell_m[1]))
            columns = _slice(np.abs(self.across_m - self.across_m[column]) <= half + _CLEAR_M)
            begins, ends = self.begins[columns, rows], self.ends[columns, rows]
            hits_left = (begins < left - _CLEAR_M) & (ends > begin_m - behind)
            hits_right = (ends > right + _CLEAR_M) & (begins < end_m + behind)
            if hits_left.any() or hits_right.any():
                return False
        rows = _slice(above > hand.tip_m - hand.underside_m - _CLEAR_M)
        columns = _slice(np.abs(self.across_m - self.across_m[column]) <= hand.half_width_m)
        begins, ends = self.begins[columns, rows], self.ends[columns, rows]
        half_m = hand.half_length_m
        meets = (begins < middle + half_m) & (ends > middle - half_m) & np.isfinite(begins)
        return not bool(meets.any())


def _slice(mask: NDArray[np.bool_]) -> slice:
    """Return the stretch of a mask that is true; a slice copies no rays."""
    numbers = np.flatnonzero(mask)
    return slice(numbers[0], numbers[-1] + 1) if len(numbers) else slice(0)


def compute_cup_force_n(diameter_m: float) -> float:
    """Return the force of a suction cup at a vacuum of 0.6 bar [N]."""
    return float(_VACUUM_PA * np.pi * diameter_m**2 / 4)


def _turn_forwards(closing: Floats) -> Floats:
    """Return a direction or its opposite, the one with a positive leading component."""
    leading = closing[np.abs(closing) > _ALMOST][0]
    return closing if leading > 0 else -closing


def _classify(grasp: JawGrasp) -> tuple[Any, ...]:
    """Return side, closing direction and class of depth of a grasp."""
    entry = grasp.entry
    depth = int(np.searchsorted(_DEPTH_CLASSES_M, entry["depth_m"] - _ALMOST))
    return str(entry.get("approach")), str(entry["closing_axis"]), depth


def _differ(grasp: JawGrasp, other: JawGrasp) -> bool:
    same = all(grasp.entry.get(key) == other.entry.get(key) for key in ("approach", "closing_axis"))
    return not same or float(np.linalg.norm(np.subtract(grasp.tip_m, other.tip_m))) > _APART_M


def _format(
    approach: Floats, closing: Floats, point: Floats, width_m: float, depth_m: float
) -> Entry:
    """Return a grasp as in a task file."""
    entry: Entry = {"type": "jaws"}
    from_top = approach[2] < -0.5
    if not from_top:
        entry["approach"] = [float(value) + 0.0 for value in approach]
    axis = int(np.argmax(np.abs(closing)))
    if abs(closing[axis]) > 1 - 1e-9:
        entry["closing_axis"] = "xyz"[axis]
    else:
        entry["closing_axis"] = [round(float(value), 9) + 0.0 for value in closing]
    entry["depth_m"] = round(float(depth_m), 6)
    entry["width_m"] = round(float(width_m), 6)
    place = point[:2] if from_top else point
    entry["at_m"] = [round(float(value), 5) + 0.0 for value in place]
    return entry
