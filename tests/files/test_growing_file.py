"""Files that grow by whole records."""

import pytest

from skillplan.files import GrowingFile


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
