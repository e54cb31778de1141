"""One verdict in a file of its own: the query, the answer, and a checksum of it all."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.checks.single_check import Checked
from skillplan.checks.verdict_key import content_hash, verdict_key
from skillplan.files.atomic_file import write_whole
from skillplan.files.regular_file import read_bytes
from skillplan.files.strict_json import parse_json
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import Facts, State
from skillplan.task.verdict import Verdict, VerdictStatus

FORMAT = "skillplan.verdict/2"

_SUFFIX = ".json"
_MOST_BYTES = 16 * 1024 * 1024
_NAME = re.compile(r"[0-9a-f]{64}\.json")


@dataclass(frozen=True)
class VerdictRecord:
    """A decided verdict as it stands in a file.

    Parameters
    ----------
    key
        Hash of all that the answer depends on; the name of the file's folder.
    task, skill
        The task that was queried about, by name.
    back_end, version
        Who said it.
    options
        The back end's, as JSON values.
    state
        The facts of the whole state that it was queried in.
    took_s
        Time of the check [s], >= 0.
    status, reason, stage, present, absent, evidence
        As in the verdict; facts by name.

    Raises
    ------
    ValueError
        If the verdict is unknown, which is never kept, or the time is negative.
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
        """Return the record of what a back end said of a skill in a state."""
        verdict = checked.verdict
        return cls(
            key=verdict_key(back_end, skill),
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
        """The name of its file: a hash of the facts that it rests on."""
        return content_hash([list(self.present), list(self.absent)]) + _SUFFIX

    def verdict(self, facts: Facts) -> Verdict:
        """Return the verdict.

        Raises
        ------
        ValueError
            If a fact is unknown, or the verdict makes no sense or does not apply in the state
            that it was queried in.
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
        """Write the record in one piece to the folder of its key; return the file's name.

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
        text = json.dumps({**content, "checksum": content_hash(content)})
        write_whole(folder / self.file_name, text)
        return self.file_name


def is_verdict_file(name: str) -> bool:
    """Whether a file's name is that of a record."""
    return _NAME.fullmatch(name) is not None


def read_record(path: Path) -> VerdictRecord:
    """Return the record in a file.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is not exactly what was written under this name.
    """
    text = read_bytes(path, _MOST_BYTES)
    try:
        content = parse_json(text)
        checksum = content.pop("checksum")
        if content["format"] != FORMAT or checksum != content_hash(content):
            raise ValueError("not what was written")
        said, back_end = content["verdict"], content["back_end"]
        record = VerdictRecord(
            key=content["key"],
            task=content["task"],
            skill=content["skill"],
            back_end=back_end["name"],
            version=back_end["version"],
            options=dict(back_end["options"]),
            state=tuple(content["state"]),
            took_s=float(content["took_s"]),
            status=VerdictStatus(said["status"]),
            reason=str(said["reason"]),
            stage=str(said["stage"]),
            present=tuple(said["present"]),
            absent=tuple(said["absent"]),
            evidence=dict(said["evidence"]),
        )
        if path.name != record.file_name or path.parent.name != record.key:
            raise ValueError("under another's name")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} is not a verdict as it was written: {error!r}") from None
    return record
