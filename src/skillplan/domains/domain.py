"""The base class of domains."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from skillplan.errors import Issue, OptionError
from skillplan.files.yaml import MAX_BYTES, Document, parse
from skillplan.task.task import Task


class Strict(BaseModel):
    """Base of all schema models: unknown keys, numbers in quotes and infinities are faults."""

    # A validator is built when a file is read, and then one for all: most models are parts.
    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        populate_by_name=True,
        defer_build=True,
    )


Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]


@dataclass(frozen=True)
class Listing:
    """A table that a domain has to show: cells are texts, rows as long as the columns.

    Raises
    ------
    ValueError
        If a row has another number of cells than there are columns.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"Row {row} does not have {len(self.columns)} cells.")


@dataclass(frozen=True)
class Account:
    """What a domain has to say of a file beyond the plans of its tasks.

    Parameters
    ----------
    document
        Keys added to the result's JSON document; JSON values only.
    listings
        Tables shown before that of the plans.
    appendix
        Tables that are saved but not shown, by the name of the file.
    lower_bound
        No path through the file's main tasks costs less in all, however the stages before are
        planned; None where nothing is proved.
    bound_given
        The same, but given the plans of the stages before.
    not_checked
        Sentences about what the file leaves unchecked of its plans.
    caveat
        What a user must know before executing the plans; empty where nothing is amiss.
    makespan_s
        Time of the whole [s], where that is more than the skills'; None otherwise.
    parallel_steps
        Steps in which the skills of several robots are executed side by side; None for one robot.
    parallel_bound
        Lower bound of any plan's parallel steps, proved; None for one robot.
    """

    document: Mapping[str, Any] = field(default_factory=dict)
    listings: tuple[Listing, ...] = ()
    appendix: Mapping[str, Listing] = field(default_factory=dict)
    lower_bound: float | None = None
    makespan_s: float | None = None
    bound_given: float | None = None
    caveat: str = ""
    not_checked: tuple[str, ...] = ()
    parallel_steps: int | None = None
    parallel_bound: int | None = None


@dataclass(frozen=True)
class Recheck:
    """A property of a solved file, checked again for ``verify``.

    Parameters
    ----------
    claim
        The property, such as ``reach``.
    holds
        Whether the plans have it; None if the file does not require it.
    detail
        The figures, or the first plan without it.
    method
        How it was checked.
    """

    claim: str
    holds: bool | None
    detail: str
    method: str


@dataclass(frozen=True)
class Overview:
    """What there is to see of a valid file before anything is solved.

    Parameters
    ----------
    document
        Keys added to the JSON document of ``check``; JSON values only.
    lines
        The same in words, a line each: a name, spaces, and what is said.
    """

    document: Mapping[str, Any] = field(default_factory=dict)
    lines: tuple[str, ...] = ()


