"""What is opened and read at all."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from skillplan.errors import OptionError
from skillplan.files import (
    FolderLock,
    GrowingFile,
    RefusedFile,
    open_regular,
    read_bytes,
    resolve_within,
)


@pytest.fixture
def folder(tmp_path):
    """A folder with a file, beside a file that is nobody's business."""
    created = tmp_path / "mine"
    (created / "deep").mkdir(parents=True)
    (created / "deep" / "file").write_bytes(b"mine")
    (tmp_path / "secret").write_bytes(b"secret")
    return created


class TestLimits:
    def test_a_file_of_just_the_limit_is_read(self, tmp_path):
        """Whole."""
        path = tmp_path / "file"
        path.write_bytes(b"x" * 1000)
        assert b"x" * 1000 == read_bytes(path, 1000)

    def test_one_byte_more_is_refused_in_words(self, tmp_path):
        """With the limit."""
        path = tmp_path / "file"
        path.write_bytes(b"x" * 1001)
        with pytest.raises(RefusedFile) as refused:
            read_bytes(path, 1000)
        assert "large" == refused.value.why
        assert "it is larger than the 1,000 bytes that it may have" == refused.value.strerror

    def test_a_huge_file_is_refused_unread(self, tmp_path):
        """By its size: a terabyte without content costs nothing."""
        path = tmp_path / "file"
        path.touch()
        os.truncate(path, 2**40)
        with pytest.raises(RefusedFile, match="larger"):
            read_bytes(path, 1000)

    def test_a_file_that_does_not_tell_its_size_is_read_to_its_end(self):
        """As those of the process file system."""
        path = Path("/proc/self/status")
        if not path.exists():
            pytest.skip("no process file system")
        assert 0 == path.stat().st_size
        assert read_bytes(path, 1_000_000).startswith(b"Name:")
        with pytest.raises(RefusedFile, match="larger"):
            read_bytes(path, 10)

    def test_an_empty_file_is_empty(self, tmp_path):
        """Even where nothing may be read."""
        path = tmp_path / "file"
        path.touch()
        assert b"" == read_bytes(path, 0)


class TestKinds:
    def test_a_pipe_is_refused_and_not_waited_for(self, tmp_path):
        """Nobody writes into it."""
        path = tmp_path / "pipe"
        os.mkfifo(path)
        with pytest.raises(RefusedFile, match="it is no regular file"):
            read_bytes(path, 10)

    @pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "/dev/tty"])
    def test_a_device_is_refused(self, device):
        """One of them never ends."""
        if not Path(device).exists():
            pytest.skip("there is no such device")
        with pytest.raises(RefusedFile, match="it is no regular file"):
            read_bytes(device, 10)

    def test_a_socket_is_refused(self, tmp_path, monkeypatch):
        """As it is no regular file."""
        monkeypatch.chdir(tmp_path)
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind("socket")
            with pytest.raises(RefusedFile, match="it is no regular file"):
                read_bytes("socket", 10)

    def test_a_folder_is_refused(self, tmp_path):
        """In words of its own."""
        with pytest.raises(RefusedFile, match="it is a folder"):
            read_bytes(tmp_path, 10)

    def test_a_link_to_a_device_is_refused(self, tmp_path):
        """What counts is what is opened."""
        path = tmp_path / "link"
        path.symlink_to("/dev/zero")
        with pytest.raises(RefusedFile, match="it is no regular file"):
            read_bytes(path, 10)

    def test_a_pipe_is_not_appended_to(self, tmp_path):
        """Nor is one waited for that nobody reads."""
        path = tmp_path / "pipe"
        os.mkfifo(path)
        with pytest.raises(RefusedFile, match="it is no regular file"):
            open_regular(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)

    def test_what_is_missing_is_missing(self, tmp_path):
        """That error is Python's."""
        with pytest.raises(FileNotFoundError):
            read_bytes(tmp_path / "none", 10)

    def test_a_name_that_no_file_can_have_is_an_error_of_the_system(self):
        """So that whoever reads needs to know of one kind of error only."""
        with pytest.raises(OSError, match="null"):
            read_bytes("a\0b", 10)


