"""Help is printed by rich without the parts of rich that it never shows."""

from __future__ import annotations

import subprocess
import sys

import pytest


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
