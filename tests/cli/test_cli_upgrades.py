"""Kept verdicts die with the code that gave them: an upgraded plugin answers at once."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import pytest

from skillplan.checks import identify_code
from skillplan.pipeline import registry

DETECTOR = '''
from pathlib import Path

from skillplan import Detector, Verdict


class Watchful(Detector):
    """Answer the same about everything."""

    name = "watchful"
    expensive = True

    def check(self, skill, state):
        with Path(__file__).with_name("calls").open("a") as calls:
            calls.write(".")
        return ANSWER
'''
ALLOWS, REFUSES = "Verdict.feasible()", 'Verdict.infeasible("closed")'
Publish = Callable[..., None]


@pytest.fixture
def publish(tmp_path, monkeypatch):
    """Install a version of a detector whose distribution is not named after its module."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))

    def put(answer: str, version: str | None, *, editable: bool = False) -> None:
        info = site / "acme_detectors.dist-info"
        info.mkdir(exist_ok=True)
        stated = "" if version is None else f"Version: {version}\n"
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: acme-detectors\n{stated}")
        (info / "entry_points.txt").write_text(
            "[skillplan.collision]\nwatchful = watchful_module:Watchful\n"
        )
        address = {"url": f"file://{site}", "dir_info": {"editable": editable}}
        (info / "direct_url.json").write_text(json.dumps(address))
        (site / "watchful_module.py").write_text(DETECTOR.replace("ANSWER", answer))
        for stale in site.glob("__pycache__/*"):
            stale.unlink()
        forget()

    def forget() -> None:
        sys.modules.pop("watchful_module", None)
        registry.refresh()

    yield put
    forget()


@pytest.fixture
def board(tmp_path, cli):
    """A small one: each verdict is a file."""
    path = tmp_path / "small.yaml"
    cli("generate", "assembly", "--parts", "3", "--density", "0", "--out", str(path))
    return str(path)


def solved(cli: Any, board: str) -> bool:
    words = ("search-optimal", board, "--collision", "watchful", "--format", "json")
    return bool(cli(*words).document["status"] == "optimal")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"version": "1.0"}, {"version": "1.1"}),
        ({"version": "1.0", "editable": True}, {"version": "1.0", "editable": True}),
        ({"version": None}, {"version": None}),
    ],
    ids=["a new version", "an edited source", "no version to tell"],
)
def test_an_upgrade_from_allows_all_to_refuses_all_changes_the_answer_at_once(
    cli, board, publish, before, after
):
    """What the former code allowed is kept, and not used."""
    publish(ALLOWS, **before)
    assert solved(cli, board)
    publish(REFUSES, **after)
    assert not solved(cli, board)


def test_the_same_code_is_not_queried_again(cli, board, publish, tmp_path):
    """What it said is used by the next process."""
    publish(ALLOWS, "3.0")
    words = ("search-optimal", board, "--collision", "watchful", "--format", "json")
    cli(*words)
    calls = tmp_path / "site" / "calls"
    first = len(calls.read_text())
    assert first
    publish(ALLOWS, "3.0")
    cli(*words)
    assert first == len(calls.read_text())


class TestOrigin:
    def test_it_is_that_of_the_distribution_that_registered_the_class(self, publish):
        """And not of one that is named like its module."""
        publish(ALLOWS, "1.0")
        origin = identify_code(registry.load("collision", "watchful"))
        assert "acme-detectors 1.0" == origin[0]
        assert not [entry for entry in origin if entry.startswith("watchful_module ")]

    def test_source_counts_where_a_version_does_not_tell(self, publish):
        """As of a distribution that somebody edits."""
        publish(ALLOWS, "1.0", editable=True)
        before = identify_code(registry.load("collision", "watchful"))
        publish(REFUSES, "1.0", editable=True)
        after = identify_code(registry.load("collision", "watchful"))
        assert before[:-1] == after[:-1]
        assert before[-1] != after[-1]

    def test_a_class_that_nothing_registered_is_told_by_its_source(self):
        """As one that a script constructs itself."""
        from skillplan import Detector

        class Own(Detector):
            """Allow nothing."""

            name = "own"

            def check(self, skill: Any, state: Any) -> Any:
                raise NotImplementedError

        package = Own.__module__.partition(".")[0]
        assert [item for item in identify_code(Own) if item.startswith(f"{package} ")]

    def test_what_a_distribution_needs_counts(self):
        """A verdict of an engine rests on its simulator's version."""
        swept = pytest.importorskip("skillplan_pinocchio").__name__
        origin = identify_code(registry.load("collision", "swept"))
        assert [entry for entry in origin if entry.startswith("coal ")], swept
