"""Where parts lie at the start and go, and which come from a feeder."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from skillplan.robots.catalogue import ARMS
from skillplan_cad.product import Part, Vector
from skillplan_cad.writing.names import task_names
from skillplan_cad.writing.tray import Item, Tray, tray
from skillplan_cad.writing.upright import Upright, standing


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """A layout of the table for the parts of a task.

    Parameters
    ----------
    upright
        Where the product stands.
    tray
        Where parts and feeders are, by their names in the task.
    feeders
        Of parts that have identical ones, by their names in the product, the name of their feeder.
    without
        Names, in the product, of parts for which there is no room in reach.
    """

    upright: Upright
    tray: Tray
    feeders: Mapping[str, str]
    without: tuple[str, ...]


def places_of(
    parts: Sequence[Part],
    gripped: Sequence[Part],
    names: Mapping[str, str],
    taken: Collection[str],
    up: Vector,
    robot: str,
) -> Places:
    """Return where everything goes.

    Parameters
    ----------
    parts, gripped
        All parts of the task, and those that stand, which a hand brings.
    names
        Of the parts in the task, by those in the product.
    taken
        Names that no feeder may have.
    up
        What points up, in the product's frame.
    robot
        Name of the arm.
    """
    upright = standing(gripped, up, (0.0, 0.0))
    feeders = _feeders(parts, names, taken)
    items: dict[str, Item] = {}
    for part in parts:
        name = feeders.get(part.name, names[part.name])
        if part in gripped or part.name in feeders:
            x, y, z = (float(one) for one in upright.size(part))
            items.setdefault(name, Item(name, (x, y, z)))
    points = np.concatenate([upright.vertices(part) for part in parts])
    x, y, z = (float(one) for one in np.ptp(points, axis=0))
    layout = tray((x, y, z), list(items.values()), ARMS[robot][0].works_within_m)
    without = tuple(
        part.name for part in parts if feeders.get(part.name, names[part.name]) in layout.without
    )
    return Places(standing(gripped, up, layout.product_m), layout, feeders, without)


def _feeders(
    parts: Sequence[Part], names: Mapping[str, str], taken: Collection[str]
) -> Mapping[str, str]:
    """Return for each part that has identical ones the name of their feeder."""
    found: dict[str, str] = {}
    by_shape: dict[int, list[Part]] = {}
    for part in parts:
        by_shape.setdefault(part.shape, []).append(part)
    known = set(taken)
    for alike in by_shape.values():
        if len(alike) > 1:
            wanted = f"{names[alike[0].name]}_feeder"
            name = task_names([wanted], known)[wanted]
            known.add(name)
            found |= {part.name: name for part in alike}
    return found
