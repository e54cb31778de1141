"""Which side of the product is up, and what that says about its parts."""

from __future__ import annotations

from typing import Any

from skillplan_cad.planning.bearing import ATTITUDES, Bearing, bearing_of, best_bearing
from skillplan_cad.product import Product
from skillplan_cad.relation import Relation

AUTO = "auto"


def attitude(product: Product, relation: Relation, up: str) -> Bearing:
    """Return what bears the parts with an axis of the file up, or with that which bears most."""
    if up == AUTO:
        return best_bearing(product, relation)
    return bearing_of(product, relation, ATTITUDES[up])


def attitude_document(bearing: Bearing) -> dict[str, Any]:
    """Return as JSON what is up and what stands on what."""
    return {
        "up": axis_of(bearing),
        "stands": [{"part": name, "on": list(bearing.on[name])} for name in bearing.order],
    }


def attitude_warnings(
    product: Product, relation: Relation, bearing: Bearing, asked: str
) -> list[str]:
    """Return what a user should know of the side that is up, a sentence each."""
    count = len(bearing.order) + len(bearing.why_not)
    up, stand = axis_of(bearing), len(bearing.order)
    found = []
    if asked == AUTO and up != next(iter(ATTITUDES)):
        found.append(
            f"{up} points up, as then {stand} of {count} parts stand by themselves, more than with "
            "any other axis; --up asks for another."
        )
    best = bearing if asked == AUTO else best_bearing(product, relation)
    if len(best.order) > stand:
        found.append(
            f"with {up} up {stand} of {count} parts stand by themselves; with --up "
            f"{axis_of(best)} it would be {len(best.order)}."
        )
    if not stand:
        found.append(
            f"with {up} up no part stands on a level face. All are in product.yaml, and no order "
            "of them is feasible until a nest holds the first."
        )
    return found


def axis_of(bearing: Bearing) -> str:
    """Return the axis of the file that points up, as ``--up`` names it."""
    return next(name for name, up in ATTITUDES.items() if up == bearing.up)
