"""Files of kept verdicts: one verdict each, in a folder named by a hash of all it depends on.

The hash covers the code of the back end. The version of a distribution identifies its code, unless
the distribution is editable; then, and for classes that no distribution registers, the source
itself is hashed. A distribution is never guessed from the name of a module.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from typing import Any

from skillplan.checks.single_check import Checked
from skillplan.checks.variants import list_queried_skills
from skillplan.files.atomic_file import write_whole
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import read_bytes
from skillplan.plugins.installed import find_entry_point, is_editable
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import Facts, State
from skillplan.task.verdict import Verdict, VerdictStatus

FORMAT = "skillplan.verdict/2"

_MOST_BYTES = 16 * 1024 * 1024
_VERDICT_FILE = re.compile(r"[0-9a-f]{64}\.json")
# A folder of verdicts, and a leftover of a killed process.
_KEY = re.compile(r"[0-9a-f]{64}")
_UNFINISHED = re.compile(r"\.[0-9a-f]{64}\.json\.[0-9a-f]+\.tmp")

_MOST_SOURCE_BYTES = 32 * 1024 * 1024
_NO_SOURCE = ("__pycache__", ".git", ".mypy_cache", ".ruff_cache")
_CORE = "skillplan"
# Packages of the core that verdicts rest on; scene and skill are in the key themselves.
_CORE_FOLDERS = ("checks", "collision", "physics", "robots", "task")
_DISTRIBUTION_NAME = re.compile(r"[\w.-]+")

# Fields that change no verdict.
_IRRELEVANT_FIELDS = ("dwell_s",)


def find_key_folder(root: Path, back_end: BackEnd, skill: Skill) -> Path:
    """Return the folder below `root` for the verdicts of a back end on a skill."""
    return root / back_end.name / compute_verdict_key(back_end, skill)


def compute_verdict_key(back_end: BackEnd, skill: Skill) -> str:
    """Return the hash of everything that affects the verdicts of a back end on a skill.

    Scene, skill, facts, and the back end's name, version, options, basis and code.
    """
    content = {
        "back_end": [
            f"{type(back_end).__module__}.{type(back_end).__qualname__}",
            back_end.name,
            back_end.version,
        ],
        "code": list(identify_code(type(back_end))),
        "options": back_end.options.model_dump(mode="json"),
        "basis": _to_json(back_end.basis),
        "facts": list(back_end.task.facts.names),
        "scene": _to_json(back_end.task.scene),
        "skill": [skill.name, skill.kind, list(skill.agents), dict(skill.parameters)],
        "execution": [_to_json(skill.motion), str(skill.precondition)],
        "prediction": [str(skill.prediction.add), str(skill.prediction.delete)],
        "cases": [
            _to_json(case.fact) + _to_json(case.forbids) + _to_json(case.outcomes)
            for case in skill.cases
        ],
        "chart": [[line.before, line.after, *line.instead] for line in back_end.task.chart],
        "operations": dict(back_end.task.operations),
    }
    return hash_content(content)


def hash_content(content: Any) -> str:
    """Return the hexadecimal hash of JSON values; the order of keys does not matter."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _to_json(value: Any) -> Any:
    """Return a data class as JSON values; a state becomes the names of its facts."""
    if isinstance(value, State):
        return list(value)
    if isinstance(value, Mapping):
        return {str(key): _to_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_json(item) for item in value]
    if hasattr(value, "__dataclass_fields__"):
        return {
            name: _to_json(getattr(value, name))
            for name in value.__dataclass_fields__
            if not name.startswith("_") and name not in _IRRELEVANT_FIELDS
        }
    return value


@cache
def identify_code(plugin: type) -> tuple[str, ...]:
    """Return texts that identify the code of a plugin.

    Parameters
    ----------
    plugin
        Class of the plugin; base classes in other packages count, too.

    Returns
    -------
    tuple of str
        ``name version`` of the distribution that registers it, of skillplan, and of the
        requirements of that distribution; ``package hash`` of every package that its version
        does not identify.

    Raises
    ------
    OSError
        If source cannot be read.
    """
    entry = find_entry_point(plugin)
    registering = None if entry is None else entry.dist
    origin = list(_list_versions(registering))
    packages = {base.__module__.partition(".")[0] for base in plugin.__mro__}
    own = {plugin.__module__.partition(".")[0]}
    if entry is not None:
        own.add(entry.module.partition(".")[0])
    packages -= {"builtins", "abc", "typing"}
    for package in sorted(packages | own):
        if package in own:
            source = registering
        else:
            # Other packages have no registering distribution; only skillplan's is known.
            source = _find_distribution(_CORE) if package == _CORE else None
            origin += _list_versions(source)
        if source is None or not source.version or is_editable(source):
            origin.append(f"{package} {_source_hash(package, sys.modules.get(package))}")
    return tuple(dict.fromkeys(origin))


