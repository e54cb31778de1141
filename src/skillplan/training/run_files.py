"""Files that a training writes as it runs: metrics, TensorBoard curves, checkpoints, progress.

Metrics and curves grow by whole records. A resumed training cuts them to the lengths in its
checkpoint. A checkpoint is always complete and checks itself: arrays as safetensors, everything
else as JSON in their header, with a hash over both.

Curves are in the format of TensorFlow event files: length, record and their masked CRC-32C; a
record is the protocol buffer message ``Event``, of which four fields are needed. This is our own
code because other writers cannot cut a file at a checkpoint, use a thread and load a learning
library.

An executor that does not share our files exchanges them as `FileChange`.
"""

from __future__ import annotations

import hashlib
import json
import struct
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from skillplan.errors import OptionError
from skillplan.files.atomic_file import GrowingFile, is_unfinished, write_whole
from skillplan.files.folder import make_folder
from skillplan.files.json_file import format_document, parse_json
from skillplan.files.regular_file import RefusedFile, read_bytes
from skillplan.files.safetensors_file import read_safetensors
from skillplan.files.schema_errors import list_schema_issues
from skillplan.records import schemas
from skillplan.records.training.run_folder import (
    MANIFEST,
    METRICS,
    PROGRESS,
    TASK_CONFIG,
    FiguresRecord,
    GroupProgress,
    format_metrics_line,
    get_group_path,
    get_run_path,
    read_metrics,
)
from skillplan.solvers.learning.learner import Episode, Snapshot
from skillplan.workers.processes import get_available_bytes

_KEY = "skillplan"
# Larger than any replay buffer that fits into memory today.
MOST_BYTES = 64 * 1024**3
_MOST_SHOWN = 40
_REMEDY = "Delete it, and --resume begins its runs again"


class _Content(BaseModel):
    """Content of a checkpoint without the arrays. It is validated because a hash can be forged."""

    model_config = ConfigDict(extra="forbid", strict=True)

    steps: int = Field(ge=0)
    lengths: dict[str, Annotated[int, Field(ge=0)]]
    notes: dict[str, Any]


@dataclass(frozen=True)
class Checkpoint:
    """State of the runs of a group.

    Parameters
    ----------
    steps
        Environment steps done in every run.
    lengths
        Lengths of the growing files [B], by path from the folder of the training.
    """

    steps: int
    lengths: Mapping[str, int]
    snapshot: Snapshot


def write_checkpoint(path: Path, checkpoint: Checkpoint, *, within: Path | None = None) -> None:
    """Write a checkpoint, which replaces the previous one.

    Parameters
    ----------
    within
        Folder that the file must be in, with no link on the way. Default: any folder.

    Raises
    ------
    OSError
        If it cannot be written; the previous one stays.
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
    # A single key, because the order of several keys is not fixed.
    write_whole(path, save(arrays, {_KEY: json.dumps(header, sort_keys=True)}), within=within)


def read_checkpoint(path: Path, *, within: Path | None = None) -> Checkpoint | None:
    """Read a checkpoint, with writable arrays; return None if there is none.

    Parameters
    ----------
    within
        Folder that the file must be in, with no link on the way. Default: any folder.

    Raises
    ------
    OptionError
        If it cannot be read, is damaged, or does not fit into memory.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        data, file_header = read_safetensors(
            path, MOST_BYTES, room_bytes=get_available_bytes(), within=within
        )
        kept = load(data)
        del data
        # Copied one by one, so that the parser's array is freed before the next copy.
        arrays = {name: np.array(kept.pop(name)) for name in list(kept)}
        header = parse_json(file_header["__metadata__"][_KEY])
        text = header["content"]
        if _digest(text, arrays) != header["sha256"]:
            raise ValueError("its hash does not match")
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
        fault = str(list_schema_issues(error, _Content)[0]).rstrip(".")
        raise OptionError(f"{path}: is damaged: {fault}. {_REMEDY}.") from None
    return Checkpoint(checked.steps, checked.lengths, Snapshot(arrays, checked.notes))


def _digest(text: str, arrays: Mapping[str, NDArray[Any]]) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape};".encode())
        digest.update(np.ascontiguousarray(array).data if array.size else b"")
    return digest.hexdigest()


_MASK_ADDED = 0xA282EAD8
_POLYNOMIAL = 0x82F63B78
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def make_opening_record(wall_s: float) -> bytes:
    """Return the first record of every event file."""
    return _framed(_double(1, wall_s) + _delimited(3, b"brain.Event:2"))


