"""Measurements as lines of JSON: what is there already is not measured again."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from fresh_process import Answer, Question, ask


class RecordFile:
    """Answers by task, solver, limit and seed, each kept as soon as it is there.

    Parameters
    ----------
    path
        The file, which need not be there; None to keep them in memory only. One that was cut off
        in the middle of a line is taken up at that line. What it holds is not asked again,
        whatever the solvers have become: name a new file after a change of them.
    """

    def __init__(self, path: str | None) -> None:
        self._path = None if path is None else Path(path)
        self._answers: dict[tuple[Any, ...], Answer] = {}
        if self._path is None or not self._path.exists():
            return
        text = self._path.read_text("utf-8")
        whole = text[: text.rfind("\n") + 1]
        if whole != text:
            self._path.write_text(whole, "utf-8")
        for line in whole.splitlines():
            record = json.loads(line)
            self._answers[tuple(record["question"])] = Answer(**record["answer"])

    def known(self, name: str, question: Question) -> Answer | None:
        """Return the answer, or None where it was not asked yet."""
        return self._answers.get(_key(name, question))

    def answer(self, name: str, question: Question) -> Answer:
        """Return the answer, asked now if need be; one that failed is not kept in the file."""
        key = _key(name, question)
        if key not in self._answers:
            self._answers[key] = found = ask(question)
            if self._path is not None and found.status != "failed":
                self._path.parent.mkdir(parents=True, exist_ok=True)
                line = json.dumps({"question": key, "answer": asdict(found)}, allow_nan=False)
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(f"{line}\n")
        return self._answers[key]


def _key(name: str, question: Question) -> tuple[Any, ...]:
    return name, question.solver, question.limit_s, question.by_cpu, question.seed