class Domain(ABC):
    """A kind of task file.

    Attributes
    ----------
    kind
        What the file's key ``kind`` says.
    Config
        The schema of the file: a model derived from `Strict`.
    stages
        The stages that a chain of its tasks may have, in order.
    suffixes
        Ends of the names of files that it reads by `read`, such as ``.sop``, in small letters;
        other files are YAML.
    max_bytes
        Greatest size of such a file.
    starter_suffix
        End of the name of the file that `starter` returns.
    former_defaults
        Values of keys left out that earlier versions took, by key path, for stored results.
    """

    kind: ClassVar[str]
    Config: ClassVar[type[BaseModel]]
    stages: ClassVar[tuple[str, ...]] = ()
    suffixes: ClassVar[tuple[str, ...]] = ()
    max_bytes: ClassVar[int] = MAX_BYTES
    starter_suffix: ClassVar[str] = ".yaml"
    former_defaults: ClassVar[Mapping[str, str]] = {}

    def read(self, text: str, source: str) -> Document:
        """Return the content of a file with one of the domain's `suffixes`.

        Parameters
        ----------
        text
            What the file holds.
        source
            The file as the user named it.

        Returns
        -------
        Document
            Data with the keys of `Config`, ``kind`` among them, and where they stand.

        Raises
        ------
        TaskError
            With every fault for which the data cannot be had.
        """
        return parse(text, source)

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return every fault that the schema cannot see, each with the path of its key."""
        return ()

    def warnings(self, config: Any) -> Iterable[Issue]:
        """Return what is valid, but hardly meant, each with the path of its key.

        Every command prints them on stderr.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        """
        return ()

    def hints(self, config: Any) -> Iterable[Issue]:
        """Return what may be meant, but is found out late; only ``check`` reports it.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        """
        return ()

    def overview(self, config: Any) -> Overview:
        """Return what ``check`` shows of a file besides its tasks, such as its extent."""
        return Overview()

    @abstractmethod
    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the tasks of a faultless content, in the order in which they are solved.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        sha256
            Hash of the content, to be carried by the tasks.
        """

    def follow(
        self, config: Any, sha256: str, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> list[Task]:
        """Return the tasks of a chain as they stand once some of them have been solved.

        Tasks that are solved, and those of their stage, stay as they are.

        Parameters
        ----------
        config, sha256
            As in `ground`.
        plans
            Names of skills by the name of the task that they solve.
        refinement
            How often the upper levels made a finer plan since a solver that does not
            search them failed below; empty is returned where there is none finer.

        Raises
        ------
        ChainBroken
            If the plans leave the next stage nothing to choose from.
        """
        return self.ground(config, sha256) if refinement == 0 else []

    def account(
        self, config: Any, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> Account:
        """Return what is to be said of the file beyond the plans of its tasks."""
        return Account()

    def recheck(
        self, config: Any, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> Iterable[Recheck]:
        """Return properties that the file requires of its plans and the replay does not check.

        Parameters
        ----------
        config, plans, refinement
            As in `follow`.
        """
        return ()

    def second_bound(self, task: Task) -> tuple[float, str] | None:
        """Return a lower bound on the cost of all plans of a task, and its method in words.

        ``verify`` compares it with the bound of a stored result. The method must share no code
        with solvers and must not depend on back ends. By default there is none.

        Parameters
        ----------
        task
            A task that this domain grounded.

        Returns
        -------
        tuple of float and str
            The bound, infinite if there is no plan; None if the domain has no such method.
        """
        return None

    def default_solver(self, config: Any) -> str:
        """Return the solver that serves a file best where the user names none."""
        return "auto"

    def variants(self, config: Any, seed: int, count: int) -> list[Any]:
        """Return contents like the given one: other layouts of the same product.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        seed
            Governs what is drawn, >= 0. The i-th depends on the seed and i alone, so that more
            of them begin with the same ones.
        count
            How many, >= 1.

        Returns
        -------
        list
            Instances of `Config` without issues, whose tasks have the same facts and skills.

        Raises
        ------
        OptionError
            If the file describes no family, or too few of its layouts are faultless.
        """
        raise OptionError(f"Tasks of kind {self.kind!r} have no families of layouts.")

    def has_family(self, config: Any) -> bool:
        """Return whether a file describes a family of layouts, of which its task is one."""
        return False

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the path of the file's entry that a fact comes from; the root by default."""
        return ()

    def locate_skill(self, config: Any, skill: str, *, reach: bool) -> tuple[str | int, ...]:
        """Return the path of the file's key to change where a skill is never feasible.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        skill
            Its name.
        reach
            Whether it fails by how the robot gets there; else by where things are.

        Returns
        -------
        tuple
            The root by default.
        """
        return ()

    def starter(self) -> str:
        """Return a commented file to begin one's own from: valid, soon solved, its keys explained.

        By default it is the file ``starter.yaml`` in the package that holds the domain's class.

        Raises
        ------
        OptionError
            If there is none.
        """
        from importlib import resources  # only a starter pays for importing this

        package = sys.modules[type(self).__module__].__package__
        file = resources.files(package or "skillplan") / f"starter{self.starter_suffix}"
        if not file.is_file():
            raise OptionError(f"Tasks of kind {self.kind!r} have no starter file.")
        return file.read_text("utf-8")
