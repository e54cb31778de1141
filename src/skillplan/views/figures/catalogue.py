"""The figures that ``skillplan plot`` draws: name, what each shows, and the module that draws it.

Nothing heavy is imported until a figure is drawn.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from skillplan.views.figures.figure_request import FigureModule


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One figure.

    Parameters
    ----------
    line
        What it shows, as ``--help`` says it.
    module
        Below ``skillplan.views.figures``; it is a `FigureModule` where the figure is of a task.
    """

    line: str
    module: str


TASK_FIGURES: Mapping[str, CatalogueEntry] = MappingProxyType(
    {
        "policy": CatalogueEntry(
            "the bench, with an arrow for what a policy recommends in every position",
            "swarmitfix.policy_figure",
        ),
        "placement": CatalogueEntry(
            "heads and bases along the trajectory, and which base holds which head",
            "swarmitfix.placement_figure",
        ),
        "learning": CatalogueEntry(
            "steps of an episode against episodes, for two sets of parameters", "learning_figure"
        ),
        "q-values": CatalogueEntry(
            "action values of some states against episodes", "q_values_figure"
        ),
        "rewards": CatalogueEntry("action and reward of every step", "rewards_figure"),
        "layout": CatalogueEntry(
            "the cell from above: parts, the path of the plan in numbers, the reach of the arm",
            "layout_figure",
        ),
        "gantt": CatalogueEntry(
            "who does what when: by arm and tool, or head, PKM and base in the five steps",
            "gantt_figure",
        ),
        "precedence": CatalogueEntry(
            "what comes before what, as a graph; --out FILE.dot writes it for Graphviz",
            "precedence_figure",
        ),
        "exploded": CatalogueEntry(
            "the product taken apart, its parts numbered in the order of the plan; --out FILE.gif "
            "films how it is put together",
            "exploded_figure",
        ),
        "fleet": CatalogueEntry(
            "the paths of several bases on one bench, with their parallel steps",
            "swarmitfix.fleet_figure",
        ),
    }
)
"""Figures of a task file, by name."""

RUN_FIGURES: Mapping[str, CatalogueEntry] = MappingProxyType(
    {
        "success": CatalogueEntry(
            "how often the last 100 episodes of training succeed, over all runs",
            "training.success_figure",
        ),
        "distances": CatalogueEntry(
            "what every completed sequence of training costs, run by run",
            "training.distances_figure",
        ),
    }
)
"""Figures of a folder of training runs, by name."""


def figure_module(name: str) -> FigureModule:
    """Return the module that draws a figure of a task.

    Raises
    ------
    KeyError
        If there is no such figure.
    ImportError
        If matplotlib is not installed.
    """
    path = f"skillplan.views.figures.{TASK_FIGURES[name].module}"
    return cast("FigureModule", importlib.import_module(path))
