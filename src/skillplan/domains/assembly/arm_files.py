"""Arms from URDF and xacro files: packages, meshes and expansion, within safe folders."""

from __future__ import annotations

import hashlib
import itertools
import os
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from skillplan.errors import nearest
from skillplan.files.regular_file import (
    CompanionFileError,
    find_companion,
    is_folder,
    is_regular,
    read_companion,
)
from skillplan.robots.arm_description import ArmDescription, Triple
from skillplan.robots.catalogue import ARMS

if TYPE_CHECKING:
    from skillplan.robots.urdf import UrdfTree

MAX_BYTES: Final = 4 * 1024 * 1024
"""Greatest size of a URDF or of an expanded xacro [B]."""

MAX_MESH_BYTES: Final = 128 * 1024 * 1024
"""Greatest total size of its meshes, counted once for each scale [B]."""

SUFFIXES: Final = (".urdf", ".xacro")

_SCHEMES: Final = ("package://", "model://")
# Levels above a file that are searched for its package.
_LEVELS: Final = 5
_PACKAGE_FILE: Final = "package.xml"
# Folders of a package that hold descriptions, next to folders of meshes.
DESCRIPTION_FOLDERS: Final = ("urdf", "robots", "robot", "model", "models", "xacro")
# Number of files of a package that are searched for a mesh of another package.
_MOST_FILES: Final = 5_000


class ArmFileError(Exception):
    """A file does not describe a supported arm.

    Parameters
    ----------
    key
        Key of the task file at fault: ``model``, ``tip``, ``home_rad`` or ``packages``.
    """

    def __init__(self, message: str, key: str = "model") -> None:
        self.key = key
        super().__init__(message)


