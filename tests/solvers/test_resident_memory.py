"""How much memory the process holds."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from skillplan.workers import measure_resident_bytes, measure_resident_bytes_of, processes

MIB = 1024**2


def test_it_grows_with_what_is_held():
    """By about as much as was written to; in a process without threads of other tests."""
    words = (
        "from skillplan.workers import measure_resident_bytes as measure; before = measure(); "
        f"held = bytearray(b'x' * {64 * MIB}); print(measure() - before, len(held))"
    )
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    grown, held = map(int, done.stdout.split())
    assert 60 * MIB < grown < 80 * MIB
    assert held == 64 * MIB


def test_where_there_is_no_process_file_system_the_largest_size_stands_for_it(monkeypatch):
    """It is never less."""
    now = measure_resident_bytes()
    monkeypatch.setattr(processes, "_STATM", Path("no/such/file"))
    assert measure_resident_bytes() > 0.9 * now


def test_of_another_process_it_is_what_that_process_says_itself():
    """By a few pages; of one that is gone it is unknown."""
    if not Path("/proc/self/statm").exists():
        assert measure_resident_bytes_of(os.getpid()) is None
        return
    words = "import sys; held = bytearray(b'x' * 2**27); print(flush=True); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", words], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        held = measure_resident_bytes_of(other.pid)
        assert held is not None
        assert 128 * MIB < held < 192 * MIB
        other.kill()
    assert measure_resident_bytes_of(other.pid) is None


def test_where_the_system_tells_nothing_it_is_unknown(monkeypatch):
    """Not zero."""
    monkeypatch.setattr(processes, "_STATM", Path("no/such/file"))
    monkeypatch.setitem(sys.modules, "resource", None)
    assert measure_resident_bytes() is None


@pytest.mark.parametrize("text", ["", "12", "a b c"])
def test_a_process_file_that_cannot_be_read_is_left_alone(monkeypatch, tmp_path, text):
    """The largest size is taken instead."""
    (tmp_path / "statm").write_text(text)
    monkeypatch.setattr(processes, "_STATM", tmp_path / "statm")
    assert measure_resident_bytes() > 10 * MIB
