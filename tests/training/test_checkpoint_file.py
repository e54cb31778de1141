"""Checkpoints: whole or not at all, and never trusted without a look."""

from __future__ import annotations

import json
import re
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of

from skillplan.errors import OptionError
from skillplan.solvers import Snapshot
from skillplan.training import (
    Checkpoint,
    make_opening_record,
    make_scalars_record,
    read_checkpoint,
    write_checkpoint,
)

NOTES = {"chance": {"state": 2**127, "words": ["a", "ä"]}, "none": None}
KEPT = Checkpoint(
    700,
    {"runs/00/metrics.jsonl": 12},
    Snapshot(
        {
            "weights": np.arange(6, dtype=np.float32).reshape(2, 3),
            "done": np.array([True, False]),
            "nothing": np.zeros((0, 4), dtype=np.int64),
            "count": np.array(7, dtype=np.int64),
        },
        NOTES,
    ),
)


def read(path: Path) -> Checkpoint:
    checkpoint = read_checkpoint(path)
    assert checkpoint is not None
    return checkpoint


def test_what_was_kept_is_what_is_read(tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    write_checkpoint(path, KEPT)
    content = read(path)
    assert (KEPT.steps, KEPT.lengths, NOTES) == (
        content.steps,
        content.lengths,
        content.snapshot.notes,
    )
    assert KEPT.snapshot.arrays.keys() == content.snapshot.arrays.keys()
    for name, array in KEPT.snapshot.arrays.items():
        there = content.snapshot.arrays[name]
        assert (array.dtype, array.shape) == (there.dtype, there.shape)
        assert np.array_equal(array, there)
        assert there.flags.writeable


@given(
    arrays_of.arrays(
        st.sampled_from([np.float32, np.float64, np.int64, np.uint8, np.bool_]),
        arrays_of.array_shapes(max_dims=3, min_side=0, max_side=4),
    )
)
def test_any_array_comes_back_bit_for_bit(tmp_path_factory, array):
    path = tmp_path_factory.mktemp("any") / "checkpoint.safetensors"
    write_checkpoint(path, Checkpoint(1, {}, Snapshot({"one": array, "turned": array.T}, {})))
    result = read(path).snapshot.arrays
    assert array.tobytes() == result["one"].tobytes()
    assert array.T.tobytes() == result["turned"].tobytes()


def test_the_same_content_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        write_checkpoint(tmp_path / name, KEPT)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_without_a_file_there_is_no_checkpoint(tmp_path):
    assert read_checkpoint(tmp_path / "checkpoint.safetensors") is None


def test_every_cut_and_every_changed_byte_is_one_clear_error(tmp_path):
    path = tmp_path / "checkpoint.safetensors"
    write_checkpoint(path, KEPT)
    whole = path.read_bytes()

    def damaged(content: bytes) -> Path:
        # A new file each time: a disk is waited for where one is cut to nothing and written again.
        path.unlink()
        path.write_bytes(content)
        return path

    for length in range(len(whole)):
        with pytest.raises(OptionError, match=r"is damaged: .*Delete it, and --resume begins"):
            read_checkpoint(damaged(whole[:length]))
    for at in range(len(whole)):
        changed = whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :]
        with pytest.raises(OptionError, match=re.escape(str(path))):
            read_checkpoint(damaged(changed))


def test_a_checkpoint_of_another_version_is_named(tmp_path, monkeypatch):
    path = tmp_path / "checkpoint.safetensors"
    with monkeypatch.context() as patch:
        patch.setattr("skillplan.records.schemas.CHECKPOINT", "skillplan.checkpoint/2")
        write_checkpoint(path, KEPT)
    with pytest.raises(OptionError, match=r"another version, skillplan.checkpoint/2"):
        read_checkpoint(path)


def test_a_write_that_fails_leaves_the_checkpoint_before(tmp_path, monkeypatch):
    path = tmp_path / "checkpoint.safetensors"
    write_checkpoint(path, KEPT)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", full)
        with pytest.raises(OSError, match="No space left"):
            write_checkpoint(path, Checkpoint(800, {}, Snapshot({}, {})))
    assert 700 == read(path).steps
    assert ["checkpoint.safetensors"] == [item.name for item in tmp_path.iterdir()]


