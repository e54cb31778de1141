"""verify, against somebody who changes one figure: any leaf of a result, any cell beside it."""

from __future__ import annotations

import json
import random
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from skillplan.errors import SkillplanError
from skillplan.pipeline import certify
from skillplan.records import Verdict
from skillplan.solvers import Stop
from skillplan.views.tables import render_csv_files
from thinned import release_case

ROOT = Path(__file__).parents[2]
BOARD = str(ROOT / "configs/inverter_board.yaml")
FLEET = str(ROOT / "configs/swarmitfix_fleet.yaml")
Path_ = tuple[str | int, ...]

# What nobody can tell from a plan, as docs/howto/verify.md lists it. A policy that is claimed and
# missing is named.
SINGLE = re.compile(
    r"solver|seed|bound_method|policy|stats\.\w+|trace\..*|trace"
    r"|origin\.(file|screening|options\..*|set\..*)"
)
# Of a chain the whole is made of its parts: less is left open.
CHAIN = re.compile(
    r"seed|origin\.(file|screening|options\..*|set\..*)|solver"
    r"|(sequences|stages)\.\d+\.(bound_method|policy|reason|trace.*"
    r"|stats\.cache_hits|stats\.checks|stats\.states|stats\.trajectories)"
)
CELLS = re.compile(r"[^,\n]+")


