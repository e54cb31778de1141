"""A cluster that is started here is for this user of this machine only.

A user who reaches the ports of a Ray cluster and has its token runs code as its owner. So the token
is readable by its owner alone, as are the folders of the session, and all ports are on 127.0.0.1.
Ray itself writes the token as the umask has it, and listens on all interfaces.
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

# 0 for a cluster of one machine, on 127.0.0.1, whatever the system.
_SEVERAL_MACHINES = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
_MODE, _TOKEN, _TOKEN_PATH = "RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"
# The path of a socket has 107 bytes at most, of which 67 are those of Ray's session in the folder.
_MOST_FOLDER_BYTES = 107 - 67
_OTHERS = stat.S_IRWXG | stat.S_IRWXO
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def require_token() -> None:
    """Have the cluster that is started next demand a token that only this user can read.

    Called before Ray is imported, which reads the mode then.

    Raises
    ------
    SkillplanError
        If the token cannot be written, or others can read it or could replace it.
    """
    # Even if the user has turned tokens off for clusters elsewhere.
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


@contextmanager
def on_loopback() -> Iterator[None]:
    """Have the cluster that is started meanwhile listen on 127.0.0.1 only.

    Ray has a switch for that on systems whose firewall would ask; it is read when Ray is imported.
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
    """Shut down the cluster of this machine that was started, if others could use it.

    Raises
    ------
    SkillplanError
        If it listens elsewhere than on 127.0.0.1, or demands no token.
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
    """Return a folder for logs and sockets of the cluster that others cannot reach.

    Ray lets everyone write to it, so it lies in a folder that others cannot enter.
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
    # In a folder that others may write to they could put another token in place of this one.
    if mode & _OTHERS_WRITE:
        folder.chmod(mode & ~_OTHERS_WRITE)


def _write_token(path: Path) -> None:
    """Write a new token unless there is one."""
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
