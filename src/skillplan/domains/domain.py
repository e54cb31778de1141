"""The base class of domains, and the values that its methods return."""

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

    # Validators are built when a file is read, once for all models: most models are parts of
    # another.
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
    """A table of a domain.

    Raises
    ------
    ValueError
        If a row and the columns differ in length.
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
    """Results of a domain beyond the plans of its tasks.

    Parameters
    ----------
    document
        Keys added to the result's JSON document; JSON values only.
    listings
        Tables printed before the table of plans.
    appendix
        Tables that are saved but not printed, by file name.
    lower_bound
        Proved lower bound on the total cost of the main tasks, for any plans of earlier stages;
        None
        if there is no proof.
    bound_given
        The same bound for the given plans of earlier stages.
    not_checked
        Sentences on properties of the plans that were not checked.
    caveat
        Warning to read before executing the plans; may be empty.
    makespan_s
        Total time [s], if it exceeds the time of the skills.
    parallel_steps
        Number of steps if robots act in parallel; None for one robot.
    parallel_bound
        Proved lower bound on that number; None for one robot.
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
        Name of the property, such as ``reach``.
    holds
        True if the plans have it; None if the file does not require it.
    detail
        Figures, or the first plan without the property.
    method
        Method of the check, in words.
    """

    claim: str
    holds: bool | None
    detail: str
    method: str


@dataclass(frozen=True)
class Overview:
    """Summary of a valid file before it is solved.

    Parameters
    ----------
    document
        Keys added to the JSON document of ``check``; JSON values only.
    lines
        The same in words: a name, blanks and a clause in each line.
    """

    document: Mapping[str, Any] = field(default_factory=dict)
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class CellChange:
    """A change of a file that may lower the cost of its plans.

    Parameters
    ----------
    kind
        ``place``, ``tool``, ``grip``, ``order`` or ``travel``; kinds are tried in turn.
    item
        The thing that changes; only the best change of an item is listed.
    words
        The change as an instruction, such as ``move home by +0.1 m in x``.
    changes
        YAML values by key path, as ``--set`` takes them.
    """

    kind: str
    item: str
    words: str
    changes: Mapping[str, str]


class Domain(ABC):
    """A kind of task file, found by the entry point group ``skillplan.domain``.

    Attributes
    ----------
    kind
        Value of the file's key ``kind``.
    Config
        Schema of the file: a model derived from `Strict`.
    stages
        Stages of a chain of tasks, in order.
    suffixes
        Suffixes of files that `read` parses, such as ``.sop``, in small letters; others are YAML.
    max_bytes
        Greatest size of such a file [B].
    starter_suffix
        Suffix of the file that `starter` returns.
    former_defaults
        Defaults of earlier versions by key path, for stored results.
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
        source
            Path as the user gave it.

        Returns
        -------
        Document
            Data with the keys of `Config` and ``kind``, and their positions.

        Raises
        ------
        TaskError
            With every fault that prevents reading.
        """
        return parse(text, source)

    def expand(self, document: Document) -> Document:
        """Return a document with its shorthands written out, before it is validated.

        Faults of shorthands are added to the document's own.
        """
        return document

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return the faults that the schema cannot find, each with the path of its key."""
        return ()

    def warnings(self, config: Any) -> Iterable[Issue]:
        """Return suspicious entries of a valid file, each with the path of its key.

        Every command prints them on stderr.
        """
        return ()

    def hints(self, config: Any) -> Iterable[Issue]:
        """Return entries that may cause trouble later; only ``check`` prints them."""
        return ()

    def overview(self, config: Any) -> Overview:
        """Return the summary for ``check``, such as extents and supports."""
        return Overview()

    @abstractmethod
    def ground(self, config: Any, sha256: str) -> list[Task]:
        """Return the tasks of a file without issues, in the order of solving.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        sha256
            Hash of the content, stored in the tasks.
        """

    def follow(
        self, config: Any, sha256: str, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> list[Task]:
        """Return the tasks of a chain after some of them have been solved.

        Solved tasks and tasks of their stages stay the same.

        Parameters
        ----------
        config, sha256
            See `ground`.
        plans
            Names of skills by the name of the solved task.
        refinement
            Number of times that a finer plan of the upper stages was needed because a lower stage
            failed.
            The result is empty without a finer plan.

        Raises
        ------
        ChainBroken
            If the plans leave no choice for the next stage.
        """
        return self.ground(config, sha256) if refinement == 0 else []

    def account(
        self, config: Any, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> Account:
        """Return results beyond the plans of the tasks."""
        return Account()

    def recheck(
        self, config: Any, plans: Mapping[str, Sequence[str]], refinement: int = 0
    ) -> Iterable[Recheck]:
        """Return properties that the file requires and the replay does not check."""
        return ()

    def second_bound(self, task: Task) -> tuple[float, str] | None:
        """Return a lower bound on the cost of a task, and its method in words.

        ``verify`` compares it with the bound of a stored result. The method must not share code
        with
        solvers or depend on back ends. By default there is none.

        Returns
        -------
        tuple of float and str
            The bound, infinite if there is no plan; None if the domain has no such method.
        """
        return None

    def default_solver(self, config: Any) -> str:
        """Return the default solver of a file."""
        return "auto"

    def list_costs(self, config: Any) -> tuple[str, ...]:
        """Return the names of the costs that a file can be solved for; none if there is one."""
        return ()

    def with_cost(self, config: Any, name: str) -> Any:
        """Return a file without issues with another of the costs that `list_costs` names."""
        raise OptionError(f"Tasks of kind {self.kind!r} have a single cost.")

    def list_changes(self, config: Any, within_m: float) -> Iterable[CellChange]:
        """Return changes of a file that may lower the cost of its plans; none by default.

        Parameters
        ----------
        within_m
            Greatest shift of a place along each axis [m], > 0.
        """
        return ()

    def variants(self, config: Any, seed: int, count: int) -> list[Any]:
        """Return random layouts of the same product.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        seed
            Random seed, >= 0. Layout i depends on the seed and i alone, so longer lists begin with
            the
            shorter ones.
        count
            Number of layouts, >= 1.

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
        """Return True if the file describes a family of layouts."""
        return False

    def benchmark(self) -> str | None:
        """Return the instances that this kind adds to ``skillplan benchmark``.

        The default is ``benchmark.json`` in the package of the domain's class.

        Returns
        -------
        str or None
            A document ``skillplan.benchmark-instances/1``; None if there are no instances.
        """
        return self._read_resource("benchmark.json")

    def generate(self, parameters: Mapping[str, Any]) -> str:
        """Return the random task file of an instance with the key ``generate``.

        Raises
        ------
        OptionError
            If a parameter is wrong, or the kind has no generator.
        """
        raise OptionError(f"Tasks of kind {self.kind!r} are not generated.")

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the path of the entry that a fact comes from; the root by default."""
        return ()

    def locate_skill(self, config: Any, skill: str, *, reach: bool) -> tuple[str | int, ...]:
        """Return the path of the key to change if a skill is never feasible; the root by default.

        Parameters
        ----------
        config
            An instance of `Config` without issues.
        reach
            True if the robot cannot get there; otherwise objects are in the way.
        """
        return ()

    def starter(self) -> str:
        """Return a commented file to start from: valid, quick to solve, with explained keys.

        The default is ``starter.yaml`` in the package of the domain's class.

        Raises
        ------
        OptionError
            If there is no such file.
        """
        text = self._read_resource(f"starter{self.starter_suffix}")
        if text is None:
            raise OptionError(f"Tasks of kind {self.kind!r} have no starter file.")
        return text

    def _read_resource(self, name: str) -> str | None:
        """Return the text of a file in the package of this class; None if it is missing."""
        from importlib import resources  # needed for starters and benchmarks only

        package = sys.modules[type(self).__module__].__package__
        file = resources.files(package or "skillplan") / name
        return file.read_text("utf-8") if file.is_file() else None