class TestFolders:
    def test_a_file_in_the_folder_is_read(self, folder):
        """However deep."""
        assert b"mine" == read_bytes(folder / "deep" / "file", 10, within=folder)

    def test_a_link_that_stays_in_the_folder_is_refused_as_well(self, folder):
        """To a file and to a folder: what writes to one file must not change another."""
        (folder / "link").symlink_to("deep/file")
        (folder / "way").symlink_to("deep", target_is_directory=True)
        for path in (folder / "link", folder / "way" / "file"):
            with pytest.raises(RefusedFile, match="there is a link on the way to it"):
                read_bytes(path, 10, within=folder)
        assert folder / "deep" / "file" == resolve_within(folder / "link", folder)

    @pytest.mark.parametrize("target", ["../secret", "/dev/zero"])
    def test_a_link_that_leads_out_of_the_folder_is_refused(self, folder, target):
        """Whether it is relative or not."""
        (folder / "link").symlink_to(target)
        with pytest.raises(RefusedFile, match="a link leads out of the folder"):
            read_bytes(folder / "link", 10, within=folder)

    def test_a_folder_that_is_such_a_link_is_refused(self, folder):
        """The file itself is none."""
        (folder / "out").symlink_to("..", target_is_directory=True)
        with pytest.raises(RefusedFile, match="a link leads out of the folder"):
            read_bytes(folder / "out" / "secret", 10, within=folder)

    def test_so_are_two_dots(self, folder):
        """Without any link."""
        with pytest.raises(RefusedFile):
            read_bytes(folder / ".." / "secret", 10, within=folder)

    def test_the_folder_may_be_a_link_itself(self, folder):
        """What the user named is the folder."""
        (folder.parent / "alias").symlink_to("mine", target_is_directory=True)
        alias = folder.parent / "alias"
        assert b"mine" == read_bytes(alias / "deep" / "file", 10, within=alias)

    def test_a_link_put_there_after_the_look_is_not_followed(self, folder, monkeypatch):
        """Every step of the path is opened without following links."""
        real = os.path.realpath
        (folder / "deep" / "file").unlink()
        (folder / "deep" / "file").symlink_to("../../secret")

        def deceived(path: os.PathLike[str]) -> str:
            result = str(path)
            return result if result.endswith("file") else real(path)

        monkeypatch.setattr(os.path, "realpath", deceived)
        with pytest.raises(OSError, match="symbolic links"):
            read_bytes(folder / "deep" / "file", 10, within=folder)

    def test_nothing_is_made_outside_the_folder(self, folder):
        """Not even where the link's target is missing."""
        (folder / "link").symlink_to("../new")
        with pytest.raises(RefusedFile, match="a link leads out of the folder"):
            open_regular(folder / "link", os.O_WRONLY | os.O_CREAT, within=folder)
        assert not (folder.parent / "new").exists()

    def test_a_neighbour_whose_name_begins_alike_is_outside(self, folder):
        """Names are compared by steps, not by letters."""
        other = folder.with_name("mine-too")
        other.mkdir()
        with pytest.raises(RefusedFile):
            resolve_within(other / "file", folder)


# One writer a folder.


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


# Files that grow by whole records.


def test_records_are_appended_and_what_was_there_stays(tmp_path):
    """Each is on its way to the disk at once, without a buffer."""
    path = tmp_path / "lines"
    path.write_bytes(b"one\n")
    file = GrowingFile(path, tmp_path)
    file.append(b"two\n")
    assert b"one\ntwo\n" == path.read_bytes()
    assert 8 == file.length
    file.close()


def test_it_goes_on_where_it_was_cut(tmp_path):
    """A piece of a record is gone."""
    file = GrowingFile(tmp_path / "lines", tmp_path)
    file.append(b"one\ntw")
    file.cut(4)
    file.append(b"three\n")
    file.sync()
    file.close()
    assert b"one\nthree\n" == (tmp_path / "lines").read_bytes()


def test_a_link_out_of_the_folder_is_neither_cut_nor_appended_to(tmp_path):
    """Of a folder that somebody else has sent."""
    (tmp_path / "precious").write_text("precious")
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "lines").symlink_to("../precious")
    with pytest.raises(OSError, match="a link leads out of the folder"):
        GrowingFile(folder / "lines", folder)
    assert "precious" == (tmp_path / "precious").read_text()
