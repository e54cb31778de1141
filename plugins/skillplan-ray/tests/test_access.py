"""A cluster of this machine serves the user who started it, and no other."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

from skillplan.errors import SkillplanError
from skillplan.workers import list_descendants
from skillplan_ray import access

NOBODY = 65534
# Starts a cluster, prints its address, and ends it with its input. Ray reads the mode when it is
# imported, perhaps for a cluster elsewhere.
START = """
import ray, sys
from skillplan_ray.cluster import Cluster
cluster = Cluster("", 80)
print(cluster.ray.get_runtime_context().gcs_address, flush=True)
sys.stdin.read()
"""
# As another user: reads the token and asks the cluster for its nodes. Loaded as root, who alone may
# be able to read the interpreter.
OTHER = """
import json, os, sys
address, token, user = sys.argv[1], sys.argv[2], int(sys.argv[3])
from ray._raylet import AuthenticationTokenLoader, Config, GcsClient
os.setgroups([]); os.setresgid(user, user, user); os.setresuid(user, user, user)
try:
    os.environ["RAY_AUTH_TOKEN"] = open(token).read()
    can_read = True
except PermissionError:
    can_read = False
if not can_read and sys.argv[4]:
    os.environ["RAY_AUTH_TOKEN"] = sys.argv[4]
Config.initialize("")
AuthenticationTokenLoader.instance().reset_cache()
try:
    client = GcsClient(address=address)
    nodes = len(client.get_all_node_info(timeout=10))
    said = ""
except Exception as error:
    nodes, said = 0, f"{type(error).__name__}: {error}"
print(json.dumps([os.getuid(), can_read, nodes, said]))
"""


@pytest.fixture
def home(monkeypatch):
    """A home that others may enter, as homes often are."""
    folder = Path(tempfile.mkdtemp(prefix="home-", dir="/tmp"))
    folder.chmod(0o755)
    monkeypatch.setenv("HOME", str(folder))
    for name in ("RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"):
        # Restored afterwards, though what is tested sets them.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    yield folder
    shutil.rmtree(folder)


def mode_of(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


class TestTheToken:
    def test_is_written_for_this_user_alone(self, home):
        """Whatever the umask."""
        before = os.umask(0)
        try:
            access.require_token()
        finally:
            os.umask(before)
        path = home / ".ray" / "auth_token"
        assert (mode_of(path.parent), mode_of(path)) == (0o700, 0o600)
        assert len(path.read_text()) == 64
        assert os.environ["RAY_AUTH_MODE"] == "token"

    def test_that_is_there_is_kept(self, home):
        """A cluster elsewhere may use it."""
        access.require_token()
        path = home / ".ray" / "auth_token"
        token = path.read_text()
        access.require_token()
        assert token == path.read_text()

    @pytest.mark.parametrize("mode", [0o644, 0o640, 0o604])
    def test_that_others_can_read_is_refused(self, home, mode):
        """They may have read it; the message says what to do."""
        access.require_token()
        path = home / ".ray" / "auth_token"
        path.chmod(mode)
        with pytest.raises(SkillplanError, match=f"has mode {mode:04o}, so that other users"):
            access.require_token()

    def test_that_is_a_link_is_refused(self, home, tmp_path):
        """It leads to a file of somebody else."""
        (tmp_path / "token").write_text("a" * 64)
        (home / ".ray").mkdir()
        (home / ".ray" / "auth_token").symlink_to(tmp_path / "token")
        with pytest.raises(SkillplanError, match="is no file of yours"):
            access.require_token()

    def test_is_in_a_folder_that_others_cannot_write_to(self, home):
        """Such a folder is tightened: they could put a token of theirs there."""
        (home / ".ray").mkdir()
        (home / ".ray").chmod(0o777)
        access.require_token()
        assert mode_of(home / ".ray") == 0o755

    def test_that_cannot_be_written_is_told(self, home):
        """In words."""
        (home / ".ray").write_text("a file")
        with pytest.raises(SkillplanError, match=r"cannot be kept in .*auth_token"):
            access.require_token()


@pytest.mark.parametrize("length", [1, 60])
def test_the_folder_of_a_session_is_closed_to_others(monkeypatch, length):
    """Ray opens its own to all; and the paths of its sockets are short enough."""
    place = Path(tempfile.mkdtemp(dir="/tmp")) / ("x" * length)
    place.mkdir(mode=0o755)
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    folder = Path(access.session_folder())
    try:
        assert mode_of(folder.parent) == 0o700
        assert len(str(folder)) <= 107 - 65
    finally:
        shutil.rmtree(folder.parent)
        shutil.rmtree(place.parent)


def listening(process: int) -> set[str]:
    """Return the addresses on which a process and those below it listen, as Linux writes them."""
    inodes = set()
    for number in (process, *list_descendants(process)):
        for path in Path(f"/proc/{number}/fd").glob("*"):
            try:
                inodes.add(os.readlink(path))
            except OSError:
                continue
    result = set()
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in inodes:
                result.add(fields[1].partition(":")[0])
    return result


def ask_as(user: int, address: str, token: Path, guess: str, home: Path) -> list[Any]:
    """Return what another user can do: their number, token read, nodes listed, and why not."""
    words = [sys.executable, "-c", OTHER, address, str(token), str(user), guess]
    # Without a token a client of Ray does not even try, unless the mode is off.
    mode = "token" if guess or user == 0 else "disabled"
    environment = {**os.environ, "HOME": str(home), "RAY_AUTH_MODE": mode}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr
    answer: list[Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


@pytest.mark.slow(reason="starts Ray; modes of the token and of folders in every run")
@pytest.mark.skipif(sys.platform != "linux", reason="looks for ports in /proc")
def test_a_cluster_of_this_machine_serves_no_other_user(home, tmp_path):
    """It listens on 127.0.0.1 only, and refuses whoever cannot read the token.

    Also if Ray was imported without a token.
    """
    cluster = subprocess.Popen(
        [sys.executable, "-c", START],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "RAY_AUTH_MODE": "disabled"},
    )
    try:
        assert cluster.stdout is not None
        address = cluster.stdout.readline().strip()
        assert address.startswith("127.0.0.1:")
        # 127.0.0.1, also as an address of version 6.
        assert listening(cluster.pid) <= {"0100007F", "0000000000000000FFFF00000100007F"}
        assert listening(cluster.pid)
        token = home / ".ray" / "auth_token"
        assert mode_of(token) == 0o600
        if os.geteuid() != 0:
            pytest.skip("only root can become another user")
        assert ask_as(0, address, token, "", home) == [0, True, 1, ""]
        for guess in ("", "a" * 64):
            user, can_read, nodes, message = ask_as(NOBODY, address, token, guess, tmp_path)
            assert (user, can_read, nodes) == (NOBODY, False, 0)
            assert "oken" in message or "nauthenticated" in message
    finally:
        # Its input ends, and so does it.
        cluster.communicate(timeout=60)
