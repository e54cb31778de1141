"""The growing files of one run: what it notes, and the same as curves for TensorBoard.

Both grow by whole records, and are cut to the length that a checkpoint knows when a training is
taken up again.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from skillplan.errors import OptionError
from skillplan.files.folder import make_folder
from skillplan.files.growing_file import GrowingFile
from skillplan.records.training.metrics_file import (
    METRICS,
    FiguresRecord,
    metrics_line,
    read_metrics,
)
from skillplan.records.training.run_folder import run_path
from skillplan.solvers.learning.learner import Episode
from skillplan.training.event_file import opening_record, scalars_record

# The success rate shown is that of so many last episodes, as in the figures of a training.
RECENT_EPISODES = 100
# Beyond this, single precision has no numbers.
_MOST_SINGLE = 3e38
_EVENTS = "events.out.tfevents.skillplan"


@contextmanager
def writing(folder: Path, name: str) -> Iterator[None]:
    """Turn a failure to write into the one message that names what is safe.

    Raises
    ------
    OptionError
        If anything within raises an OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OptionError(
            f"--out {folder}: {name} cannot be written: {reason}. The last checkpoints are "
            "intact: make room, and go on with --resume."
        ) from None


def events_path(folder: Path, run: int) -> Path:
    """Return the file of a run's curves."""
    return folder / "tensorboard" / f"run-{run:02d}" / _EVENTS


class RunLog:
    """Notes what happens in a run.

    Parameters
    ----------
    folder
        Of all runs.
    run
        The run's number.
    lengths
        How long its files were at the checkpoint, by path from the folder; empty for a run that
        is yet to begin.

    Attributes
    ----------
    episodes
        How many have ended.
    recent
        Whether the last `RECENT_EPISODES` of them succeeded.
    best_cost
        The least that a successful one cost; None without one.

    Raises
    ------
    OptionError
        If a file cannot be written, is shorter than it was, or is damaged.
    """

    def __init__(self, folder: Path, run: int, lengths: Mapping[str, int]) -> None:
        self.episodes = 0
        self.recent: deque[bool] = deque(maxlen=RECENT_EPISODES)
        self.best_cost: float | None = None
        self._folder = folder
        self._files: dict[str, GrowingFile] = {}
        metrics = run_path(folder, run) / METRICS
        events = events_path(folder, run)
        self._run = run
        self._metrics, self._events = (
            path.relative_to(folder).as_posix() for path in (metrics, events)
        )
        try:
            for name in (self._metrics, self._events):
                self._open(name, lengths.get(name, 0))
            if lengths.get(self._metrics):
                self._count(read_metrics(metrics, run, within=folder).episodes)
            if not lengths.get(self._events):
                self._append(self._events, opening_record(time.time()))
        except BaseException:
            self.close()
            raise

    def note(self, step: int, episodes: Sequence[Episode], figures: Mapping[str, float]) -> None:
        """Append what happened since the last call.

        Parameters
        ----------
        step
            Environment steps done.
        episodes
            Those of this run that ended, in order.
        figures
            What the learner thinks worth a curve; may be empty.

        Raises
        ------
        OptionError
            If it cannot be written.
        ValueError
            If an episode's figures are not finite.
        """
        self._count(episodes)
        lines = [metrics_line(episode) for episode in episodes]
        lines += [metrics_line(FiguresRecord(step, figures))] if figures else []
        if lines:
            self._append(self._metrics, "".join(f"{line}\n" for line in lines).encode())
        scalars = {
            f"learner/{name}": float(value)
            for name, value in figures.items()
            if abs(value) < _MOST_SINGLE
        }
        if episodes:
            scalars["episode/success_rate"] = sum(self.recent) / len(self.recent)
            scalars["episode/reward"] = sum(one.reward for one in episodes) / len(episodes)
            costs = [one.cost for one in episodes if one.success]
            if costs:
                scalars["episode/cost_of_success"] = sum(costs) / len(costs)
        if scalars:
            self._append(self._events, scalars_record(time.time(), step, scalars))

    def sync(self) -> dict[str, int]:
        """Force all to disk; return how long the files are [bytes], by path from the folder.

        Raises
        ------
        OptionError
            If they cannot be written.
        """
        lengths = {}
        for name, file in self._files.items():
            with writing(self._folder, name):
                file.sync()
                lengths[name] = file.length
        return lengths

    def close(self) -> None:
        """Let go of the files."""
        for file in self._files.values():
            file.close()
        self._files.clear()

    def _open(self, name: str, length: int) -> None:
        path = self._folder / name
        with writing(self._folder, name):
            make_folder(path.parent, within=self._folder)
            file = self._files[name] = GrowingFile(path, self._folder)
            if file.length < length:
                raise OptionError(
                    f"{path}: is damaged: it is shorter than the checkpoint says. Bring it back "
                    "from a copy, or train again in another folder."
                )
            file.cut(length)

    def _append(self, name: str, content: bytes) -> None:
        with writing(self._folder, name):
            self._files[name].append(content)

    def _count(self, episodes: Sequence[Episode]) -> None:
        self.episodes += len(episodes)
        self.recent += [episode.success for episode in episodes]
        costs = [episode.cost for episode in episodes if episode.success]
        if costs:
            self.best_cost = min(costs if self.best_cost is None else [*costs, self.best_cost])
