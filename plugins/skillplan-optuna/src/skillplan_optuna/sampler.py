"""The sampler that chooses settings by Optuna.

Akiba et al., "Optuna: A next-generation hyperparameter optimization framework", KDD 2019.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, Literal

import optuna
from optuna.samplers import BaseSampler, RandomSampler, TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileSymlinkLock
from optuna.trial import TrialState
from pydantic import Field

from skillplan.errors import OptionError
from skillplan.files.atomic_file import GrowingFile
from skillplan.files.json_file import parse_json
from skillplan.files.regular_file import read_bytes
from skillplan.records.sweep.plan import Choice, Dimension, Span, Trial, Value, count_multiples
from skillplan.sweep.sampler import FinishedTrial, Question, Sampler, SharedTrials
from skillplan.task import back_end

_STUDY = "sweep"
# Attributes in addition to Optuna's: the identity of the study, and the values and runs of a trial.
_ABOUT, _VALUES, _LINES = "about", "values", "lines"
# Attribute of the study: numbers of finished trials that were begun again.
_RETRIED = "retried"
# Greatest size of a journal; a trial takes about 2 kB.
_MOST_BYTES = 1024**3
# Age of a lock [s] after which others break it, because its process was killed.
_GRACE_S = 30


class OptunaSampler(Sampler):
    """Try settings near good ones, and sometimes others."""

    name = "optuna"
    keeps = "trials.jsonl"

    class Options(back_end.Options):
        """Options of the sampler."""

        method: Literal["tpe", "random"] = Field(
            default="tpe",
            description="tpe: by densities of good and other settings; random: independent draws",
        )
        startup: int = Field(
            default=10, ge=1, le=100_000, description="random trials before tpe starts [-]"
        )

    options: Options

    def join(self, folder: Path, question: Question) -> OptunaTrials:
        """Return the trials of a folder; parameters and errors as in `Sampler.join`."""
        return OptunaTrials(folder / self.keeps, question, self._chooser)

    def _chooser(self, seed: int) -> BaseSampler:
        """Return the Optuna sampler for a seed."""
        if self.options.method == "random":
            return RandomSampler(seed=seed)
        return TPESampler(seed=seed, n_startup_trials=self.options.startup, constant_liar=True)


class OptunaTrials(SharedTrials):
    """The trials of a journal.

    Parameters
    ----------
    chooser
        Returns the Optuna sampler for a seed.

    Raises
    ------
    OptionError
        If the journal cannot be read or written, or is damaged.
    """

    def __init__(
        self, path: Path, question: Question, chooser: Callable[[int], BaseSampler]
    ) -> None:
        self._path, self._question, self._chooser = path, question, chooser
        optuna.logging.set_verbosity(optuna.logging.CRITICAL)
        with self._told():
            self._study = optuna.create_study(
                storage=JournalStorage(_open_journal(path)),
                study_name=_STUDY,
                direction="minimize",
                load_if_exists=True,
                sampler=chooser(question.seed),
            )
            if _ABOUT not in self._study.user_attrs:
                self._study.set_user_attr(_ABOUT, dict(question.about))
                self._study.enqueue_trial(self._coded(question.first), skip_if_exists=True)

    @property
    def about(self) -> Mapping[str, Any]:
        """Description of the question at the start of the study."""
        with self._told():
            user_attr = self._study.user_attrs[_ABOUT]
            if not isinstance(user_attr, dict):
                raise ValueError("it does not name its study")
            return user_attr

    def ask(self) -> Trial:
        """Return a setting to try, with a unique number."""
        with self._told():
            trial = self._study.ask()
            # Processes that share a study draw differently, because their trial numbers differ.
            self._study.sampler = self._chooser((self._question.seed << 20) + trial.number)
            values = {
                dimension.option: _suggested(trial, dimension)
                for dimension in self._question.dimensions
            }
            trial.set_user_attr(_VALUES, values)
            return Trial(trial.number, values)

    def tell(self, trial: Trial, value: float | None, lines: Sequence[str]) -> None:
        """Keep the result of a trial; parameters as for `SharedTrials.tell`."""
        with self._told():
            storage, study_id = self._study._storage, self._study._study_id
            number = storage.get_trial_id_from_study_id_trial_number(study_id, trial.number)
            storage.set_trial_user_attr(number, _LINES, list(lines))
            state = TrialState.FAIL if value is None else TrialState.COMPLETE
            self._study.tell(trial.number, value, state=state)

    def give_up(self, trial: Trial) -> None:
        """Discard an unfinished trial."""
        with self._told():
            self._study.tell(trial.number, state=TrialState.FAIL)

    def retry(self, numbers: Sequence[int]) -> None:
        """Try the settings of finished trials again; parameters as for `SharedTrials.retry`."""
        with self._told():
            by_number = {trial.number: trial for trial in self._over()}
            known = self._study.user_attrs.get(_RETRIED, [])
            self._study.set_user_attr(_RETRIED, sorted({*known, *numbers}))
            for number in numbers:
                self._study.enqueue_trial(by_number[number].params)

    def done(self) -> int:
        """Return the number of finished trials."""
        with self._told():
            return len(self._over())

    def finished(self) -> list[FinishedTrial]:
        """Return the finished trials in the order of their numbers."""
        with self._told():
            trials = []
            for trial in self._over():
                values, lines = trial.user_attrs[_VALUES], trial.user_attrs[_LINES]
                if not isinstance(values, dict) or not all(isinstance(x, str) for x in lines):
                    raise ValueError(f"trial {trial.number} is none of a sweep")
                value = trial.value if trial.state is TrialState.COMPLETE else None
                trials.append(FinishedTrial(Trial(trial.number, values), value, tuple(lines)))
            return trials

    def _over(self) -> list[Any]:
        """Return the trials whose runs are complete; others were discarded or are running."""
        states = (TrialState.COMPLETE, TrialState.FAIL)
        trials = self._study.get_trials(deepcopy=False, states=states)
        retried = set(self._study.user_attrs.get(_RETRIED, []))
        return [
            trial for trial in trials if _LINES in trial.user_attrs and trial.number not in retried
        ]

    def _coded(self, values: Mapping[str, Value]) -> dict[str, Any]:
        """Return values in Optuna's form: the index of a choice, the number of steps."""
        known = {dimension.option: dimension for dimension in self._question.dimensions}
        coded: dict[str, Any] = {}
        for name, value in values.items():
            option = known[name]
            if isinstance(option, Choice):
                coded[name] = option.values.index(value)
            elif option.multiple_of is not None and isinstance(value, int | float):
                coded[name] = count_multiples(value, option.multiple_of)[0]
            else:
                coded[name] = value
        return coded

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Convert errors of a journal to messages."""
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield
        except OptionError:
            raise
        except OSError as error:
            raise OptionError(
                f"{self._path}: cannot be read or written: {error.strerror or error}. Trials that "
                "are finished are kept."
            ) from None
        except Exception as error:
            why = f"Optuna cannot read it: {type(error).__name__} {error}".rstrip(" .")
            raise OptionError(_damaged(self._path, why)) from None


def _suggested(trial: optuna.Trial, dimension: Dimension) -> Value:
    """Return the value of an option in a trial."""
    if isinstance(dimension, Span):
        if dimension.multiple_of is not None:
            # Optuna has no logarithmic ranges with steps, so that it draws the number of steps.
            ends = (dimension.low, dimension.high)
            low, high = (count_multiples(end, dimension.multiple_of)[0] for end in ends)
            count = trial.suggest_int(dimension.option, low, high, log=dimension.logarithmic)
            return count_multiples(count * dimension.multiple_of, dimension.multiple_of)[1]
        if dimension.whole:
            return trial.suggest_int(
                dimension.option, int(dimension.low), int(dimension.high), log=dimension.logarithmic
            )
        return trial.suggest_float(
            dimension.option, dimension.low, dimension.high, log=dimension.logarithmic
        )
    places = list(range(len(dimension.values)))
    if dimension.ordered:
        return dimension.values[trial.suggest_int(dimension.option, 0, places[-1])]
    return dimension.values[trial.suggest_categorical(dimension.option, places)]


def _open_journal(path: Path) -> JournalFileBackend:
    """Return the journal, created if needed; an incomplete last line is cut off.

    Raises
    ------
    OptionError
        If a line is damaged.
    OSError
        If it cannot be read or written.
    """
    lock = JournalFileSymlinkLock(str(path), grace_period=_GRACE_S)
    if path.exists() or path.is_symlink():
        content = read_bytes(path, _MOST_BYTES, within=path.parent)
        if content and not content.endswith(b"\n"):
            _cut_journal(path, lock)
            content = read_bytes(path, _MOST_BYTES, within=path.parent)
        _check_journal(path, content)
    return JournalFileBackend(str(path), lock_obj=lock)


def _cut_journal(path: Path, lock: JournalFileSymlinkLock) -> None:
    """Cut off the incomplete line of a killed process.

    Under the lock, because then no other process is writing.
    """
    lock.acquire()
    try:
        content = read_bytes(path, _MOST_BYTES, within=path.parent)
        with closing(GrowingFile(path, path.parent)) as file:
            file.cut(content.rfind(b"\n") + 1)
    finally:
        lock.release()


def _check_journal(path: Path, content: bytes) -> None:
    """Check that every line is a JSON object."""
    whole = content[: content.rfind(b"\n") + 1]
    for number, line in enumerate(whole.splitlines(), start=1):
        try:
            entry = parse_json(line)
        except ValueError as error:
            raise OptionError(_damaged(path, f"line {number}: {error}")) from None
        if not isinstance(entry, dict):
            raise OptionError(_damaged(path, f"line {number} is not an entry of a journal"))


def _damaged(path: Path, why: str) -> str:
    """Return the error about a damaged journal."""
    return f"{path}: is damaged: {why}. Begin in a new folder, or put back a copy of the file."