def test_notes_that_are_no_json_are_refused(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_checkpoint(tmp_path / "a", Checkpoint(1, {}, Snapshot({}, {"x": float("nan")})))
    assert [] == list(tmp_path.iterdir())
    assert json.dumps(NOTES)


class TestASparseFile:
    """It takes no room on disk, and in memory all that it claims."""

    SIZE = 512 * 1024**2

    def refused(self, path: Path, begins: bytes) -> str:
        """Return what is said of such a file, for which nothing is allocated."""
        with path.open("wb") as file:
            file.write(begins)
            file.truncate(self.SIZE)
        tracemalloc.start()
        try:
            with pytest.raises(OptionError) as caught:
                read_checkpoint(path)
            assert tracemalloc.get_traced_memory()[1] < self.SIZE / 100
        finally:
            tracemalloc.stop()
        return str(caught.value)

    def test_that_has_no_header_is_damaged(self, tmp_path):
        assert "is damaged" in self.refused(tmp_path / "a", b"")
        assert "longer than the file" in self.refused(tmp_path / "a", b"\xff" * 8)

    def test_whose_header_accounts_for_less_is_damaged(self, tmp_path):
        path = tmp_path / "a"
        write_checkpoint(path, KEPT)
        message = self.refused(path, path.read_bytes())
        assert re.search(r"is damaged: its header accounts for \d+ bytes, not for 53\d,", message)

    def test_for_which_there_is_no_room_is_told_so(self, tmp_path, monkeypatch):
        """Though its header accounts for all of it."""
        begins = self.begins()
        room = "skillplan.training.run_files.get_available_bytes"
        monkeypatch.setattr(room, lambda: 2 * (self.SIZE - len(begins)) - 1)
        message = self.refused(tmp_path / "a", begins)
        assert "its arrays take more memory than the 1,07" in message
        assert message.endswith("Resume where there is more.")

    def begins(self) -> bytes:
        """Return the length of a header, and the header of an array that takes all the rest."""
        end = self.SIZE
        for _ in range(3):
            array = {"dtype": "U8", "shape": [end], "data_offsets": [0, end]}
            header = json.dumps({"a": array}).encode()
            end = self.SIZE - 8 - len(header)
        return len(header).to_bytes(8, "little") + header


# Event files are what TensorBoard reads.


def events(content: bytes) -> list[Any]:
    """Read records with somebody else's message and somebody else's checksum."""
    # Importing it takes seconds, which only who runs these tests shall wait for.
    from tensorboardX.proto.event_pb2 import Event
    from tensorboardX.record_writer import masked_crc32c

    results = []
    while content:
        (length,) = struct.unpack("<Q", content[:8])
        record = content[12 : 12 + length]
        for part, check in (
            (content[:8], content[8:12]),
            (record, content[12 + length : 16 + length]),
        ):
            assert struct.unpack("<I", check)[0] == masked_crc32c(part)
        results.append(Event.FromString(record))
        content = content[16 + length :]
    return results


def test_the_file_begins_with_its_version():
    (first,) = events(make_opening_record(12.5))
    assert (12.5, "brain.Event:2") == (first.wall_time, first.file_version)


@given(
    st.floats(0, 2e9),
    st.integers(0, 2**40),
    st.dictionaries(st.text(max_size=200), st.floats(width=32, allow_nan=False), max_size=20),
)
def test_every_figure_is_read_as_it_was_written(wall_s, step, scalars):
    (item,) = events(make_scalars_record(wall_s, step, scalars))
    assert (wall_s, step) == (item.wall_time, item.step)
    assert scalars == {value.tag: value.simple_value for value in item.summary.value}


def test_records_follow_each_other():
    content = make_opening_record(0.0) + make_scalars_record(0.0, 300, {"loss": 0.5})
    assert [0, 300] == [event.step for event in events(content)]


def test_a_record_has_the_same_length_whatever_the_clock_says():
    lengths = {len(make_scalars_record(wall_s, 5, {"a": 1.0})) for wall_s in (0.0, 1.7e9, 1e-300)}
    assert 1 == len(lengths)
    assert pytest.approx(1.7e9) == events(make_opening_record(1.7e9))[0].wall_time
