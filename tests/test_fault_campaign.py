"""The campaign of ``make fault-campaign`` in short, and that it finds what it looks for."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests" / "campaign"))

import failing_io  # noqa: E402
import failing_writers  # noqa: E402
import forgeries  # noqa: E402
import liars  # noqa: E402
import mutants  # noqa: E402
import mutated_inputs  # noqa: E402
import tally as tallies  # noqa: E402
from interrupted_writes import fail_every_call_of_a_search  # noqa: E402

SEED = 20261122


@pytest.fixture
def tally(monkeypatch, tmp_path):
    """An empty tally, and a cache of its own."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))
    return tallies.Tally(SEED)


@pytest.fixture
def starter(tmp_path):
    """A small task file."""
    path = tmp_path / "task.yaml"
    assert 0 == tallies.survives("init", "assembly", "--out", path)
    return path


def test_liars_are_caught(tally):
    """Solvers, also under chance, detectors that give no verdict or contradict themselves."""
    liars.lie(tally)
    expected = {"lying-solver": 16, "lying-under-chance": 4, "lying-detector": 6}
    assert {**expected, "inconsistent-detector": 2} == tally.cases
    assert [] == tally.failures


def test_every_mutant_fits_the_source():
    """Each changes one place; `python tests/campaign/mutants.py` shows that each is noticed."""
    package = ROOT / "src" / "skillplan"
    for mutant in mutants.MUTANTS:
        assert 1 == (package / mutant.file).read_text("utf-8").count(mutant.old), mutant.name
    assert 20 <= len({mutant.name for mutant in mutants.MUTANTS}) == len(mutants.MUTANTS)


def test_every_writer_survives_a_failure_and_a_kill_at_every_call(tally):
    """What was there stays, or all is new."""
    failing_writers.fail_every_call_of_writers(tally)
    assert tally.cases["fail-writer"] > 100
    assert [] == tally.failures


@pytest.mark.slow(reason="a dozen searches and verifications; tests/cli/test_verify_forgeries.py")
def test_forged_results_are_refuted(tally):
    """Of a board, a board with chance and a chain; with two changed leaves."""
    forgeries.forge_results(tally, 2)
    assert sum(tally.cases.values()) > 30
    assert [] == tally.failures


def test_a_few_spoilt_inputs_do_no_harm(tally, tmp_path, monkeypatch):
    """Two of each kind that needs no preparation of seconds."""
    inputs = mutated_inputs.Inputs(tmp_path, whole=False)
    for kind, way in inputs.ways().items():
        for number in range(2):
            tally.case(kind, number, way)
    assert 10 == sum(tally.cases.values())
    assert [] == tally.failures


@pytest.mark.slow(reason="many searches; spoilt inputs in every run")
def test_a_search_survives_a_failure_of_its_calls(tally, starter):
    """Every twelfth that opens, writes, renames or forces to disk, by a full disk."""
    fail_every_call_of_a_search(tally, starter, ["ENOSPC"], step=12)
    assert tally.cases["fail-search"] > 1
    assert [] == tally.failures


def test_the_shim_fails_the_call_of_that_number_and_no_other(tmp_path):
    """Opening, writing, forcing to disk, renaming; beneath its folder only."""

    def write(folder: Path) -> None:
        with (folder / "a").open("wb") as file:
            file.write(b"content")
            file.flush()
            os.fsync(file.fileno())
        os.replace(folder / "a", folder / "b")

    inside, beside = tmp_path / "inside", tmp_path / "beside"
    inside.mkdir()
    beside.mkdir()
    for number in range(1, 5):
        with failing_io.failing(inside, tmp_path / f"calls-{number}", number, "short"):
            write(beside)
            with pytest.raises(OSError, match="No space left on device"):
                write(inside)
    with failing_io.failing(inside, tmp_path / "calls", 0, "EIO"):
        write(inside)
    assert 4 == (tmp_path / "calls").stat().st_size


def test_a_failure_is_kept_with_the_seed_that_makes_it_again(tally):
    """A traceback, an exit code, a hang, and what was touched outside."""

    def fails(chance: object) -> None:
        tallies.holds_to_its_word(7, "oops")

    tally.case("kind", 4, fails)
    assert 1 == len(tally.failures)
    assert tally.failures[0].startswith(f"{SEED}:kind:4  AssertionError: (7, 'oops')")
    with pytest.raises(AssertionError, match="outside"), tallies.guarded_folder() as inside:
        (inside.parent / "untouched" / "0.txt").write_text("gone")
    again = tallies.Tally(SEED, only=f"{SEED}:kind:4")
    again.case("kind", 3, fails)
    again.case("kind", 4, fails)
    assert {"kind": 1} == again.cases
