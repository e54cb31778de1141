"""What the program can do is in the reference, and what the reference says is what it does."""

from __future__ import annotations

import functools
import importlib
import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import BaseModel

import skillplan
from same_process import studies_in_this_process
from skillplan import errors
from skillplan.pipeline import registry
from skillplan.records import Status, schemas
from thinned import slow_case
from transcripts import ROOT, run

DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_ext"))

import command_pages  # noqa: E402
import generated_reference  # noqa: E402
import limits  # noqa: E402
import schema_tables  # noqa: E402

BOARD = "configs/inverter_board.yaml"
BENCH = "configs/swarmitfix_polygonal.yaml"


def built(page: str) -> str:
    """Return a page of the reference with what is generated in it."""
    return generated_reference.filled((DOCS / "reference" / page).read_text("utf-8"))


@pytest.fixture(scope="module")
def commands_page():
    """The page of all commands."""
    return built("commands.md")


def test_every_command_and_option_is_in_the_reference(commands_page):
    """A reader finds every word of the command line."""
    for words, command, _ in command_pages.commands():
        assert f"# {words}\n" in commands_page
        for parameter in command.params:
            for option in parameter.opts if parameter.param_type_name == "option" else ():
                assert option in commands_page, f"{words} {option}"
    assert len(command_pages.option_names()) >= 50


def test_every_option_says_what_it_does():
    """No option is without a help text."""
    silent = [
        f"{words} {parameter.opts[-1]}"
        for words, command, _ in command_pages.commands()
        for parameter in command.params
        if not getattr(parameter, "help", None) and "--help" not in parameter.opts
    ]
    assert [] == silent


def test_every_exit_code_is_in_the_reference():
    """Each constant of the errors module has its row, and no row is of another."""
    page = built("exit_codes.md")
    codes = {name for name in vars(errors) if name.startswith("EXIT_")}
    assert codes == set(generated_reference.EXIT_MEANINGS)
    assert all(f"| {getattr(errors, name)} | `{name}` |" in page for name in codes)


def test_every_status_is_in_the_reference():
    """What a result may be is explained."""
    page = built("exit_codes.md")
    assert [] == [status.value for status in Status if f"| `{status.value}` |" not in page]


def test_every_plugin_of_this_repository_is_in_the_reference():
    """What this repository brings is described, and so is the entry point of every kind."""
    pages = {
        "solver": built("solvers.md"),
        "physics": built("back_ends.md"),
        "collision": built("back_ends.md"),
        "domain": built("back_ends.md"),
        "executor": built("executors.md"),
        "exporter": built("exporters.md"),
        "sampler": built("samplers.md"),
    }
    written = "".join(page.read_text("utf-8") for page in DOCS.rglob("*.md"))
    for path in [ROOT / "pyproject.toml", *(ROOT / "plugins").glob("*/pyproject.toml")]:
        groups = tomllib.loads(path.read_text("utf-8"))["project"].get("entry-points", {})
        for group, entries in groups.items():
            kind = group.removeprefix("skillplan.")
            assert f"`{group}`" in written
            known = registry.names(kind) if kind in registry.KINDS else ()
            for name in set(entries) & set(known):
                assert f"# `{name}`" in pages[kind], name
            for name in entries:
                assert f"`{name}`" in written or f"kind: {name}" in written, name


@pytest.mark.parametrize("kind", registry.KINDS)
def test_every_option_of_every_plugin_is_in_the_reference(kind):
    """Each has its row, with its range and what it is."""
    text = generated_reference.plugin_options(kind)
    for info in registry.describe(kind):
        options = getattr(registry.load(kind, info.name), "Options", None)
        for name, about in (options.model_fields if options else {}).items():
            assert f"| `{name}` |" in text, f"{info.name}.{name}"
            assert about.description, f"{info.name}.{name}"


@pytest.mark.parametrize("kind", registry.names("domain"))
def test_every_key_of_a_task_file_is_in_the_reference(kind):
    """Each key of the schema stands in a table, at any depth."""
    page = built(f"{kind}.md")
    result = set(re.findall(r"^\| `([A-Za-z_0-9]+)` \|", page, re.MULTILINE))
    assert keys_of(registry.load("domain", kind).Config) - result == set()


