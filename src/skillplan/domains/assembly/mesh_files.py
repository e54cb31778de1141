"""Mesh files: closed polyhedra with outward faces, convex hulls, and convex pieces."""

from __future__ import annotations

import hashlib
import io
import json
import math
import struct
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from skillplan.collision.surface import cross_rows
from skillplan.errors import SkillplanError
from skillplan.files.regular_file import CompanionFileError, find_companion, read_companion
from skillplan.plugins.installed import list_mesh_readers
from skillplan.task.motion import Point
from skillplan.xml_tree import Element, XmlError, parse_xml

if TYPE_CHECKING:
    import trimesh

MAX_CORNERS = 20_000
"""Greatest number of corners of a polyhedron."""

LEAST_EXTENT_M = 1e-6
"""A polyhedron with a smaller extent is flat."""

DECIMALS = 9
"""Decimals of lengths in metres: a nanometre."""

# Tolerance of a corner outside the plane of a face, as a share of the greatest extent: files have
# seven digits, and fewer for lengths far from the origin.
_FLATNESS = 1e-5
# Least such tolerance, and width below which a triangle with rounded corners has no plane [m].
_ROUNDED_M, _SLIVER_M = 2e-7, 1e-6
# Greatest number of corners times faces in one array.
_MOST_PRODUCTS = 200_000
# Number of faces that are compared with all corners first.
_FIRST_FACES = 8

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class MeshFileError(Exception):
    """A file does not contain a polyhedron that a part can have.

    Parameters
    ----------
    key
        Key of the task file at fault: ``file``, ``scale`` or ``pieces``.
    """

    def __init__(self, message: str, key: str = "file") -> None:
        self.key = key
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Polyhedron:
    """A polyhedron from a file.

    Parameters
    ----------
    corners
        Corners relative to the centre of the bounding box [m].
    size
        Extents of the bounding box [m].
    middle
        Centre of the bounding box in the file's frame [m].
    """

    corners: tuple[Point, ...]
    faces: tuple[tuple[int, int, int], ...]
    size: Point
    sha256: str
    convex: bool
    middle: Point

    def about(self, centre: Point) -> tuple[Point, ...]:
        """Return the corners for a bounding box with its centre at `centre` [m], to a nanometre."""
        x_m, y_m, z_m = centre
        return tuple(
            (round(x + x_m, DECIMALS), round(y + y_m, DECIMALS), round(z + z_m, DECIMALS))
            for x, y, z in self.corners
        )


def build_polyhedron(
    raw_corners: Floats,
    raw_faces: Indices,
    sha256: str,
    middle: Floats | None = None,
    *,
    is_connected: bool = False,
) -> Polyhedron:
    """Return a checked polyhedron.

    Parameters
    ----------
    raw_corners
        Corners relative to the centre of the bounding box [m], shape (n, 3).
    raw_faces
        Three indices of corners for each face, shape (m, 3).
    sha256, middle
        See `Polyhedron`; None for the origin.
    is_connected
        True if the faces are known to form one connected body.

    Raises
    ------
    MeshFileError
        If it is open, has no outside or no volume, or more than `MAX_CORNERS` corners.
    """
    corners, faces = _merge_corners(raw_corners, raw_faces)
    if not len(faces):
        raise MeshFileError("It encloses no volume; give it a thickness.")
    size = corners.max(axis=0) - corners.min(axis=0)
    if len(corners) > MAX_CORNERS:
        raise MeshFileError(
            f"It has {len(corners):,} corners, where {MAX_CORNERS:,} are the most; simplify it."
        )
    longest_m = float(size.max())
    volume_m3 = _measure_outward_m3(corners, faces, is_connected=is_connected)
    if volume_m3 is None:
        corners, faces = _separate_bodies(corners, faces)
        surface = _orient_outward(corners, faces, is_connected=is_connected)
        faces, volume_m3 = np.asarray(surface.faces), float(surface.volume)
    if not (math.isfinite(volume_m3) and volume_m3 > 1e-6 * longest_m * LEAST_EXTENT_M**2):
        raise MeshFileError("It encloses no volume; give it a thickness.")
    return Polyhedron(
        tuple((x, y, z) for x, y, z in corners.tolist()),
        tuple((a, b, c) for a, b, c in faces.tolist()),
        (float(size[0]), float(size[1]), float(size[2])),
        sha256,
        _is_convex(corners, faces, longest_m),
        (0.0, 0.0, 0.0)
        if middle is None
        else (float(middle[0]), float(middle[1]), float(middle[2])),
    )


