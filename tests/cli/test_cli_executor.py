"""`--executor`: where the processes of `--jobs` are."""

from __future__ import annotations

from typing import Any

import pytest


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
def test_a_wrong_one_is_refused_before_anything_is_done(
    cli: Any, board: str, command: str, words: list[str], message: str
) -> None:
    """In one line, by every command that has jobs."""
    more = ["--solvers", "exact"] if command == "compare" else []
    outcome = cli(*command.split(), board, *more, *words)
    assert 2 == outcome.code
    assert message in outcome.err