def leaves(value: Any, path: Path_ = ()) -> Iterator[Path_]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from leaves(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from leaves(item, (*path, index))
    else:
        yield path


def tampered(value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return f"{value}x"
    if value is None:
        return 1
    return value + 1 if isinstance(value, int) else value * 1.001 + 0.01


def changed(document: Any, path: Path_) -> Any:
    """Return a copy of a document with one leaf changed."""
    copy = json.loads(json.dumps(document))
    holder = copy
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = tampered(holder[path[-1]])
    return copy


def accepted(folder: Path) -> bool:
    """Whether verify finds nothing wrong; proofs of all plans are given up at once."""
    try:
        result = certify(str(folder), stop=Stop(time_limit_s=1e-3), saved_tables=render_csv_files)
    except SkillplanError:
        return False
    return result.verdict is not Verdict.REFUTED


def unnoticed(folder: Path, name: str, paths: Iterator[Path_] | list[Path_]) -> set[str]:
    """Return the leaves of a JSON file that verify accepts whatever stands there."""
    file = folder / name
    original = file.read_text("utf-8")
    document = json.loads(original)
    result = set()
    for path in paths:
        file.write_text(json.dumps(changed(document, path)), "utf-8")
        if accepted(folder):
            result.add(".".join(map(str, path)))
    file.write_text(original, "utf-8")
    return result


def one_of_each(document: Any) -> list[Path_]:
    """Return of leaves that differ only in where they stand in a list the last."""
    kinds = {tuple("*" if isinstance(k, int) else k for k in p): p for p in leaves(document)}
    return list(kinds.values())


@pytest.fixture
def run(solved_board, tmp_path):
    """The inverter board by exact search, in a folder of its own."""
    return Path(shutil.copytree(solved_board, tmp_path / "run"))


@pytest.fixture
def chain(solved_corner, tmp_path):
    """A chain on the bench, in a folder of its own."""
    return Path(shutil.copytree(solved_corner, tmp_path / "chain"))


def document_of(folder: Path, name: str = "result.json") -> Any:
    return json.loads((folder / name).read_text("utf-8"))


@pytest.mark.parametrize(
    "path",
    [
        ("makespan",),
        ("makespan_s",),
        ("cost_unit",),
        ("task", "name"),
        ("task", "kind"),
        ("physics",),
        ("collision",),
        ("reason",),
        ("proved_by", 1),
        ("steps", 3, "goal", 1),
        ("steps", 14, "duration_s"),
    ],
)
def test_a_changed_figure_is_noticed(run, path):
    """Those that once passed, of a board."""
    assert set() == unnoticed(run, "result.json", [path])


@pytest.mark.parametrize(
    "path",
    [
        ("makespan_s",),
        ("stats", "wall_s"),
        ("timeline", 2, "time_s"),
        ("goals", 0, "goal"),
        ("bench", "pitch_m"),
        ("sequences", 0, "optimum"),
    ],
)
def test_a_changed_figure_of_a_chain_is_noticed(chain, path):
    """Those that once passed, of the bench."""
    document = document_of(chain)
    known = {tuple("*" if isinstance(k, int) else k for k in p) for p in leaves(document)}
    if tuple("*" if isinstance(k, int) else k for k in path) not in known:
        path = next(p for p in leaves(document) if p[0] == path[0])
    assert set() == unnoticed(chain, "result.json", [path])


def test_a_stage_with_a_skill_that_there_is_not_fails(cli, chain):
    """What follows from it is not grounded; that raised once."""
    document = document_of(chain)
    goals = next(part for part in document["stages"] if part["name"] == "goals")
    goals["skills"][-1] += "x"
    (chain / "result.json").write_text(json.dumps(document), "utf-8")
    outcome = cli("verify", str(chain))
    assert 1 == outcome.code
    assert "NOT VALID: goals: plan" in outcome.out


@pytest.mark.release(reason="225 verifications; test_a_changed_figure_is_noticed in every run")
def test_every_leaf_of_a_board_is_checked_or_listed(run):
    """One at a time."""
    result = unnoticed(run, "result.json", leaves(document_of(run)))
    assert set() == {path for path in result if not SINGLE.fullmatch(path)}


@pytest.mark.parametrize(
    "share",
    [
        release_case(3, reason="70 verifications of a chain"),
        release_case(1, reason="200 verifications of a chain"),
    ],
)
def test_every_leaf_of_a_chain_is_checked_or_listed(chain, share):
    """Of each kind of leaf one; of all kinds, or of every third."""
    result = unnoticed(chain, "result.json", one_of_each(document_of(chain))[::share])
    assert set() == {path for path in result if not CHAIN.fullmatch(path)}


@pytest.mark.release(reason="15 verifications of a fleet, a second each")
def test_every_leaf_of_a_fleet_is_checked_or_listed(cli, tmp_path):
    """Schedule, robots and bounds included."""
    folder = tmp_path / "fleet"
    words = (FLEET, "--format", "json", "--out", str(folder))
    assert 0 == cli("search-optimal", *words).code
    sample = random.Random(0).sample(one_of_each(document_of(folder)), 15)
    result = unnoticed(folder, "result.json", sample)
    assert set() == {path for path in result if not CHAIN.fullmatch(path)}


@pytest.fixture(scope="module")
def solved_policy(solved, tmp_path_factory):
    """The board by value iteration, which stores its policy."""
    folder = tmp_path_factory.mktemp("policy") / "run"
    return Path(solved(folder, BOARD, "--solver", "value-iteration"))


@pytest.mark.slow(reason="a dozen verifications; a changed choice of a policy in every run")
def test_a_changed_leaf_of_policies_is_noticed(solved_policy, tmp_path):
    """Headers, and a sample of the choices."""
    folder = Path(shutil.copytree(solved_policy, tmp_path / "run"))
    every = list(leaves(document_of(folder, "policies.json")))
    heads = [path for path in every if "choices" not in path]
    sample = random.Random(0).sample([path for path in every if "choices" in path], 3)
    assert set() == unnoticed(folder, "policies.json", [*heads, *sample])


def test_a_choice_on_the_way_of_the_plan_is_noticed(solved_policy, tmp_path):
    """Though the other skill can be executed there, too."""
    folder = Path(shutil.copytree(solved_policy, tmp_path / "run"))
    document = document_of(folder, "policies.json")
    choices = document["policies"][0]["choices"]
    first = next(state for state, skill in choices.items() if skill == "place(pcb)")
    other = dict(choices)
    del other[first]
    document["policies"][0]["choices"] = other
    (folder / "policies.json").write_text(json.dumps(document), "utf-8")
    assert not accepted(folder)


def tampered_cells(file: Path, folder: Path, sample: int | None) -> list[str]:
    """Return the cells of a CSV file that verify accepts with one character more."""
    text = file.read_text("utf-8")
    cells = list(CELLS.finditer(text))
    chosen = cells if sample is None else random.Random(0).sample(cells, min(sample, len(cells)))
    results = []
    for cell in chosen:
        file.write_text(f"{text[: cell.end()]}1{text[cell.end() :]}", "utf-8")
        if accepted(folder):
            results.append(cell.group())
    file.write_text(text, "utf-8")
    return results


def test_a_changed_cell_beside_the_result_is_noticed(run, chain):
    """In plan.csv, and in the timeline of a bench."""
    assert [] == tampered_cells(run / "plan.csv", run, 3)
    assert [] == tampered_cells(chain / "plan.csv", chain, 1)
    assert [] == tampered_cells(chain / "timeline.csv", chain, 1)


@pytest.mark.slow(reason="a hundred verifications; a sample of cells is tried in every run")
def test_every_cell_beside_the_result_is_checked(run):
    """One at a time."""
    assert [] == tampered_cells(run / "plan.csv", run, None)


@pytest.mark.parametrize("folder", ["run", "chain"])
def test_a_result_of_an_older_version_without_the_later_keys_is_valid(folder, request):
    place: Path = request.getfixturevalue(folder)
    document = document_of(place)
    for row in (document, *document.get("sequences", ()), *document.get("stages", ())):
        for key in ("proved_by", "simulation", "not_checked"):
            del row[key]
    (place / "result.json").write_text(json.dumps(document), "utf-8")
    assert accepted(place)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("not_checked", ["the weather"]),
        ("proved_by", []),
        ("simulation", {"engine": "mujoco", "complete": True}),
    ],
)
def test_a_claim_about_the_checks_that_was_made_up_fails(run, key, value):
    document = {**document_of(run), key: value}
    (run / "result.json").write_text(json.dumps(document), "utf-8")
    assert not accepted(run)


