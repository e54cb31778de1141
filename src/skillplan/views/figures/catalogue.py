"""The figures that ``skillplan plot`` draws: name, one line of help, and the module that draws it.

Plugins add figures by entry points of the group ``skillplan.figure``, each named as its figure and
naming a `CatalogueEntry`. Nothing heavy is imported until a figure is drawn.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from operator import attrgetter
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

from skillplan.errors import PluginError
from skillplan.plugins.blame import ends_program
from skillplan.plugins.installed import figures, name_and_version

if TYPE_CHECKING:
    from skillplan.views.figures.figure_request import FigureModule

_HERE = "skillplan.views.figures"


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One figure.

    Parameters
    ----------
    line
        Description for ``--help``.
    module
        Full name of the module that draws the figure; a `FigureModule` for a figure of a task.
    kind
        The kind of task that the module draws; empty for any kind. A module for one kind replaces
        the module for any kind.
    """

    line: str
    module: str
    kind: str = ""


TASK_FIGURES: Mapping[str, CatalogueEntry] = MappingProxyType(
    {
        "learning": CatalogueEntry(
            "steps of an episode against episodes, for two sets of parameters",
            f"{_HERE}.learning_figure",
        ),
        "q-values": CatalogueEntry(
            "action values of some states against episodes", f"{_HERE}.q_values_figure"
        ),
        "rewards": CatalogueEntry("action and reward of every step", f"{_HERE}.rewards_figure"),
        "layout": CatalogueEntry(
            "the cell from above: parts, the path of the plan in numbers, the reach of the arm",
            f"{_HERE}.layout_figure",
        ),
        "gantt": CatalogueEntry("who does what when, by arm and tool", f"{_HERE}.gantt_figure"),
        "precedence": CatalogueEntry(
            "what comes before what, as a graph; --out FILE.dot writes it for Graphviz",
            f"{_HERE}.precedence_figure",
        ),
        "exploded": CatalogueEntry(
            "the product taken apart, its parts numbered in the order of the plan; --out FILE.gif "
            "films how it is put together",
            f"{_HERE}.exploded_figure",
        ),
    }
)
"""Figures of a task file that the core draws, by name."""

RUN_FIGURES: Mapping[str, CatalogueEntry] = MappingProxyType(
    {
        "success": CatalogueEntry(
            "how often the last 100 episodes of training succeed, over all runs",
            f"{_HERE}.training_figures",
        ),
        "distances": CatalogueEntry(
            "what every completed sequence of training costs, run by run",
            f"{_HERE}.training_figures",
        ),
        "profile": CatalogueEntry(
            "share of the runs whose policy scores above tau (optimum / cost), and which learner "
            "beats which; also of several tasks",
            f"{_HERE}.profile_figure",
        ),
    }
)
"""Figures of a folder of training runs, by name."""


def list_figure_names() -> list[str]:
    """Return the names of all figures of a task, core ones first; imports no plugin."""
    return list(dict.fromkeys([*TASK_FIGURES, *sorted(figures().names)]))


def describe_figures() -> dict[str, str]:
    """Return the line of help of every figure of a task, by name.

    The line of a broken plugin is the reason.
    """
    lines = {name: TASK_FIGURES[name].line for name in TASK_FIGURES}
    for point in sorted(figures(), key=lambda point: point.name):
        try:
            entry = _load_entry(point)
        except PluginError as error:
            lines.setdefault(point.name, str(error))
            continue
        if point.name in lines:
            lines[point.name] += f"; of {entry.kind}: {entry.line}"
        else:
            lines[point.name] = entry.line
    return lines


def load_figure_module(name: str, kind: str) -> FigureModule:
    """Return the module that draws a figure of a task.

    Raises
    ------
    KeyError
        If there is no such figure.
    PluginError
        If the plugin that draws it is broken.
    ImportError
        If matplotlib is not installed.
    """
    entries = [TASK_FIGURES[name]] if name in TASK_FIGURES else []
    entries += [_load_entry(point) for point in figures().select(name=name)]
    fitting = sorted(
        (entry for entry in entries if entry.kind in ("", kind)), key=attrgetter("kind")
    )
    if not (fitting or entries):
        raise KeyError(name)
    entry = fitting[-1] if fitting else entries[-1]
    return cast("FigureModule", importlib.import_module(entry.module))


def _load_entry(point: EntryPoint) -> CatalogueEntry:
    owner = point.module if point.dist is None else " ".join(name_and_version(point.dist))
    plugin = f"The figure {point.name!r} of {owner} ({point.value})"
    try:
        entry = point.load()
    except BaseException as error:
        if ends_program(error):
            raise
        reason = f"{type(error).__name__}: {error}"
        raise PluginError(f"{plugin} cannot be imported: {reason}") from error
    if not isinstance(entry, CatalogueEntry):
        raise PluginError(f"{plugin} is not a CatalogueEntry of {__name__}.")
    return entry
