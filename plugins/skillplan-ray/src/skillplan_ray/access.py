"""Access to a local cluster: for this user of this machine only.

A user who reaches the ports of a Ray cluster and has its token runs code as its owner. So only the
owner can read the token and the folders of the session, and all ports are on 127.0.0.1. By default,
Ray writes the token with the umask, and listens on all interfaces.
"""

from __future__ import annotations

import atexit
import importlib
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from skillplan.errors import SkillplanError

# 0 for a single machine on 127.0.0.1, on every system.
_SEVERAL_MACHINES = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
_MODE, _TOKEN, _TOKEN_PATH = "RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"
# Socket paths have at most 107 bytes, of which Ray's session takes 67.
_MOST_FOLDER_BYTES = 107 - 67
_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def require_token() -> None:
    """Make the next cluster demand a token that only this user can read.

    Ray reads this setting when it is imported, or in `reload_token_mode`.

    Raises
    ------
    SkillplanError
        If the token cannot be written, or others could read or replace it.
    """
    # Even if the user has disabled tokens for other clusters.
    os.environ[_MODE] = "token"
    if os.environ.get(_TOKEN):
        return
    named = os.environ.get(_TOKEN_PATH)
    path = Path(named) if named else Path.home() / ".ray" / "auth_token"
    try:
        _make_private_folder(path.parent)
        _write_token(path)
        if os.name == "posix":
            _check_token(path)
    except OSError as error:
        raise SkillplanError(
            f"The token of the Ray cluster cannot be kept in {path}: {error.strerror or error}."
        ) from None


def reload_token_mode() -> None:
    """Make Ray read the token settings again.

    Ray reads them once, when it is imported. If another part of the program imported it without a
    token, the new cluster would demand one that this process does not send.
    """
    inner: Any = importlib.import_module("ray._raylet")
    inner.Config.initialize("")
    inner.AuthenticationTokenLoader.instance().reset_cache()


@contextmanager
def on_loopback() -> Iterator[None]:
    """Make a cluster that starts in this block listen on 127.0.0.1 only.

    Ray has a switch for this on systems with a firewall; it is read at import.
    """
    constants: Any = importlib.import_module("ray._private.ray_constants")
    before, constants.ENABLE_RAY_CLUSTER = constants.ENABLE_RAY_CLUSTER, False
    given = os.environ.get(_SEVERAL_MACHINES)
    os.environ[_SEVERAL_MACHINES] = "0"
    try:
        yield
    finally:
        constants.ENABLE_RAY_CLUSTER = before
        if given is None:
            del os.environ[_SEVERAL_MACHINES]
        else:
            os.environ[_SEVERAL_MACHINES] = given


def refuse_open_cluster(ray: Any) -> None:
    """Shut down the started cluster if other users could access it.

    Raises
    ------
    SkillplanError
        If it listens on other addresses, or demands no token.
    """
    places = {node["NodeManagerAddress"] for node in ray.nodes()}
    inner = importlib.import_module("ray._raylet")
    has_token = inner.get_authentication_mode() == inner.AuthenticationMode.TOKEN
    if has_token and all(ip_address(place).is_loopback for place in places):
        return
    ray.shutdown()
    raise SkillplanError(
        f"Ray listens on {', '.join(sorted(places))}"
        f"{'' if has_token else ' and demands no token'}, so that others could run code as you; "
        "it is shut down again. Start a cluster yourself, with a token, and name its address."
    )


def session_folder() -> str:
    """Return a private folder for logs and sockets of a cluster.

    Ray makes its folder writable for all users, so it is inside a folder that others cannot enter.
    """
    folder = tempfile.gettempdir()
    private = os.name != "posix" or not stat.S_IMODE(os.stat(folder).st_mode) & _OTHERS
    if not private or len(os.fsencode(folder)) > _MOST_FOLDER_BYTES:
        is_long = len(os.fsencode(os.path.join(folder, "ray-01234567"))) > _MOST_FOLDER_BYTES
        folder = tempfile.mkdtemp(prefix="ray-", dir="/tmp" if is_long else None)
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return os.path.join(folder, "r")


def _make_private_folder(folder: Path) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.name != "posix":
        return
    mode = stat.S_IMODE(folder.stat().st_mode)
    # In a writable folder, others could replace the token.
    if mode & _OTHERS_WRITE:
        folder.chmod(mode & ~_OTHERS_WRITE)


def _write_token(path: Path) -> None:
    """Write a new token if there is none."""
    try:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return
    with os.fdopen(number, "w") as file:
        file.write(secrets.token_hex(32))


def _check_token(path: Path) -> None:
    lstat = path.lstat()
    if not stat.S_ISREG(lstat.st_mode) or lstat.st_uid != os.geteuid():
        raise SkillplanError(f"{path}: is no file of yours. Remove it; a new token is written.")
    mode = stat.S_IMODE(lstat.st_mode)
    if mode & _OTHERS:
        raise SkillplanError(
            f"{path}: has mode {mode:04o}, so that other users of this machine can read it, and "
            "may have. With this token they can run code as you. Remove the file, and a new token "
            "is written; if a cluster elsewhere uses it and you trust all users here: "
            f"chmod 600 {path}"
        )
