"""The folder of a study: what is studied, and every finished run, whatever ends the program.

``manifest.json`` is there whole or not at all. ``runs.jsonl`` grows by a line for every finished
run and is forced to disk; a line that was being written when the program ended is dropped.
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
from skillplan.records.sweep.plan import SweepPlan, same
from skillplan.records.sweep.result import SweepRecord, record_of

# What a study may differ in from the one that is resumed, in words.
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
    "minimise": "what is minimised",
    "sampler": "the sampler",
    "sampler_options": "the options of the sampler",
    "centre": "the centre",
    "fixed": "the fixed options",
    "starts": "the starts",
    "seeds": "the seeds",
    "versions": "a version",
}


def identity(plan: SweepPlan) -> dict[str, Any]:
    """Return what has to be the same for runs to belong together."""
    versions = {"skillplan": __version__}
    for entry in registered("solver").select(name=plan.solver):
        if entry.dist is not None:
            versions[entry.dist.name] = entry.dist.version
    # The optima are proved again, which may take longer than the limit.
    starts = [start.name for start in plan.starts]
    return {**plan.document(), "starts": starts, "versions": versions}


def difference(was: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """Return in what two identities differ, in words; None where they are the same."""
    for key, words in _WORDS.items():
        if not same(was.get(key), now.get(key)):
            there, here = _differing(was.get(key), now.get(key))
            return f"in {words}: {there} there, {here} now"
    return None


def _differing(was: Any, now: Any, most: int = 60) -> tuple[str, str]:
    """Return the first things in which two JSON values differ, as texts of bounded length."""
    while type(was) is type(now):
        if isinstance(was, dict) and was.keys() == now.keys():
            key = next(key for key in was if not same(was[key], now[key]))
            was, now = was[key], now[key]
        elif isinstance(was, list) and len(was) == len(now):
            was, now = next((a, b) for a, b in zip(was, now, strict=True) if not same(a, b))
        else:
            break
    texts = (json.dumps(was), json.dumps(now))
    return tuple(text if len(text) <= most else f"{text[:most]}..." for text in texts)  # type: ignore[return-value]


RUNS, RESULT, STARTS = "runs.jsonl", "sweep.json", "starts.csv"
_MOST_BYTES = 1024**3


class StudyFolder(HeldFolder):
    """A folder that is being written by one study; a context manager.

    Parameters
    ----------
    path
        The folder, made if need be.
    plan
        The study.
    resume
        Whether a study that was begun there is continued.
    command
        The words of the command line, to be kept.

    Attributes
    ----------
    records
        The runs that are done; those that failed are to be done again.

    Raises
    ------
    OptionError
        If the folder cannot be used, holds something else, or holds another study: what
        differs is named.
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
        """Let others write."""
        if self._lines is not None:
            self._lines.close()
            self._lines = None
        super().close()

    def add(self, record: SweepRecord) -> None:
        """Keep a run, whatever happens next.

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
        # A program that was ended while it wrote leaves pieces; of its first file that is all.
        there = {one.name for one in self.path.iterdir()}
        found = there - {name for name in there if is_unfinished(name, MANIFEST)}
        if found and not resume:
            raise OptionError(
                f"--out {self.path}: is not empty. Name a new folder, or go on with --resume."
            )
        if found - {RUNS} and MANIFEST not in found:
            raise OptionError(f"--out {self.path}: holds no {MANIFEST}, so nothing to resume.")
        self._lines = GrowingFile(self.path / RUNS, self.path)
        remove_unfinished(self.path, within=self.path)
        wanted = identity(plan)
        if MANIFEST in found:
            self._compare(wanted)
            self._read(plan)
        else:
            self._lines.cut(0)
            content = {
                "schema": schemas.SWEEP_MANIFEST,
                **wanted,
                "command": list(command),
                "python": sys.version.split()[0],
                "runs": len(plan.settings) * len(plan.seeds),
            }
            text = json.dumps(content, indent=2, allow_nan=False)
            write_whole(self.path / MANIFEST, text, within=self.path)

    def _compare(self, wanted: dict[str, Any]) -> None:
        content = parse_json(read_bytes(self.path / MANIFEST, _MOST_BYTES, within=self.path))
        if not isinstance(content, dict) or content.get("schema") != schemas.SWEEP_MANIFEST:
            raise OptionError(
                f"--out {self.path}: {MANIFEST} is no document {schemas.SWEEP_MANIFEST}."
            )
        differs = difference(content, wanted)
        if differs is not None:
            raise OptionError(
                f"--resume: the study in {self.path} is another one, {differs}. Give the same "
                "values, or name a new folder."
            )

    def _read(self, plan: SweepPlan) -> None:
        """Read the finished runs, and drop the piece of a line that may end the file."""
        assert self._lines is not None
        content = read_bytes(self.path / RUNS, _MOST_BYTES, within=self.path)
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            self._lines.cut(len(whole))
        known: dict[tuple[int, int], SweepRecord] = {}
        starts = [start.name for start in plan.starts]
        for number, line in enumerate(whole.decode("utf-8", "replace").splitlines(), start=1):
            try:
                record = record_of(line)
                fits = [outcome.start for outcome in record.outcomes] in (starts, [])
                if (
                    not fits
                    or record.setting >= len(plan.settings)
                    or record.seed not in plan.seeds
                ):
                    raise ValueError("it is no run of this study")
            except ValueError as error:
                raise OptionError(
                    f"{self.path / RUNS}:{number}: is damaged: {error}. Delete the line, and "
                    "--resume does its run again."
                ) from None
            if record.error is None:
                known[record.key] = record
        self.records = list(known.values())
