"""A shim that lets one call fail which opens, writes, renames or forces to disk beneath a folder.

As SQLite's tests have it: the first call fails, then the second, until a run meets no failure. The
calls of all processes of a run are counted together, in a file. Set in the process by `failing`, or
by `install_from_environment` in every process that imports ``sitecustomize``.
"""

from __future__ import annotations

import builtins
import contextlib
import errno
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

VARIABLE = "CAMPAIGN_FAILING_IO"
# What a failing disk says, and a write that stops half way with a disk that is full afterwards.
MODES = {"ENOSPC": errno.ENOSPC, "EIO": errno.EIO, "short": errno.ENOSPC}
HALVING = {"short", "kill"}
_PLAIN = {
    "open": os.open,
    "io_open": io.open,
    "write": os.write,
    "replace": os.replace,
    "rename": os.rename,
    "fsync": os.fsync,
    "link": os.link,
    "mkdir": os.mkdir,
}


class Shim:
    """Counts calls, and fails one.

    Parameters
    ----------
    folder
        Only calls beneath it count.
    counter
        A file whose length is the number of calls so far.
    number
        Which call fails, from 1 on; 0 for none.
    mode
        One of `MODES`; or ``kill``, which ends the process.
    """

    def __init__(self, folder: Path, counter: Path, number: int, mode: str) -> None:
        self.folder, self.number, self.mode = os.path.realpath(folder), number, mode
        self._counter = _PLAIN["open"](counter, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)

    def counts(self, path: Any, dir_fd: int | None = None) -> bool:
        """Whether a path, or the file of a descriptor, lies beneath the folder."""
        try:
            if isinstance(path, int):
                real = os.readlink(f"/proc/self/fd/{path}")
            else:
                name = os.fsdecode(path)
                if dir_fd is not None:
                    name = os.path.join(os.readlink(f"/proc/self/fd/{dir_fd}"), name)
                real = os.path.realpath(name)
        except (OSError, TypeError, ValueError):
            return False
        return real == self.folder or real.startswith(self.folder + os.sep)

    def due(self) -> bool:
        """Count a call; whether it is the one that fails."""
        _PLAIN["write"](self._counter, b".")
        return os.fstat(self._counter).st_size == self.number

    def error(self, path: Any) -> OSError:
        """Return what the call raises; a killed process does not come back."""
        if self.mode == "kill":
            os._exit(9)
        code = MODES[self.mode]
        return OSError(code, os.strerror(code), path if isinstance(path, str) else None)

    def step(self, path: Any) -> None:
        """Count a call, and raise if it is the one."""
        if self.due():
            raise self.error(path)


class ShimmedFile:
    """A file whose writes may fail; all else is the file's own."""

    def __init__(self, file: Any, shim: Shim) -> None:
        self._file, self._shim = file, shim

    def write(self, content: Any) -> int:
        """Write, or fail, or write half and fail."""
        if self._shim.due():
            if self._shim.mode in HALVING:
                self._file.write(content[: len(content) // 2])
                with contextlib.suppress(OSError):
                    self._file.flush()
            raise self._shim.error(None)
        written: int = self._file.write(content)
        return written

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> ShimmedFile:
        self._file.__enter__()
        return self

    def __exit__(self, *details: Any) -> Any:
        return self._file.__exit__(*details)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._file)


def _functions(shim: Shim) -> dict[str, Any]:
    def os_open(path: Any, flags: int, mode: int = 0o777, *, dir_fd: int | None = None) -> int:
        if shim.counts(path, dir_fd):
            shim.step(path)
        return int(_PLAIN["open"](path, flags, mode, dir_fd=dir_fd))

    def io_open(file: Any, mode: str = "r", *more: Any, **options: Any) -> Any:
        counts = shim.counts(file)
        if counts and not isinstance(file, int):
            shim.step(file)
        created = _PLAIN["io_open"](file, mode, *more, **options)
        return ShimmedFile(created, shim) if counts and set(mode) & set("wax+") else created

    def os_write(number: int, content: Any) -> int:
        if shim.counts(number) and shim.due():
            if shim.mode in HALVING:
                if shim.mode == "kill":
                    _PLAIN["write"](number, bytes(content)[: len(content) // 2])
                    os._exit(9)
                return int(_PLAIN["write"](number, bytes(content)[: max(1, len(content) // 2)]))
            raise shim.error(None)
        return int(_PLAIN["write"](number, content))

    def moving(name: str) -> Any:
        def call(source: Any, target: Any, **options: Any) -> None:
            if shim.counts(target, options.get("dst_dir_fd")):
                shim.step(target)
            _PLAIN[name](source, target, **options)

        return call

    def one_path(name: str) -> Any:
        def call(path: Any, *more: Any, **options: Any) -> None:
            if shim.counts(path, options.get("dir_fd")):
                shim.step(path)
            _PLAIN[name](path, *more, **options)

        return call

    moved = {name: moving(name) for name in ("replace", "rename", "link")}
    single = {name: one_path(name) for name in ("fsync", "mkdir")}
    return {"open": os_open, "io_open": io_open, "write": os_write, **moved, **single}


def _set(functions: dict[str, Any]) -> None:
    for name, function in functions.items():
        if name == "io_open":
            io.open = builtins.open = function
        else:
            setattr(os, name, function)


@contextlib.contextmanager
def failing(folder: Path, counter: Path, number: int, mode: str) -> Iterator[None]:
    """Let the call of that number fail, in this process."""
    _set(_functions(Shim(folder, counter, number, mode)))
    try:
        yield
    finally:
        _set(_PLAIN)


def install_from_environment() -> None:
    """Set the shim that `variable` describes, for the whole life of this process."""
    value = os.environ.get(VARIABLE)
    if value:
        folder, counter, number, mode = value.split(os.pathsep)
        _set(_functions(Shim(Path(folder), Path(counter), int(number), mode)))


def variable(folder: Path, counter: Path, number: int, mode: str) -> str:
    """Return what the environment of a process holds in which a call is to fail."""
    return os.pathsep.join([str(folder), str(counter), str(number), mode])
