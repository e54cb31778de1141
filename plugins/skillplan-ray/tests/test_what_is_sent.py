"""What workers start from is sent by its content: Ray fetches an object once a node."""

from __future__ import annotations

from typing import Any

import pytest

from skillplan.workers import pack_content
from skillplan_ray import RayExecutor
from skillplan_ray import executor as executors


class Store:
    """Ray's object store, and all else that starting a worker takes of a cluster."""

    def __init__(self) -> None:
        self.objects: list[bytes] = []
        self.started: list[int] = []
        self.ray = self

    def put(self, content: bytes) -> int:
        """Keep an object; return its reference."""
        self.objects.append(content)
        return len(self.objects) - 1


class Started:
    """A worker, of which only what it starts from matters."""

    alive = True

    def __init__(self, cluster: Store, prepare: Any, content: int, what: str, **_: Any) -> None:
        cluster.started.append(content)

    def end(self, *, gently: bool = True) -> None:
        """Nothing runs."""


@pytest.fixture
def store(monkeypatch):
    """A cluster that keeps what is put into it."""
    created = Store()
    monkeypatch.setattr(executors, "connected", lambda address, mib: created)
    monkeypatch.setattr(executors, "RayWorker", Started)
    return created


def test_equal_content_is_sent_once_however_many_workers_start_from_it(store):
    """By its hash, not by which object it is."""
    executor = RayExecutor(3)
    content = pack_content({"task": "lid"}, "tests")
    for item in (content, pack_content({"task": "box"}, "tests"), bytes(bytearray(content))):
        executor.start(int, item, "tests")
    assert store.started == [0, 1, 0]
    assert len(store.objects) == 2


def test_after_closing_it_is_sent_anew(store):
    """Nothing is kept in the cluster's memory for nobody."""
    executor = RayExecutor(1)
    content = pack_content({"task": "lid"}, "tests")
    executor.start(int, content, "tests")
    executor.close()
    executor.start(int, content, "tests")
    assert store.started == [0, 1]
