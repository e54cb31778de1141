"""Shell completion, driven as a shell drives it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from skillplan.cli import COMMANDS

ROOT = Path(__file__).parents[2]


@pytest.fixture
def complete(cli, monkeypatch, tmp_path):
    """Completes the last word of a line, in a folder with the configs and one file beside."""
    shutil.copytree(ROOT / "configs", tmp_path / "configs")
    (tmp_path / "mine.yaml").write_text("kind: assembly\n")
    monkeypatch.chdir(tmp_path)

    def ask(line: str) -> list[str]:
        words = line.split(" ")
        monkeypatch.setenv("_SKILLPLAN_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
        outcome = cli()
        assert (0, "") == (outcome.code, outcome.err)
        return outcome.out.split()

    return ask


def test_commands(complete):
    """All of them, or those that begin so."""
    assert list(COMMANDS) == complete("skillplan ")
    assert ["check", "chart"] == sorted(complete("skillplan ch"), reverse=True)


def test_task_files(complete):
    """Those here and those in configs."""
    folder = Path(__file__).parents[2] / "configs"
    files = [path for ending in ("yaml", "sop") for path in sorted(folder.glob(f"*.{ending}"))]
    known = [f"configs/{path.name}" for path in files]
    assert {"configs/inverter_board.yaml", "configs/ESC12.sop"} < set(known)
    assert ["mine.yaml", *known] == complete("skillplan check ")
    assert ["configs/motor_drive.yaml"] == complete("skillplan search-optimal configs/mo")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("skillplan search-optimal mine.yaml --solver ex", ["exact", "exhaustive"]),
        ("skillplan compare mine.yaml --solvers exa", ["exact"]),
        ("skillplan compare mine.yaml --solvers exact,ex", ["exact,exhaustive"]),
        ("skillplan chart mine.yaml --collision a", ["aabb"]),
        ("skillplan check --format ", ["table", "json", "csv", "md"]),
        ("skillplan explain mine.yaml --collision aabb,pre", ["aabb,precedence"]),
        ("skillplan search-optimal mine.yaml --physics k", ["kinematic"]),
        ("skillplan search-optimal mine.yaml --physics au", ["auto"]),
        ("skillplan search-optimal mine.yaml --solver exact -O max", ["max_labels="]),
        ("skillplan search-optimal mine.yaml --solver exact -O exact.d", ["exact.dives="]),
        ("skillplan explain mine.yaml --collision aabb -O aabb.t", ["aabb.tolerance_m="]),
        ("skillplan search-optimal mine.yaml --solver nonsense -O x", []),
        ("skillplan plot mine.yaml gan", ["gantt"]),
        ("skillplan init s", ["sop", "swarmitfix"]),
        ("skillplan plugins c", ["collision"]),
        ("skillplan plugins collision aa", ["aabb"]),
        ("skillplan plugins nonsense ", []),
        ("skillplan schema a", ["assembly"]),
        ("skillplan evaluate mine.yaml --seq", ["--sequence"]),
    ],
)
def test_names_of_plugins_and_options(complete, line, expected):
    """What is installed, for each option that takes it; none twice after a comma."""
    assert expected == complete(line)


def test_a_plugin_just_installed_is_completed(complete, choosy_solver):
    """Names come from the entry points, without importing anything."""
    assert [choosy_solver] == complete("skillplan search-optimal mine.yaml --solver cho")


def test_skills_of_the_task_named_before(complete):
    """Read from the file on the line."""
    board = "configs/inverter_board.yaml"
    assert ["pick(switch_1)", "pick(switch_2)"] == complete(f"skillplan explain {board} pick(sw")
    assert 16 == len(complete(f"skillplan explain {board} "))


def test_a_wrong_file_completes_to_nothing(complete):
    """Completion never prints a fault into the line that is typed."""
    assert [] == complete("skillplan explain mine.yaml pick")
    assert [] == complete("skillplan explain nowhere.yaml pick")


def test_it_installs_itself(cli):
    """Two options of the group, which the help shows."""
    out = cli("--help").out
    assert "--install-completion" in out
    assert "--show-completion" in out


def test_bash_gets_its_script(cli, monkeypatch):
    """Which shell it is, Typer finds out; named in the environment it need not."""
    monkeypatch.setenv("_SKILLPLAN_COMPLETE", "source_zsh")
    assert "#compdef skillplan" in cli().out


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
@pytest.mark.parametrize("option", ["--show-completion", "--install-completion"])
def test_a_shell_is_set_up_with_exit_code_0(option, shell, tmp_path):
    """In a process of its own: Typer looks for the shell above it while it is imported."""
    told_by_name = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", option, shell],
        env={**os.environ, **told_by_name, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "skillplan" in done.stdout or list(tmp_path.rglob("*skillplan*"))


# Help is printed by rich without the parts of rich that it never shows.


def printed(before: str, *words: str) -> str:
    """Return the help that a fresh interpreter prints after a statement."""
    code = f"{before}\nfrom skillplan.cli.app import main\nmain({list(words)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


@pytest.mark.slow(reason="two processes; the help of every command in every run")
def test_it_looks_as_with_all_of_rich():
    """What is left out would have changed nothing."""
    whole = "import rich.markdown, rich.traceback, typer.rich_utils"
    assert printed(whole, "train", "--help") == printed("", "train", "--help")


def test_what_was_left_out_is_there_for_others():
    """A plugin that prints Markdown afterwards gets the real class."""
    code = (
        "from skillplan.cli import load_rich_utils\n"
        "load_rich_utils()\n"
        "from rich.markdown import Markdown\n"
        "from rich.console import Console\n"
        "Console(width=20).print(Markdown('# Title'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Title" in done.stdout
