"""Files that are there whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest

from skillplan.files import (
    atomic_file,
    is_unfinished,
    make_folder,
    replace_file,
    sync_folder,
    write_beside,
    write_new,
    write_whole,
)


def test_what_was_there_is_replaced(tmp_path):
    """By text or bytes, and nothing else is left in the folder."""
    path = tmp_path / "file"
    write_whole(path, "früher")
    assert "früher".encode() == path.read_bytes()
    write_whole(path, b"now")
    assert b"now" == path.read_bytes()
    assert [path] == list(tmp_path.iterdir())


def test_a_failure_leaves_the_old_content_and_nothing_beside(tmp_path):
    """Half of the new content had been written."""
    path = tmp_path / "file"
    path.write_text("old")

    def half() -> None:
        with replace_file(path) as file:
            file.write(b"ne")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OSError, match="No space"):
        half()
    assert "old" == path.read_text()
    assert [path] == list(tmp_path.iterdir())


def test_a_failure_to_force_it_to_disk_leaves_the_old_content(tmp_path, monkeypatch):
    """What is not on disk takes nothing's place."""
    path = tmp_path / "file"
    path.write_text("old")

    def failing(descriptor: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", failing)
    with pytest.raises(OSError, match="Input/output"):
        write_whole(path, "new")
    assert "old" == path.read_text()
    assert [path] == list(tmp_path.iterdir())


def test_file_and_folder_are_forced_to_disk_in_this_order(tmp_path, monkeypatch):
    """The file before it takes the other's place, the folder afterwards."""
    seen: list[str] = []
    sync, replace = os.fsync, os.replace

    def noted_sync(descriptor: int) -> None:
        kind = "folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file"
        seen.append(kind)
        sync(descriptor)

    def noted_replace(source: Path, target: Path) -> None:
        seen.append("replace")
        replace(source, target)

    monkeypatch.setattr(os, "fsync", noted_sync)
    monkeypatch.setattr(os, "replace", noted_replace)
    write_whole(tmp_path / "file", "new")
    assert ["file", "replace", "folder"] == seen
    seen.clear()
    with write_beside(tmp_path / "other") as temporary:
        temporary.write_text("by another program")
    assert ["file", "replace", "folder"] == seen


def test_file_systems_that_cannot_sync_folders_do_not_matter(tmp_path, monkeypatch):
    """But a disk that fails does."""

    def failing(number: int) -> None:
        def sync(descriptor: int) -> None:
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr(os, "fsync", sync)

    failing(errno.EINVAL)
    sync_folder(tmp_path)
    failing(errno.EIO)
    with pytest.raises(OSError, match="Input/output"):
        sync_folder(tmp_path)


def test_nothing_that_is_there_is_taken_for_the_temporary_file(tmp_path, monkeypatch):
    """A link of its name least of all: where it leads is not written to."""
    (tmp_path / "precious").write_text("precious")
    name = tmp_path / ".file.00.tmp"
    name.symlink_to("precious")
    monkeypatch.setattr(atomic_file, "_temporary_name", lambda path: name)
    with pytest.raises(FileExistsError):
        write_whole(tmp_path / "file", "new")
    assert "precious" == (tmp_path / "precious").read_text()
    assert name.is_symlink()


def test_two_temporary_files_have_two_names(tmp_path):
    """So that two programs may replace one file; the last one wins."""
    path = tmp_path / "file"
    with replace_file(path) as first, replace_file(path) as second:
        first.write(b"first")
        second.write(b"second")
    assert b"first" == path.read_bytes()


def test_a_long_name_leaves_room_for_the_temporary_file(tmp_path):
    """A name may have 255 bytes."""
    path = tmp_path / ("ä" * 127)
    write_whole(path, "content")
    assert "content" == path.read_text()


def test_a_link_is_replaced_itself(tmp_path):
    """What it leads to stays as it is."""
    (tmp_path / "target").write_text("target")
    (tmp_path / "link").symlink_to("target")
    write_whole(tmp_path / "link", "new")
    assert "target" == (tmp_path / "target").read_text()
    assert "new" == (tmp_path / "link").read_text()
    assert not (tmp_path / "link").is_symlink()


def test_nothing_is_written_through_a_link_out_of_the_folder(tmp_path):
    """Of a folder that somebody else has sent."""
    folder, outside = tmp_path / "folder", tmp_path / "outside"
    folder.mkdir()
    outside.mkdir()
    (folder / "runs").symlink_to(outside, target_is_directory=True)
    with pytest.raises(OSError, match="a link leads out of the folder"):
        write_whole(folder / "runs" / "policy.json", "{}", within=folder)
    assert [] == list(outside.iterdir())


def test_no_folder_is_made_through_such_a_link(tmp_path):
    """Within the folder it is."""
    folder, outside = tmp_path / "folder", tmp_path / "outside"
    folder.mkdir()
    outside.mkdir()
    (folder / "runs").symlink_to(outside, target_is_directory=True)
    with pytest.raises(OSError, match="a link leads out of the folder"):
        make_folder(folder / "runs" / "00", within=folder)
    assert [] == list(outside.iterdir())
    make_folder(folder / "groups" / "0", within=folder)
    assert (folder / "groups" / "0").is_dir()


def test_the_mode_of_a_new_file_is_the_users_choice(tmp_path):
    """Not that of a private temporary file."""
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "file", "")
    finally:
        os.umask(before)
    assert 0o640 == stat.S_IMODE((tmp_path / "file").stat().st_mode)


