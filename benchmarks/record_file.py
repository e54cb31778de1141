"""Measurements as lines of JSON: what is there already is not measured again."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fresh_process import Outcome, Trial, run_in_process


class RecordFile:
    """Outcomes by task, solver, limit and seed, each kept as soon as it is there.

    Parameters
    ----------
    path
        The file, which need not be there; None to keep them in memory only. One that was cut off
        in the middle of a line is taken up at that line. What it holds is not measured again,
        whatever the solvers have become: name a new file after a change of them.
    """

    def __init__(self, path: str | None) -> None:
        self._path = None if path is None else Path(path)
        self._outcomes: dict[tuple[Any, ...], Outcome] = {}
        if self._path is None or not self._path.exists():
            return
        text = self._path.read_text("utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._path.write_text(whole, "utf-8")
        for line in whole.splitlines():
            record = json.loads(line)
            self._outcomes[tuple(record["question"])] = Outcome(**record["answer"])

    def known(self, name: str, trial: Trial) -> Outcome | None:
        """Return the outcome, or None where it was not measured yet."""
        return self._outcomes.get(_key(name, trial))

    def outcome(self, name: str, trial: Trial) -> Outcome:
        """Return the outcome, measured now if need be; one that failed is not kept in the file."""
        key = _key(name, trial)
        if key not in self._outcomes:
            self._outcomes[key] = found = run_in_process(trial)
            if self._path is not None and found.status != "failed":
                self._path.parent.mkdir(parents=True, exist_ok=True)
                line = json.dumps({"question": key, "answer": asdict(found)}, allow_nan=False)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(f"{line}\n")
        return self._outcomes[key]


def _key(name: str, trial: Trial) -> tuple[Any, ...]:
    return name, trial.solver, trial.limit_s, trial.by_cpu, trial.seed
