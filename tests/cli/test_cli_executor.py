"""`--executor`: where the processes of `--jobs` are."""

from __future__ import annotations

from typing import ClassVar

import pytest

from same_process import SameProcess
from skillplan.collision import AabbDetector
from skillplan.pipeline import registry
from skillplan.workers import Prepare, Worker
from tabular_learner import learner_installed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--executor", "lokal"], "Unknown executor 'lokal'. Did you mean 'local'?"),
        (["--executor", "local:here"], "The executor 'local' takes no address"),
        (["--executor", "local:"], "no address follows the colon"),
        (["--executor", "local", "-O", "local.slots=3"], "has no option 'slots'"),
    ],
)
@pytest.mark.parametrize("command", ["search-optimal", "cache fill", "compare", "sweep"])
def test_a_wrong_one_is_refused_before_anything_is_done(cli, board, command, words, message):
    """In one line, by every command that has jobs."""
    more = ["--solvers", "exact"] if command == "compare" else []
    assert message in cli(*command.split(), board, *more, *words).refusal


class Noted(SameProcess):
    """An executor of somebody else's: it notes what it was asked for."""

    name = "noted"
    takes_address = True
    started: ClassVar[list[str]] = []

    def start(self, prepare: Prepare, content: bytes, what: str) -> Worker:
        self.started.append(f"{what}, {self.slots} at {self.address}")
        return super().start(prepare, content, what)


@pytest.fixture
def noted(monkeypatch):
    """What it was asked for; checks by boxes are worth a process meanwhile."""
    known = registry.load
    monkeypatch.setattr(
        registry, "load", lambda kind, name: Noted if name == "noted" else known(kind, name)
    )
    monkeypatch.setattr(Noted, "started", [])
    monkeypatch.setattr(AabbDetector, "expensive", True)
    return Noted.started


@pytest.mark.slow(reason="a command each; checks, searches and studies by themselves in every run")
@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("search-optimal BOARD --collision aabb --no-cache", "checks, 2 at there"),
        ("chart BOARD --collision aabb", "checks, 2 at there"),
        ("cache fill BOARD --collision aabb", "checks, 2 at there"),
        ("cache verify BOARD --collision aabb", "checks, 2 at there"),
        ("compare BOARD --solvers exact,value-iteration", "the comparison, 2 at there"),
        ("compare GENERATED --solvers exact,value-iteration", "the comparison, 2 at there"),
        ("sweep BOARD --solver exact --runs 2", "the runs, 2 at there"),
        ("sweep GENERATED --solver exact --runs 2 --collision precedence", "the runs, 2 at there"),
        ("train BOARD --solver tabular --runs 2 --steps 100", "the training, 2 at there"),
        ("train GENERATED --solver tabular --runs 2 --steps 100", "the training, 2 at there"),
    ],
)
def test_every_command_that_has_jobs_gives_them_to_the_executor(
    cli, board, noted, tmp_path, monkeypatch, words, what
):
    """On generated boards, too; and of as many slots as there are jobs."""
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))
    generated = str(tmp_path / "generated.yaml")
    if "GENERATED" in words:
        cli(*["generate", "assembly", "--parts", "5", "--density", "0.3", "--out"], generated)
    if "verify" in words:
        cli("cache", "fill", board, "--collision", "aabb")
    paths = {"BOARD": board, "GENERATED": generated}
    call = [paths.get(word, word) for word in words.split()]
    call += ["--out", str(tmp_path / "out")] if call[0] in ("train", "sweep") else []
    with learner_installed(tmp_path / "site", monkeypatch):
        outcome = cli(*call, "--jobs", "2", "--executor", "noted:there")
    assert outcome.code in (0, 1), outcome.err
    assert {what} == set(noted)
