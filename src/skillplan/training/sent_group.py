"""A group of runs that is driven where the folder of the training is not.

What the group goes on from is sent along, into a scratch folder; after every order what has changed
there is sent back, and put into the folder of the training in the order in which it was written.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Generic, TypeVar

from skillplan.files.atomic_file import is_unfinished, write_whole
from skillplan.files.folder import make_folder
from skillplan.files.growing_file import GrowingFile
from skillplan.files.regular_file import read_bytes
from skillplan.records.training.metrics_file import METRICS
from skillplan.records.training.run_folder import MANIFEST, TASK_CONFIG, group_path, run_path
from skillplan.training.checkpoint_file import MOST_BYTES
from skillplan.training.group_job import GroupJob
from skillplan.training.run_log import events_path, writing

Order = TypeVar("Order")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True, slots=True)
class FileChange:
    """What is new in a file.

    Parameters
    ----------
    name
        Its path from the folder of the training.
    start
        From where on it is new [B]; None where all of it takes the place of what was there.
    content
        What is new.
    """

    name: str
    start: int | None
    content: bytes


@dataclass(frozen=True, slots=True)
class SentGroup:
    """A group and the files that it goes on from.

    Parameters
    ----------
    job
        The group; its folder is that of the head.
    files
        Content of files, by path from the folder.
    """

    job: GroupJob
    files: tuple[FileChange, ...]

    @classmethod
    def of(cls, job: GroupJob) -> SentGroup:
        """Return a group with what its folder holds for it.

        Raises
        ------
        OSError
            If a file cannot be read.
        """
        files = tuple(
            FileChange(name, None, read_bytes(job.folder / name, MOST_BYTES, within=job.folder))
            for name in _names(job, job.folder)
        )
        return cls(job, files)


@dataclass(frozen=True, slots=True)
class SentAnswer(Generic[Outcome]):
    """What became of an order, and what it changed.

    Parameters
    ----------
    outcome
        As where the folder is at hand.
    changes
        In the order in which they were written.
    """

    outcome: Outcome
    changes: tuple[FileChange, ...]


def serving_sent(
    sent: SentGroup, serve: Callable[[GroupJob], Callable[[Order], Outcome]]
) -> Callable[[Order], SentAnswer[Outcome]]:
    """Return what does strides of a group that was sent, in a scratch folder of its own.

    Parameters
    ----------
    sent
        The group.
    serve
        Returns what does them in a folder that is at hand.
    """
    folder = Path(tempfile.mkdtemp(prefix="skillplan-training-")).resolve()
    put_in_place(folder, sent.files)
    work = serve(replace(sent.job, folder=folder))
    watched = _Watched(replace(sent.job, folder=folder), sent.files)

    def order(one: Order) -> SentAnswer[Outcome]:
        outcome = work(one)
        return SentAnswer(outcome, tuple(watched.changes()))

    weakref.finalize(order, shutil.rmtree, folder, ignore_errors=True)
    return order


def put_in_place(folder: Path, changes: Sequence[FileChange]) -> None:
    """Put what has changed elsewhere into a folder: whole files at once, growing ones at their end.

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
                # A checkpoint that counts on it may follow.
                file.sync()
            finally:
                file.close()


class _Watched:
    """Notices what changes in the files of a group.

    Parameters
    ----------
    job
        The group, in the folder that is watched.
    known
        What the head has already.
    """

    def __init__(self, job: GroupJob, known: Sequence[FileChange]) -> None:
        self._job = job
        self._hashes = {one.name: sha256(one.content).digest() for one in known}
        # A growing file is sent whole first: it may have been cut and grown again.
        self._lengths: dict[str, int] = {}

    def changes(self) -> Iterator[FileChange]:
        """Yield what is new since the last time: first what has grown, then what was replaced."""
        folder = self._job.folder
        names = list(_names(self._job, folder))
        grown = [name for name in names if _grows(name)]
        whole = [name for name in names if not _grows(name)]
        for name in grown:
            content = read_bytes(folder / name, MOST_BYTES, within=folder)
            start = self._lengths.get(name)
            if start != len(content):
                self._lengths[name] = len(content)
                yield FileChange(name, start, content[start or 0 :])
        for name in sorted(whole, key=lambda one: ((folder / one).stat().st_mtime_ns, one)):
            content = read_bytes(folder / name, MOST_BYTES, within=folder)
            digest = sha256(content).digest()
            if digest != self._hashes.get(name):
                self._hashes[name] = digest
                yield FileChange(name, None, content)


def _names(job: GroupJob, folder: Path) -> Iterator[str]:
    """Yield the files that a group reads or writes, by path from the folder."""
    runs = job.plan.groups[job.group]
    own = [group_path(folder, job.group)]
    own += [run_path(folder, run) for run in runs]
    own += [events_path(folder, run).parent for run in runs]
    settings = [path for path in (folder / MANIFEST, folder / TASK_CONFIG) if path.is_file()]
    for path in (*settings, *(one for root in own for one in sorted(root.rglob("*")))):
        if path.is_file() and not path.is_symlink() and not is_unfinished(path.name):
            yield path.relative_to(folder).as_posix()


def _grows(name: str) -> bool:
    return name.startswith("tensorboard/") or name.endswith(f"/{METRICS}")
