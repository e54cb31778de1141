"""Ray clusters of two nodes on this machine, and the processes that belong to them."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PATIENCE_S = 60.0


def two_nodes() -> Iterator[Any]:
    """Start both, and end them after the test."""
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    import ray
    from ray.cluster_utils import Cluster

    ray.shutdown()
    nodes = Cluster(
        initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False}
    )
    nodes.second = nodes.add_node(num_cpus=1)
    yield nodes
    ray.shutdown()
    nodes.shutdown()


def processes_of(node: Any) -> list[int]:
    """Return the processes of a node, its actors too, but for what keeps track of the cluster."""
    own = [
        info.process.pid
        for kind, infos in node.all_processes.items()
        for info in infos
        if kind != "gcs_server"
    ]
    items = list(own)
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        if parent in own:
            items.append(int(path.parent.name))
    return items


def actors(cluster: Any) -> set[int]:
    """Return the processes of actors of a cluster; other clusters of this machine do not count."""
    return {
        process
        for node in cluster.list_all_nodes()
        for process in processes_of(node)
        if _is_actor(process)
    }


def first_actors(cluster: Any) -> set[int]:
    """Return the actors of a cluster as soon as there are any."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        result = actors(cluster)
        if result:
            return result
        time.sleep(0.1)
    raise AssertionError("there are no actors")


def _is_actor(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/cmdline").read_bytes().startswith(b"ray::ListeningActor")
    except OSError:
        return False


def places(cluster: Any) -> dict[str, list[str]]:
    """Return where all answers must be the same: words of a command line, by name."""
    two = ["--jobs", "2"]
    return {
        "local 1": ["--jobs", "1"],
        "local 2": two,
        "ray": [*two, "--executor", "ray"],
        "cluster": [*two, "--executor", f"ray:{cluster.address}"],
    }
