"""Choose the arm of a task by the payload and the reach that the parts need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skillplan.robots.catalogue import ARMS, DEFAULT_ARM
from skillplan_cad.product import Part, Vector
from skillplan_cad.writing.held_part import compute_payload_kg
from skillplan_cad.writing.task_document import (
    Places,
    assign_task_names,
    compute_safe_height_m,
    lay_out_parts,
)

AUTO_ARM = "auto"


def choose_arm(parts: Sequence[Part], up: Vector) -> str:
    """Return the arm that carries and reaches most parts: the default one, or the weakest.

    Parameters
    ----------
    parts
        Parts that may be in the task.
    up
        Vector that points up, in the product's frame.
    """
    names = assign_task_names(part.name for part in parts)
    others = sorted(set(ARMS) - {DEFAULT_ARM}, key=lambda arm: (compute_payload_kg(arm), arm))
    best, most = DEFAULT_ARM, -1
    for arm in (DEFAULT_ARM, *others):
        carried = [part for part in parts if part.mass_kg <= compute_payload_kg(arm)]
        count = len(carried)
        if count > most and carried:
            places = lay_out_parts(carried, carried, names, (), up, arm)
            far = {part.name for part in carried if not _is_in_reach(part, carried, places, arm)}
            count -= len(far.union(places.without))
        if count > most:
            best, most = arm, count
        if most == len(parts):
            break
    return best


def _is_in_reach(part: Part, parts: Sequence[Part], places: Places, arm: str) -> bool:
    """Return whether an arm's tip reaches above a part at its goal, also at the safe height."""
    x_m, y_m, _ = places.upright.bottom(part)
    top_m = max(
        float(places.upright.vertices(part)[:, 2].max()),
        compute_safe_height_m(parts, parts, places.upright),
    )
    return float(np.linalg.norm((x_m, y_m, top_m))) <= ARMS[arm][0].works_within_m
