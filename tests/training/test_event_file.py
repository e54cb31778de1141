"""Event files are what TensorBoard reads."""

from __future__ import annotations

import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.training import make_opening_record, make_scalars_record


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
