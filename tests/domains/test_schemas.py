"""Every key of every kind of task file is described, with its unit, and with what its default is.

The reference of keys is generated from these descriptions.
"""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from skillplan.domains import Domain, Strict
from skillplan.errors import OptionError
from skillplan.files import parse
from skillplan.pipeline import load_problem, registry, solve, solve_chain

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


# Every kind of task has a starter: a commented file that is valid and is solved at once.


def starter_of(kind: str) -> str:
    return registry.load("domain", kind)().starter()


def schema_keys(kind: str) -> set[str]:
    schema = registry.load("domain", kind).Config.model_json_schema(by_alias=True)
    models = [schema, *schema.get("$defs", {}).values()]
    return {key for model in models for key in model.get("properties", {})}


@pytest.fixture(params=KINDS)
def starter(request, tmp_path):
    """The starter of a kind, as a file of the user's."""
    path = tmp_path / f"{request.param}{registry.load('domain', request.param).starter_suffix}"
    path.write_text(starter_of(request.param), "utf-8")
    return path


class TestAStarter:
    def test_is_valid_and_of_its_kind(self, starter):
        """Loading finds no fault, and another starter is of another kind."""
        assert load_problem(starter).kind == starter.stem

    def test_solves_to_a_proved_optimum(self, starter):
        """The only task, or every task of the chain that a solver plans, has a proof."""
        problem = load_problem(starter)
        if problem.is_chain:
            chain = solve_chain(problem, "exact")
            assert chain.complete
            statuses = {p.result.status.value for p in chain.parts if p.task.stage != "goals"}
        else:
            statuses = {solve(problem.task, "exact").status.value}
        assert statuses == {"optimal"}

    def test_begins_with_the_line_that_editors_look_for(self, starter):
        """And the second says how to get the schema that it names."""
        first, second, *_ = starter.read_text("utf-8").splitlines()
        assert first == f"# yaml-language-server: $schema={starter.stem}.schema.json"
        assert f"skillplan schema {starter.stem} > {starter.stem}.schema.json" in second

    def test_explains_every_key_where_it_first_stands(self, starter):
        """A comment on its line or on the one above; names of the user's own need none."""
        keys = schema_keys(starter.stem)
        message: set[str] = set()
        unexplained = []
        above = ""
        for line in starter.read_text("utf-8").splitlines():
            code, _, comment = line.partition("#")
            for key in re.findall(r"([a-z_]+):(?= |$)", code):
                if key in keys - message and not comment and "#" not in above:
                    unexplained.append(key)
                message.add(key)
            above = line
        assert unexplained == []

    def test_leaves_the_step_limit_to_the_default(self, starter):
        """No newcomer has to count skills."""
        assert "step_limit" not in parse(starter.read_text("utf-8"), "starter").data


def test_a_kind_without_a_starter_says_so():
    """A plugin's domain need not ship one."""

    class Bare(Domain):
        kind = "bare"
        Config = Strict

        def ground(self, config, sha256):
            return []

    with pytest.raises(OptionError, match="'bare' have no starter file"):
        Bare().starter()
