"""Repair meshes: merge vertices, split edges, turn triangles outwards, close gaps and holes."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.surface import cross_rows
from skillplan.domains.assembly.mesh_files import label_connected
from skillplan_cad.product import Face, Points, Triangles
from skillplan_cad.reading.raw_part import Measure, Mended, RawPart, compute_area_vectors_m2

# Distances below which vertices are merged, in part sizes; coordinates have single precision.
_SAME, _NEARLY_SAME = 1e-7, 2e-6
# Largest share of the surface in filled holes; larger holes are missing faces.
_MOST_FILLED = 1e-2
# Coordinates that cannot be merged [m].
_FAR_M = 1e9
# Rounds of splitting edges; each round splits an edge once.
_ROUNDS = 8
# Odd factors that spread rows of numbers over 64 bits.
_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64).astype(
    np.int64
)
# Largest number of corners of a hole to fill.
_MOST_HOLE_CORNERS = 10_000


@dataclass(slots=True, eq=False)
class _Repairs:
    """Counts of repairs, for the notes of a part."""

    doubles: int = 0
    slivers: int = 0
    turned: int = 0
    split: int = 0
    filled: int = 0
    gap_m: float = 0.0
    hole_m: float = 0.0
    inside_out: bool = False

    def list_notes(self, name: str) -> tuple[str, ...]:
        """Return the repairs as sentences."""
        counted = [
            (self.doubles, "stood twice and {was} dropped", True),
            (self.slivers, "had no area and {was} dropped", True),
            (self.turned, "{was} turned over", True),
            (self.split, "{was} split at a corner in the middle", False),
        ]
        notes = []
        for count, words, is_triangle in counted:
            if count:
                what = "triangle" if is_triangle else "edge"
                was = "was" if count == 1 else "were"
                notes.append(f"{count} {what}{'s' if count > 1 else ''} {words.format(was=was)}")
        if self.inside_out:
            notes.append("it was inside out and was turned")
        if self.gap_m:
            notes.append(f"gaps of up to {self.gap_m * 1000:.2g} mm were closed")
        if self.filled:
            holes = "a hole" if self.filled == 1 else f"{self.filled} holes"
            notes.append(f"{holes} of up to {self.hole_m * 1000:.3g} mm closed by new triangles")
        return tuple(f"{name}: {words}" for words in notes)


def mend(
    part: RawPart, weld_m: float = 0.0, *, is_merged: bool = False, is_one_shell: bool = False
) -> Mended:
    """Return a part with a closed mesh, or with its open edges.

    Parameters
    ----------
    weld_m
        Largest gap between open edges that is closed [m].
    is_merged
        True if equal vertices have been merged.
    is_one_shell
        True if the mesh is known to be one closed shell.
    """
    repairs = _Repairs()
    if is_one_shell:
        if compute_volumes_m3(part.vertices_m, part.triangles).sum() < 0:
            part, repairs.inside_out = replace(part, triangles=part.triangles[:, ::-1]), True
        bodies = np.zeros(len(part.triangles), dtype=np.int64)
        return Mended(part, 0, np.zeros(3), bodies, repairs.list_notes(part.name))
    if not np.abs(part.vertices_m).max(initial=0.0) < _FAR_M:
        # No product reaches so far; the reader refuses it.
        bodies = np.zeros(len(part.triangles), dtype=np.int64)
        return Mended(part, 0, np.zeros(3), bodies)
    repaired = part if is_merged else _merge_vertices(part, _SAME)
    if len(_find_open_edges(repaired.triangles)):
        repaired = _close(part, weld_m, repairs)
    gaps = _find_open_edges(repaired.triangles)
    bodies = np.zeros(len(repaired.triangles), dtype=np.int64)
    middle = np.zeros(3)
    if len(gaps):
        middle = repaired.vertices_m[gaps[0]].mean(axis=0)
    elif len(repaired.triangles):
        repaired, bodies, repairs.inside_out = _turn_outwards(repaired)
    gap_m = max(repairs.gap_m, repairs.hole_m)
    notes = repairs.list_notes(part.name)
    return Mended(repaired, len(gaps), middle, bodies, notes, gap_m)


def merge_equal_vertices(part: RawPart) -> tuple[RawPart, bool]:
    """Return a part with equal vertices merged, and whether its mesh is closed then."""
    bits = np.ascontiguousarray(part.vertices_m + 0.0).view(np.int64)
    first, which = _find_distinct_rows(bits.reshape(-1, 3))
    merged = replace(part, vertices_m=part.vertices_m[first], triangles=which[part.triangles])
    merged = _drop_collapsed(merged)
    if len(_find_open_edges(merged.triangles)):
        merged = _merge_vertices(part, _SAME)
    return merged, len(merged.triangles) > 0 and not len(_find_open_edges(merged.triangles))


def join(name: str, bodies: list[Mended]) -> Mended:
    """Return several closed or open bodies as one part, none merged with another."""
    if len(bodies) == 1:
        return replace(bodies[0], part=replace(bodies[0].part, name=name))
    points, triangles, labels, faces = [], [], [], []
    measures: list[Measure] = []
    corner = triangle = label = 0
    for body in bodies:
        part = body.part
        points.append(part.vertices_m)
        triangles.append(part.triangles + corner)
        labels.append(body.bodies + label)
        faces += [replace(face, triangles=face.triangles + triangle) for face in part.faces]
        measures += body.measures
        corner += len(part.vertices_m)
        triangle += len(part.triangles)
        label += int(body.bodies.max(initial=-1)) + 1
    first = bodies[0]
    whole = replace(
        first.part,
        name=name,
        vertices_m=np.concatenate(points),
        triangles=np.concatenate(triangles),
        faces=tuple(faces),
    )
    worst = max(bodies, key=lambda body: body.open_edges)
    return Mended(
        whole,
        sum(body.open_edges for body in bodies),
        worst.gap_point_m,
        np.concatenate(labels),
        tuple(note for body in bodies for note in body.notes),
        max(body.gap_m for body in bodies),
        tuple(measures) if all(body.measures for body in bodies) else (),
    )


def compute_volumes_m3(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the signed volume between each triangle and the centre of the mesh."""
    middle = vertices_m.mean(axis=0) if len(vertices_m) else np.zeros(3)
    a, b, c = (vertices_m[triangles[:, corner]] - middle for corner in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, cross_rows(b, c)) / 6)