@pytest.mark.parametrize(
    ("name", "of", "expected"),
    [
        (".manifest.json.0f3a.tmp", None, True),
        (".manifest.json.0f3a.tmp", "manifest.json", True),
        (".manifest.json.4711.tmp", "manifest.json", True),
        (".manifest.json.0f3a.tmp", "other.json", False),
        ("manifest.json", None, False),
        (".notes.tmp", None, False),
        ("thesis.tmp", None, False),
    ],
)
def test_what_a_killed_program_left_is_known_by_its_name(name, of, expected):
    """That of earlier versions, with the number of a process, too; a user's files are not."""
    assert expected == is_unfinished(name, of)


def test_what_is_being_written_has_such_a_name(tmp_path):
    """Until it has taken its place."""
    with write_beside(tmp_path / "video.mp4") as temporary:
        assert is_unfinished(temporary.name, "video.mp4")
        assert tmp_path == temporary.parent


@pytest.fixture(params=["links", "no links"])
def _system(request, monkeypatch):
    """A file system with hard links, and one without."""
    if request.param == "no links":

        def refused(source: Path, target: Path) -> None:
            raise OSError(errno.EPERM, os.strerror(errno.EPERM))

        monkeypatch.setattr(os, "link", refused)


@pytest.mark.usefixtures("_system")
class TestNewFiles:
    def test_it_is_there_whole_and_nothing_beside_it(self, tmp_path):
        """As where another is replaced."""
        path = tmp_path / "file"
        write_new(path, "früher")
        assert "früher".encode() == path.read_bytes()
        assert [path] == list(tmp_path.iterdir())

    @pytest.mark.parametrize("dangling", [False, True])
    def test_what_is_there_stays(self, tmp_path, dangling):
        """Be it a link that leads nowhere."""
        path = tmp_path / "file"
        if dangling:
            path.symlink_to(tmp_path / "nowhere")
        else:
            path.write_text("old")
        with pytest.raises(FileExistsError):
            write_new(path, "new")
        assert [path] == list(tmp_path.iterdir())
        assert path.is_symlink() if dangling else "old" == path.read_text()

    def test_one_of_many_programs_writes_it(self, tmp_path):
        """All begin at once; the others are told, and the file is that of the one."""
        path = tmp_path / "file"
        gate = threading.Barrier(8)

        def write(text: str) -> str | None:
            gate.wait()
            with suppress(FileExistsError):
                write_new(path, text * 100_000)
                return text
            return None

        with ThreadPoolExecutor(8) as pool:
            written = [text for text in pool.map(write, "abcdefgh") if text is not None]
        assert [path.read_text()] == [text * 100_000 for text in written]
        assert [path] == list(tmp_path.iterdir())