def make_scalars_record(wall_s: float, step: int, scalars: Mapping[str, float]) -> bytes:
    """Return a record of figures.

    Parameters
    ----------
    wall_s
        Time since the epoch [s].
    step
        Environment steps done, >= 0.
    scalars
        Figures by tag, stored in single precision.
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


# Number of episodes that the success rate is of.
RECENT_EPISODES = 100
# Largest number in single precision, about.
_MOST_SINGLE = 3e38
_EVENTS = "events.out.tfevents.skillplan"


@contextmanager
def writing(folder: Path, name: str) -> Iterator[None]:
    """Turn a failed write into a message that names the intact files.

    Raises
    ------
    OptionError
        If the body raises an OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OptionError(
            f"--out {folder}: {name} cannot be written: {reason}. The last checkpoints are "
            "intact: make room, and go on with --resume."
        ) from None


def get_events_path(folder: Path, run: int) -> Path:
    """Return the path of a run's curves."""
    return folder / "tensorboard" / f"run-{run:02d}" / _EVENTS


class RunLog:
    """Writes the metrics and curves of a run.

    Parameters
    ----------
    lengths
        Lengths of the files at the checkpoint [B], by path from the folder; empty for a new run.

    Attributes
    ----------
    recent
        Successes among the last `RECENT_EPISODES` episodes.
    best_cost
        Lowest cost of a successful episode, if any.

    Raises
    ------
    OptionError
        If a file cannot be written, is damaged, or is shorter than at the checkpoint.
    """

    def __init__(self, folder: Path, run: int, lengths: Mapping[str, int]) -> None:
        self.episodes = 0
        self.recent: deque[bool] = deque(maxlen=RECENT_EPISODES)
        self.best_cost: float | None = None
        self._folder = folder
        self._files: dict[str, GrowingFile] = {}
        metrics = get_run_path(folder, run) / METRICS
        events = get_events_path(folder, run)
        self._run = run
        self._metrics, self._events = (
            path.relative_to(folder).as_posix() for path in (metrics, events)
        )
        try:
            for name in (self._metrics, self._events):
                self._open(name, lengths.get(name, 0))
            if lengths.get(self._metrics):
                self._count(read_metrics(metrics, run, within=folder).episodes)
            if not lengths.get(self._events):
                self._append(self._events, make_opening_record(time.time()))
        except BaseException:
            self.close()
            raise

    def note(self, step: int, episodes: Sequence[Episode], figures: Mapping[str, float]) -> None:
        """Append the episodes and figures since the last call.

        Parameters
        ----------
        figures
            Figures of the learner; may be empty.

        Raises
        ------
        OptionError
            If a file cannot be written.
        ValueError
            If the figures of an episode are not finite.
        """
        self._count(episodes)
        lines = [format_metrics_line(episode) for episode in episodes]
        lines += [format_metrics_line(FiguresRecord(step, figures))] if figures else []
        if lines:
            self._append(self._metrics, "".join(f"{line}\n" for line in lines).encode())
        scalars = {
            f"learner/{name}": float(value)
            for name, value in figures.items()
            if abs(value) < _MOST_SINGLE
        }
        if episodes:
            scalars["episode/success_rate"] = sum(self.recent) / len(self.recent)
            scalars["episode/reward"] = sum(episode.reward for episode in episodes) / len(episodes)
            costs = [episode.cost for episode in episodes if episode.success]
            if costs:
                scalars["episode/cost_of_success"] = sum(costs) / len(costs)
        if scalars:
            self._append(self._events, make_scalars_record(time.time(), step, scalars))

    def sync(self) -> dict[str, int]:
        """Flush all files to disk; return their lengths [B] by path from the folder.

        Raises
        ------
        OptionError
            If they cannot be written.
        """
        lengths = {}
        for name, file in self._files.items():
            with writing(self._folder, name):
                file.sync()
                lengths[name] = file.length
        return lengths

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()
        self._files.clear()

    def _open(self, name: str, length: int) -> None:
        path = self._folder / name
        with writing(self._folder, name):
            make_folder(path.parent, within=self._folder)
            file = self._files[name] = GrowingFile(path, self._folder)
            if file.length < length:
                raise OptionError(
                    f"{path}: is damaged: it is shorter than at the checkpoint. Bring it back "
                    "from a copy, or train again in another folder."
                )
            file.cut(length)

    def _append(self, name: str, content: bytes) -> None:
        with writing(self._folder, name):
            self._files[name].append(content)

    def _count(self, episodes: Sequence[Episode]) -> None:
        self.episodes += len(episodes)
        self.recent += [episode.success for episode in episodes]
        costs = [episode.cost for episode in episodes if episode.success]
        if costs:
            self.best_cost = min(costs if self.best_cost is None else [*costs, self.best_cost])