def compute_centre_m(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the centroid of the volume of a closed mesh."""
    middle = vertices_m.mean(axis=0)
    volumes = compute_volumes_m3(vertices_m, triangles)
    corners = (vertices_m[triangles] - middle).sum(axis=1) / 4
    return np.asarray(middle + (volumes[:, None] * corners).sum(axis=0) / volumes.sum())


def split(repaired: Mended) -> list[Mended]:
    """Return the bodies of a part as separate parts."""
    part = repaired.part
    separate = []
    for number in range(int(repaired.bodies.max()) + 1):
        own = repaired.bodies == number
        body = _select_triangles(
            replace(part, name=f"{part.name}.{number + 1}"), own, part.triangles
        )
        separate.append(
            replace(
                repaired,
                part=body,
                bodies=np.zeros(int(own.sum()), dtype=np.int64),
                notes=(),
                measures=repaired.measures[number : number + 1],
            )
        )
    return separate


def thicken(part: RawPart, thickness_m: float) -> RawPart:
    """Return an open surface as a closed sheet, with the surface as its outer side.

    Parameters
    ----------
    thickness_m
        Thickness of the sheet [m], > 0.
    """
    vertices, triangles = part.vertices_m, part.triangles
    vectors = compute_area_vectors_m2(vertices, triangles)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], vectors)
    length = np.linalg.norm(normals, axis=1)
    normals /= np.where(length > 0, length, 1.0)[:, None]
    count = len(vertices)
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = {(int(a), int(b)) for a, b in edges}
    rim = [(a, b) for a, b in forward if (b, a) not in forward]
    walls = [
        triangle for a, b in rim for triangle in ((b, a, a + count), (b, a + count, b + count))
    ]
    inner = triangles[:, ::-1] + count
    parts = [triangles, inner, np.asarray(walls, dtype=np.int64).reshape(-1, 3)]
    return replace(
        part,
        vertices_m=np.concatenate([vertices, vertices - thickness_m * normals]),
        triangles=np.concatenate(parts),
        faces=(),
    )


def _close(part: RawPart, weld_m: float, repairs: _Repairs) -> RawPart:
    """Return a part with as few open edges as possible, and count the repairs."""
    repaired = _merge_vertices(part, _NEARLY_SAME)
    repairs.slivers += len(part.triangles) - len(repaired.triangles)
    if not len(repaired.triangles):
        return repaired
    repaired = _drop_doubles(repaired, repairs)
    size_m = float(np.ptp(repaired.vertices_m, axis=0).max(initial=0.0)) or 1.0
    repaired = _drop_slivers(repaired, _NEARLY_SAME * size_m, repairs)
    repaired = _split_edges(repaired, _NEARLY_SAME * size_m, repairs)
    repaired = _turn_over(repaired, repairs)
    if weld_m and len(_find_open_edges(repaired.triangles)):
        welded = _weld(repaired, weld_m, repairs)
        welded = _turn_over(_split_edges(welded, weld_m, repairs, is_gap=True), repairs)
        if len(_find_open_edges(welded.triangles)) < len(_find_open_edges(repaired.triangles)):
            repaired = welded
    return _fill_holes(repaired, repairs)


def _merge_vertices(part: RawPart, share: float) -> RawPart:
    """Return a part with close vertices merged."""
    vertices = part.vertices_m
    size = float(np.ptp(vertices, axis=0).max(initial=0.0)) or 1.0
    if not len(vertices):
        return part
    cells = np.round((vertices - vertices.min(axis=0)) / (size * share)).astype(np.int64)
    first, which = _find_distinct_rows(cells)
    points = vertices[first]
    # Close vertices may lie in neighbouring cells.
    pairs = _build_tree(points).query_pairs(size * share, output_type="ndarray")
    return _merge_pairs(replace(part, vertices_m=points, triangles=which[part.triangles]), pairs)


def _find_distinct_rows(rows: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first place of each distinct row, and for each row its number among these."""
    with np.errstate(over="ignore"):
        keys = (rows * _FACTORS[: rows.shape[1]]).sum(axis=1)
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    if (rows[first[which]] == rows).all():
        return first, which
    # Two rows share a key.
    _, first, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return first, which.reshape(-1)


def _merge_pairs(part: RawPart, pairs: NDArray[np.int64]) -> RawPart:
    """Return a part with pairs of vertices merged, without triangles that vanish."""
    points = part.vertices_m
    label = label_connected(pairs, len(points))
    kept = np.full(int(label.max()) + 1, len(points))
    np.minimum.at(kept, label, np.arange(len(points)))
    return _drop_collapsed(replace(part, vertices_m=points[kept], triangles=label[part.triangles]))


def _drop_collapsed(part: RawPart) -> RawPart:
    """Return a part without triangles that have a corner twice, and without unused vertices."""
    a, b, c = part.triangles.T
    whole = (a != b) & (b != c) & (c != a)
    used = np.bincount(part.triangles.ravel(), minlength=len(part.vertices_m))
    if whole.all() and used.all():
        return part
    return _select_triangles(part, whole, part.triangles)


def _select_triangles(part: RawPart, chosen: NDArray[np.bool_], triangles: Triangles) -> RawPart:
    """Return a part with only the chosen triangles and their vertices."""
    number = np.cumsum(chosen) - 1
    faces = []
    for face in part.faces:
        left = face.triangles[chosen[face.triangles]]
        if len(left):
            faces.append(replace(face, triangles=number[left]))
    used, renumbered = np.unique(triangles[chosen], return_inverse=True)
    return replace(
        part,
        vertices_m=part.vertices_m[used],
        triangles=renumbered.reshape(-1, 3).astype(np.int64),
        faces=tuple(faces),
    )


def _find_open_edges(triangles: Triangles) -> NDArray[np.int64]:
    """Return the edges, as vertex pairs, that triangles do not pass equally often each way."""
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    keys = np.minimum(start, end) * (int(triangles.max()) + 1) + np.maximum(start, end)
    forward = start < end
    ways = np.sort(keys[forward]), np.sort(keys[~forward])
    if np.array_equal(*ways):
        return np.zeros((0, 2), dtype=np.int64)
    distinct, which = np.unique(keys, return_inverse=True)
    balance = np.bincount(which, np.where(forward, 1, -1), len(distinct))
    return np.stack(np.divmod(distinct[balance != 0], int(triangles.max()) + 1), axis=1)


def _find_rims(triangles: Triangles) -> NDArray[np.int64]:
    """Return the edges, as vertex pairs, of an odd number of triangles."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    first, which = _find_distinct_rows(edges)
    return np.asarray(edges[first[np.bincount(which) % 2 == 1]], dtype=np.int64)


def _drop_doubles(part: RawPart, repairs: _Repairs) -> RawPart:
    """Return a part in which each set of three corners has one triangle."""
    ordered = np.sort(part.triangles, axis=1)
    first, _ = _find_distinct_rows(ordered)
    if len(first) == len(ordered):
        return part
    chosen = np.zeros(len(ordered), dtype=np.bool_)
    chosen[first] = True
    repairs.doubles += len(ordered) - len(first)
    return _select_triangles(part, chosen, part.triangles)


def _drop_slivers(part: RawPart, width_m: float, repairs: _Repairs) -> RawPart:
    """Return a part without triangles whose corners lie in a row."""
    corners = part.vertices_m[part.triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    areas = np.linalg.norm(compute_area_vectors_m2(part.vertices_m, part.triangles), axis=1)
    flat = 2 * areas <= 0.1 * width_m * longest
    if not flat.any():
        return part
    repairs.slivers += int(flat.sum())
    return _select_triangles(part, ~flat, part.triangles)


def _split_edges(
    part: RawPart, width_m: float, repairs: _Repairs, *, is_gap: bool = False
) -> RawPart:
    """Return a part whose open edges are split at corners that lie in the middle of them."""
    for _ in range(_ROUNDS):
        rims = _find_rims(part.triangles)
        if not len(rims):
            return part
        splits, off_m = _find_splits(part, rims, width_m)
        if not splits:
            return part
        if is_gap:
            repairs.gap_m = max(repairs.gap_m, off_m)
        part = _split_triangles(part, splits)
        repairs.split += len(splits)
    return part


def _find_splits(
    part: RawPart, rims: NDArray[np.int64], width_m: float
) -> tuple[dict[tuple[int, int], int], float]:
    """Return for each open edge the corner nearest to its middle, and the largest distance."""
    loose = np.unique(rims)
    points = part.vertices_m[loose]
    tree = _build_tree(points)
    splits: dict[tuple[int, int], int] = {}
    farthest_m = 0.0
    for a, b in rims:
        start, end = part.vertices_m[a], part.vertices_m[b]
        along = end - start
        length = float(np.linalg.norm(along))
        if length <= 2 * width_m:
            continue
        near = tree.query_ball_point((start + end) / 2, length / 2 + width_m)
        offsets = points[near] - start
        share = offsets @ along / length**2
        off = np.linalg.norm(offsets - share[:, None] * along, axis=1)
        inside = (share * length > width_m) & ((1 - share) * length > width_m) & (off <= width_m)
        if inside.any():
            best = int(np.flatnonzero(inside)[np.argmin(np.abs(share[inside] - 0.5))])
            splits[int(a), int(b)] = int(loose[near[best]])
            farthest_m = max(farthest_m, float(off[best]))
    return splits, farthest_m


def _split_triangles(part: RawPart, splits: dict[tuple[int, int], int]) -> RawPart:
    """Return a part with the triangles at some edges cut in two."""
    triangles = [tuple(int(corner) for corner in triangle) for triangle in part.triangles]
    origin = list(range(len(triangles)))
    done = []
    owner = []
    for number, triangle in zip(origin, triangles, strict=True):
        pieces = [triangle]
        for turn in range(3):
            a, b, c = triangle[turn], triangle[(turn + 1) % 3], triangle[(turn + 2) % 3]
            middle = splits.get((min(a, b), max(a, b)))
            if middle is not None and middle not in triangle:
                pieces = [(a, middle, c), (middle, b, c)]
                break
        done += pieces
        owner += [number] * len(pieces)
    owners = np.asarray(owner)
    faces = []
    for face in part.faces:
        own = np.flatnonzero(np.isin(owners, face.triangles))
        faces.append(replace(face, triangles=own))
    return replace(part, triangles=np.asarray(done, dtype=np.int64), faces=tuple(faces))


def _turn_over(part: RawPart, repairs: _Repairs) -> RawPart:
    """Return a part whose triangles pass each common edge in opposite ways."""
    if len(_find_rims(part.triangles)) == len(_find_open_edges(part.triangles)):
        return part
    import trimesh

    mesh: Any = trimesh.Trimesh(part.vertices_m, part.triangles, process=False)
    repair: Any = trimesh.repair
    repair.fix_winding(mesh)
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    if len(_find_open_edges(triangles)) >= len(_find_open_edges(part.triangles)):
        return part
    other = int((triangles != part.triangles).any(axis=1).sum())
    repairs.turned += min(other, len(triangles) - other)
    return replace(part, triangles=triangles)


def _weld(part: RawPart, weld_m: float, repairs: _Repairs) -> RawPart:
    """Return a part with the corners of open edges merged that are nearest to one another."""
    loose = np.unique(_find_rims(part.triangles))
    if not len(loose):
        return part
    points = part.vertices_m[loose]
    edges = np.sort(part.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    linked = {(int(a), int(b)) for a, b in edges}
    group = {int(corner): {int(corner)} for corner in loose}
    close = _build_tree(points).query_pairs(weld_m, output_type="ndarray")
    gaps = np.linalg.norm(points[close[:, 0]] - points[close[:, 1]], axis=1)
    pairs = []
    for number in np.argsort(gaps, kind="stable"):
        a, b = (int(loose[end]) for end in close[number])
        if group[a] is group[b]:
            continue
        # Corners of a common edge stay apart, or a triangle would vanish.
        if any((min(c, d), max(c, d)) in linked for c in group[a] for d in group[b]):
            continue
        merged = group[a] | group[b]
        for corner in merged:
            group[corner] = merged
        pairs.append((a, b))
        repairs.gap_m = max(repairs.gap_m, float(gaps[number]))
    if not pairs:
        return part
    return _merge_pairs(part, np.asarray(pairs, dtype=np.int64))


def _fill_holes(part: RawPart, repairs: _Repairs) -> RawPart:
    """Return a part with small holes closed by triangles about their middle."""
    triangles = part.triangles
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ordered = np.sort(edges, axis=1)
    _, which = _find_distinct_rows(ordered)
    # A hole may end at an edge that three triangles share.
    ways = np.where(edges[:, 0] < edges[:, 1], 1, -1)
    spare = np.flatnonzero(ways == np.bincount(which, ways)[which])
    _, once = np.unique(which[spare], return_index=True)
    single = {tuple(edge) for edge in ordered[np.bincount(which)[which] == 1].tolist()}
    loops = [
        loop
        for loop in _chain_loops(edges[spare[np.sort(once)]])
        # A rim of shared edges alone bounds an inner wall.
        if any((min(a, b), max(a, b)) in single for a, b in pairwise([*loop, loop[0]]))
    ]
    areas = np.linalg.norm(compute_area_vectors_m2(part.vertices_m, triangles), axis=1)
    allowed = _MOST_FILLED * float(areas.sum())
    points, extra = [part.vertices_m], []
    count, filled = len(part.vertices_m), 0
    size_m = 0.0
    for loop in loops:
        corners = part.vertices_m[loop]
        middle = corners.mean(axis=0)
        following = np.roll(corners, -1, axis=0)
        area = np.linalg.norm(np.cross(corners - middle, following - middle), axis=1).sum() / 2
        allowed -= area
        if allowed < 0:
            return part
        number, fan = count + filled, np.roll(loop, -1)
        if len(loop) == 3:
            extra.append([[loop[0], loop[2], loop[1]]])
        else:
            points.append(middle[None])
            extra.append([[b, a, number] for a, b in zip(loop, fan, strict=True)])
            filled += 1
        spread = np.linalg.norm(corners - middle, axis=1).max()
        size_m = max(size_m, 2 * float(spread))
    if not extra:
        return part
    added = np.concatenate([np.asarray(fan, dtype=np.int64) for fan in extra])
    repairs.filled += len(extra)
    repairs.hole_m = max(repairs.hole_m, size_m)
    faces = part.faces
    if faces:
        faces = (*faces, Face("free", np.arange(len(triangles), len(triangles) + len(added))))
    return replace(
        part,
        vertices_m=np.concatenate(points),
        triangles=np.concatenate([triangles, added]),
        faces=faces,
    )


def _chain_loops(edges: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return the closed loops of directed edges; open chains are left out."""
    following: dict[int, list[int]] = defaultdict(list)
    for a, b in edges:
        following[int(a)].append(int(b))
    loops = []
    for start in list(following):
        while following[start]:
            loop = [start]
            at = following[start].pop()
            while at != start and following[at] and len(loop) < _MOST_HOLE_CORNERS:
                loop.append(at)
                at = following[at].pop()
            if at != start:
                break
            if len(loop) > 2:
                loops.append(np.asarray(loop, dtype=np.int64))
    return loops


def _turn_outwards(part: RawPart) -> tuple[RawPart, NDArray[np.int64], bool]:
    """Return a closed part with outward triangles, the body of each, and whether any was turned.

    A shell of negative volume inside another is a cavity of it, not a body.
    """
    triangles = part.triangles
    shell, corner_of = _label_shells(part.vertices_m, triangles)
    if corner_of is not triangles:
        vertices = np.zeros((int(corner_of.max()) + 1, 3))
        vertices[corner_of] = part.vertices_m[triangles]
        part, triangles = replace(part, vertices_m=vertices, triangles=corner_of), corner_of
    count = int(shell.max()) + 1
    volume = np.bincount(shell, compute_volumes_m3(part.vertices_m, triangles), count)
    corners = part.vertices_m[triangles]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, shell, corners.min(axis=1))
    np.maximum.at(high, shell, corners.max(axis=1))

    def find_around(number: int) -> list[int]:
        return [
            other
            for other in range(count)
            if other != number
            and abs(volume[other]) > abs(volume[number])
            and (low[other] <= low[number] + 1e-12).all()
            and (high[other] >= high[number] - 1e-12).all()
        ]

    inverted = [
        number
        for number in range(count)
        if volume[number] < 0 and (volume.sum() < 0 or not find_around(number))
    ]
    if volume.sum() < 0:
        # The whole is inside out, its cavities too; a body next to it may not be.
        inverted = [number for number in range(count) if volume[number] < 0 or find_around(number)]
    if inverted:
        flipped = np.isin(shell, inverted)
        triangles = np.where(flipped[:, None], triangles[:, ::-1], triangles)
        volume[inverted] *= -1
        part = replace(part, triangles=triangles)
    solid = np.flatnonzero(volume > 0)
    body = np.zeros(count, dtype=np.int64)
    body[solid] = np.arange(len(solid))
    for cavity in np.flatnonzero(volume <= 0):
        around = [number for number in find_around(int(cavity)) if volume[number] > 0]
        if around:
            body[cavity] = body[min(around, key=lambda number: volume[number])]
    return part, body[shell], bool(inverted)


