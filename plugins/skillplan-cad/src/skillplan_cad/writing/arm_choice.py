"""Choose the arm of a task by the payload and the reach that the parts need."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from skillplan.robots.catalogue import ARMS, DEFAULT_ARM
from skillplan_cad.planning.bearing import Bearing
from skillplan_cad.product import Part, Vector
from skillplan_cad.relation import Relation
from skillplan_cad.writing.held_part import LONG_ARM, Load, get_payload_kg
from skillplan_cad.writing.task_document import (
    Places,
    assign_task_names,
    compute_safe_height_m,
    lay_out_parts,
)
from skillplan_cad.writing.upright import compute_rotation_to_z, place_upright

AUTO_ARM = "auto"
# Cosine of the axis of a screw and the direction away from the arm.
_TOWARDS = 0.7
# Reach beyond which an arm comes after all others: its cell is large.
_LONG_REACH_M = 2.5


def choose_arm(parts: Sequence[Part], up: Vector, loads: Mapping[str, Load] | None = None) -> str:
    """Return the arm that carries and reaches most parts: the default one, or the smallest.

    Parameters
    ----------
    parts
        Parts that may be in the task.
    up
        Vector that points up, in the product's frame.
    loads
        Parts with the tools that hold them; default: with the arm's hand, at their tops.
    """
    names = assign_task_names(part.name for part in parts)
    others = sorted(set(ARMS) - {DEFAULT_ARM}, key=_rank_size)
    hand_kg = ARMS[DEFAULT_ARM][1].mass_kg
    upright = place_upright(parts, up, (0.0, 0.0))
    load_of = {
        part.name: Load(part.mass_kg + hand_kg, float(upright.size(part)[2])) for part in parts
    } | dict(loads or {})
    best, most = DEFAULT_ARM, -1
    for arm in (DEFAULT_ARM, *others):
        carried = [part for part in parts if load_of[part.name].mass_kg <= get_payload_kg(arm)]
        count = len(carried)
        if count > most and carried:
            places = lay_out_parts(carried, carried, names, (), Bearing(up, ()), arm)
            far = {
                part.name
                for part in carried
                if not _is_in_reach(part, load_of[part.name].tip_m, carried, places, arm)
            }
            count -= len(far.union(places.without))
        if count > most:
            best, most = arm, count
        if most == len(parts):
            break
    return best


def _rank_size(arm: str) -> tuple[bool, float, str]:
    return ARMS[arm][0].works_within_m > _LONG_REACH_M, get_payload_kg(arm), arm


def find_longer_arm(arm: str, loads: Iterable[Load]) -> str | None:
    """Return an arm that reaches farther and carries what another one does, or None."""
    masses_kg = [load.mass_kg for load in loads]
    least_kg = max((kg for kg in masses_kg if kg <= get_payload_kg(arm)), default=0.0)
    for other in sorted(ARMS, key=lambda name: (name != LONG_ARM, *_rank_size(name))):
        is_longer = ARMS[other][0].works_within_m > ARMS[arm][0].works_within_m
        if is_longer and get_payload_kg(other) >= least_kg:
            return other
    return None


def list_screws_towards_arm(relation: Relation, bearing: Bearing) -> list[str]:
    """Return the screws that go in towards the arm, which has to reach over the product for them.

    The default arm cannot, a longer one can.
    """
    to_z = compute_rotation_to_z(bearing.up)
    return [
        fastener.part
        for fastener in relation.fasteners
        if fastener.part in relation.driven - bearing.undriven.keys()
        and float(to_z[0] @ np.asarray(fastener.axis)) > _TOWARDS
    ]


def _is_in_reach(part: Part, tip_m: float, parts: Sequence[Part], places: Places, arm: str) -> bool:
    """Return whether an arm's tip reaches a part at its goal, also when it travels with it."""
    x_m, y_m, _ = places.upright.bottom(part)
    top_m = max(
        float(places.upright.vertices(part)[:, 2].max()),
        compute_safe_height_m(parts, parts, places.upright) + tip_m,
    )
    return float(np.linalg.norm((x_m, y_m, top_m))) <= ARMS[arm][0].works_within_m
