"""The TSPLIB instances of sequential ordering that tests read, and files made from matrices."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

from skillplan.domains import Problem
from skillplan.pipeline import load_problem

FOLDER = Path(__file__).parents[1] / "instances" / "sop"

with (FOLDER / "best_known.csv").open(encoding="utf-8") as _file:
    BEST_KNOWN = {row["name"]: row for row in csv.DictReader(_file)}
"""By instance: ``n``, ``best_known`` and ``lower_bound``, as texts."""


@cache
def instance(name: str) -> Problem:
    """Return an instance by its file's name, such as ``br17.10``."""
    return load_problem(FOLDER / f"{name}.sop")


def instance_text(name: str) -> str:
    """Return what an instance's file holds."""
    return (FOLDER / f"{name}.sop").read_text("utf-8")


def tsplib_text(costs: list[list[int]], *, header: bool = True, dimension: bool = True) -> str:
    """Return the text of a matrix, with or without a header and the dimension before it."""
    lines = [" ".join(map(str, row)) for row in costs]
    if dimension:
        lines.insert(0, str(len(costs)))
    if not header:
        return "\n".join(lines) + "\n"
    keywords = {
        "TYPE": "SOP",
        "DIMENSION": len(costs),
        "EDGE_WEIGHT_TYPE": "EXPLICIT",
        "EDGE_WEIGHT_FORMAT": "FULL_MATRIX",
    }
    above = [f"{key}: {value}" for key, value in keywords.items()]
    return "\n".join([*above, "EDGE_WEIGHT_SECTION", *lines, "EOF"]) + "\n"
