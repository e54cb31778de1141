"""Fixtures as they are read, once each, and what is true of them."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import skillplan_cad as cad
from skillplan_cad.reading import step_file

FIXTURES = Path(__file__).parents[2] / "plugins/skillplan-cad/tests/fixtures"
AXES = ((1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0), (0, 0, 1.0), (0, 0, -1.0))
ALONG = {"+x": 0, "+y": 2, "+z": 4}


def file(name: str) -> Path:
    """Return the STEP file of a fixture."""
    (files,) = FIXTURES.glob(f"{name}.step*")
    return files


def truth(name: str) -> dict:
    """Return what is true of a fixture by construction."""
    return json.loads((FIXTURES / f"{name}.json").read_text("utf-8"))


def read_here(patch: pytest.MonkeyPatch) -> None:
    """Have OCCT read in this process: to start it takes ten times as long as to read a fixture."""
    patch.setattr(
        step_file, "read_in_process", lambda path, prepare, content, *_: prepare(content)(None)
    )


@cache
def product(name: str, chord_mm: float = 0.05) -> cad.Product:
    """Return a fixture as it is read."""
    with pytest.MonkeyPatch.context() as patch:
        read_here(patch)
        return cad.read_product(file(name), cad.ReadOptions(chord_m=chord_mm / 1000))


def related(product: cad.Product, tolerance_mm: float = 0.1, source="axes", threads="unscrew"):
    """Return the relation of a product."""
    joints = cad.find_joints(product, tolerance_mm / 1000, source, threads)
    blocked = cad.find_blocked(product, joints.directions, tolerance_mm / 1000)
    return cad.assemble_relation(product, joints, blocked, tolerance_mm / 1000, threads)


@cache
def relation(name: str, tolerance_mm: float = 0.1, chord_mm: float = 0.05):
    """Return the relation of a fixture along the axes of its file."""
    return related(product(name, chord_mm), tolerance_mm)


def moved(product: cad.Product, matrix) -> cad.Product:
    """Return a product whose parts are turned, or turned and mirrored, as one."""
    turn = np.asarray(matrix)
    parts = tuple(
        dataclasses.replace(
            part,
            vertices_m=part.vertices_m @ turn.T,
            centre_m=tuple(turn @ part.centre_m),
            faces=tuple(
                dataclasses.replace(
                    face, origin_m=tuple(turn @ face.origin_m), axis=tuple(turn @ face.axis)
                )
                for face in part.faces
            ),
        )
        for part in product.parts
    )
    return dataclasses.replace(product, parts=parts)


def links(expected, direction: int) -> set[tuple[str, str]]:
    """Return the pairs (part, by) that a relation has along a direction."""
    return {(link.part, link.by) for link in expected.blocked if link.direction == direction}


def true_links(name: str, axis: str) -> set[tuple[str, str]]:
    """Return the pairs that are blocked by construction along an axis."""
    return {(part, by) for part, all_by in truth(name)["blocked"][axis].items() for by in all_by}
