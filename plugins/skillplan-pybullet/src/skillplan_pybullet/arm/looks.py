"""What links of an arm look like in pictures, where an installed package has meshes of them."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from skillplan.robots.arm_description import ArmDescription

# Of an arm by name: a package, and the meshes of base and links in it.
_MESHES = {
    "Franka Emika Panda": (
        "pybullet_data",
        tuple(f"franka_panda/meshes/visual/link{number}.obj" for number in range(8)),
    )
}


def looks_of(description: ArmDescription) -> tuple[Path | None, ...]:
    """Return meshes of base and links in their frames; None for what is drawn by its shapes."""
    none = (None,) * (len(description.joints) + 1)
    if description.name not in _MESHES:
        return none
    package, files = _MESHES[description.name]
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        return none
    paths = [Path(spec.origin).parent / name for name in files]
    return tuple(path if path.is_file() else None for path in paths)
