"""Entries of the bench in the catalogue of ``skillplan plot``, with the modules that draw them."""

from __future__ import annotations

from typing import Final

from skillplan.views.figures.catalogue import CatalogueEntry

_HERE = "skillplan_swarmitfix.figures"

POLICY: Final = CatalogueEntry(
    "the bench, with an arrow for the action of a policy in every position",
    f"{_HERE}.policy_figure",
)
PLACEMENT: Final = CatalogueEntry(
    "heads and bases along the trajectory, and which base holds which head",
    f"{_HERE}.placement_figure",
)
GANTT: Final = CatalogueEntry(
    "by head, PKM and base in the five steps", f"{_HERE}.gantt_figure", "swarmitfix"
)
FLEET: Final = CatalogueEntry(
    "the paths of several bases on one bench, with their parallel steps", f"{_HERE}.fleet_figure"
)
