"""PyTorch asks for the current folder while it is imported: one that is gone is told of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

BOARD = Path(__file__).parents[3] / "configs" / "inverter_board.yaml"


@pytest.mark.slow(reason="imports PyTorch in a process; other solvers there in test_cli_outward")
@pytest.mark.parametrize("command", ["search-optimal", "train"])
def test_a_vanished_current_folder_is_one_message(command, tmp_path):
    """What to do is in it, and the exit code is that of wrong input."""
    script = 'cd "$0" && rmdir "$0" && exec "$@"'
    words = [sys.executable, "-m", "skillplan", command, str(BOARD), "--solver", "dqn"]
    gone = tmp_path / "gone"
    gone.mkdir()
    # An empty entry stands for the current folder, without which Python itself does not start.
    path = os.pathsep.join(entry for entry in sys.path if entry)
    done = subprocess.run(
        ["bash", "-c", script, str(gone), *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("skillplan: error: The solver 'dqn' ")
    assert done.stderr.endswith(
        "the current folder is gone, and PyTorch needs one; change to a folder that exists\n"
    )
