"""Read the meshes and CAD faces of the binary glTF that cascadio creates from STEP."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Face, FaceKind, Vector
from skillplan_cad.reading.raw_part import MOST_PARTS, RawPart

# Largest number of characters in a part's path.
MOST_PATH = 10_000
NOT_FINITE = "has coordinates that are not finite"

_HEADER_BYTES, _CHUNK_HEAD_BYTES = 12, 8
_TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
# Labels that exporters give to instances without a name.
_LABEL = re.compile(r"(NAUO|nauo)?\d*|=>\[[\d:]*\]|NEXT_ASSEMBLY_USAGE_OCCURRENCE\d*")
_FACES = "TM_brep_faces"
_KINDS: tuple[FaceKind, ...] = ("plane", "cylinder", "cone", "sphere", "torus")


def read_parts(content: bytes) -> tuple[str, list[RawPart]]:
    """Return the name of the root, and the meshes in the order of the tree.

    Raises
    ------
    ValueError
        If the content is not binary glTF, has numbers that are not finite, more than `MOST_PARTS`
        parts, or a path longer than `MOST_PATH`. The message is a clause without subject.
    """
    document, data = _split_chunks(content)
    roots = document["scenes"][document.get("scene", 0)].get("nodes", [])
    parts: list[RawPart] = []
    for node in _iterate_placed_meshes(document, roots):
        part = _read_part(document, data, node)
        if part is not None:
            parts.append(part)
        if len(parts) > MOST_PARTS:
            raise ValueError(f"holds more than {MOST_PARTS:,} parts")
    names = [document["nodes"][root].get("name", "") for root in roots]
    return (names[0] if len(names) == 1 else ""), parts


def _split_chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    if content[:4] != b"glTF":
        raise ValueError("is not read as a product by OCCT")
    chunks: dict[bytes, bytes] = {}
    at = _HEADER_BYTES
    while at + _CHUNK_HEAD_BYTES <= len(content):
        size, kind = struct.unpack_from("<I4s", content, at)
        at += _CHUNK_HEAD_BYTES
        chunks.setdefault(kind, content[at : at + size])
        at += size
    try:
        document = json.loads(chunks[b"JSON"])
    except ValueError:
        # OCCT writes non-finite numbers, which JSON lacks.
        raise ValueError(NOT_FINITE) from None
    return document, chunks.get(b"BIN\0", b"")


@dataclass(frozen=True, slots=True, eq=False)
class _PlacedMesh:
    """A node with a mesh: number, pose in the product's frame, name and path."""

    mesh: int
    pose: NDArray[np.float64]
    name: str
    path: tuple[str, ...]


def _iterate_placed_meshes(
    document: Mapping[str, Any], roots: Sequence[int]
) -> Iterator[_PlacedMesh]:
    """Yield the meshes of a tree from its roots, in order."""
    nodes, taken = document["nodes"], set[str]()
    named = [(root, _choose_name(document, root, taken)) for root in roots]
    todo: list[tuple[int, NDArray[np.float64], tuple[str, ...], str, int]] = [
        (root, np.eye(4), (), name, len(name)) for root, name in reversed(named)
    ]
    while todo:
        number, above, path, name, length = todo.pop()
        if length > MOST_PATH:
            raise ValueError(
                f"has a part {len(path)} assemblies deep, whose names have more than "
                f"{MOST_PATH:,} characters"
            )
        node = nodes[number]
        pose = above @ _read_pose(node)
        if "mesh" in node:
            yield _PlacedMesh(node["mesh"], pose, name, path)
        taken = set()
        below = (*path, name)
        children = [
            (child, _choose_name(document, child, taken)) for child in node.get("children", ())
        ]
        todo += [
            (child, pose, below, own, length + 1 + len(own)) for child, own in reversed(children)
        ]


def _choose_name(document: Mapping[str, Any], node_number: int, taken: set[str]) -> str:
    """Return the name of a node, numbered if a sibling before it has the same name.

    Instances with a mere counting label get the name of their design.
    """
    node = document["nodes"][node_number]
    name = str(node.get("name", ""))
    if "mesh" in node and _LABEL.fullmatch(name):
        name = str(document["meshes"][node["mesh"]].get("name", "")) or name
    stem = name
    number = 1
    while name in taken:
        number += 1
        name = f"{stem}#{number}"
    taken.add(name)
    return name


