"""Networks as files: what is read is what was written, and nothing else is ever trusted."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save

from skillplan.env import Observation
from skillplan.errors import OptionError
from skillplan.records import read_network, write_network
from skillplan.solvers import NetworkPolicy
from skillplan.task import Task

CHANCE = np.random.Generator(np.random.PCG64(0))


def a_network(*widths: int) -> NetworkPolicy:
    layers = list(pairwise(widths))
    return NetworkPolicy(
        tuple(CHANCE.normal(size=layer).astype(np.float32) for layer in layers),
        tuple(CHANCE.normal(size=layer[1]).astype(np.float32) for layer in layers),
    )


def content_for(task: Task, **changes: Any) -> dict[str, Any]:
    content = {
        "features": list(Observation.of(task, "markov").features),
        "actions": [skill.name for skill in task.skills],
        "observation": "markov",
        "mask": "applicable",
        "objective": "reward",
        "solver": "dqn",
        "options": {"steps": 20_000},
        "task": {"name": task.name, "kind": task.kind, "sha256": "0", "fingerprint": "1"},
        "seed": 4,
        "step": 1_200,
        "cost": 1.88,
        "kept": "best",
    }
    return {**content, **changes}


@pytest.fixture
def stored(board_task, tmp_path):
    """The JSON file of a policy for the board."""
    width = Observation.of(board_task, "markov").width
    network = a_network(width, 8, len(board_task.skills))
    write_network(tmp_path, "policy", network, **content_for(board_task))
    return tmp_path / "policy.json"


def test_what_is_read_acts_as_what_was_written(board_task, tmp_path):
    width = Observation.of(board_task, "markov").width
    network = a_network(width, 8, 8, len(board_task.skills))
    write_network(tmp_path, "last", network, **content_for(board_task, kept="last", cost=None))
    result = read_network(tmp_path / "last.json")
    observations = CHANCE.normal(size=(5, width)).astype(np.float32)
    assert np.array_equal(network.scores(observations), result.network.scores(observations))
    assert ("last", 1_200, None) == (result.kept, result.content.step, result.content.cost)
    assert [(width, 8), (8, 8), (8, len(board_task.skills))] == result.content.layers
    assert result.misfit(board_task, Observation.of(board_task, "markov")) is None


def test_it_does_not_fit_a_task_with_other_actions_or_features(board_task, lid_task, stored):
    network = read_network(stored)
    other = network.misfit(lid_task, Observation.of(lid_task, "markov"))
    assert other == "it was learned on other actions: pick(pcb) where the task has pick(box)"
    narrow = network.misfit(board_task, Observation.of(board_task, "paper"))
    assert narrow == "it was learned on 34 features, not 17"


def test_files_are_json_and_safetensors_and_hold_no_pickle(stored):
    document = json.loads(stored.read_text())
    assert "skillplan.network-policy/1" == document["schema"]
    data = stored.with_suffix(".safetensors").read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    assert {"weight_0", "bias_0", "weight_1", "bias_1"} == set(header)
    assert {"F32"} == {item["dtype"] for item in header.values()}


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.999])
@pytest.mark.parametrize("suffix", [".json", ".safetensors"])
def test_a_file_that_is_cut_is_one_clear_error(stored, suffix, share):
    path = stored.with_suffix(suffix)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(OptionError) as caught:
        read_network(stored)
    assert str(caught.value).startswith(f"{path}: is ")
    assert str(caught.value).endswith("Train again, or go on with --resume, which writes it again.")


def test_any_other_bytes_in_the_weights_are_noticed(stored):
    path = stored.with_suffix(".safetensors")
    content = path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(OptionError, match=r"its hash is not the one in"):
        read_network(stored)


def test_a_missing_file_is_named(stored):
    stored.with_suffix(".safetensors").unlink()
    with pytest.raises(OptionError, match="safetensors: cannot be read: No such file"):
        read_network(stored)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("schema", "skillplan.network-policy/2", "is of another version"),
        ("schema", "skillplan.policy/1", "is no document skillplan.network-policy/1"),
        ("seed", -1, "seed"),
        ("step", "1200", "step"),
        ("kept", "worst", "kept"),
        ("layers", [], "layers"),
        ("layers", [[34, 9], [9, 16]], "its layers have other sizes"),
        ("layers", [[34, 16]], "it holds 4 arrays, not 2"),
        ("features", ["a"], "does not fit the features or actions"),
        ("surplus", 1, "surplus"),
    ],
)
def test_a_value_that_makes_no_sense_is_named(stored, key, value, message):
    document = json.loads(stored.read_text())
    stored.write_text(json.dumps({**document, key: value}))
    with pytest.raises(OptionError) as caught:
        read_network(stored)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda arrays: {**arrays, "bias_1": arrays["bias_1"] * np.nan}, "must be finite"),
        (lambda arrays: {**arrays, "bias_1": arrays["bias_1"].astype("f8")}, "not float32"),
        (lambda arrays: {**arrays, "bias_1": arrays["bias_1"][:-1]}, "do not fit each other"),
        (
            lambda arrays: (
                {k: v for k, v in arrays.items() if k != "bias_1"} | {"x": arrays["bias_1"]}
            ),
            "has no 'bias_1'",
        ),
    ],
)
def test_weights_that_make_no_sense_are_refused_even_where_their_hash_is_right(
    stored, change, message
):
    import hashlib

    from safetensors.numpy import load

    path = stored.with_suffix(".safetensors")
    data = save(change({name: np.array(item) for name, item in load(path.read_bytes()).items()}))
    path.write_bytes(data)
    document = json.loads(stored.read_text())
    stored.write_text(json.dumps({**document, "sha256": hashlib.sha256(data).hexdigest()}))
    with pytest.raises(OptionError) as caught:
        read_network(stored)
    assert message in str(caught.value)
