"""The bench in `skillplan benchmark`: its instances appear, and their optima are proved again."""

import pytest

from skillplan.benchmark import load_instances
from skillplan.pipeline import Setup, registry, solve

WALKS = {each.name: each for each in load_instances() if each.suite == "swarmitfix"}


def test_the_bench_adds_its_walks():
    """They come from the data of this distribution, and name who proved them."""
    text = registry.load("domain", "swarmitfix")().benchmark()
    assert text is not None
    assert all(f'"{name}"' in text for name in WALKS)
    assert {"swarmitfix"} == {each.kind for each in WALKS.values()}
    proofs = {name: walk.proof_text for name, walk in WALKS.items()}
    assert proofs["walk-C20-C1"] == "auto and fast-downward"
    assert proofs["swarmitfix_fleet"] == "one proof: auto"


@pytest.mark.parametrize("name", [name for name in WALKS if name.startswith("walk-")])
def test_a_walk_has_the_optimum_of_the_data(name):
    """A third solver agrees with the two codes."""
    task = WALKS[name].load()
    result = solve(task, "exact", Setup("kinematic"))
    assert ("optimal", WALKS[name].optimum) == (result.status, result.cost)
