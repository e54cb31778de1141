"""A first day: a starter file of every kind, and what is compiled ahead or announced."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import subprocess
import sys

import pytest

from skillplan.cli import NOTICE, announce_compilation, main
from skillplan.cli.commands import warm_up
from skillplan.pipeline import registry
from skillplan.solvers import kernels
from thinned import slow_case

SUFFIXES = {"assembly": ".yaml", "swarmitfix": ".yaml", "sop": ".yaml"}
# Compiles one kernel of this project anew, in a process of its own.
COMPILING = """
import sys
from skillplan.cli.commands.warm_up import announce_compilation
from skillplan.solvers.kernels import compiled

def kernel(x):
    return x + 1

kernel.__module__ = "skillplan.solvers.kernel"
with announce_compilation():
    compiled(kernel)(1)
    compiled(kernel)(1.0)
"""


class TestInit:
    @pytest.mark.parametrize(
        "kind",
        [
            slow_case(kind, reason="solves; an order in every run")
            if kind in ("assembly", "swarmitfix")
            else kind
            for kind in registry.names("domain")
        ],
    )
    def test_the_starter_is_valid_and_solved(self, cli, tmp_path, kind):
        """Commented, too; and the next two commands are those that were told."""
        path = tmp_path / f"mine{SUFFIXES[kind]}"
        outcome = cli("init", kind, "--out", str(path))
        assert (0, "") == (outcome.code, outcome.err)
        first, check, search = outcome.out.splitlines()
        assert f"{path}: a task of kind {kind}. Next:" == first
        assert 0 == cli(*check.split()[1:]).code
        assert 0 == cli(*search.split()[1:]).code
        assert path.read_text("utf-8").count("#") > 10

    def test_by_default_it_is_an_assembly_on_stdout(self, cli):
        """The same as in a file."""
        outcome = cli("init")
        assert (0, "") == (outcome.code, outcome.err)
        assert cli("init", "assembly").out == outcome.out
        assert "kind: assembly" in outcome.out

    def test_a_file_that_is_there_stays(self, cli, tmp_path):
        """It may be somebody's work."""
        path = tmp_path / "mine.yaml"
        path.write_text("kind: assembly\n")
        assert "is there already. Name a new file." in cli("init", "--out", str(path)).refusal
        assert "kind: assembly\n" == path.read_text()

    @pytest.mark.parametrize(
        ("words", "message"),
        [
            (("asembly",), "Did you mean 'assembly'?"),
            (("--out", "mine.txt"), "end it in .yaml or .yml."),
            (("--out", "nowhere/mine.yaml"), "there is no folder nowhere."),
            (("--example", "gear_unti"), "Did you mean 'gear_unit'?"),
            (("--example", "sensor_stack"), "needs meshes/hexagonal_coil.obj. Give --out FILE."),
        ],
    )
    def test_what_cannot_be_is_refused(self, cli, words, message):
        """In one message."""
        assert message in cli("init", *words).refusal

    def test_an_example_brings_its_meshes_and_no_figures_of_tests(self, cli, tmp_path):
        """It is valid where it is written; a mesh of others stays."""
        path = tmp_path / "mine.yaml"
        told = cli("init", "--example", "sensor_stack", "--out", str(path)).out
        assert "the example sensor_stack, with 1 other file. Next:" in told
        assert 0 == cli("check", str(path), "--collision", "aabb").code
        assert "expect:" not in path.read_text("utf-8")
        mesh = tmp_path / "meshes" / "hexagonal_coil.obj"
        mesh.write_text("mine")
        other = ("init", "--example", "sensor_stack", "--out", str(tmp_path / "other.yaml"))
        assert "hexagonal_coil.obj is there already." in cli(*other).refusal
        assert "mine" == mesh.read_text()


@pytest.fixture(scope="module")
def warm():
    """All kernels are compiled, once for the tests that need them."""
    with contextlib.redirect_stdout(io.StringIO()), pytest.raises(SystemExit):
        main(["warm-up"])


class TestWarmUp:
    def test_it_tells_of_every_step_and_what_was_compiled(self, cli, monkeypatch):
        """Progress on stderr, one line on stdout."""
        steps = [("this", lambda: kernels.notify("a")), ("that", lambda: kernels.notify("b"))]
        monkeypatch.setattr(warm_up, "warm_up_steps", lambda: iter(steps))
        outcome = cli("warm-up")
        assert 0 == outcome.code
        assert ["compiling 1 of 2: this", "compiling 2 of 2: that"] == outcome.err.splitlines()
        assert outcome.out.startswith("2 kernels compiled in ")

    @pytest.mark.slow(
        reason="warms up twice; every run asks once whether all solvers find their kernels"
    )
    @pytest.mark.usefixtures("warm")
    def test_a_second_time_nothing_is_left(self, cli):
        """What is kept is loaded."""
        assert "nothing to compile: all kernels are kept already\n" == cli("warm-up").out

    @pytest.mark.slow(
        reason="learns with nine solvers; every run tells of kernels that are compiled"
    )
    @pytest.mark.usefixtures("warm")
    def test_all_solvers_find_their_kernels(self, cli, board):
        """On a board, with and without chance, and on a bench."""
        messages: list[str] = []
        done = kernels.on_compilation(messages.append)
        grasps = board.replace("inverter_board", "inverter_grasps")
        for task, solvers in {
            board: "value-iteration,policy-iteration,q-learning,sarsa,monte-carlo,local-search",
            grasps: "value-iteration,policy-iteration,q-learning,sarsa,monte-carlo",
        }.items():
            cli("compare", task, "--solvers", solvers)
        done()
        assert [] == messages


class TestNotice:
    @pytest.mark.slow(reason="compiles kernels in a process; every run tells of them in this one")
    def test_a_terminal_is_told_once(self):
        """Of several kernels in one line on stderr, and nothing on stdout."""
        far, near = pty.openpty()
        command = [sys.executable, "-c", COMPILING]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=near, check=True)
        os.close(near)
        shown = os.read(far, 4096).decode()
        os.close(far)
        assert b"" == done.stdout
        assert [NOTICE] == shown.splitlines()

    def test_nobody_else_is(self, capsys):
        """A log is no terminal."""
        with announce_compilation():
            kernels.notify("kernel")
        assert ("", "") == tuple(capsys.readouterr())
