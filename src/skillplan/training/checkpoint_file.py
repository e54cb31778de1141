"""Checkpoints: all that runs which learn side by side go on from, in one file.

The file is there whole or not at all. It vouches for itself: arrays as safetensors, everything
else as JSON in their header, with a hash over both.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from skillplan.errors import OptionError
from skillplan.files.atomic_file import write_whole
from skillplan.files.regular_file import RefusedFile
from skillplan.files.safetensors_file import read_safetensors
from skillplan.files.schema_errors import schema_issues
from skillplan.files.strict_json import parse_json
from skillplan.records import schemas
from skillplan.solvers.learning.learner import Snapshot
from skillplan.workers.resident_memory import available_bytes

_KEY = "skillplan"
# More than any replay memory that fits into a machine of today.
MOST_BYTES = 64 * 1024**3
_MOST_SHOWN = 40
_REMEDY = "Delete it, and --resume begins its runs again"


class _Content(BaseModel):
    """What stands beside the arrays: anybody can make a hash that fits."""

    model_config = ConfigDict(extra="forbid", strict=True)

    steps: int = Field(ge=0)
    lengths: dict[str, Annotated[int, Field(ge=0)]]
    notes: dict[str, Any]


@dataclass(frozen=True)
class Checkpoint:
    """Where runs that learn side by side stand.

    Parameters
    ----------
    steps
        Environment steps done in every run.
    lengths
        How long files of the run folder were then [bytes], by path from the folder.
    snapshot
        What the learner goes on from.
    """

    steps: int
    lengths: Mapping[str, int]
    snapshot: Snapshot


def write_checkpoint(path: Path, checkpoint: Checkpoint, *, within: Path | None = None) -> None:
    """Write a checkpoint, which replaces the one before.

    Parameters
    ----------
    path
        Of the file.
    checkpoint
        What it holds.
    within
        A folder that the file must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OSError
        If it cannot be written; the one before stays.
    ValueError
        If the notes of the snapshot are not JSON.
    """
    from safetensors.numpy import save

    arrays = {
        name: np.asarray(array, order="C") for name, array in checkpoint.snapshot.arrays.items()
    }
    content = {
        "schema": schemas.CHECKPOINT,
        "steps": checkpoint.steps,
        "lengths": dict(checkpoint.lengths),
        "notes": dict(checkpoint.snapshot.notes),
    }
    text = json.dumps(content, allow_nan=False, separators=(",", ":"), sort_keys=True)
    header = {"content": text, "sha256": _digest(text, arrays)}
    # One key only: the order of several would be left to chance.
    write_whole(path, save(arrays, {_KEY: json.dumps(header, sort_keys=True)}), within=within)


def read_checkpoint(path: Path, *, within: Path | None = None) -> Checkpoint | None:
    """Return a checkpoint; None where there is none. Its arrays may be written to.

    Parameters
    ----------
    path
        Of the file.
    within
        A folder that the file must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OptionError
        If it cannot be read, is not as it was written, or there is no room for it in memory.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        data, said = read_safetensors(path, MOST_BYTES, room_bytes=available_bytes(), within=within)
        kept = load(data)
        del data
        # One after the other: that of the parser goes where its copy, to be written to, comes.
        arrays = {name: np.array(kept.pop(name)) for name in list(kept)}
        header = parse_json(said["__metadata__"][_KEY])
        text = header["content"]
        if _digest(text, arrays) != header["sha256"]:
            raise ValueError("its hash is another one")
        content = parse_json(text)
        schema = content.pop("schema")
    except FileNotFoundError:
        return None
    except RefusedFile as error:
        remedy = "Resume where there is more" if error.why == "memory" else _REMEDY
        raise OptionError(f"{path}: cannot be read: {error.strerror}. {remedy}.") from None
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}. {_REMEDY}.") from None
    except (SafetensorError, ValueError, KeyError, TypeError, AttributeError) as error:
        reason = f"{type(error).__name__}: {error}" if isinstance(error, KeyError) else str(error)
        raise OptionError(f"{path}: is damaged: {reason.rstrip('.')}. {_REMEDY}.") from None
    if schema != schemas.CHECKPOINT:
        raise OptionError(
            f"{path}: is of another version, {str(schema)[:_MOST_SHOWN]}; this skillplan reads "
            f"{schemas.CHECKPOINT}. Use the version that wrote it."
        )
    try:
        checked = _Content.model_validate(content)
    except ValidationError as error:
        fault = str(schema_issues(error, _Content)[0]).rstrip(".")
        raise OptionError(f"{path}: is damaged: {fault}. {_REMEDY}.") from None
    return Checkpoint(checked.steps, checked.lengths, Snapshot(arrays, checked.notes))


def _digest(text: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(np.ascontiguousarray(array).data if array.size else b"")
    return digest.hexdigest()
