"""What a verdict depends on besides the task: versions, sources and the kind of processor.

Sent to every node by value and run there, so it uses nothing but Python's own library: a node that
lacks skillplan can say so.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import distributions
from pathlib import Path

# Besides skillplan's distributions, those whose version may change a figure.
LIBRARIES = frozenset(
    {"coacd", "coal", "gymnasium", "highspy", "manifold3d", "mujoco-core", "numba", "numpy"}
    | {"ompl", "ortools", "pin", "pybullet", "ray", "scipy", "toppra", "torch", "trimesh"}
)
ABSENT = "is not installed"


def fingerprint() -> dict[str, str]:
    """Return what is compared between machines, by name."""
    found = {"processor": _processor(), "Python": platform.python_version()}
    # The first of a name is the one that is imported.
    for distribution in distributions():
        name = (distribution.metadata["Name"] or "").lower()
        if name in found or not (name in LIBRARIES or name.startswith("skillplan")):
            continue
        found[name] = distribution.version
        if name.startswith("skillplan"):
            found[f"source of {name}"] = _source(name.replace("-", "_"))
    return found


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[str]:
    """Return what differs there, in words.

    Parameters
    ----------
    here, there
        Fingerprints of this machine and of another.
    """
    found = []
    for name in sorted({*here, *there}):
        mine, theirs = here.get(name, ABSENT), there.get(name, ABSENT)
        if mine == theirs:
            continue
        package = name.removeprefix("source of ")
        if package == name:
            found.append(f"{name} {theirs} (here {mine})")
        elif here.get(package) == there.get(package):
            found.append(f"another source of {package} {here[package]}")
    return found


def _processor() -> str:
    """Return the kind of processor, as exactly as the system says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return " ".join(filter(None, (platform.machine(), next(names, platform.processor()))))


def _source(package: str) -> str:
    """Return the hash of a package's modules, as they would be imported."""
    from importlib.util import find_spec

    spec = find_spec(package)
    if spec is None or spec.origin is None:
        return ABSENT
    root = Path(spec.origin).parent
    digest = hashlib.sha256()
    for path in sorted(_modules(root)):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _modules(root: Path) -> Iterator[Path]:
    return root.rglob("*.py")
