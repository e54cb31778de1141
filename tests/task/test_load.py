"""From a path to a problem: who reads a file, by its suffix."""

from __future__ import annotations

from typing import Any

import pytest

from skillplan.domains import Domain, Strict, load_task
from skillplan.domains.sop import SopDomain
from skillplan.errors import OptionError, PluginError, TaskError
from skillplan.files import Document
from skillplan.pipeline import load_problem
from sop_instances import instance_text


class WordsDomain(Domain):
    """Reads files of words, of which it makes a matrix of two nodes."""

    kind = "words"
    Config = Strict
    suffixes = (".words", ".list")
    max_bytes = 20

    def read(self, text: str, source: str) -> Document:
        """Return a matrix whose one cost is the number of words."""
        costs = [[0, len(text.split())], [-1, 0]]
        return Document(source, {"kind": "sop", "name": "words", "costs": costs}, {(): (1, 1)}, {})

    def ground(self, config: Any, sha256: str) -> list[Any]:
        """Return nothing: what it reads is of another kind."""
        raise AssertionError


@pytest.fixture
def looked_up():
    """The kinds that were looked up."""
    return []


@pytest.fixture
def load(looked_up):
    """Load with three kinds, one of which is broken."""

    class Domains(dict[str, type[Domain]]):
        def __getitem__(self, kind: str) -> Any:
            looked_up.append(kind)
            if kind == "broken":
                raise PluginError("cannot be imported")
            return super().__getitem__(kind)()

    domains: Any = Domains(broken=Domain, sop=SopDomain, words=WordsDomain)
    return lambda path: load_task(path, domains)


def test_a_suffix_is_read_by_the_domain_that_claims_it(tmp_path, load, looked_up):
    """The kind of that name is looked up first, so that no other has to be imported."""
    path = tmp_path / "a.words"
    path.write_text("three words here")
    assert 3 == load(path).task.skills[0].cost.least(0, 0)
    assert ["words", "sop"] == looked_up


@pytest.mark.parametrize("name", ["a.list", "A.LIST"])
def test_a_broken_kind_keeps_nobody_from_reading(tmp_path, load, name):
    """Nor do capital letters."""
    path = tmp_path / name
    path.write_text("one")
    assert 1 == load(path).task.skills[0].cost.least(0, 0)


@pytest.mark.parametrize("name", ["a.yaml", "a.yml", "a"])
def test_yaml_looks_up_no_kind_but_its_own(tmp_path, load, looked_up, name):
    """What a file does not need is not imported for it."""
    path = tmp_path / name
    path.write_text("kind: sop\nname: two\ncosts: [[0, 7], [-1, 0]]\n")
    assert 7 == load(path).task.skills[0].cost.least(0, 0)
    assert ["sop"] == looked_up


def test_a_suffix_that_nobody_claims_is_yaml(tmp_path, load):
    """As it always was."""
    path = tmp_path / "a.txt"
    path.write_text("kind: sop\nname: two\ncosts: [[0, 7], [-1, 0]]\n")
    assert "two" == load(path).name


def test_a_domain_says_how_large_its_files_may_be(tmp_path, load):
    """The limit of YAML is not theirs."""
    path = tmp_path / "a.words"
    path.write_text("a " * 11)
    with pytest.raises(TaskError, match="larger than the 20 bytes that a task file may have"):
        load(path)


class TestChanges:
    @pytest.fixture
    def path(self, tmp_path):
        """A copy of a TSPLIB file."""
        path = tmp_path / "ESC07.sop"
        path.write_text(instance_text("ESC07"))
        return path

    def test_a_tsplib_file_is_read_as_if_it_held_what_is_set(self, path):
        """Its name as well as an entry of its matrix."""
        problem = load_problem(path, changes={"name": "other", "costs.0.1": "5"})
        assert "other" == problem.name
        assert 5 == problem.config.costs[0][1]  # type: ignore[attr-defined]

    @pytest.mark.parametrize(
        ("key", "value", "message"),
        [
            (
                "dimension",
                "4",
                ": dimension: unknown key 'dimension'. Did you mean 'description'? "
                "That is what --set says.",
            ),
            (
                "name",
                "a b",
                ": name: 'a b' is not a name. Use letters, digits and '_.+-', at most 64. "
                "That is what --set says.",
            ),
            (
                "costs.8.3",
                "4",
                ": costs[8][3]: node 8, the last, must come after all others, but need not come "
                "after node 3. Write -1 there in its row. That is what --set says.",
            ),
        ],
    )
    def test_what_does_not_fit_is_one_message(self, path, key, value, message):
        """That says where the value came from."""
        with pytest.raises(TaskError) as caught:
            load_problem(path, changes={key: value})
        assert [f"{path}{message}"] == caught.value.lines()

    def test_a_row_that_is_not_there_is_refused(self, path):
        """With the rows there are."""
        with pytest.raises(OptionError, match="a list of 9; give an index from 0 to 8"):
            load_problem(path, changes={"costs.9": "[]"})
