"""Event files of TensorBoard, a record a time.

The format is that of TensorFlow: a length, the record and their masked CRC-32C; a record is the
protocol buffer message ``Event``, of which four fields are needed. Written here because a file
must be cut at a checkpoint and go on from there byte for byte in length, and because what writes
such files elsewhere does so in a thread and loads a learning library that the core goes without.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

_MASK_ADDED = 0xA282EAD8
_POLYNOMIAL = 0x82F63B78
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def opening_record(wall_s: float) -> bytes:
    """Return the record that every event file begins with."""
    return _framed(_double(1, wall_s) + _delimited(3, b"brain.Event:2"))


def scalars_record(wall_s: float, step: int, scalars: Mapping[str, float]) -> bytes:
    """Return the record of some figures.

    Parameters
    ----------
    wall_s
        Time since the epoch [s].
    step
        Environment steps done, >= 0.
    scalars
        Figures by tag; single precision is kept of them.
    """
    values = b"".join(
        _delimited(1, _delimited(1, tag.encode()) + _float(2, value))
        for tag, value in scalars.items()
    )
    return _framed(_double(1, wall_s) + _key(2, _VARINT) + _varint(step) + _delimited(5, values))


def _framed(record: bytes) -> bytes:
    length = struct.pack("<Q", len(record))
    checks = [struct.pack("<I", _masked_crc(part)) for part in (length, record)]
    return length + checks[0] + record + checks[1]


def _key(field: int, kind: int) -> bytes:
    return _varint(field << 3 | kind)


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _double(field: int, value: float) -> bytes:
    return _key(field, _FIXED64) + struct.pack("<d", value)


def _float(field: int, value: float) -> bytes:
    return _key(field, _FIXED32) + struct.pack("<f", value)


def _delimited(field: int, content: bytes) -> bytes:
    return _key(field, _BYTES) + _varint(len(content)) + content


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        rest = byte
        for _ in range(8):
            rest = rest >> 1 ^ (_POLYNOMIAL if rest & 1 else 0)
        table.append(rest)
    return tuple(table)


_TABLE = _crc_table()


def _masked_crc(data: bytes) -> int:
    crc = 0xFFFFFFFF
    for byte in data:
        crc = _TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + _MASK_ADDED) & 0xFFFFFFFF
