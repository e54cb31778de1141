"""Every key of every kind of task file is described, with its unit, and with what its default is.

The reference of keys is generated from these descriptions.
"""

from collections.abc import Iterator
from typing import Any

import pytest

from skillplan.pipeline import registry

KINDS = ("assembly", "sop", "swarmitfix")
# Of the last word of a key's name.
UNITS = {"m": "[m]", "s": "[s]", "kg": "[kg]", "rad": "[rad]", "deg": "[deg]"}
# Figures that only the project's tests read.
FIGURES = ("ExpectConfig", "BenchExpectConfig")


def keys_of(kind: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield the model, the name and the schema of every key."""
    schema = registry.load("domain", kind).Config.model_json_schema(by_alias=True)
    models = {kind: schema, **schema.get("$defs", {})}
    for model, definition in models.items():
        for key, entry in definition.get("properties", {}).items():
            yield model, key, entry


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_is_described(kind):
    """In words that begin small, as they go on in a message."""
    bare = [
        f"{model}.{key}"
        for model, key, entry in keys_of(kind)
        if not entry.get("description") or entry["description"][-1] == "."
    ]
    assert bare == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_key_with_a_unit_in_its_name_has_it_in_its_description(kind):
    """In brackets, as in the headings of tables."""
    without = [
        f"{model}.{key}"
        for model, key, entry in keys_of(kind)
        if (unit := UNITS.get(key.rpartition("_")[2])) and "_per_" not in key
        if unit not in entry["description"]
    ]
    assert without == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_key_that_may_be_left_out_says_what_then(kind):
    """Where its default is no value of its own."""
    words = ("; left out: ", "; instead of ", "; or one of ")
    silent = [
        f"{model}.{key}"
        for model, key, entry in keys_of(kind)
        if model not in FIGURES and "default" in entry and entry["default"] in (None, {}, [])
        if not any(word in entry["description"] for word in words)
    ]
    assert silent == []