def read_arm(
    folder: Path,
    name: str,
    tip: str | None,
    home_rad: Sequence[float] | None,
    packages: Sequence[str] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> tuple[ArmDescription, str]:
    """Return the arm of a URDF or xacro file, and a hash of all files read.

    Parameters
    ----------
    folder
        Folder of the task file, which must contain the file.
    home_rad
        Home posture [rad], of prismatic joints [m]; None to find one.
    packages
        Folders of ROS packages, or folders that contain them; relative ones begin at `folder`.
    xacro_args
        Arguments of a xacro file, by name.

    Raises
    ------
    ArmFileError
        If the file is elsewhere, unreadable, larger than `MAX_BYTES`, or describes no arm.
    """
    # Imports the XML reader, which named arms do not need.
    from skillplan.robots.urdf import UrdfError

    tree, files = read_tree(folder, name, packages, xacro_args)
    try:
        arm = tree.arm(tip, home_rad)
    except UrdfError as error:
        raise _make_refusal(error) from None
    except ValueError as error:
        # The description is inconsistent: a home posture beyond limits, or repeated joint names.
        key = "home_rad" if "home_rad" in str(error) else "model"
        raise ArmFileError(str(error), key) from None
    return arm, files.digest.hexdigest()


def read_tree(
    folder: Path,
    name: str,
    packages: Sequence[str] = (),
    xacro_args: Mapping[str, str] | None = None,
) -> tuple[UrdfTree, ArmFiles]:
    """Return the links and joints of a URDF or xacro file, and the reader of its meshes.

    Raises
    ------
    ArmFileError
        See `read_arm`.
    """
    from skillplan.robots.urdf import UrdfError, find_xacro, parse_root, parse_urdf

    if not name.lower().endswith(SUFFIXES):
        similar = nearest(name, ARMS)
        hint = "" if similar is None else f" Did you mean {similar!r}?"
        raise ArmFileError(
            f"There is no such model.{hint} Give {', '.join(ARMS)}, or a file that ends in .urdf "
            "or .xacro."
        )
    try:
        path = find_companion(folder, name)
        content = read_companion(path, MAX_BYTES, "robot")
    except CompanionFileError as error:
        raise ArmFileError(str(error)) from None
    files = ArmFiles(folder, name, packages)
    files.digest.update(content)
    try:
        root = parse_root(content)
        first_use = find_xacro(root).first_use
        if first_use is not None or name.lower().endswith(".xacro"):
            content = files.expand(path, dict(xacro_args or {}), first_use)
            files.digest.update(content)
        tree = parse_urdf(content, files.read_pieces)
    except UrdfError as error:
        raise _make_refusal(error) from None
    files.notes = tree.notes
    return tree, files


def _make_refusal(error: Exception) -> ArmFileError:
    text = str(error)
    return ArmFileError(f"{text[:1].upper()}{text[1:]}.", getattr(error, "key", "model"))


class ArmFiles:
    """Files that a URDF names: meshes, and what xacro includes.

    Parameters
    ----------
    name
        The URDF relative to `folder`, with slashes.

    Attributes
    ----------
    digest
        Hash of all contents read.
    notes
        Sentences on packages that were not found by their names.
    """

    def __init__(self, folder: Path, name: str, packages: Sequence[str]) -> None:
        self.folder, self.name = folder, name
        self.notes: list[str] = []
        self.beside = posixpath.dirname(posixpath.normpath(name))
        self.declared = [Path(os.path.abspath(folder / given)) for given in packages]
        self.digest = hashlib.sha256()
        self._pieces: dict[tuple[str, Triple], tuple[tuple[Triple, ...], ...]] = {}
        self._left = MAX_MESH_BYTES
        for given, path in zip(packages, self.declared, strict=True):
            if not is_folder(path):
                raise ArmFileError(f"There is no folder {given[:200]!r}.", "packages")

    def read_pieces(self, name: str, scale: Triple) -> tuple[tuple[Triple, ...], ...]:
        """Return the corners of the convex pieces of a mesh [m]; empty if it has no triangle.

        Raises
        ------
        UrdfError
            If the mesh is missing, elsewhere, or unreadable.
        """
        # Imports trimesh and numpy.
        from skillplan.domains.assembly.arm_meshes import ArmMeshError, cover_mesh
        from skillplan.robots.urdf import UrdfError

        try:
            path = self.find(name)
            key = (str(path), scale)
            if key not in self._pieces:
                content = read_companion(path, MAX_BYTES_OF_A_MESH, "surface")
                self._left -= len(content)
                if self._left < 0:
                    raise UrdfError(
                        f"its meshes have more than {MAX_MESH_BYTES // 1024**2} MiB together; "
                        "save them with fewer triangles"
                    )
                self.digest.update(hashlib.sha256(content).hexdigest().encode())
                self._pieces[key] = cover_mesh(content, path.suffix.lower(), scale)
            return self._pieces[key]
        except (CompanionFileError, ArmMeshError) as error:
            words = str(error)
            raise UrdfError(
                f"mesh {name[:200]!r}: {words[:1].lower()}{words[1:].rstrip('.')}"
            ) from None

    def find(self, name: str) -> Path:
        """Return the path of a file that the URDF names.

        Raises
        ------
        CompanionFileError
            If no folder contains it; the message lists the folders tried.
        """
        scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), None)
        if scheme is None:
            return self._find_beside(name.removeprefix("file://"))
        package, _, rest = name.removeprefix(scheme).partition("/")
        tried: list[str] = []
        for root in self._list_roots(package):
            try:
                path = find_companion(root, rest)
            except CompanionFileError:
                if ".." in rest.split("/"):
                    raise
                continue
            if is_regular(path):
                return path
            if str(root) not in tried:
                tried.append(str(root))
        path_of_copy = self._find_copy(package, rest)
        if path_of_copy is not None:
            return path_of_copy
        folders = "; ".join(tried) or "none"
        raise CompanionFileError(
            f"There is no such file. Folders tried: {folders}. Give the package's in "
            "'robot.packages'."
        )

    def _find_copy(self, package: str, rest: str) -> Path | None:
        """Return a file of a package whose folder has another name, around the URDF, or None.

        Of several, the longest common end of the path decides, then the name of the URDF; at least
        the file's folder must agree.
        """
        steps = [package, *rest.split("/")]
        if ".." in steps:
            return None
        around = self._around
        roots = [path for path in around if is_folder(path / "meshes")]
        roots += [around[1] if around[0].name in DESCRIPTION_FOLDERS else around[0]]
        for root in roots:
            path = self._find_end(root, steps)
            if path is None:
                continue
            note = f"no package {package!r}: its files are taken from {root.name}"
            if note not in self.notes:
                self.notes.append(note)
            return find_companion(root, path.relative_to(root).as_posix())
        return None

    def _find_end(self, root: Path, steps: Sequence[str]) -> Path | None:
        """Return the file below a folder whose path ends most like the steps, None if unclear."""
        stem = posixpath.basename(self.name).partition(".")[0].lower()
        ranked: dict[tuple[int, bool], list[Path]] = {}
        for path in _walk(root, steps[-1]):
            own = path.relative_to(root).parts
            pairs = zip(reversed(own), reversed(steps), strict=False)
            common = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs))
            ranked.setdefault((common, stem in [part.lower() for part in own]), []).append(path)
        best = max(ranked, default=(0, False))
        return ranked[best][0] if best[0] >= 2 and len(ranked[best]) == 1 else None

    @property
    def _around(self) -> list[Path]:
        """The folder of the URDF, and those above it."""
        here = Path(os.path.abspath(self.folder / self.beside))
        return [here, *here.parents][:_LEVELS]

    def find_package(self, package: str) -> Path:
        """Return the folder of a ROS package.

        Raises
        ------
        CompanionFileError
            If there is none.
        """
        for root in self._list_packages(package):
            if is_folder(root):
                return root
        raise CompanionFileError(
            f"There is no package {package[:100]!r}. Give its folder in 'robot.packages'."
        )

    def list_allowed(self) -> list[Path]:
        """Return the folders from which xacro may include files."""
        packages = [path for path in self._around if _is_package(path)]
        return [Path(os.path.abspath(self.folder)), *packages, *self.declared, *_list_ros_folders()]

    def expand(
        self, path: Path, arguments: Mapping[str, str], first_use: tuple[int, str] | None
    ) -> bytes:
        """Return a xacro file in expanded form.

        Raises
        ------
        UrdfError
            If the file is at fault, or the library is not installed.
        """
        from skillplan.domains.assembly.xacro_files import expand_xacro

        return expand_xacro(path, self, arguments, first_use, MAX_BYTES)

    def _find_beside(self, name: str) -> Path:
        within = posixpath.normpath(posixpath.join(self.beside, name))
        try:
            return find_companion(self.folder, within)
        except CompanionFileError as error:
            here = Path(os.path.abspath(self.folder / self.beside))
            target = Path(os.path.normpath(here / name))
            for root in [path for path in self.declared if target.is_relative_to(path)]:
                return find_companion(root, target.relative_to(root).as_posix())
            raise CompanionFileError(
                f"{error} Or give its package in 'robot.packages'."
                if "outside" in str(error)
                else str(error)
            ) from None

    def _list_roots(self, package: str) -> Iterator[Path]:
        """Yield folders in which a package's files may be."""
        yield from self._list_packages(package)
        # A copy of the package's files next to the URDF.
        yield self.folder / self.beside

    def _list_packages(self, package: str) -> Iterator[Path]:
        """Yield possible folders of a package: declared, around the URDF, and ROS's."""
        if not re.fullmatch(r"[\w.-]+", package) or package in (".", ".."):
            return
        for path in self.declared:
            if path.name == package or _name_package(path) == package:
                yield path
            yield path / package
        folder = Path(os.path.abspath(self.folder))
        for path in self._around:
            if path.name == package or _name_package(path) == package:
                yield path
            # Outside the task's folder only packages count.
            inside = path.is_relative_to(folder)
            if inside or _is_package(path / package):
                yield path / package
        for path in _list_ros_folders():
            if path.name == package:
                yield path
            yield path / package


