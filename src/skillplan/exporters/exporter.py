"""What every exporter offers: the files that hand a task or a plan on, or why there are none."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from pydantic import BaseModel

from skillplan.exporters.handover import Handover
from skillplan.task import back_end


class Exporter(ABC):
    """Says a task, or a plan of it, in a format that other tools read.

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
    suffix
        End of the name of the one file that it makes, such as ``.csv``; empty where it makes
        several, which go into a folder.
    needs_plan
        Whether there is nothing to hand over without a plan.
    """

    name: ClassVar[str]
    Options: ClassVar[type[BaseModel]] = back_end.Options
    suffix: ClassVar[str] = ""
    needs_plan: ClassVar[bool] = True

    def __init__(self, options: BaseModel | None = None) -> None:
        self.options = self.Options() if options is None else options

    def refuses(self, handover: Handover) -> str | None:
        """Return in words what the format cannot say of it; None where it can say all.

        By default what is left to chance is refused: a list of skills says nothing of it.
        """
        return refused_chance(handover)

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return what whoever takes the files over has to know, a clause each."""
        return ()

    @abstractmethod
    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return contents by the names of files; the name of a single one is not used.

        Called where it does not refuse. Texts are written as UTF-8. The last of several is
        written last.
        """


def refused_chance(handover: Handover) -> str | None:
    """Return why what is left to chance cannot be handed over; None where nothing is."""
    if not handover.chance:
        return None
    return (
        f"what becomes of {handover.chance} is left to chance, and this format knows one outcome "
        "only. Take the chance out, as by --set parts.NAME.grasp_failure=0, or "
        "export to btcpp, which tries again"
    )