def _list_versions(registering: Distribution | None) -> Iterator[str]:
    """Yield name and version of a distribution and of its requirements."""
    if registering is None:
        return
    yield f"{registering.name} {registering.version}"
    if registering.name == _CORE:
        return
    for requirement in registering.requires or ():
        name = None if "extra ==" in requirement else _DISTRIBUTION_NAME.match(requirement)
        required = None if name is None else _find_distribution(name[0])
        if required is not None:
            yield f"{required.name} {required.version}"


def _find_distribution(name: str) -> Distribution | None:
    try:
        return distribution(name)
    except PackageNotFoundError:
        return None


@cache
def _source_hash(package: str, module: ModuleType | None) -> str:
    """Return the hash of all files of a package, or of a module that is a single file."""
    file = getattr(module, "__file__", None)
    digest = hashlib.sha256()
    if file is None:
        return "without source"
    path = Path(file)
    root = path.parent
    if path.name != "__init__.py":
        sources = [path]
    else:
        folders = [root / name for name in _CORE_FOLDERS] if package == _CORE else [root]
        sources = sorted(source for folder in folders for source in _list_sources(folder))
    for source in sources:
        content = read_bytes(source, _MOST_SOURCE_BYTES)
        digest.update(f"{source.relative_to(root).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _list_sources(folder: Path) -> Iterator[Path]:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            if path.name not in _NO_SOURCE:
                yield from _list_sources(path)
        elif path.is_file() and path.suffix not in (".pyc", ".pyo"):
            yield path


@dataclass(frozen=True)
class VerdictRecord:
    """A decided verdict in a file.

    Parameters
    ----------
    key
        Hash of everything that affects the verdict; name of the file's folder.
    back_end, version, options
        Name, version and options of the back end, as JSON values.
    state
        Facts of the whole state in which the verdict was made.
    took_s
        Duration of the check [s], >= 0.
    status, reason, stage, present, absent, evidence
        As in the verdict; facts by name.
    """

    key: str
    task: str
    skill: str
    back_end: str
    version: str
    options: Mapping[str, Any]
    state: tuple[str, ...]
    took_s: float
    status: VerdictStatus
    reason: str
    stage: str
    present: tuple[str, ...]
    absent: tuple[str, ...]
    evidence: Mapping[str, Any]

    def __post_init__(self) -> None:
        if self.status is VerdictStatus.UNKNOWN:
            raise ValueError("A verdict that is unknown is never kept.")
        if not self.took_s >= 0:
            raise ValueError(f"A check cannot take {self.took_s} s.")

    @classmethod
    def of(cls, back_end: BackEnd, skill: Skill, checked: Checked, state: State) -> VerdictRecord:
        """Return the record of an answer."""
        verdict = checked.verdict
        return cls(
            key=compute_verdict_key(back_end, skill),
            task=back_end.task.name,
            skill=skill.name,
            back_end=back_end.name,
            version=back_end.version,
            options=back_end.options.model_dump(mode="json"),
            state=tuple(state),
            took_s=checked.took_s,
            status=verdict.status,
            reason=verdict.reason,
            stage=verdict.stage,
            present=tuple(verdict.present or ()),
            absent=tuple(verdict.absent or ()),
            evidence=dict(verdict.evidence),
        )

    @property
    def file_name(self) -> str:
        """The name of the file: a hash of the facts that the verdict rests on."""
        return hash_content([list(self.present), list(self.absent)]) + ".json"

    def verdict(self, facts: Facts) -> Verdict:
        """Return the verdict.

        Raises
        ------
        ValueError
            If a fact is unknown, or the verdict does not apply in the state it was made in.
        """
        if not all(name in facts for name in (*self.present, *self.absent, *self.state)):
            raise ValueError("a kept verdict rests on unknown facts")
        present, absent = facts.of(*self.present), facts.of(*self.absent)
        verdict = Verdict(
            self.status, self.reason, self.stage, present, absent, dict(self.evidence)
        )
        if not verdict.applies_in(facts.of(*self.state)):
            raise ValueError("a kept verdict does not apply where it was made")
        return verdict

    def write(self, folder: Path) -> str:
        """Write the file atomically to the folder of its key, and return its name.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        content = {
            "format": FORMAT,
            "key": self.key,
            "task": self.task,
            "skill": self.skill,
            "back_end": {
                "name": self.back_end,
                "version": self.version,
                "options": dict(self.options),
            },
            "state": list(self.state),
            "took_s": self.took_s,
            "verdict": {
                "status": self.status.value,
                "reason": self.reason,
                "stage": self.stage,
                "present": list(self.present),
                "absent": list(self.absent),
                "evidence": dict(self.evidence),
            },
        }
        text = json.dumps({**content, "checksum": hash_content(content)})
        write_whole(folder / self.file_name, text)
        return self.file_name


def is_verdict_file(name: str) -> bool:
    """Return whether a file name is that of a verdict."""
    return _VERDICT_FILE.fullmatch(name) is not None


def read_record(path: Path) -> VerdictRecord:
    """Return the record in a file.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the file is not exactly as it was written under its name.
    """
    text = read_bytes(path, _MOST_BYTES)
    try:
        content = parse_json(text)
        checksum = content.pop("checksum")
        if content["format"] != FORMAT or checksum != hash_content(content):
            raise ValueError("not what was written")
        verdict, back_end = content["verdict"], content["back_end"]
        record = VerdictRecord(
            key=content["key"],
            task=content["task"],
            skill=content["skill"],
            back_end=back_end["name"],
            version=back_end["version"],
            options=dict(back_end["options"]),
            state=tuple(content["state"]),
            took_s=float(content["took_s"]),
            status=VerdictStatus(verdict["status"]),
            reason=str(verdict["reason"]),
            stage=str(verdict["stage"]),
            present=tuple(verdict["present"]),
            absent=tuple(verdict["absent"]),
            evidence=dict(verdict["evidence"]),
        )
        if path.name != record.file_name or path.parent.name != record.key:
            raise ValueError("under another's name")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} is not a verdict as it was written: {error!r}") from None
    return record


@dataclass(frozen=True)
class KeptVerdict:
    """A verdict on disk.

    Parameters
    ----------
    modified_s
        Time of the last change [s since 1970].
    """

    path: Path
    record: VerdictRecord
    size_bytes: int
    modified_s: float


class VerdictFolder:
    """The folder of a `DiskVerdictCache`, with verdicts of any number of tasks.

    Parameters
    ----------
    root
        The folder; it need not exist.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def survey(self) -> tuple[list[KeptVerdict], list[Path]]:
        """Return the sound verdicts in the order of their names, and all other files.

        The other files are damaged, unfinished or of the previous format.
        """
        sound, others = [], []
        for path in self._files():
            is_named = is_verdict_file(path.name) and _KEY.fullmatch(path.parent.name)
            kept = _read(path) if is_named else None
            if kept is None:
                others.append(path)
            else:
                sound.append(kept)
        return sound, others

    def kept_for(self, back_ends: Sequence[BackEnd]) -> list[list[KeptVerdict]]:
        """Return the sound verdicts that each back end would reuse on its task now."""
        by_back_end = []
        for back_end in back_ends:
            verdicts = []
            for skill in list_queried_skills(back_end.task) if back_end.expensive else ():
                folder = find_key_folder(self.root, back_end, skill)
                paths = (folder / name for name in _list_names(folder) if is_verdict_file(name))
                verdicts += [kept for kept in map(_read, paths) if kept is not None]
            by_back_end.append(verdicts)
        return by_back_end

    def drop(self, kept: KeptVerdict) -> bool:
        """Remove a verdict, and return whether it is gone."""
        with suppress(OSError):
            kept.path.unlink(missing_ok=True)
            return True
        return False

    def clear(self, tasks: Collection[str] | None = None) -> int:
        """Remove all files of this folder, or the verdicts of some tasks; return their number.

        Files that a cache did not write stay.

        Raises
        ------
        OSError
            If a file cannot be removed.
        """
        if tasks is None:
            doomed = self._files()
        else:
            doomed = [kept.path for kept in self.survey()[0] if kept.record.task in tasks]
        removed = 0
        for path in doomed:
            with suppress(FileNotFoundError):
                path.unlink()
                removed += 1
        for folder in sorted({path.parent for path in doomed}, reverse=True):
            # Fails if the folder holds something else.
            with suppress(OSError):
                folder.rmdir()
                folder.parent.rmdir()
        return removed

    def _files(self) -> list[Path]:
        """Return all files that a cache has written, sound or not."""
        paths: list[Path] = []
        for name in _list_names(self.root):
            back_end = self.root / name
            if not back_end.is_dir() or back_end.is_symlink():
                continue
            for entry in _list_names(back_end):
                path = back_end / entry
                # The previous format had one file per key here.
                if is_verdict_file(entry) or _UNFINISHED.fullmatch(entry):
                    paths += [path] if path.is_file() else []
                elif _KEY.fullmatch(entry) and path.is_dir() and not path.is_symlink():
                    paths += [
                        path / file
                        for file in _list_names(path)
                        if is_verdict_file(file) or _UNFINISHED.fullmatch(file)
                    ]
        return paths


def _list_names(folder: Path) -> list[str]:
    try:
        return sorted(os.listdir(folder))
    except OSError:
        return []


def _read(path: Path) -> KeptVerdict | None:
    try:
        record = read_record(path)
        status = path.stat()
    except (OSError, ValueError):
        return None
    return KeptVerdict(path, record, status.st_size, status.st_mtime)
