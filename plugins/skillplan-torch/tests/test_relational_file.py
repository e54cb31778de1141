"""Policies that carry over as files: what is read is what was written; damage is named."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from skillplan.errors import OptionError
from skillplan.records import is_relational, write_relational
from skillplan.training import read_policy
from skillplan_torch import NetworkSize, RelationalNetwork

SIZE = NetworkSize(width=8, heads=2, layers=1, pair_width=4)


def a_network() -> RelationalNetwork:
    chance = np.random.Generator(np.random.PCG64(0))
    shapes = SIZE.shapes().items()
    arrays = {name: chance.normal(size=shape).astype(np.float32) for name, shape in shapes}
    return RelationalNetwork(SIZE, arrays)


@pytest.fixture
def stored(tmp_path):
    content: dict[str, Any] = {
        "solver": "relational",
        "options": {"boards": 3},
        "family": "generated:3-5",
        "boards": 3,
        "seed": 1,
        "trace": {"states": 12},
        "trial": None,
        "wall_s": 1.5,
    }
    write_relational(tmp_path, a_network(), **content)
    return tmp_path


def test_what_is_read_is_what_was_written(stored):
    policy = read_policy(stored)
    assert is_relational(str(stored))
    assert SIZE.width == policy.policy.dimensions["width"]
    assert policy.content.family == "generated:3-5"
    for name, array in a_network().arrays.items():
        assert np.array_equal(array, policy.policy.weights[name])


def test_another_folder_is_none(tmp_path):
    assert not is_relational(str(tmp_path))


def test_weights_that_were_changed_are_named(stored):
    path = stored / "relational.safetensors"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(OptionError, match=r"safetensors: is damaged: its hash is not the one in"):
        read_policy(stored)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("element_features", ["another"], "has other features"),
        ("boards", 0, "is damaged"),
        ("size", {"width": 16, "heads": 2, "layers": 1, "pair_width": 4}, "is damaged"),
    ],
)
def test_a_document_that_was_changed_is_named(stored, key, value, message):
    path = stored / "relational.json"
    document = json.loads(path.read_text("utf-8"))
    path.write_text(json.dumps({**document, key: value}), "utf-8")
    with pytest.raises(OptionError, match=message):
        read_policy(stored)


def test_missing_weights_are_named(stored):
    (stored / "relational.safetensors").unlink()
    with pytest.raises(OptionError, match="cannot be read"):
        read_policy(stored)