def _read_pose(node: Mapping[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        pose = np.asarray(node["matrix"], dtype=np.float64).reshape(4, 4).T.copy()
        # Undo rounding to single precision, which would shear a large part.
        left, _, right = np.linalg.svd(pose[:3, :3])
        if np.abs(left @ right - pose[:3, :3]).max() < 1e-5:
            pose[:3, :3] = left @ right
        return pose
    pose = np.eye(4)
    if "rotation" in node:
        x, y, z, w = node["rotation"] / np.linalg.norm(node["rotation"])
        pose[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    pose[:3, :3] *= np.asarray(node.get("scale", (1.0, 1.0, 1.0)))
    pose[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return pose


def _read_part(document: Mapping[str, Any], data: bytes, node: _PlacedMesh) -> RawPart | None:
    pose, mesh = node.pose, document["meshes"][node.mesh]
    vertices, triangles, faces = [], [], []
    points_before, triangles_before = 0, 0
    for primitive in mesh["primitives"]:
        if primitive.get("mode", 4) != 4:
            continue
        points = _read_array(document, data, primitive["attributes"]["POSITION"]).astype(np.float64)
        if "indices" in primitive:
            corners = (
                _read_array(document, data, primitive["indices"]).astype(np.int64).reshape(-1, 3)
            )
        else:
            corners = np.arange(len(points)).reshape(-1, 3)
        vertices.append(points)
        triangles.append(corners + points_before)
        extension = primitive.get("extensions", {}).get(_FACES)
        if extension is not None:
            of_triangle = _read_array(document, data, extension["faceIndices"]).astype(np.int64)
            faces += _read_faces(extension["faces"], of_triangle, triangles_before, pose)
        points_before += len(points)
        triangles_before += len(corners)
    if not triangles_before:
        return None
    with np.errstate(all="ignore"):
        placed = np.concatenate(vertices) @ pose[:3, :3].T + pose[:3, 3]
    if not np.isfinite(placed).all():
        raise ValueError(NOT_FINITE)
    design, name = str(mesh.get("name", "")), node.name
    corners = np.concatenate(triangles)
    return RawPart(name or design, node.path, placed, corners, tuple(faces), design)


def _read_faces(
    described: list[Mapping[str, Any] | None],
    of_triangle: NDArray[np.int64],
    first: int,
    pose: NDArray[np.float64],
) -> list[Face]:
    about = {
        description["face_index"]: description
        for description in described
        if description is not None
    }
    order = np.argsort(of_triangle, kind="stable")
    numbers, starts = np.unique(of_triangle[order], return_index=True)
    return [
        _read_face(about.get(int(number), {}), triangles + first, pose)
        for number, triangles in zip(numbers, np.split(order, starts[1:]), strict=True)
    ]


def _read_face(
    fields: Mapping[str, Any], triangles: NDArray[np.int64], pose: NDArray[np.float64]
) -> Face:
    kind = fields.get("type")
    if kind not in _KINDS:
        return Face("free", triangles)
    turn, move = pose[:3, :3], pose[:3, 3]
    origin = next((fields[key] for key in ("origin", "center", "apex") if key in fields), (0, 0, 0))
    axis = turn @ np.asarray(fields.get("normal", fields.get("axis", (0.0, 0.0, 1.0))))
    # The distances of a cone are along its side.
    half_angle = float(fields.get("semi_angle", 0.0))
    along = fields.get("extent_height", fields.get("extent_distance", (0.0, 0.0)))
    scale = np.cos(half_angle) if kind == "cone" else 1.0
    round_axis = fields.get("extent_angle", fields.get("extent_u", (0.0, 2 * np.pi)))
    return Face(
        kind,
        triangles,
        _vector(turn @ np.asarray(origin) + move),
        _vector(axis / np.linalg.norm(axis)),
        float(fields.get("radius", fields.get("major_radius", fields.get("ref_radius", 0.0)))),
        float(fields.get("minor_radius", 0.0)),
        half_angle,
        (float(along[0]) * float(scale), float(along[1]) * float(scale)),
        0.0 if kind == "plane" else float(abs(round_axis[1] - round_axis[0])),
    )


def _read_array(document: Mapping[str, Any], data: bytes, number: int) -> NDArray[Any]:
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    kind, width = np.dtype(_TYPES[accessor["componentType"]]), _COUNTS[accessor["type"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count, stride = accessor["count"], view.get("byteStride", 0)
    if stride and stride != kind.itemsize * width:
        rows = np.frombuffer(data, np.uint8, (count - 1) * stride + kind.itemsize * width, start)
        picked = np.lib.stride_tricks.as_strided(
            rows, (count, kind.itemsize * width), (stride, 1)
        ).copy()
        values = picked.view(kind)
    else:
        values = np.frombuffer(data, kind, count * width, start)
    return values.reshape(count, width) if width > 1 else values.reshape(count)


def _vector(numbers: NDArray[np.float64]) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return x, y, z
