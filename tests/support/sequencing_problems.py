"""Small sequencing problems that tests are made of, and where the benchmark lies."""

import math
import random
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from skillplan.model import SequencingProblem

SOP = Path(__file__).parents[1] / "instances" / "sop"


def problem_of(first, costs, precedence=frozenset(), lengths=None, step_limit=1_000):
    """Return a problem; `lengths` says how many skills lead from one job (-1: start) to another."""
    n = len(first)
    paths = {
        arc: tuple(f"change_{i}" for i in range(length)) for arc, length in (lengths or {}).items()
    }
    return SequencingProblem(
        jobs=tuple(f"job_{i}" for i in range(n)),
        skills=tuple((f"do_{i}",) for i in range(n)),
        first=np.array(first, dtype=float),
        costs=np.array(costs, dtype=float).reshape(n, n),
        precedence=frozenset(precedence),
        paths=paths,
        step_limit=step_limit,
    )


@st.composite
def random_problems(draw):
    """Draw a problem of 1 to 6 jobs, with costs in whole numbers or not, that has an order."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    n = draw(st.integers(1, 6))
    whole = draw(st.booleans())

    def cost():
        return float(rng.randrange(20)) if whole else rng.uniform(0, 2)

    order = rng.sample(range(n), n)
    density = draw(st.sampled_from([0.0, 0.2, 0.5]))
    precedence = {
        (node, other)
        for place, node in enumerate(order)
        for other in order[place + 1 :]
        if rng.random() < density
    }
    lengths = {(i, j): rng.randrange(3) for i in range(-1, n) for j in range(n) if i != j}
    costs = [[math.inf if i == j else cost() for j in range(n)] for i in range(n)]
    return problem_of([cost() for _ in range(n)], costs, precedence, lengths)
