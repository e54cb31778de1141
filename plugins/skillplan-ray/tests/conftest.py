"""Clusters that tests are given."""

import pytest

from ray_clusters import two_nodes


@pytest.fixture
def cluster():
    """A cluster of two nodes with a CPU each; this process is not connected to it."""
    yield from two_nodes()


@pytest.fixture
def impatient_cluster(monkeypatch):
    """The same, in which a node counts as lost after some seconds of silence."""
    monkeypatch.setenv("RAY_health_check_initial_delay_ms", "5000")
    monkeypatch.setenv("RAY_health_check_period_ms", "1000")
    monkeypatch.setenv("RAY_health_check_timeout_ms", "4000")
    monkeypatch.setenv("RAY_health_check_failure_threshold", "3")
    yield from two_nodes()
