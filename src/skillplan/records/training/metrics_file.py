"""What a run noted while it learned: a line for every episode, and figures now and then.

No clock stands in a line, so that a run that was interrupted and taken up again leaves the same
bytes as one that was not.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from skillplan.errors import OptionError
from skillplan.files.regular_file import read_bytes
from skillplan.files.strict_json import parse_json
from skillplan.solvers.learning.learner import End, Episode

METRICS = "metrics.jsonl"
_ENDS = get_args(End)
# More than a run of a hundred million steps notes.
_MOST_BYTES = 4 * 1024**3


@dataclass(frozen=True, slots=True)
class FiguresRecord:
    """What a learner thinks worth a curve.

    Parameters
    ----------
    step
        Environment steps done, >= 1.
    figures
        Finite numbers by name, such as ``loss``.
    """

    step: int
    figures: Mapping[str, float]


@dataclass(frozen=True)
class RunMetrics:
    """All that a run noted, in order.

    Parameters
    ----------
    episodes
        Those that ended.
    figures
        What the learner thought worth a curve.
    """

    episodes: tuple[Episode, ...] = ()
    figures: tuple[FiguresRecord, ...] = ()


def metrics_line(record: Episode | FiguresRecord) -> str:
    """Return a line of JSON, without its end.

    Figures that are not finite are left out; an episode's must be finite.

    Raises
    ------
    ValueError
        If an episode's cost or reward is not finite.
    """
    if isinstance(record, FiguresRecord):
        finite = {name: float(x) for name, x in record.figures.items() if math.isfinite(x)}
        content: dict[str, Any] = {"kind": "figures", "step": record.step, **finite}
    else:
        content = {
            "kind": "episode",
            "step": record.step,
            "end": record.end,
            "cost": float(record.cost),
            "reward": float(record.reward),
            "length": len(record.actions),
            "actions": [int(action) for action in record.actions],
            "greedy": bool(record.greedy),
        }
    return json.dumps(content, allow_nan=False, separators=(",", ":"))


def read_metrics(path: Path, run: int, *, within: Path | None = None) -> RunMetrics:
    """Return what a run noted; a piece of a line at the end of the file is left out.

    Parameters
    ----------
    path
        The file; none is that of a run which has noted nothing.
    run
        The run's number.
    within
        A folder that the file must lie in, with no link on the way to it; None for anywhere.

    Raises
    ------
    OptionError
        If the file cannot be read, or another line is damaged: it is named.
    """
    try:
        lines = metrics_lines(path, within=within)
    except OSError as error:
        raise OptionError(f"{path}: cannot be read: {error.strerror}.") from None
    return metrics_of(lines, path, run)


def metrics_of(lines: Iterable[str], path: Path, run: int) -> RunMetrics:
    """Return what lines say; parameters and errors are those of `read_metrics`."""
    episodes: list[Episode] = []
    figures: list[FiguresRecord] = []
    for record in _records(lines, path, run):
        if isinstance(record, Episode):
            episodes.append(record)
        else:
            figures.append(record)
    return RunMetrics(tuple(episodes), tuple(figures))


def metrics_lines(path: Path, *, within: Path | None = None) -> list[str]:
    """Return the whole lines of a file, unread; none where there is no file.

    Parameters
    ----------
    path, within
        As for `read_metrics`.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    try:
        content = read_bytes(path, _MOST_BYTES, within=within)
    except FileNotFoundError:
        return []
    whole = content[: content.rfind(b"\n") + 1]
    return whole.decode("utf-8", "replace").splitlines()


def _records(lines: Iterable[str], path: Path, run: int) -> Iterator[Episode | FiguresRecord]:
    before = 0
    for number, line in enumerate(lines, start=1):
        try:
            record = _record(line, run)
            if record.step < max(before, 1):
                raise ValueError("its step is before that of the line above")
        except (ValueError, TypeError, KeyError) as error:
            reason = str(error) if isinstance(error, ValueError) else type(error).__name__
            raise OptionError(
                f"{path}:{number}: is damaged: {reason}. Bring the file back from a copy, or "
                "train again."
            ) from None
        before = record.step
        yield record


def _record(line: str, run: int) -> Episode | FiguresRecord:
    content = parse_json(line)
    if not isinstance(content, dict):
        raise ValueError("it is no mapping")
    kind, step = content.pop("kind", None), content.pop("step", None)
    if type(step) is not int:
        raise ValueError("it has no step")
    if kind == "figures":
        return FiguresRecord(step, {name: _finite(value) for name, value in content.items()})
    if kind != "episode":
        raise ValueError("it is neither an episode nor figures")
    actions = tuple(content["actions"])
    if not all(type(action) is int and action >= 0 for action in actions):
        raise ValueError("its actions are no numbers of skills")
    if content["end"] not in _ENDS or content["length"] != len(actions):
        raise ValueError("its end or its length is wrong")
    if type(content["greedy"]) is not bool:
        raise ValueError("it does not say whether it was greedy")
    return Episode(
        run,
        step,
        content["end"],
        actions,
        _finite(content["cost"]),
        _finite(content["reward"]),
        content["greedy"],
    )


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError("a figure is no finite number")
    return float(value)
