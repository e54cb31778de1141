"""All verdicts kept in a folder, whatever task they are of: what is there, and clearing it."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from skillplan.checks.verdict_cache import key_folder
from skillplan.checks.verdict_file import VerdictRecord, is_verdict_file, read_record
from skillplan.checks.ways import asked_about
from skillplan.task.back_end import BackEnd

# A folder of verdicts; a file of verdicts of the format before; what a killed process left.
_KEY = re.compile(r"[0-9a-f]{64}")
_EARLIER = re.compile(r"[0-9a-f]{64}\.json")
_UNFINISHED = re.compile(r"\.[0-9a-f]{64}\.json\.[0-9a-f]+\.tmp")


@dataclass(frozen=True)
class KeptVerdict:
    """A verdict on disk.

    Parameters
    ----------
    path
        Its file.
    record
        What the file says.
    size_bytes
        Its length.
    modified_s
        When it was written [s since 1970].
    """

    path: Path
    record: VerdictRecord
    size_bytes: int
    modified_s: float


class VerdictFolder:
    """The folder in which a `DiskVerdictCache` keeps verdicts.

    Parameters
    ----------
    root
        Need not be there.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def survey(self) -> tuple[list[KeptVerdict], list[Path]]:
        """Return the sound verdicts in the order of their names, and all other files.

        The others are of this folder's making, too, but no verdict is read from them: damaged,
        unfinished, or of the format before.
        """
        sound, others = [], []
        for path in self._files():
            named = is_verdict_file(path.name) and _KEY.fullmatch(path.parent.name)
            found = _kept(path) if named else None
            if found is None:
                others.append(path)
            else:
                sound.append(found)
        return sound, others

    def kept_for(self, back_ends: Sequence[BackEnd]) -> list[list[KeptVerdict]]:
        """Return the sound verdicts that each of some back ends would use on its task now."""
        found = []
        for back_end in back_ends:
            own = []
            for skill in asked_about(back_end.task) if back_end.expensive else ():
                folder = key_folder(self.root, back_end, skill)
                paths = (folder / name for name in _names(folder) if is_verdict_file(name))
                own += [kept for kept in map(_kept, paths) if kept is not None]
            found.append(own)
        return found

    def drop(self, kept: KeptVerdict) -> bool:
        """Remove one verdict; return whether it is gone."""
        with suppress(OSError):
            kept.path.unlink(missing_ok=True)
            return True
        return False

    def clear(self, tasks: Collection[str] | None = None) -> int:
        """Remove what is kept, or only the verdicts of some tasks; return how many files.

        Nothing is touched that is not a file of this folder's making.

        Raises
        ------
        OSError
            If a file cannot be removed.
        """
        if tasks is None:
            doomed = self._files()
        else:
            doomed = [kept.path for kept in self.survey()[0] if kept.record.task in tasks]
        removed = 0
        for path in doomed:
            with suppress(FileNotFoundError):
                path.unlink()
                removed += 1
        for folder in sorted({path.parent for path in doomed}, reverse=True):
            # Folders in which something else is, stay.
            with suppress(OSError):
                folder.rmdir()
                folder.parent.rmdir()
        return removed

    def _files(self) -> list[Path]:
        """Return every file that is of this folder's making, sound or not."""
        found = []
        for back_end in _folders(self.root):
            for name in _names(back_end):
                path = back_end / name
                if _EARLIER.fullmatch(name) or _UNFINISHED.fullmatch(name):
                    found += [path] if path.is_file() else []
                elif _KEY.fullmatch(name) and path.is_dir() and not path.is_symlink():
                    found += [
                        path / entry
                        for entry in _names(path)
                        if is_verdict_file(entry) or _UNFINISHED.fullmatch(entry)
                    ]
        return found


def _folders(root: Path) -> list[Path]:
    return [
        root / name
        for name in _names(root)
        if (root / name).is_dir() and not (root / name).is_symlink()
    ]


def _names(folder: Path) -> list[str]:
    try:
        return sorted(os.listdir(folder))
    except OSError:
        return []


def _kept(path: Path) -> KeptVerdict | None:
    try:
        record = read_record(path)
        status = path.stat()
    except (OSError, ValueError):
        return None
    return KeptVerdict(path, record, status.st_size, status.st_mtime)
