"""Commands without the plugin of the bench: everything else works, and its absence is explained."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import Distribution, EntryPoints, distributions

import pytest

from skillplan.pipeline import registry
from skillplan.plugins import installed

DISTRIBUTION = "skillplan-swarmitfix"
COMMAND = f"pip install {DISTRIBUTION}, or in a checkout pip install -c constraints.txt"


def without_bench() -> Iterator[Distribution]:
    """Yield all distributions except the plugin of the bench."""
    return (distribution for distribution in distributions() if distribution.name != DISTRIBUTION)


@pytest.fixture
def no_bench(monkeypatch):
    """Hide the plugin of the bench."""
    monkeypatch.setattr(installed, "distributions", without_bench)
    registry.refresh()
    yield
    monkeypatch.undo()
    registry.refresh()


@pytest.mark.usefixtures("no_bench")
class TestWithoutBench:
    @pytest.mark.parametrize("command", ["check", "search-optimal", "report"])
    def test_a_task_is_refused_with_the_command_that_installs_its_kind(
        self, cli, corner, tmp_path, command
    ):
        out = ("--out", str(tmp_path / "page.html")) if command == "report" else ()
        refusal = cli(command, corner, *out).refusal
        place = f"{corner}:1:7: kind: The domain 'swarmitfix' is not installed: {COMMAND}"
        assert place in " ".join(refusal.split())

    @pytest.mark.parametrize("command", ["verify", "plot"])
    def test_a_stored_result_is_refused_with_the_command_that_installs_its_kind(
        self, cli, solved_corner, command
    ):
        refusal = cli(
            command, str(solved_corner), *(("gantt",) if command == "plot" else ())
        ).refusal
        assert COMMAND in " ".join(refusal.split())

    @pytest.mark.parametrize(
        "words",
        [
            ("init", "swarmitfix"),
            ("schema", "swarmitfix"),
            ("search-optimal", "BOARD", "--solver", "fleet"),
            ("plot", "BOARD", "placement"),
        ],
        ids=lambda words: words[0],
    )
    def test_what_it_brings_is_answered_with_the_command_that_installs_it(self, cli, board, words):
        refusal = cli(*(board if word == "BOARD" else word for word in words)).refusal
        assert COMMAND in " ".join(refusal.split())

    def test_a_board_needs_none_of_it(self, cli, seven, tmp_path):
        assert cli("search-optimal", seven).code == 0
        page = str(tmp_path / "page.html")
        assert cli("report", seven, "--no-simulation", "--out", page).code == 0

    def test_it_is_listed_nowhere(self, cli):
        assert "swarmitfix" not in cli("plugins").out
        assert "placement" not in cli("plot", "--help").out

    def test_an_unknown_kind_is_answered_with_the_nearest(self, cli, tmp_path):
        path = tmp_path / "task.yaml"
        path.write_text("kind: assembley\n", "utf-8")
        assert "unknown kind 'assembley'. Did you mean 'assembly'?" in cli("check", str(path)).err


def test_a_chain_without_a_chapter_is_reported_by_its_tables(
    cli, solved_corner, tmp_path, monkeypatch
):
    """A kind of task need not bring a chapter."""
    monkeypatch.setattr("skillplan.views.report.chapters.chapters", EntryPoints)
    page = tmp_path / "page.html"
    outcome = cli("report", str(solved_corner), "--out", str(page))
    assert outcome.code == 0
    text = page.read_text("utf-8")
    assert "no plugin shows tasks of kind &#x27;swarmitfix&#x27; in motion" in text.replace(
        "&#39;", "&#x27;"
    )
    assert "base-1" in text


def test_a_chapter_that_fails_is_named(cli, solved_corner, tmp_path, monkeypatch):
    point = installed.chapters()["swarmitfix"]
    broken = type(point)(point.name, "skillplan_swarmitfix.report.absent:chapter", point.group)
    monkeypatch.setattr("skillplan.views.report.chapters.chapters", lambda: EntryPoints([broken]))
    refusal = cli("report", str(solved_corner), "--out", str(tmp_path / "page.html")).refusal
    assert "The report's chapter on tasks of kind 'swarmitfix'" in " ".join(refusal.split())