def _label_shells(vertices_m: Points, triangles: Triangles) -> tuple[NDArray[np.int64], Triangles]:
    """Return the shell of each triangle, and triangles with corners of their own where edges touch.

    Shells that share corners or edges only are distinct.
    """
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(triangles)), 3)
    ordered = np.sort(edges, axis=1)
    order = np.lexsort((ordered[:, 1], ordered[:, 0]))
    same = (ordered[order[1:]] == ordered[order[:-1]]).all(axis=1)
    starts = np.flatnonzero(np.concatenate([[True], ~same]))
    sizes = np.diff(np.append(starts, len(order)))
    twins = starts[sizes == 2]
    # Pairs of half edges; those of a triangle have its number by 3.
    pairs = [np.stack([order[twins], order[twins + 1]], axis=1)]
    for start, size in zip(starts[sizes > 2], sizes[sizes > 2], strict=True):
        around = order[start : start + size]
        own = _pair_around_edge(vertices_m, triangles, edges[around], owner[around])
        pairs.append(around[own])
    joined = np.concatenate(pairs)
    shells = label_connected(joined // 3, len(triangles))
    if len(pairs) == 1:
        return shells, triangles
    # A half edge starts at the corner of its own number, and ends at the next of its triangle.
    first, second = joined.T
    first_end, second_end = (half - half % 3 + (half + 1) % 3 for half in (first, second))
    turned = triangles.ravel()[first] != triangles.ravel()[second]
    links = [
        np.stack([first, np.where(turned, second_end, second)], axis=1),
        np.stack([first_end, np.where(turned, second, second_end)], axis=1),
    ]
    corners = label_connected(np.concatenate(links), 3 * len(triangles))
    return shells, corners.reshape(-1, 3)


def _build_tree(points: Points) -> Any:
    # Closed solids need none of scipy, which takes longer to load than most products to mesh.
    from scipy.spatial import cKDTree

    return cKDTree(points)


def _pair_around_edge(
    vertices_m: Points, triangles: Triangles, edges: NDArray[np.int64], owner: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the pairs of places in `owner`, triangles at an edge that bound the same material."""
    start, end = np.sort(edges[0])
    axis = vertices_m[end] - vertices_m[start]
    axis /= np.linalg.norm(axis) or 1.0
    across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    across /= np.linalg.norm(across)
    upward = np.cross(axis, across)
    third = triangles[owner].sum(axis=1) - edges.sum(axis=1)
    offsets = vertices_m[third] - vertices_m[start]
    angle = np.arctan2(offsets @ upward, offsets @ across)
    # Seen against the axis, material lies clockwise of a triangle that passes the edge forward.
    forward = edges[:, 0] == start
    pairs = []
    free = set(np.flatnonzero(~forward).tolist())
    for ahead in np.flatnonzero(forward):
        if not free:
            break
        partner = min(free, key=lambda other: (angle[ahead] - angle[other] - 1e-6) % (2 * np.pi))
        free.discard(partner)
        pairs.append((ahead, partner))
    return np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
