"""Signals that come while Ray starts."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ray_clusters import PATIENCE_S
from skillplan_ray import signals_held

ORDERING = Path(__file__).parents[3] / "tests" / "instances" / "sop" / "ESC47.sop"
# In so long all are gone once the command has ended [s].
GONE_S = 2.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_amid_the_start_is_heard_once_that_is_over(number):
    """By whoever hears it, as often as it came."""
    heard: list[int] = []
    before = signal.signal(number, lambda first, _: heard.append(first))
    try:
        with signals_held():
            signal.raise_signal(number)
            # As Ray does in its start.
            signal.signal(number, signal.SIG_DFL)
            assert heard == []
        assert heard == [number]
        signal.raise_signal(number)
        assert heard == [number] * 2
    finally:
        signal.signal(number, before)


def of_session(leader: int) -> list[int]:
    """Return the processes of a session."""
    results = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == leader and fields[0] != "Z":
            results.append(int(path.parent.name))
    return results


def words_of(process: int) -> bytes:
    """Return the command line of a process, empty once that is gone."""
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return b""


@pytest.mark.release(reason="breaks off a start of Ray; held signals in every run")
@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
def test_ctrl_c_twice_amid_the_start_leaves_no_process():
    """Not even those that Ray's own processes have started."""
    words = ["search-optimal", str(ORDERING), "--solver", "portfolio", "--jobs", "2"]
    search = subprocess.Popen(
        [sys.executable, "-m", "skillplan", *words, "--executor", "ray"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    end_s = time.monotonic() + PATIENCE_S
    while not any(b"/agent.py\0" in words_of(process) for process in of_session(search.pid)):
        assert time.monotonic() < end_s
        assert search.poll() is None
        time.sleep(0.05)
    for _ in range(2):
        os.kill(search.pid, signal.SIGINT)
        time.sleep(0.3)
    _, err = search.communicate(timeout=PATIENCE_S)
    assert search.returncode == 130, err
    end_s = time.monotonic() + GONE_S
    while of_session(search.pid) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert of_session(search.pid) == []
