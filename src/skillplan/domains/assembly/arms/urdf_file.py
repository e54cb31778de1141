"""Arms from URDF files in a task's folder."""

from __future__ import annotations

import hashlib
import posixpath
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from skillplan.files.companion_file import CompanionFileError, companion_in, read_companion
from skillplan.robots.arm_description import ArmDescription, Triple
from skillplan.robots.urdf import read_urdf
from skillplan.robots.urdf_elements import UrdfError

MAX_BYTES: Final = 4 * 1024 * 1024
"""Greatest size of a URDF."""

MAX_MESH_BYTES: Final = 64 * 1024 * 1024
"""Greatest size of all meshes that it names, each counted once a scale."""

_PACKAGE = "package://"


class ArmFileError(Exception):
    """A file holds no arm; says why and what to do instead.

    Parameters
    ----------
    message
        A sentence.
    key
        The key of the task file that is at fault.
    """

    def __init__(self, message: str, key: str = "model") -> None:
        self.key = key
        super().__init__(message)


def read_arm(
    folder: Path, name: str, tip: str | None, home_rad: Sequence[float] | None
) -> tuple[ArmDescription, str]:
    """Return the arm that a file holds, and a hash of all that was read.

    Parameters
    ----------
    folder
        The task file's folder, which the file must lie in.
    name
        The file's name relative to `folder`.
    tip
        The link to which hands are fixed.
    home_rad
        A posture with room for every joint [rad], or None.

    Raises
    ------
    ArmFileError
        If it lies elsewhere, cannot be read, is larger than `MAX_BYTES`, or describes no arm.
    """
    if name.lower().endswith(".xacro"):
        raise ArmFileError(
            "This is xacro, a language of macros; expand it first: xacro arm.urdf.xacro > arm.urdf."
        )
    if not name.lower().endswith(".urdf"):
        raise ArmFileError(
            "There is no such model; give panda, ur5e, or a file that ends in .urdf."
        )
    try:
        path = companion_in(folder, name)
        content = read_companion(path, MAX_BYTES, "robot")
    except CompanionFileError as error:
        raise ArmFileError(str(error)) from None
    meshes = _Meshes(folder, posixpath.dirname(name), hashlib.sha256(content))
    try:
        arm = read_urdf(content, tip, home_rad, meshes.corners)
    except UrdfError as error:
        raise ArmFileError(f"{str(error)[:1].upper()}{str(error)[1:]}.", error.key) from None
    except ValueError as error:
        # Of the description: a home posture beyond the limits, joints of one name.
        key = "home_rad" if "home_rad" in str(error) else "model"
        raise ArmFileError(str(error), key) from None
    return arm, meshes.digest.hexdigest()


class _Meshes:
    """Reads meshes beside a URDF, and remembers what they were."""

    def __init__(self, folder: Path, beside: str, digest: hashlib._Hash) -> None:
        self.folder = folder
        self.beside = beside
        self.digest = digest
        self._hulls: dict[tuple[str, Triple], tuple[Triple, ...]] = {}
        self._left = MAX_MESH_BYTES

    def corners(self, name: str, scale: Triple) -> tuple[Triple, ...]:
        """Return the corners of the convex hull of a mesh [m]."""
        # Takes trimesh, and numpy with it.
        from skillplan.domains.assembly.meshes.mesh_files import read_hull
        from skillplan.domains.assembly.meshes.polyhedron import MeshFileError

        refusal = MeshFileError("It names no file.")
        for candidate in _candidates(name):
            within = posixpath.normpath(posixpath.join(self.beside, candidate))
            if (within, scale) in self._hulls:
                return self._hulls[within, scale]
            try:
                corners, content = read_hull(self.folder, within, scale)
            except MeshFileError as error:
                refusal = error
                continue
            self._left -= len(content)
            if self._left < 0:
                raise UrdfError(
                    f"its meshes have more than {MAX_MESH_BYTES // 1024**2} MiB together; save "
                    "them with fewer triangles"
                )
            self.digest.update(hashlib.sha256(content).hexdigest().encode())
            self._hulls[within, scale] = corners
            return corners
        words = str(refusal)
        raise UrdfError(f"mesh {name[:200]!r}: {words[:1].lower()}{words[1:].rstrip('.')}")


def _candidates(name: str) -> list[str]:
    """Return where a mesh may lie: of a package, in its folder or that of the URDF."""
    if not name.startswith(_PACKAGE):
        return [name]
    within = name.removeprefix(_PACKAGE)
    return [within, within.partition("/")[2]]
