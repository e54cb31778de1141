"""A product as bytes and back, so that it need not be read again."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load, save

from skillplan_cad.product import Face, Part, Product


def product_bytes(product: Product) -> bytes:
    """Return a product as arrays and one document, without any object."""
    tensors: dict[str, NDArray[Any]] = {}
    parts = []
    for number, part in enumerate(product.parts):
        tensors[f"{number}.vertices"] = np.ascontiguousarray(part.vertices_m)
        tensors[f"{number}.triangles"] = np.ascontiguousarray(part.triangles)
        of_face = [face.triangles for face in part.faces]
        joined = np.concatenate(of_face) if of_face else np.zeros(0, dtype=np.int64)
        tensors[f"{number}.faces"] = np.ascontiguousarray(joined, dtype=np.int64)
        faces = []
        for face in part.faces:
            about = {name: value for name, value in asdict(face).items() if name != "triangles"}
            faces.append({**about, "count": len(face.triangles)})
        parts.append(
            {
                "name": part.name,
                "path": part.path,
                "volume_m3": part.volume_m3,
                "density_kg_m3": part.density_kg_m3,
                "centre_m": part.centre_m,
                "shape": part.shape,
                "mirrors": part.mirrors,
                "bodies": part.bodies,
                "design": part.design,
                "faces": faces,
            }
        )
    about = {
        "name": product.name,
        "unit": product.unit,
        "chord_m": product.chord_m,
        "notes": product.notes,
        "parts": parts,
    }
    tensors["about"] = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    return bytes(save(tensors))


def product_of(content: bytes) -> Product:
    """Return the product that `product_bytes` wrote.

    Raises
    ------
    ValueError
        If it is no such content.
    """
    tensors = load(content)
    about = json.loads(tensors["about"].tobytes())
    parts = []
    for number, one in enumerate(about["parts"]):
        joined, start, faces = tensors[f"{number}.faces"], 0, []
        for face in one.pop("faces"):
            count = face.pop("count")
            for name in ("origin_m", "axis", "extent_m"):
                face[name] = tuple(face[name])
            faces.append(Face(triangles=joined[start : start + count], **face))
            start += count
        one["path"], one["centre_m"] = tuple(one["path"]), tuple(one["centre_m"])
        parts.append(
            Part(
                vertices_m=tensors[f"{number}.vertices"],
                triangles=tensors[f"{number}.triangles"],
                faces=tuple(faces),
                **one,
            )
        )
    return Product(
        about["name"], tuple(parts), about["unit"], about["chord_m"], tuple(about["notes"])
    )