def _list_ros_folders() -> list[Path]:
    """Return the folders in which ROS looks for packages."""
    paths = [path for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if path]
    prefixes = [path for path in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if path]
    return [Path(path) for path in paths] + [Path(path) / "share" for path in prefixes]


def _is_package(path: Path) -> bool:
    """Return whether a folder looks like a ROS package."""
    return is_regular(path / _PACKAGE_FILE) or is_folder(path / "meshes")


def _walk(root: Path, name: str) -> Iterator[Path]:
    """Yield the files of a name below a folder, without following links."""
    seen = 0
    for folder, folders, files in os.walk(root):
        folders.sort()
        seen += len(files) + len(folders)
        if seen > _MOST_FILES:
            return
        if name in files:
            yield Path(folder) / name


def _name_package(path: Path) -> str | None:
    """Return the name in a package's file, or None."""
    if not is_regular(path / _PACKAGE_FILE):
        return None
    try:
        content = read_companion(path / _PACKAGE_FILE, 1024 * 1024, "package")
    except CompanionFileError:
        return None
    match = re.search(rb"<name>\s*([\w.-]+)\s*</name>", content)
    return None if match is None else match[1].decode()


MAX_BYTES_OF_A_MESH: Final = 32 * 1024 * 1024
"""Greatest size of a mesh [B]."""