def _measure_outward_m3(corners: Floats, faces: Indices, *, is_connected: bool) -> float | None:
    """Return the volume within closed bodies [m3]; None unless all faces look outward."""
    begins, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    there, back = begins * len(corners) + ends, ends * len(corners) + begins
    order, mates = np.argsort(there), np.argsort(back)
    if (np.diff(there[order]) == 0).any() or (there[order] != back[mates]).any():
        # An edge is not one between two faces that run along it in opposite ways.
        return None
    a, b, c = (corners[faces[:, corner]] for corner in range(3))
    volumes_m3 = np.einsum("ij,ij->i", a, cross_rows(b, c)) / 6
    if is_connected:
        volumes_m3 = volumes_m3.sum(keepdims=True)
    else:
        bodies = label_connected(np.column_stack([order, mates]) // 3, len(faces))
        volumes_m3 = np.bincount(bodies, volumes_m3)
    return float(volumes_m3.sum()) if (volumes_m3 > 0).all() else None


def _merge_corners(corners: Floats, faces: Indices) -> tuple[Floats, Indices]:
    """Return distinct corners to a nanometre, and the faces with three distinct corners."""
    rounded = np.round(corners, DECIMALS) + 0.0
    unique, index = np.unique(rounded, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    distinct = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    faces = faces[distinct]
    used, compact = np.unique(faces, return_inverse=True)
    return unique[used], compact.reshape(-1, 3)


def _separate_bodies(corners: Floats, faces: Indices) -> tuple[Floats, Indices]:
    """Return the surface with corners of its own for each side, if bodies touch along edges.

    A body may touch itself: every fan of faces around a corner has its own copy of the corner.

    Raises
    ------
    MeshFileError
        If faces at such an edge are turned inward.
    """
    # trimesh takes a second to import, and most files do without.
    import trimesh

    surface = trimesh.Trimesh(corners, faces, process=False)
    if surface.is_watertight:
        return corners, faces
    graph: Any = trimesh.graph
    pairs = np.array(
        [*surface.face_adjacency.tolist(), *_pair_at_shared_edges(corners, faces)], dtype=np.int64
    ).reshape(-1, 2)
    # Faces that go on in each other share the corners of their edge.
    pair, mine, yours = np.nonzero(faces[pairs[:, 0]][:, :, None] == faces[pairs[:, 1]][:, None])
    nodes = np.column_stack([3 * pairs[pair, 0] + mine, 3 * pairs[pair, 1] + yours])
    fans = graph.connected_component_labels(nodes, node_count=faces.size)
    _, first, index = np.unique(fans, return_index=True, return_inverse=True)
    own_corners, own_faces = corners[faces.reshape(-1)[first]], index.reshape(-1, 3)
    if trimesh.Trimesh(own_corners, own_faces, process=False).is_watertight:
        return own_corners, own_faces
    _, counts = np.unique(np.sort(surface.edges, axis=1), axis=0, return_counts=True)
    if not (counts % 2).any():
        raise MeshFileError(
            f"An edge lies between {counts.max()} faces, some of them turned inward. Unite bodies, "
            "or give each as a mesh of its own."
        )
    return corners, faces


# Angle between faces that coincide [rad]: files round the corners of narrow faces.
_SAME_RAD = 1e-3


def _pair_at_shared_edges(corners: Floats, faces: Indices) -> Iterator[tuple[int, int]]:
    """Yield the faces of the same body at edges of more than two: material lies between them."""
    around: dict[tuple[int, int], list[tuple[int, int, bool]]] = {}
    for face, (a, b, c) in enumerate(faces.tolist()):
        for start, end, third in ((a, b, c), (b, c, a), (c, a, b)):
            edge = (min(start, end), max(start, end))
            around.setdefault(edge, []).append((face, third, start > end))
    for (low, high), sides in around.items():
        opening = next((side for side in sides if side[2]), None)
        if len(sides) <= 2 or len(sides) % 2 or opening is None:
            continue
        axis = corners[high] - corners[low]
        axis = axis / np.linalg.norm(axis)
        right = corners[opening[1]] - corners[low]
        ahead = np.cross(axis, right - axis * (axis @ right))
        right = np.cross(ahead, axis)
        turned = []
        for face, third, opens in sides:
            arm = corners[third] - corners[low]
            # Counted from a face after which material begins.
            angle = round(math.atan2(arm @ ahead, arm @ right) / _SAME_RAD)
            if opens or angle < 0:
                angle %= round(2 * math.pi / _SAME_RAD)
            elif angle == 0:
                angle = round(2 * math.pi / _SAME_RAD)
            # Of faces that coincide, the one at which material ends comes first.
            turned.append((angle, opens, face))
        turned.sort()
        for (_, opens, first), (_, closes, second) in zip(turned[::2], turned[1::2], strict=True):
            if opens and not closes:
                yield first, second


def _orient_outward(
    corners: Floats, faces: Indices, *, is_connected: bool = False
) -> trimesh.Trimesh:
    """Return the surface with its faces turned outward, each connected body by itself."""
    import trimesh

    surface = trimesh.Trimesh(corners, faces, process=False)
    if not surface.is_watertight:
        raise MeshFileError(
            "It is not closed: an edge does not lie between two faces. Close its holes, and leave "
            "out what lies inside."
        )
    repair: Any = trimesh.repair  # parts of trimesh have no types
    repair.fix_winding(surface)
    if not surface.is_winding_consistent:
        raise MeshFileError("It has no outside: its faces cannot all be turned outward. Repair it.")
    repair.fix_inversion(surface, multibody=not is_connected)
    return surface


def _is_convex(corners: Floats, faces: Indices, longest_m: float) -> bool:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    normals = cross_rows(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    edges_m = np.linalg.norm(np.stack([b - a, c - b, a - c]), axis=2).max(axis=0)
    flatness_m = max(_FLATNESS * longest_m, _ROUNDED_M)
    # A hull may fold triangles that are thinner than its tolerance; their neighbours decide, but
    # not those of a foil.
    sliver_m = max(flatness_m, _SLIVER_M)
    is_thick = float(np.ptp(corners, axis=0).min()) > 2 * sliver_m
    sound = np.flatnonzero(lengths > (sliver_m * edges_m if is_thick else 1e-12 * longest_m**2))
    a, normals = a[sound], normals[sound]
    levels = np.einsum("ij,ij->i", a, normals)
    highest = levels + flatness_m * lengths[sound]
    most = max(1, _MOST_PRODUCTS // len(corners))
    # A concave mesh has corners beyond one of its first faces.
    first, count = 0, min(most, _FIRST_FACES)
    while first < len(sound):
        some = slice(first, first + count)
        if not (corners @ normals[some].T <= highest[some]).all():
            return False
        first, count = first + count, min(most, 2 * count)
    return True


MAX_BYTES = 4 * 1024 * 1024
"""Greatest size of a file [B]."""

SUFFIXES = (".obj", ".stl", ".ply", ".glb", ".3mf", ".step", ".stp")

_MOST_EXTENT_M = 10.0


def read_mesh(folder: Path, name: str, scale: float) -> Polyhedron:
    """Return the polyhedron of a file.

    Parameters
    ----------
    folder
        Folder of the task file, which must contain the file.
    name
        Name of the file relative to `folder`, with one of `SUFFIXES`.
    scale
        Factor that converts its lengths to metres, > 0.

    Raises
    ------
    MeshFileError
        If the file is elsewhere, unreadable or larger than `MAX_BYTES`, or is not a closed surface
        of
        at most `MAX_CORNERS` corners, 1e-6 m to 10 m long.
    """
    content, suffix = read_content(folder, name)
    polyhedron = _try_parse(content, suffix, scale)
    if isinstance(polyhedron, MeshFileError):
        raise MeshFileError(str(polyhedron), polyhedron.key)
    return polyhedron


def read_content(folder: Path, name: str) -> tuple[bytes, str]:
    """Return the content of a file and its suffix."""
    try:
        path = find_companion(folder, name)
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise MeshFileError(
                f"The suffix selects the format; give one of {', '.join(SUFFIXES)}."
            )
        return read_companion(path, MAX_BYTES, "surface"), suffix
    except CompanionFileError as error:
        raise MeshFileError(str(error)) from None


# Hundreds of parts may use the same file, and an import loads a task many times.
@lru_cache(maxsize=128)
def _try_parse(content: bytes, suffix: str, scale: float) -> Polyhedron | MeshFileError:
    try:
        return _parse_polyhedron(content, suffix, scale)
    except MeshFileError as refusal:
        return refusal.with_traceback(None)


def _parse_polyhedron(content: bytes, suffix: str, scale: float) -> Polyhedron:
    raw_corners, raw_faces = parse_mesh(content, suffix)
    if not len(raw_faces):
        raise MeshFileError("It holds no faces; save the surface as triangles or polygons.")
    if not np.isfinite(raw_corners).all():
        raise MeshFileError("A coordinate is not finite; save the surface again.")
    with np.errstate(over="ignore", invalid="ignore"):
        corners = raw_corners * scale
        used = corners[np.unique(raw_faces)]
        size = used.max(axis=0) - used.min(axis=0)
    _check_size(size, scale)
    middle = (used.max(axis=0) + used.min(axis=0)) / 2
    return build_polyhedron(
        corners - middle, raw_faces, hashlib.sha256(content).hexdigest(), middle
    )


def parse_mesh(content: bytes, suffix: str) -> tuple[Floats, Indices]:
    """Return corners and triangles as stored in the file; STEP, 3MF and GLB in metres."""
    if suffix in (".step", ".stp"):
        return _parse_step(content)
    if suffix in (".3mf", ".glb"):
        objects = parse_objects(content, suffix)
        starts = np.cumsum([0, *(len(item.corners) for item in objects)])
        corners = [np.zeros((0, 3)), *(item.corners for item in objects)]
        faces = [item.faces + start for item, start in zip(objects, starts[:-1], strict=True)]
        return np.concatenate(corners), np.concatenate([np.zeros((0, 3), np.int64), *faces])
    with _refuse_unread(suffix):
        table = _parse_plain_obj(content) if suffix == ".obj" else None
        if table is None:
            mesh = _load_scene(content, suffix).to_mesh()
            table = mesh.vertices, mesh.faces
        return _check_table(*table)


def _parse_plain_obj(content: bytes) -> tuple[Floats, Indices] | None:
    """Return corners and triangles of an OBJ file of named triangles; None for other files."""
    lines = [line for line in content.splitlines() if not line.startswith(b"o ")]
    corners = [line[2:] for line in lines if line.startswith(b"v ")]
    faces = [line[2:] for line in lines if line.startswith(b"f ")]
    numbers, indices = b" ".join(corners).split(), b" ".join(faces).split()
    # A corner that no face names is not part of the mesh.
    is_plain = (
        len(corners) + len(faces) == len(lines)
        and all(len(line.split()) == 3 for line in (*corners, *faces))
        and all(map(bytes.isdigit, indices))
        and len(set(map(int, indices))) == len(corners)
    )
    if not is_plain:
        return None
    return (
        np.array(numbers, dtype=np.float64).reshape(-1, 3),
        np.array(indices, dtype=np.int64).reshape(-1, 3) - 1,
    )


@dataclass(frozen=True, slots=True, eq=False)
class MeshObject:
    """An object of a 3MF or GLB file, at its place.

    Parameters
    ----------
    name
        Name in the file; may repeat or be empty.
    path
        Names of the objects or nodes above it.
    corners, faces
        Mesh as stored in the file [m].
    """

    name: str
    path: tuple[str, ...]
    corners: Floats
    faces: Indices


def parse_objects(content: bytes, suffix: str) -> list[MeshObject]:
    """Return the objects of a 3MF or GLB file; those of several materials are one object.

    Raises
    ------
    MeshFileError
        If the file is unreadable or too large.
    """
    if suffix == ".3mf":
        return _parse_3mf(content)
    import trimesh

    with _refuse_unread(suffix):
        scene = _load_scene(content, suffix)
        return [
            _place_object(scene, node)
            for node in scene.graph.nodes_geometry
            if isinstance(scene.geometry[scene.graph[node][1]], trimesh.Trimesh)
        ]


def _place_object(scene: Any, node: Any) -> MeshObject:
    pose, geometry = scene.graph[node]
    mesh = scene.geometry[geometry]
    parents, path = scene.graph.transforms.parents, list[str]()
    above = parents.get(node)
    while above not in (None, scene.graph.base_frame) and len(path) <= len(parents):
        path.insert(0, str(above))
        above = parents.get(above)
    corners, faces = _check_table(mesh.vertices, mesh.faces)
    if np.linalg.det(pose[:3, :3]) < 0:
        faces = faces[:, ::-1]
    # Nodes without a name are numbered.
    name = str(geometry) if str(node).isdigit() else str(node)
    return MeshObject(name, tuple(path), corners @ pose[:3, :3].T + pose[:3, 3], faces)


def _load_scene(content: bytes, suffix: str) -> Any:
    """Return a file as a scene of trimesh; raises the exceptions of its parsers."""
    import trimesh

    if suffix == ".glb":
        _check_glb(content)
    # Faces of several materials are one mesh.
    options: dict[str, Any] = {"merge_primitives": True} if suffix == ".glb" else {}
    with warnings.catch_warnings(action="ignore"):
        return trimesh.load_scene(
            io.BytesIO(content),
            file_type=suffix[1:],
            skip_materials=True,
            process=False,
            **options,
        )


@contextmanager
def _refuse_unread(suffix: str) -> Iterator[None]:
    """Turn the exceptions of parsers, with messages for programmers, into refusals."""
    try:
        yield
    except MeshFileError:
        raise
    except Exception:
        raise MeshFileError(f"It cannot be read as {suffix[1:].upper()}; save it again.") from None


def _check_table(corners: Any, faces: Any) -> tuple[Floats, Indices]:
    """Return corners and faces as arrays; raises ValueError if a corner is missing."""
    corners, faces = np.asarray(corners, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    is_table = corners.ndim == 2 and corners.shape[1:] == (3,)
    if not is_table or (len(faces) and not 0 <= faces.min() <= faces.max() < len(corners)):
        raise ValueError("a face has a corner that is missing")
    return corners, faces.reshape(-1, 3)


# Bytes of an accessor's number and numbers of its item (glTF 2.0, section 3.6.2.2).
_GLB_NUMBER_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_GLB_ITEM = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_GLB_COMPRESSIONS = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
# Accessors may share bytes: together they take up to this many times the file.
_MOST_GLB_SHARES = 4
# Corners of all nodes: nodes may place the same mesh.
_MOST_GLB_CORNERS = 2_000_000


def _check_glb(content: bytes) -> None:
    """Refuse a GLB whose accessors exceed its bytes, or whose shape trimesh would misread."""
    (length,) = struct.unpack_from("<I", content, 12)
    header = json.loads(content[20 : 20 + length])
    accessors = header.get("accessors", [])
    meshes = header.get("meshes", [])
    used = {
        index
        for mesh in meshes
        for primitive in mesh["primitives"]
        for index in (primitive["attributes"].get("POSITION"), primitive.get("indices"))
        if index is not None
    }
    is_partial = any("bufferView" not in accessors[index] for index in used)
    for extension, name in _GLB_COMPRESSIONS.items():
        is_required = extension in header.get("extensionsRequired", ())
        if is_required or (is_partial and extension in header.get("extensionsUsed", ())):
            raise MeshFileError(f"It is compressed by {name}; save it without compression.")
    total = 0
    for index, accessor in enumerate(accessors):
        count = int(accessor["count"])
        size = _GLB_NUMBER_BYTES[accessor["componentType"]] * _GLB_ITEM[accessor["type"]]
        total += count * size
        if count < 0 or total > _MOST_GLB_SHARES * len(content):
            raise MeshFileError(
                f"Its accessors up to number {index} claim {total:,} bytes, where the file has "
                f"{len(content):,}; save it again."
            )
    for index in used:
        if "sparse" in accessors[index] or accessors[index].get("normalized"):
            raise MeshFileError(
                "Its corners are sparse or normalized, which is not read; save them as plain "
                "numbers."
            )
        if "bufferView" not in accessors[index]:
            raise MeshFileError(f"Its accessor {index} has no data in the file; save it again.")
    corners = [
        sum(int(accessors[part["attributes"]["POSITION"]]["count"]) for part in mesh["primitives"])
        for mesh in meshes
    ]
    placed = sum(corners[node["mesh"]] for node in header.get("nodes", ()) if "mesh" in node)
    if placed > _MOST_GLB_CORNERS:
        raise MeshFileError(
            f"Its nodes place {placed:,} corners, where {_MOST_GLB_CORNERS:,} are the most; "
            "simplify it."
        )


def _parse_step(content: bytes) -> tuple[Floats, Indices]:
    """Return the surface of the solids of a STEP file [m], meshed by a plugin."""
    entry = next(iter(list_mesh_readers()), None)
    if entry is None:
        raise MeshFileError("STEP is read by skillplan-cad; install it, or save the part as STL.")
    try:
        corners, faces = entry.load()(content)
    except SkillplanError as error:
        raise MeshFileError(str(error)) from None
    return np.asarray(corners, dtype=np.float64), np.asarray(faces, dtype=np.int64)


# Largest model of a 3MF once unpacked [B]; its units in metres.
_MOST_MODEL_BYTES = 32 * 1024 * 1024
_UNITS_3MF_M = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
_MOST_PARTS_3MF = 1_000
# Name of the first model by convention.
_MODEL_3MF = "3D/3dmodel.model"


def _parse_3mf(content: bytes) -> list[MeshObject]:
    """Return all objects that a 3MF builds, at their places."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            models = _read_models(archive)
        root = next(name for name in (_MODEL_3MF, *models) if name in models)
        unit_m = _UNITS_3MF_M[models[root].attributes.get("unit", "millimeter")]
        objects = {
            (name, item.attributes["id"]): item
            for name, model in models.items()
            for resources in _iterate_children(model, "resources")
            for item in _iterate_children(resources, "object")
        }
        meshes: list[MeshObject] = []
        todo: list[tuple[tuple[str, str], tuple[str, ...], Floats]] = [
            (_find_3mf_key(item, root), (), _read_transform(item))
            for build in _iterate_children(models[root], "build")
            for item in _iterate_children(build, "item")
        ]
        placed = 0
        while todo:
            key, path, pose = todo.pop(0)
            placed += 1
            if placed > _MOST_PARTS_3MF:
                raise MeshFileError("It builds too many objects; keep the part alone.")
            item = objects[key]
            name = item.attributes.get("name", "")
            for mesh in _iterate_children(item, "mesh"):
                own, triangles = _read_3mf_mesh(mesh)
                corners = (own @ pose[:3] + pose[3]) * unit_m
                mirrored = np.linalg.det(pose[:3]) < 0
                faces = triangles[:, ::-1] if mirrored else triangles
                meshes.append(MeshObject(name, path, corners, faces))
            below = (*path, name)
            for components in _iterate_children(item, "components"):
                for component in _iterate_children(components, "component"):
                    own_pose = _read_transform(component)
                    joined = np.vstack([own_pose[:3] @ pose[:3], own_pose[3] @ pose[:3] + pose[3]])
                    todo.append((_find_3mf_key(component, key[0]), below, joined))
    except (KeyError, ValueError, StopIteration, zipfile.BadZipFile, XmlError, OSError):
        raise MeshFileError("It cannot be read as 3MF; save it again.") from None
    return meshes


def _read_models(archive: zipfile.ZipFile) -> dict[str, Element]:
    """Return the models of a 3MF by name; printers' programs keep objects in models of their own.

    Source: 3MF Production Extension 1.1.2, section 2.2.
    """
    models = {}
    left = _MOST_MODEL_BYTES
    for name in archive.namelist():
        if not name.lower().endswith(".model"):
            continue
        with archive.open(name) as stream:
            text = stream.read(left + 1)
        left -= len(text)
        if left < 0:
            raise MeshFileError("Its model is too large once unpacked; simplify it.")
        models[name] = parse_xml(text, "simplify it")
    return models


def _find_3mf_key(element: Element, model: str) -> tuple[str, str]:
    """Return the model and number of the object that an item or component refers to."""
    paths = (value for key, value in element.attributes.items() if key.rpartition(":")[2] == "path")
    return next(paths, model).removeprefix("/"), element.attributes["objectid"]


def _iterate_children(element: Element, tag: str) -> Iterator[Element]:
    """Yield the children with a tag in any name space."""
    return (child for child in element.children if child.tag.rpartition(":")[2] == tag)


def _read_transform(element: Element) -> Floats:
    """Return the matrix of an item or component, shape (4, 3); corners are rows."""
    text = element.attributes.get("transform", "1 0 0 0 1 0 0 0 1 0 0 0")
    return np.array([float(value) for value in text.split()]).reshape(4, 3)


def _read_3mf_mesh(mesh: Element) -> tuple[Floats, Indices]:
    (vertices,) = _iterate_children(mesh, "vertices")
    (triangles,) = _iterate_children(mesh, "triangles")
    corners = [
        [float(vertex.attributes[axis]) for axis in "xyz"]
        for vertex in _iterate_children(vertices, "vertex")
    ]
    faces = [
        [int(triangle.attributes[corner]) for corner in ("v1", "v2", "v3")]
        for triangle in _iterate_children(triangles, "triangle")
    ]
    numbers = np.array(faces, dtype=np.int64).reshape(-1, 3)
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < len(corners):
        raise ValueError("a triangle has a corner that is missing")
    return np.array(corners).reshape(-1, 3), numbers


def _check_size(size: Floats, scale: float) -> None:
    longest_m = float(size.max())
    if not longest_m <= _MOST_EXTENT_M:
        hint = ""
        if longest_m * 1e-3 <= _MOST_EXTENT_M:
            hint = f" Is the file in millimetres? Then give scale: {scale * 1e-3:g}."
        raise MeshFileError(
            f"It is {longest_m:g} m long, where {_MOST_EXTENT_M:g} m are the most.{hint}", "scale"
        )
    shortest_m = float(size.min())
    if shortest_m < LEAST_EXTENT_M:
        if longest_m < LEAST_EXTENT_M:
            message = f"It is {longest_m:g} m long, where {LEAST_EXTENT_M:g} m are the least."
            raise MeshFileError(message, "scale")
        axis = "xyz"[int(size.argmin())]
        raise MeshFileError(f"It is flat: {shortest_m:g} m along {axis}; give it a thickness.")


MAX_PIECES = 1024
"""Greatest number of convex pieces of a polyhedron."""

# Tolerance of the bounding box of the pieces, as a share of the greatest extent. Pieces with play
# may be smaller, by a length [m] or a share.
_PIECES_OFF, _PIECES_SHORT_M, _PIECES_SHORT = 1e-3, 5e-4, 0.1


def read_pieces(
    folder: Path, name: str | None, scale: float, whole: Polyhedron
) -> tuple[tuple[Polyhedron, ...], str]:
    """Return the convex pieces of a polyhedron about its centre, and the hash of their file.

    Parameters
    ----------
    folder, name, scale
        See `read_mesh`; the result is empty without a name. Connected faces form a piece.

    Raises
    ------
    MeshFileError
        If the file is elsewhere, unreadable, contains a piece that is open or concave, contains
        more
        than `MAX_PIECES`, or if the pieces do not fill the bounding box of the whole.
    """
    if name is None:
        return (), ""
    try:
        content, suffix = read_content(folder, name)
    except MeshFileError as error:
        raise MeshFileError(str(error), "pieces") from None
    return _parse_pieces(content, suffix, scale, whole.middle, whole.size)


# Identical parts have files with the same content, and an import loads a task many times.
@lru_cache(maxsize=128)
def _parse_pieces(
    content: bytes, suffix: str, scale: float, middle: Point, size: Point
) -> tuple[tuple[Polyhedron, ...], str]:
    raw_corners, raw_faces = parse_mesh(content, suffix)
    corners = np.round(raw_corners * scale - np.array(middle), DECIMALS) + 0.0
    groups = _split_components(raw_faces, len(corners))
    if not 0 < len(groups) <= MAX_PIECES:
        raise MeshFileError(f"It holds {len(groups):,} pieces; give 1 to {MAX_PIECES:,}.", "pieces")
    pieces = []
    for number, faces in enumerate(groups, 1):
        # Corners of all pieces would be sorted for every piece.
        used, own_faces = np.unique(faces, return_inverse=True)
        try:
            piece = build_polyhedron(corners[used], own_faces.reshape(-1, 3), "", is_connected=True)
        except MeshFileError as error:
            raise MeshFileError(f"Piece {number}: {error}", "pieces") from None
        if not piece.convex:
            raise MeshFileError(f"Piece {number} is not convex; cut it further.", "pieces")
        pieces.append(piece)
    points = np.concatenate([piece.corners for piece in pieces])
    half, short_m = np.array(size) / 2, min(_PIECES_SHORT_M, _PIECES_SHORT * max(size))
    beyond = np.concatenate([points.max(axis=0) - half, -half - points.min(axis=0)])
    off = float(np.where(beyond < 0, np.maximum(-beyond - short_m, 0.0), beyond).max())
    if off > _PIECES_OFF * max(size):
        raise MeshFileError(
            f"The box about all pieces is {off * 1e3:.3g} mm off that about the mesh; give pieces "
            "of this mesh, in its frame.",
            "pieces",
        )
    return tuple(pieces), hashlib.sha256(content).hexdigest()


def _split_components(faces: Indices, count: int) -> list[Indices]:
    """Return the faces of each connected body, in the order of the file."""
    labels = label_connected(faces, count)[faces[:, 0]]
    _, first = np.unique(labels, return_index=True)
    return [faces[labels == labels[index]] for index in np.sort(first)]


def label_connected(groups: Indices, count: int) -> Indices:
    """Return a label of each number below `count`, the same for all that groups connect.

    Parameters
    ----------
    groups
        Numbers that are connected, shape (groups, numbers in a group).
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    others = groups[:, 1:].reshape(-1)
    first = np.repeat(groups[:, 0], groups.shape[1] - 1)
    graph = coo_matrix((np.ones(len(others)), (first, others)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
