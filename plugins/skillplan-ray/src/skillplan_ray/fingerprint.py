"""Fingerprint of a machine: versions, sources and processor, on which verdicts depend.

It is sent to every node by value and run there, so it uses only the standard library: a node
without skillplan can report that.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterator, Mapping
from importlib.metadata import distributions
from pathlib import Path

# Further distributions whose version may change a figure.
LIBRARIES = frozenset(
    {"coacd", "coal", "gymnasium", "highspy", "manifold3d", "mujoco-core", "numba", "numpy"}
    | {"ompl", "ortools", "pin", "pybullet", "ray", "scipy", "shapely", "toppra", "torch"}
    | {"trimesh"}
)
ABSENT = "is not installed"


def fingerprint() -> dict[str, str]:
    """Return the compared values, by name."""
    values = {"processor": _processor(), "Python": platform.python_version()}
    # The first distribution of a name is the imported one.
    for distribution in distributions():
        name = (distribution.metadata["Name"] or "").lower()
        if name in values or not (name in LIBRARIES or name.startswith("skillplan")):
            continue
        values[name] = distribution.version
        if name.startswith("skillplan"):
            values[f"source of {name}"] = _source(name.replace("-", "_"))
    return values


def differences(here: Mapping[str, str], there: Mapping[str, str]) -> list[str]:
    """Return the differences of another machine, as text.

    Parameters
    ----------
    here, there
        Fingerprints of this machine and the other.
    """
    texts = []
    for name in sorted({*here, *there}):
        mine, theirs = here.get(name, ABSENT), there.get(name, ABSENT)
        if mine == theirs:
            continue
        package = name.removeprefix("source of ")
        if package == name:
            texts.append(f"{name} {theirs} (here {mine})")
        elif here.get(package) == there.get(package):
            texts.append(f"another source of {package} {here[package]}")
    return texts


def _processor() -> str:
    """Return the model of the processor, as exactly as the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return " ".join(filter(None, (platform.machine(), next(names, platform.processor()))))


def _source(package: str) -> str:
    """Return the hash of the modules of a package, as imported."""
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
