"""Files of arrays (safetensors), read only if their header accounts for every byte.

A sparse file takes no space on disk but all its size in memory. So its arrays must be as long as
stated in the header, and fit in memory, before any is allocated.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from numpy.typing import NDArray

from skillplan.errors import OptionError
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import RefusedFile, open_regular, read_rest

Built = TypeVar("Built")

# Longest header that the parser of safetensors accepts.
_MOST_HEADER_BYTES = 100_000_000
_LENGTH_BYTES = 8
# Copies of the arrays in memory during reading: the file's, and the parsed ones.
_COPIES = 2


def read_safetensors(
    path: str | os.PathLike[str],
    most_bytes: int,
    *,
    room_bytes: int | None = None,
    within: str | os.PathLike[str] | None = None,
) -> tuple[bytes, dict[str, Any]]:
    """Return the content of a regular file, and its header.

    Parameters
    ----------
    most_bytes
        Greatest size [bytes], >= 0.
    room_bytes
        Available memory [bytes]; None if it is unknown.
    within
        Folder that must contain the file, with no link on the way; None for any.

    Raises
    ------
    RefusedFile
        If it is not a regular file, is too large, or there is a link below `within`.
    OSError
        If it cannot be read.
    ValueError
        If the header is invalid, or does not account for every byte.
    """
    with os.fdopen(open_regular(path, os.O_RDONLY, within=within), "rb", buffering=0) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most_bytes:
            raise RefusedFile("large", path, most_bytes)
        if size < _LENGTH_BYTES:
            raise ValueError("it is too short to have a header")
        length = int.from_bytes(file.read(_LENGTH_BYTES), "little")
        if length > min(_MOST_HEADER_BYTES, size - _LENGTH_BYTES):
            raise ValueError("its header is longer than the file, or than a header may be")
        header = parse_json(file.read(length))
        left = size - _LENGTH_BYTES - length
        if left != _claimed(header):
            raise ValueError(
                f"its header accounts for {_claimed(header):,} bytes, not for {left:,}"
            )
        if room_bytes is not None and _COPIES * left > room_bytes:
            raise RefusedFile("memory", path, room_bytes)
        file.seek(0)
        return read_rest(file, path, most_bytes), header


def build_from_weights(
    path: Path,
    most_bytes: int,
    sha256: str,
    build: Callable[[Mapping[str, NDArray[Any]]], Built],
    *,
    document: Path,
    remedy: str,
    within: Path | None = None,
) -> Built:
    """Return an object built from the arrays of a file.

    Parameters
    ----------
    most_bytes, within
        As in `read_safetensors`.
    sha256, document
        Hash of the file, and the document that states it.
    build
        Raises ValueError or KeyError if the arrays do not fit.
    remedy
        What to do if the file is damaged, for messages.

    Raises
    ------
    OptionError
        If the file cannot be read, has another hash, or its arrays do not fit.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        data, _ = read_safetensors(path, most_bytes, within=within)
        if hashlib.sha256(data).hexdigest() != sha256:
            raise ValueError(f"its hash is not the one in {document}")
        return build(load(data))
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}. {remedy}.") from None
    except (ValueError, KeyError, SafetensorError) as error:
        reason = f"has no {error}" if isinstance(error, KeyError) else str(error).rstrip(".")
        raise OptionError(f"{path}: is damaged: {reason}. {remedy}.") from None


def _claimed(header: Any) -> int:
    """Return the size of the arrays in a header [bytes]."""
    if not isinstance(header, dict):
        raise ValueError("its header is not an object")
    ends = [0]
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        try:
            ends.append(int(entry["data_offsets"][1]))
        except (KeyError, IndexError, TypeError, ValueError, OverflowError):
            raise ValueError(f"its header does not place the array {name!r:.60}") from None
    return max(ends)
