"""One writer a folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from skillplan.errors import OptionError
from skillplan.files import FolderLock

HOLDER = """
import sys
from pathlib import Path
from skillplan.files.folder import FolderLock
lock = FolderLock(Path(sys.argv[1]), "training")
print("held", flush=True)
sys.stdin.read()
"""


def test_a_second_writer_is_refused_in_words_until_the_first_lets_go(tmp_path):
    """And no file is made in the folder."""
    first = FolderLock(tmp_path, "study")
    with pytest.raises(OptionError, match="another study is writing there just now"):
        FolderLock(tmp_path, "study")
    assert [] == list(tmp_path.iterdir())
    first.release()
    FolderLock(tmp_path, "study").release()


def test_a_lock_of_a_killed_process_does_not_block(tmp_path):
    """While it lived it did."""
    words = [sys.executable, "-c", HOLDER, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert b"held\n" == holder.stdout.readline()
        with pytest.raises(OptionError, match="another training"):
            FolderLock(tmp_path, "training")
        os.kill(holder.pid, signal.SIGKILL)
        FolderLock(tmp_path, "training", patience_s=20).release()


def test_where_there_are_no_locks_nobody_is_kept_out(tmp_path, monkeypatch):
    """Neither every system nor every file system has them."""

    def none(descriptor: int, *, blocking: bool) -> bool:
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr("skillplan.files.folder.lock_descriptor", none)
    first, second = FolderLock(tmp_path, "study"), FolderLock(tmp_path, "study")
    first.release()
    second.release()
