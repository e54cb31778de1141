"""What import-cad takes once a file is read: seconds a stage for 17, 41 and 129 parts, and memory.

Every product is a plate with copies of the tutorial's eight parts on it. Budgets of the project, on
one core and without reading: 17 parts 1 s, 40 parts 10 s, 130 parts 30 s, less than 2 GB.

Run from the repository, on one core: ``taskset -c 0 python benchmarks/cad.py [COPIES ...]``, by
default 2 5 16.
"""

from __future__ import annotations

import math
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from cad_fixtures import box, part_of, step_path
from skillplan_cad.build_relation import assemble_relation, find_blocked, find_joints
from skillplan_cad.importing.findings import Confirmation
from skillplan_cad.planning.assembly_plan import Planner
from skillplan_cad.planning.replay import replay
from skillplan_cad.product import Face, Part, Product, Vector
from skillplan_cad.reading.product_reader import ReadOptions, read_product
from skillplan_cad.writing.build_task import build_task

COPIES = (2, 5, 16)
TOLERANCE_M = 1e-4
STAGES = ("joints", "blocking", "confirming", "planning", "replaying", "writing")
# Between two copies, and beyond the outermost [mm].
APART_MM, EDGE_MM, THICK_MM = 20.0, 10.0, 10.0


def product_of(copies: int) -> Product:
    """Return a plate with so many copies of the eight parts on it."""
    one = read_product(step_path("eight"), ReadOptions())
    points = np.concatenate([part.vertices_m for part in one])
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    columns = math.ceil(math.sqrt(copies))
    rows = math.ceil(copies / columns)
    pitch = size[:2] + APART_MM / 1e3
    parts: list[Part] = []
    for number in range(copies):
        row, column = divmod(number, columns)
        shift = np.array([column * pitch[0], row * pitch[1], 0.0]) - low
        parts += [moved(part, shift, f"{part.name} {number + 1}") for part in one]
    far = 1e3 * np.array([columns * pitch[0], rows * pitch[1]])
    plate = part_of("plate", box(-EDGE_MM, -EDGE_MM, -THICK_MM, *far.tolist(), 0.0))
    shapes = max(part.shape for part in parts) + 1
    return replace(one, name=f"{copies} copies", parts=(replace(plate, shape=shapes), *parts))


def moved(part: Part, shift: np.ndarray, name: str) -> Part:
    """Return a part elsewhere, of another name."""

    def there(point: Vector) -> Vector:
        x, y, z = (np.asarray(point) + shift).tolist()
        return x, y, z

    def face(one: Face) -> Face:
        begin, end = one.extent_m
        return replace(one, origin_m=there(one.origin_m), extent_m=(begin, end))

    return replace(
        part,
        name=name,
        vertices_m=part.vertices_m + shift,
        centre_m=there(part.centre_m),
        faces=tuple(face(one) for one in part.faces),
    )


def stages_s(product: Product) -> tuple[dict[str, float], Any]:
    """Return the seconds of every stage, and the plan."""
    took: dict[str, float] = {}

    def timed(stage: str, make: Callable[[], Any]) -> Any:
        begin_s = time.perf_counter()
        made = make()
        took[stage] = time.perf_counter() - begin_s
        return made

    joints = timed("joints", lambda: find_joints(product, TOLERANCE_M, "axes", "unscrew"))
    directions = joints.directions
    blocked = timed("blocking", lambda: find_blocked(product, directions, TOLERANCE_M))
    touching = [one.parts for one in joints.contacts if one.kind != "thread"]
    confirmation = Confirmation(product, TOLERANCE_M)
    timed("confirming", lambda: confirmation.find_doubts(blocked.entries, touching, directions))
    relation = assemble_relation(product, joints, blocked, TOLERANCE_M, "unscrew")
    plan = timed("planning", lambda: Planner(product, relation, TOLERANCE_M).plan())
    timed("replaying", lambda: replay(product, relation, plan, TOLERANCE_M))
    timed("writing", lambda: build_task(product, relation, plan))
    return took, plan


def main(words: Sequence[str]) -> None:
    """Print a row a product."""
    print(f"{'parts':>5}" + "".join(f"{stage:>12}" for stage in (*STAGES, "all [s]", "GB")))
    stages_s(product_of(1))  # imports and kernels are not timed
    for copies in [int(word) for word in words] or COPIES:
        product = product_of(copies)
        took, plan = stages_s(product)
        assert plan.complete, "a part is stuck"
        gigabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
        figures = [*(took[stage] for stage in STAGES), sum(took.values()), gigabytes]
        print(f"{len(product):>5}" + "".join(f"{figure:12.2f}" for figure in figures), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
