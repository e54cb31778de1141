"""Interface of samplers, which choose the settings of a study from earlier trials.

A sampler subclasses `Sampler` and is registered in the group ``skillplan.sampler``. It stores its
trials in a folder that several processes and machines may share.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel

from skillplan.records.sweep.plan import Dimension, Trial, Value
from skillplan.task import back_end


@dataclass(frozen=True, slots=True)
class FinishedTrial:
    """A trial whose runs are all done.

    Parameters
    ----------
    value
        The minimised quantity; None if every run failed.
    lines
        The lines that `SharedTrials.tell` received.
    """

    trial: Trial
    value: float | None
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Question:
    """A study as a sampler sees it.

    Parameters
    ----------
    dimensions
        The options that vary, with their ranges.
    about
        Identity of the study as JSON values; stored with the trials.
    first
        Setting of the first trial; the sampler chooses missing options.
    """

    dimensions: Sequence[Dimension]
    about: Mapping[str, Any]
    first: Mapping[str, Value]
    seed: int


class SharedTrials(ABC):
    """All trials of a study, of this process and others.

    Every method raises `OptionError` if the folder cannot be read or written, or is damaged.
    """

    @property
    @abstractmethod
    def about(self) -> Mapping[str, Any]:
        """`Question.about` from the beginning of the study."""

    @abstractmethod
    def ask(self) -> Trial:
        """Return a setting to try, with a number that no other process gets."""

    @abstractmethod
    def tell(self, trial: Trial, value: float | None, lines: Sequence[str]) -> None:
        """Store the result of a trial.

        Parameters
        ----------
        trial
            A trial of this process, stored once.
        value
            The minimised quantity; None if every run failed.
        """

    @abstractmethod
    def give_up(self, trial: Trial) -> None:
        """Discard a trial of this process: it counts neither as finished nor for later choices."""

    @abstractmethod
    def retry(self, numbers: Sequence[int]) -> None:
        """Try the settings of finished trials again, before new ones.

        Parameters
        ----------
        numbers
            Numbers of finished trials, which no longer count as finished.
        """

    @abstractmethod
    def done(self) -> int:
        """Return the number of finished trials."""

    @abstractmethod
    def finished(self) -> list[FinishedTrial]:
        """Return the finished trials in the order of their numbers."""


class Sampler(ABC):
    """Chooses settings of a solver's options.

    Parameters
    ----------
    options
        An instance of `Options`. Default: the default options.

    Attributes
    ----------
    name
        Name in kebab-case, as in the entry point.
    Options
        A pydantic model whose fields have a range and a description.
    keeps
        Name of the file with the trials.
    """

    name: ClassVar[str]
    keeps: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    @abstractmethod
    def join(self, folder: Path, question: Question) -> SharedTrials:
        """Open the trials in a folder, new or existing.

        Parameters
        ----------
        folder
            Existing folder; other processes may use it at the same time.

        Raises
        ------
        OptionError
            If the folder cannot be used or is damaged.
        """