NO_PROGRESS = GroupProgress(
    steps=0, failures={}, wall_s=0.0, elapsed_s=0.0, checks=0, hits=0, executions=0, asked={}
)
"""Progress of a group without a checkpoint."""


def write_progress(folder: Path, group: int, progress: GroupProgress) -> None:
    """Write the progress of a group.

    Raises
    ------
    OptionError
        If it cannot be written.
    """
    with writing(folder, f"groups/{group}/{PROGRESS}"):
        make_folder(get_group_path(folder, group), within=folder)
        text = format_document(schemas.RUN_GROUP, progress)
        write_whole(get_group_path(folder, group) / PROGRESS, text, within=folder)


@dataclass(frozen=True, slots=True)
class FileChange:
    """New content of a file.

    Parameters
    ----------
    name
        Path from the folder of the training.
    start
        Offset of the new content [B]; None if it replaces the whole file.
    """

    name: str
    start: int | None
    content: bytes


def read_files(folder: Path, group: int, runs: Sequence[int]) -> Iterator[FileChange]:
    """Yield the files that a group continues from.

    Raises
    ------
    OSError
        If a file cannot be read.
    """
    for name in _list_files(folder, group, runs):
        yield FileChange(name, None, read_bytes(folder / name, MOST_BYTES, within=folder))


def apply_changes(folder: Path, changes: Sequence[FileChange]) -> None:
    """Write the file changes of another machine into a folder.

    Raises
    ------
    OptionError
        If something cannot be written.
    """
    for change in changes:
        with writing(folder, change.name):
            path = folder / change.name
            make_folder(path.parent, within=folder)
            if change.start is None:
                write_whole(path, change.content, within=folder)
                continue
            file = GrowingFile(path, folder)
            try:
                file.cut(change.start)
                file.append(change.content)
                # The checkpoint that counts on it may follow.
                file.sync()
            finally:
                file.close()


class FolderWatcher:
    """Detects changes in the files of a group, given the files that the sender already has."""

    def __init__(
        self, folder: Path, group: int, runs: Sequence[int], known: Sequence[FileChange]
    ) -> None:
        self._folder, self._group, self._runs = folder, group, runs
        self._hashes = {file.name: sha256(file.content).digest() for file in known}
        # A growing file is sent as a whole first, because it may have been cut.
        self._lengths: dict[str, int] = {}

    def changes(self) -> Iterator[FileChange]:
        """Yield the changes since the last call: files that grew, then files that were replaced."""
        folder = self._folder
        names = list(_list_files(folder, self._group, self._runs))
        for name in filter(_grows, names):
            content = read_bytes(folder / name, MOST_BYTES, within=folder)
            start = self._lengths.get(name)
            if start != len(content):
                self._lengths[name] = len(content)
                yield FileChange(name, start, content[start or 0 :])
        replaced = [name for name in names if not _grows(name)]
        for name in sorted(replaced, key=lambda name: ((folder / name).stat().st_mtime_ns, name)):
            content = read_bytes(folder / name, MOST_BYTES, within=folder)
            digest = sha256(content).digest()
            if digest != self._hashes.get(name):
                self._hashes[name] = digest
                yield FileChange(name, None, content)


def _list_files(folder: Path, group: int, runs: Sequence[int]) -> Iterator[str]:
    """Yield the files that a group reads or writes, as paths from the folder."""
    roots = [get_group_path(folder, group)]
    roots += [get_run_path(folder, run) for run in runs]
    roots += [get_events_path(folder, run).parent for run in runs]
    settings = [path for path in (folder / MANIFEST, folder / TASK_CONFIG) if path.is_file()]
    for path in (*settings, *(path for root in roots for path in sorted(root.rglob("*")))):
        if path.is_file() and not path.is_symlink() and not is_unfinished(path.name):
            yield path.relative_to(folder).as_posix()


def _grows(name: str) -> bool:
    return name.startswith("tensorboard/") or name.endswith(f"/{METRICS}")
