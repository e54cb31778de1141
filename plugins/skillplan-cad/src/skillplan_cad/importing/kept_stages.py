"""What stages made, kept by a hash of all that it was made from.

A stage whose input did not change is not run again; what is damaged is made anew, never trusted.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from skillplan.files.atomic_file import write_whole
from skillplan.files.cache_folder import cache_folder
from skillplan.files.regular_file import read_bytes
from skillplan_cad import __version__

_MOST_BYTES = 1 << 30
_HASH_BYTES = 32


class KeptStages:
    """Stages of an import.

    Parameters
    ----------
    keep
        Whether anything is read from disk or kept there.
    tell
        Told what is done, a line each.
    """

    def __init__(self, keep: bool, tell: Callable[[str], None]) -> None:
        self._folder: Path | None = cache_folder() / "import-cad" if keep else None
        self._tell = tell

    def run(
        self, name: str, made_from: Mapping[str, Any], make: Callable[[], bytes]
    ) -> tuple[bytes, str]:
        """Return what a stage makes, and a hash of it.

        Parameters
        ----------
        name
            Of the stage.
        made_from
            All that it depends on; hashes of the stages before it among it.
        make
            Makes it.
        """
        key = hashlib.sha256(
            json.dumps([name, __version__, dict(made_from)], sort_keys=True).encode()
        ).hexdigest()
        path = None if self._folder is None else self._folder / f"{name}-{key}"
        content = None if path is None else _kept(path)
        if content is None:
            self._tell(f"{name} ...")
            content = make()
            if path is not None:
                # What cannot be kept is made again.
                with suppress(OSError):
                    path.parent.mkdir(parents=True, exist_ok=True)
                    write_whole(path, hashlib.sha256(content).digest() + content)
        else:
            self._tell(f"{name}: kept from an earlier run")
        return content, hashlib.sha256(content).hexdigest()


def _kept(path: Path) -> bytes | None:
    """Return what is kept, or None if it is not there or not as it was written."""
    try:
        content = read_bytes(path, _MOST_BYTES)
    except OSError:
        return None
    whole = content[_HASH_BYTES:]
    return whole if hashlib.sha256(whole).digest() == content[:_HASH_BYTES] else None