def keys_of(model: type[BaseModel]) -> set[str]:
    """Return all keys of a schema but those inside ``expect``, which only tests read."""
    schema = model.model_json_schema()
    result = set(schema["properties"])
    for name, own in schema.get("$defs", {}).items():
        if "Expect" not in name:
            result |= set(own.get("properties", {}))
    return result


def test_every_floor_is_in_the_architecture():
    """The packages of the source tree are those of the page."""
    page = generated_reference.filled((DOCS / "explanation/architecture.md").read_text("utf-8"))
    folders = {path.parent.name for path in (ROOT / "src/skillplan").glob("*/__init__.py")}
    assert [] == sorted(name for name in folders if f"`{name}`" not in page)


def test_every_public_name_is_in_the_reference():
    """The API has a section for each."""
    page = built("api.md")
    assert [] == [name for name in skillplan.__all__ if f"### {name}\n" not in page]


def test_every_document_is_in_the_reference():
    """Each schema name of the records is described, or named as private."""
    page = built("documents.md")
    names = [getattr(schemas, name) for name in schemas.__all__]
    assert [] == [name for name in names if f"`{name}`" not in page]


def test_every_key_of_every_document_is_explained():
    """Each has a meaning beside its type."""
    bare = [
        f"{name} {key.path}"
        for name, schema in known_schemas().items()
        for mapping in schema_tables.mappings(schema)
        for key in mapping.keys
        if not key.meaning
    ]
    assert [] == bare


SEQUENCE = "0,1,4,5,2,3,8,9,10,11,6,7,13,14,15"
PRINTED = [
    f"search-optimal {BOARD}",
    f"evaluate {BOARD} --sequence {SEQUENCE}",
    f"evaluate {BOARD} --sequence 0,1,10,11",
    f"explain {BOARD} place(transformer) --after 0,1,10,11,8 --collision aabb",
    f"chart {BOARD}",
    f"check {BOARD}",
    f"check {BENCH}",
    "check configs/missing.yaml",
    "cache show",
    f"cache fill {BOARD}",
    "plugins",
    "plugins solver exact",
    *(
        slow_case(command, reason="a second; a board's in every run")
        for command in (
            "search-optimal configs/ESC12.sop",
            f"search-optimal {BOARD} --pareto time,distance --collision precedence",
            f"advise {BOARD} --tries 1 --within 0.1",
            f"compare {BOARD} --solvers exhaustive,exact --set step_limit=15",
            "search-optimal configs/swarmitfix_triangular.yaml",
            "search-optimal configs/swarmitfix_fleet.yaml",
            f"compare {BENCH} --solvers csp,exact",
        )
    ),
]


@pytest.mark.parametrize("command", PRINTED)
def test_a_document_has_the_keys_that_the_reference_says(command, monkeypatch, tmp_path):
    """What is printed with ``--format json`` validates, and has no key besides."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path))
    monkeypatch.chdir(ROOT)
    printed = run(["skillplan", *command.split(), "--format", "json"])
    validate(json.loads(printed[printed.index("{") : printed.rindex("}") + 1]))


@pytest.mark.slow(reason="a search, a study and a chain; other documents in every run")
def test_the_documents_of_results_and_studies_have_those_keys(tmp_path, monkeypatch):
    """A result's verification, a study and its manifest, and policies validate, too."""
    monkeypatch.chdir(tmp_path)
    board, cases = ROOT / BOARD, ROOT / "configs/swarmitfix_cases.yaml"
    run(["skillplan", "search-optimal", str(board), "--out", "solved"])
    validate(json.loads(run(["skillplan", "verify", "solved", "--format", "json"])))
    study = f"sweep {cases} -O gamma=0.9,0.99 -O episodes=300 --runs 2 --starts C20 --out study"
    with studies_in_this_process():
        run(["skillplan", *study.split()])
    Path("goals.yaml").write_text("kind: swarmitfix\nname: goals\nbase: {goals: [C42, C29]}\n")
    chain = "search-optimal goals.yaml --solver policy-iteration --out chain"
    run(["skillplan", *chain.split()])
    for path in (
        "solved/result.json",
        "study/manifest.json",
        "study/sweep.json",
        "chain/policies.json",
    ):
        validate(json.loads(Path(path).read_text("utf-8")))