def test_what_is_listed_as_unchecked_passes(run):
    """The list is no longer than it must be."""
    for path in [("seed",), ("stats", "wall_s"), ("stats", "checks"), ("solver",)]:
        assert {".".join(path)} == unnoticed(run, "result.json", [path]) or path == ("solver",)


class TestLimits:
    def test_absurd_replans_are_refused(self, cli, chain):
        """A billion of them once hung it."""
        document = document_of(chain)
        document["replans"] = 10**9
        (chain / "result.json").write_text(json.dumps(document), "utf-8")
        assert (
            "replans is 1000000000, and at most 100 are followed"
            in cli("verify", str(chain), "--time-limit", "2").refusal
        )

    def test_replans_that_are_allowed_keep_the_time_limit(self, cli, chain):
        """What does not follow is said."""
        document = document_of(chain)
        document["replans"] = 100
        (chain / "result.json").write_text(json.dumps(document), "utf-8")
        outcome = cli("verify", str(chain), "--time-limit", "1")
        assert outcome.code in (1, 2)

    def test_a_memory_limit_is_kept(self, cli, run):
        """Here there is none left for the replay: then nothing is valid."""
        outcome = cli("verify", str(run), "--memory-limit", "64MiB", "--format", "json")
        claims = {claim["claim"]: claim for claim in outcome.document["claims"]}
        assert (1, False) == (outcome.code, outcome.document["valid"])
        assert "memory limit" == claims["plan"]["detail"]


class TestWhatWasAsked:
    def test_back_ends_and_options_are_named(self, cli, run):
        """With their versions."""
        document = cli("verify", str(run), "--format", "json").document
        queries = {item["name"]: item for item in document["asked"]}
        assert {"kinematic", "precedence"} == set(queries)
        assert {"hold_back_picks": False} == queries["precedence"]["options"]
        assert not document["warm"]
        assert {"seed", "stats", "trace"} <= {entry["key"] for entry in document["not_checked"]}

    def test_kept_verdicts_are_used_only_when_warm(self, cli, run, monkeypatch):
        """Nothing on disk is even opened."""
        from skillplan.pipeline import solving as pipeline

        opened = []
        real = pipeline.open_warm_cache

        def open_cache() -> Any:
            opened.append(1)
            return real()

        monkeypatch.setattr(pipeline, "open_warm_cache", open_cache)
        assert 0 == cli("verify", str(run)).code
        assert [] == opened
        document = cli("verify", str(run), "--warm", "--format", "json").document
        assert ([1], True) == (opened, document["warm"])
