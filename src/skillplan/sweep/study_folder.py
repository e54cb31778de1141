"""The folder of a study: its settings, and every finished run.

``manifest.json`` is always complete. ``runs.jsonl`` grows by one line per finished run and is
flushed to disk; an incomplete last line is dropped.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from skillplan import __version__
from skillplan.errors import OptionError
from skillplan.files.atomic_file import GrowingFile, is_unfinished, remove_unfinished, write_whole
from skillplan.files.folder import HeldFolder
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import read_bytes
from skillplan.plugins.installed import registered
from skillplan.records import schemas
from skillplan.records.stored.result_folder import MANIFEST
from skillplan.records.sweep.plan import SweepPlan, is_same
from skillplan.records.sweep.result import SweepRecord, parse_record

RUNS, RESULT, STARTS = "runs.jsonl", "sweep.json", "starts.csv"
_MOST_BYTES = 1024**3

# Settings that must not change when a study is resumed, with their names in messages.
_WORDS = {
    "task": "the task",
    "step_limit": "the step limit",
    "solver": "the solver",
    "physics": "the physics engine",
    "collision": "the collision detectors",
    "warm": "--warm",
    "design": "the design",
    "axes": "the values of the options",
    "space": "the ranges of the options",
    "minimise": "the quantity to minimise",
    "sampler": "the sampler",
    "sampler_options": "the options of the sampler",
    "centre": "the centre",
    "fixed": "the fixed options",
    "starts": "the starts",
    "seeds": "the seeds",
    "versions": "a version",
}


def get_identity(plan: SweepPlan) -> dict[str, Any]:
    """Return the settings that all runs of a study share."""
    versions = {"skillplan": __version__}
    for entry in registered("solver").select(name=plan.solver):
        if entry.dist is not None:
            versions[entry.dist.name] = entry.dist.version
    # Without the optima: their proofs may exceed the time limit at another time.
    starts = [start.name for start in plan.starts]
    return {**plan.document(), "starts": starts, "versions": versions}


def describe_difference(was: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """Describe the first difference of two identities; None if they are equal."""
    for key, words in _WORDS.items():
        if not is_same(was.get(key), now.get(key)):
            there, here = _find_difference(was.get(key), now.get(key))
            return f"in {words}: {there} there, {here} now"
    return None


def _find_difference(was: Any, now: Any, most: int = 60) -> tuple[str, str]:
    """Return the first values that differ in two JSON values, as texts of limited length."""
    while type(was) is type(now):
        if isinstance(was, dict) and was.keys() == now.keys():
            key = next(key for key in was if not is_same(was[key], now[key]))
            was, now = was[key], now[key]
        elif isinstance(was, list) and len(was) == len(now):
            was, now = next((a, b) for a, b in zip(was, now, strict=True) if not is_same(a, b))
        else:
            break
    texts = (json.dumps(was), json.dumps(now))
    return tuple(text if len(text) <= most else f"{text[:most]}..." for text in texts)  # type: ignore[return-value]


class StudyFolder(HeldFolder):
    """A folder that one study writes; a context manager.

    Parameters
    ----------
    resume
        True to continue the study in the folder.
    command
        The words of the command line, stored in the manifest.

    Attributes
    ----------
    records
        The finished runs; runs that failed are repeated.

    Raises
    ------
    OptionError
        If the folder cannot be used, or holds something else or another study; the message names
        the difference.
    """

    def __init__(
        self, path: str, plan: SweepPlan, *, resume: bool = False, command: tuple[str, ...] = ()
    ) -> None:
        super().__init__(path)
        self.records: list[SweepRecord] = []
        self._lines: GrowingFile | None = None
        with self._opening("study"):
            self._open(plan, resume, command)

    def close(self) -> None:
        """Release the folder."""
        if self._lines is not None:
            self._lines.close()
            self._lines = None
        super().close()

    def add(self, record: SweepRecord) -> None:
        """Append a run and flush it to disk.

        Raises
        ------
        OptionError
            If it cannot be written.
        """
        assert self._lines is not None
        try:
            self._lines.append(f"{record.line()}\n".encode())
            self._lines.sync()
        except OSError as error:
            raise OptionError(
                f"--out {self.path}: {RUNS} cannot be written: {error.strerror}. --resume goes "
                "on from the runs that are there."
            ) from None

    def _open(self, plan: SweepPlan, resume: bool, command: tuple[str, ...]) -> None:
        # Unfinished files come from a program that was killed; its manifest may be one of them.
        there = {path.name for path in self.path.iterdir()}
        existing = there - {name for name in there if is_unfinished(name, MANIFEST)}
        if existing and not resume:
            raise OptionError(
                f"--out {self.path}: is not empty. Name a new folder, or go on with --resume."
            )
        if existing - {RUNS} and MANIFEST not in existing:
            raise OptionError(f"--out {self.path}: holds no {MANIFEST}, so nothing to resume.")
        self._lines = GrowingFile(self.path / RUNS, self.path)
        remove_unfinished(self.path, within=self.path)
        settings = get_identity(plan)
        if MANIFEST in existing:
            self._compare(settings)
            self._read(plan)
        else:
            self._lines.cut(0)
            content = {
                "schema": schemas.SWEEP_MANIFEST,
                **settings,
                "command": list(command),
                "python": sys.version.split()[0],
                "runs": len(plan.settings) * len(plan.seeds),
            }
            text = json.dumps(content, indent=2, allow_nan=False)
            write_whole(self.path / MANIFEST, text, within=self.path)

    def _compare(self, settings: dict[str, Any]) -> None:
        content = parse_json(read_bytes(self.path / MANIFEST, _MOST_BYTES, within=self.path))
        if not isinstance(content, dict) or content.get("schema") != schemas.SWEEP_MANIFEST:
            raise OptionError(
                f"--out {self.path}: {MANIFEST} is not a document {schemas.SWEEP_MANIFEST}."
            )
        differs = describe_difference(content, settings)
        if differs is not None:
            raise OptionError(
                f"--resume: the study in {self.path} differs {differs}. Give the same "
                "values, or name a new folder."
            )

    def _read(self, plan: SweepPlan) -> None:
        """Read the finished runs, and drop an incomplete last line."""
        assert self._lines is not None
        content = read_bytes(self.path / RUNS, _MOST_BYTES, within=self.path)
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            self._lines.cut(len(whole))
        known: dict[tuple[int, int], SweepRecord] = {}
        starts = [start.name for start in plan.starts]
        for number, line in enumerate(whole.decode("utf-8", "replace").splitlines(), start=1):
            try:
                record = parse_record(line)
                fits = [outcome.start for outcome in record.outcomes] in (starts, [])
                if (
                    not fits
                    or record.setting >= len(plan.settings)
                    or record.seed not in plan.seeds
                ):
                    raise ValueError("it is not a run of this study")
            except ValueError as error:
                raise OptionError(
                    f"{self.path / RUNS}:{number}: is damaged: {error}. Delete the line, and "
                    "--resume does its run again."
                ) from None
            if record.error is None:
                known[record.key] = record
        self.records = list(known.values())
