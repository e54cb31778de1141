"""The meshes of a binary glTF that cascadio made of a STEP file, with the faces of CAD."""

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

# Characters of a part's name and those of the assemblies above it.
MOST_PATH = 10_000
NOT_FINITE = "has coordinates that are no finite numbers"

_HEADER_BYTES, _CHUNK_HEAD_BYTES = 12, 8
_TYPES = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_COUNTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
# What exporters write where an instance has no name.
_LABEL = re.compile(r"(NAUO|nauo)?\d*|=>\[[\d:]*\]|NEXT_ASSEMBLY_USAGE_OCCURRENCE\d*")
_FACES = "TM_brep_faces"
_KINDS: tuple[FaceKind, ...] = ("plane", "cylinder", "cone", "sphere", "torus")


def parts_of(content: bytes) -> tuple[str, list[RawPart]]:
    """Return the name of the root and the meshes in the order of the tree.

    Raises
    ------
    ValueError
        If the content is no binary glTF, has a number that is not finite, more than `MOST_PARTS`
        parts, or a path longer than `MOST_PATH`. The message is a clause without subject.
    """
    document, data = _chunks(content)
    roots = document["scenes"][document.get("scene", 0)].get("nodes", [])
    parts: list[RawPart] = []
    for node in _placed_meshes(document, roots):
        part = _part(document, data, node)
        if part is not None:
            parts.append(part)
        if len(parts) > MOST_PARTS:
            raise ValueError(f"holds more than {MOST_PARTS:,} parts")
    names = [document["nodes"][root].get("name", "") for root in roots]
    return (names[0] if len(names) == 1 else ""), parts


def _chunks(content: bytes) -> tuple[dict[str, Any], bytes]:
    if content[:4] != b"glTF":
        raise ValueError("is read by OCCT as something that is no product")
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
        # JSON has no word for them, and OCCT writes them all the same.
        raise ValueError(NOT_FINITE) from None
    return document, chunks.get(b"BIN\0", b"")


@dataclass(frozen=True, slots=True, eq=False)
class _PlacedMesh:
    """A node of the tree with a mesh: its number, pose in the product's frame, name and path."""

    mesh: int
    pose: NDArray[np.float64]
    name: str
    path: tuple[str, ...]


def _placed_meshes(document: Mapping[str, Any], roots: Sequence[int]) -> Iterator[_PlacedMesh]:
    """Yield the meshes of a tree from its roots on, in order."""
    nodes, taken = document["nodes"], set[str]()
    named = [(root, _numbered(document, root, taken)) for root in roots]
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
        pose = above @ _pose(node)
        if "mesh" in node:
            yield _PlacedMesh(node["mesh"], pose, name, path)
        taken = set()
        below = (*path, name)
        children = [(one, _numbered(document, one, taken)) for one in node.get("children", ())]
        todo += [
            (child, pose, below, own, length + 1 + len(own)) for child, own in reversed(children)
        ]


def _numbered(document: Mapping[str, Any], number_of: int, taken: set[str]) -> str:
    """Return the name of a node, numbered where a sibling before it has the same one.

    Where the file has no name for an instance but a label that counts, its design names it.
    """
    node = document["nodes"][number_of]
    name = str(node.get("name", ""))
    if "mesh" in node and _LABEL.fullmatch(name):
        name = str(document["meshes"][node["mesh"]].get("name", "")) or name
    wanted = name
    number = 1
    while name in taken:
        number += 1
        name = f"{wanted}#{number}"
    taken.add(name)
    return name


def _pose(node: Mapping[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        pose = np.asarray(node["matrix"], dtype=np.float64).reshape(4, 4).T.copy()
        # It is rounded to single precision, which would shear a large part.
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


def _part(document: Mapping[str, Any], data: bytes, node: _PlacedMesh) -> RawPart | None:
    pose, mesh = node.pose, document["meshes"][node.mesh]
    vertices, triangles, faces = [], [], []
    so_far, triangles_so_far = 0, 0
    for primitive in mesh["primitives"]:
        if primitive.get("mode", 4) != 4:
            continue
        points = _array(document, data, primitive["attributes"]["POSITION"]).astype(np.float64)
        if "indices" in primitive:
            corners = _array(document, data, primitive["indices"]).astype(np.int64).reshape(-1, 3)
        else:
            corners = np.arange(len(points)).reshape(-1, 3)
        vertices.append(points)
        triangles.append(corners + so_far)
        extension = primitive.get("extensions", {}).get(_FACES)
        if extension is not None:
            of_triangle = _array(document, data, extension["faceIndices"]).astype(np.int64)
            faces += _faces(extension["faces"], of_triangle, triangles_so_far, pose)
        so_far += len(points)
        triangles_so_far += len(corners)
    if not triangles_so_far:
        return None
    with np.errstate(all="ignore"):
        placed = np.concatenate(vertices) @ pose[:3, :3].T + pose[:3, 3]
    if not np.isfinite(placed).all():
        raise ValueError(NOT_FINITE)
    design, name = str(mesh.get("name", "")), node.name
    corners = np.concatenate(triangles)
    return RawPart(name or design, node.path, placed, corners, tuple(faces), design)


def _faces(
    described: list[Mapping[str, Any] | None],
    of_triangle: NDArray[np.int64],
    first: int,
    pose: NDArray[np.float64],
) -> list[Face]:
    about = {one["face_index"]: one for one in described if one is not None}
    order = np.argsort(of_triangle, kind="stable")
    numbers, starts = np.unique(of_triangle[order], return_index=True)
    return [
        _face(about.get(int(number), {}), triangles + first, pose)
        for number, triangles in zip(numbers, np.split(order, starts[1:]), strict=True)
    ]


def _face(
    about: Mapping[str, Any], triangles: NDArray[np.int64], pose: NDArray[np.float64]
) -> Face:
    kind = about.get("type")
    if kind not in _KINDS:
        return Face("free", triangles)
    turn, move = pose[:3, :3], pose[:3, 3]
    origin = next((about[one] for one in ("origin", "center", "apex") if one in about), (0, 0, 0))
    axis = turn @ np.asarray(about.get("normal", about.get("axis", (0.0, 0.0, 1.0))))
    # A cone's distances run along its side.
    half_angle = float(about.get("semi_angle", 0.0))
    along = about.get("extent_height", about.get("extent_distance", (0.0, 0.0)))
    scale = np.cos(half_angle) if kind == "cone" else 1.0
    round_axis = about.get("extent_angle", about.get("extent_u", (0.0, 2 * np.pi)))
    return Face(
        kind,
        triangles,
        _vector(turn @ np.asarray(origin) + move),
        _vector(axis / np.linalg.norm(axis)),
        float(about.get("radius", about.get("major_radius", about.get("ref_radius", 0.0)))),
        float(about.get("minor_radius", 0.0)),
        half_angle,
        (float(along[0]) * float(scale), float(along[1]) * float(scale)),
        0.0 if kind == "plane" else float(abs(round_axis[1] - round_axis[0])),
    )


def _array(document: Mapping[str, Any], data: bytes, number: int) -> NDArray[Any]:
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
    x, y, z = (float(one) for one in numbers)
    return x, y, z
