"""The base class of domains."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

from skillplan.errors import Issue
from skillplan.task.task import Task


class Strict(BaseModel):
    """Base of all schema models: unknown keys, numbers in quotes and infinities are faults."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, populate_by_name=True
    )


Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]{0,63}$")]


class Domain(ABC):
    """A kind of task file.

    Attributes
    ----------
    kind
        What the file's key ``kind`` says.
    Config
        The schema of the file: a model derived from `Strict`.
    """

    kind: ClassVar[str]
    Config: ClassVar[type[BaseModel]]

    def issues(self, config: Any) -> Iterable[Issue]:
        """Return every fault that the schema cannot see, each with the path of its key."""
        return ()

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

    def locate(self, fact: str) -> tuple[str | int, ...]:
        """Return the path of the file's entry that a fact comes from; the root by default."""
        return ()
