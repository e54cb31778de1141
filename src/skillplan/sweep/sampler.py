"""What every sampler offers: settings to try, each chosen by what has come of those before.

A sampler subclasses `Sampler` and is registered in the group ``skillplan.sampler``. It keeps its
trials on disk in a folder that several processes, and machines, may share.
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
    """A trial of which all runs have been done.

    Parameters
    ----------
    trial
        Its setting.
    value
        What was to be minimised; None where no run went well.
    lines
        What `SharedTrials.tell` was given of its runs.
    """

    trial: Trial
    value: float | None
    lines: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Question:
    """What a sampler is to choose, by whom it is asked, and what to begin with.

    Parameters
    ----------
    dimensions
        The options that vary, and what they may be.
    about
        What makes the study this one, as JSON values; kept with the trials.
    first
        A setting to try before any other; options that it leaves out are chosen.
    seed
        Governs all randomness, >= 0.
    """

    dimensions: Sequence[Dimension]
    about: Mapping[str, Any]
    first: Mapping[str, Value]
    seed: int


class SharedTrials(ABC):
    """The trials of a study, those of other processes too.

    Every method raises `OptionError` where the folder cannot be read or written, or what is kept
    there is damaged.
    """

    @property
    @abstractmethod
    def about(self) -> Mapping[str, Any]:
        """What `Question.about` was when the study was begun."""

    @abstractmethod
    def ask(self) -> Trial:
        """Return a setting to try; no other process is given the same number."""

    @abstractmethod
    def tell(self, trial: Trial, value: float | None, lines: Sequence[str]) -> None:
        """Keep what came of a trial.

        Parameters
        ----------
        trial
            One that `ask` returned, told once.
        value
            What is minimised; None where no run went well.
        lines
            What else is to be kept.
        """

    @abstractmethod
    def give_up(self, trial: Trial) -> None:
        """Forget a trial that `ask` returned: it is neither finished nor learned from."""

    @abstractmethod
    def done(self) -> int:
        """Return how many trials are finished."""

    @abstractmethod
    def finished(self) -> list[FinishedTrial]:
        """Return the finished trials by their numbers."""


class Sampler(ABC):
    """Chooses settings of a solver's options.

    Parameters
    ----------
    options
        An instance of `Options`; None for the defaults.

    Attributes
    ----------
    name
        Kebab-case, as in the entry point.
    Options
        A pydantic model whose fields carry range and description.
    keeps
        Name of the file in which it keeps trials.
    """

    name: ClassVar[str]
    keeps: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    @abstractmethod
    def join(self, folder: Path, question: Question) -> SharedTrials:
        """Return the trials of a folder, begun or gone on with.

        Parameters
        ----------
        folder
            Exists; other processes may use it at the same time.
        question
            What is to be chosen.

        Raises
        ------
        OptionError
            If the folder cannot be used or what is kept there is damaged.
        """