@pytest.mark.slow(reason="a training with torch")
def test_the_documents_of_trainings_have_those_keys(tmp_path, monkeypatch):
    """Manifest, result and policies of a training validate, and what ``evaluate`` makes of it."""
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    train = f"train {ROOT / BOARD} --solver dqn --runs 1 --steps 3000 --out board"
    run(["skillplan", *train.split()])
    validate(json.loads(run(["skillplan", "evaluate", "board", "--format", "json"])))
    for path in ("manifest.json", "result.json", "runs/00/policy.json", "runs/00/last.json"):
        validate(json.loads(Path("board", path).read_text("utf-8")))


@pytest.mark.release(
    reason="a simulation and detectors on trial; documents of trainings in the whole suite"
)
def test_the_documents_of_simulations_have_those_keys(monkeypatch):
    """A simulated plan, and detectors on trial, validate."""
    pytest.importorskip("pybullet")
    monkeypatch.chdir(ROOT)
    for command in (
        f"simulate {BOARD} --sequence 0,1",
        f"compare {BOARD} --detectors aabb,contact-pairs --physics pybullet --staged 1",
    ):
        validate(json.loads(run(["skillplan", *command.split(), "--format", "json"])))


@functools.cache
def known_schemas() -> dict[str, Any]:
    """Return the schemas of all documents by name; made once."""
    return generated_reference.document_schemas()


def validate(document: dict[str, Any]) -> None:
    """Hold a document against the schema that it names; rows of a comparison against theirs."""
    known = known_schemas()
    jsonschema.validate(document, known[document["schema"]])
    if document["schema"] in ("skillplan.comparison/1", "skillplan.trainings/1"):
        for row in document["rows"]:
            validate(row)


@pytest.mark.slow(reason="checks every schema; documents are held to theirs in every run")
def test_the_schemas_that_are_published_are_json_schemas(tmp_path):
    """Validators elsewhere can read each of them."""
    generated_reference.write_json_schemas(tmp_path)
    written = sorted(tmp_path.iterdir())
    assert len(known_schemas()) == len(written)
    for path in written:
        jsonschema.Draft202012Validator.check_schema(json.loads(path.read_text("utf-8")))


def test_references_to_modules_lead_to_public_names():
    """Every public name is found by where it lives."""
    public_names = importlib.import_module("public_names")
    assert len(public_names.homes()) >= len(skillplan.__all__) - 2
    assert "skillplan.Verdict" == public_names.homes()["skillplan.task.verdict.Verdict"]


class TestLimits:
    def test_the_page_on_trust_holds_what_the_code_refuses(self):
        """The table is made of the constants, and stands in the page."""
        page = (DOCS / "explanation" / "trust.md").read_text("utf-8")
        table = limits.page()
        assert table in generated_reference.filled(page)
        for row in (
            "| task file in YAML | 1 MiB, 32 levels, 100,000 values |",
            "| SOP and TSPLIB | 16 MiB, 2,000 nodes, a cost of 2⁴⁰ |",
            "| checkpoint | 64 GiB, and the free memory |",
        ):
            assert row in table

    def test_a_changed_constant_changes_the_table(self, monkeypatch):
        """No figure of it is typed by hand."""
        for _, words, places in limits.ROWS:
            assert re.sub(r"{[a-z]*}", "", words).isascii()
            assert not re.search(r"\d", words)
            assert words.count("{") == len(places)
        monkeypatch.setattr("skillplan.files.yaml.MAX_BYTES", 3 * 1024)
        assert "| task file in YAML | 3 KiB, " in limits.page()

    def test_every_limit_on_the_bytes_of_a_file_is_in_the_table(self):
        """A new reader with a limit of its own is not forgotten."""
        listed = {place.partition(":")[0] for _, _, places in limits.ROWS for place in places}
        named = re.compile(r"^_?(?:MOST|MAX)_BYTES\b", re.MULTILINE)
        source = ROOT / "src" / "skillplan"
        limited = {
            ".".join(path.relative_to(source).with_suffix("").parts)
            for path in source.rglob("*.py")
            if named.search(path.read_text("utf-8"))
        }
        assert set() == limited - listed
