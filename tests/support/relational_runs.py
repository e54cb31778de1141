"""A policy that carries over without having been learned: it goes to what is nearest."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from skillplan.records import write_relational
from skillplan_torch import ELEMENT_FEATURES, NetworkSize, RelationalNetwork

SIZE = NetworkSize(width=4, heads=1, layers=1, pair_width=1)
# Beside it, what is counted is small, so that the normalisation of rows keeps its order.
_CONSTANT = 1000.0


def nearest_first() -> RelationalNetwork:
    """Return a network that does what nothing must come before, with few tool changes."""
    arrays = {name: np.zeros(shape, dtype=np.float32) for name, shape in SIZE.shapes().items()}
    weights = {
        "by how much it costs more to come to than the cheapest": 1.0,
        "something must come before it that is not done": 100.0,
    }
    for feature, weight in weights.items():
        arrays["enter.weight"][ELEMENT_FEATURES.index(feature), 0] = weight
    arrays["enter.bias"][:] = (10.0, 0.0, 0.0, _CONSTANT)
    arrays["score.weight"][:] = np.eye(4)
    arrays["score.last"][0] = -1.0
    return RelationalNetwork(SIZE, arrays)


def nearest_first_run(folder: Path) -> Path:
    """Return the folder of such a policy."""
    folder.mkdir()
    write_relational(
        folder,
        nearest_first(),
        solver="relational",
        options={},
        family="generated:3-5",
        boards=1,
        seed=0,
        trace={},
        trial=None,
        wall_s=0.0,
    )
    return folder
