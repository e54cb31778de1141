"""Choose how a product stands before the arm, turned about the vertical."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from skillplan.robots.catalogue import ARMS
from skillplan_cad.planning.bearing import Bearing, can_come_down
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.relation import Relation
from skillplan_cad.writing.task_document import (
    WRIST,
    choose_goal,
    find_range_m,
    measure_travel_m,
)
from skillplan_cad.writing.upright import place_turned

# Largest sine of a level direction, and quarter turns that are compared.
_LEVEL, _QUARTERS = 1e-3, 4
# Farthest place of the wrist of a level hand, as a share of the arm's reach.
_FARTHEST = 0.85


def choose_heading(product: Product, relation: Relation, bearing: Bearing, robot: str) -> int:
    """Return the quarter turns about the vertical with which an arm reaches most level parts.

    The wrist of a level hand has to be in reach behind the part. The heading of the file stays if
    the arm reaches half of the level parts, as this is an estimate.
    """
    level = list(_list_level(product, relation, bearing))
    if not level:
        return 0
    names = {*bearing.order, *(relation.driven - bearing.undriven.keys())}
    parts = [part for part in product if part.name in names]
    reached = [_count_reached(parts, level, bearing, robot, turns) for turns in range(_QUARTERS)]
    return 0 if 2 * reached[0] >= len(level) else reached.index(max(reached))


def _list_level(
    product: Product, relation: Relation, bearing: Bearing
) -> Iterator[tuple[Part, Vector]]:
    """Yield the parts and screws that only go in level, each with its direction."""
    before = 0
    for name in bearing.order:
        number = relation.index(name)
        if name not in bearing.turned and not can_come_down(relation, name, before, bearing.up):
            part = product.part(name)
            ways = [
                _negate(relation.directions[direction])
                for direction, blockers in relation.blocker_sets[number]
                if not blockers & before
                and abs(float(np.dot(relation.directions[direction], bearing.up))) < _LEVEL
            ]
            travels_m = [measure_travel_m(relation, part, way) for way in ways]
            if ways:
                yield part, ways[int(np.argmin(travels_m))]
        before |= 1 << number
    for name in sorted(relation.driven - bearing.undriven.keys(), key=relation.index):
        fastener = relation.fastener(name)
        is_turned = name in bearing.turned
        if fastener and not is_turned and abs(np.dot(fastener.axis, bearing.up)) < _LEVEL:
            yield product.part(name), _negate(fastener.axis)


def _count_reached(
    parts: Sequence[Part],
    level: Sequence[tuple[Part, Vector]],
    bearing: Bearing,
    robot: str,
    heading: int,
) -> int:
    """Return the number of level parts at whose end the wrist of a hand is in reach."""
    reach_m, range_m = ARMS[robot][0].works_within_m, find_range_m(robot)
    upright = place_turned(parts, bearing.ups, bearing.turned, (0.0, 0.0), heading)
    corners = np.concatenate([upright.vertices(part) for part in parts])
    x, y, z = np.ptp(corners, axis=0).tolist()
    place = np.array(choose_goal((x, y, z), *range_m))
    count = 0
    for part, way in level:
        along = upright.matrix @ way
        points = upright.vertices(part)
        end = np.array(upright.point(part.centre_m))
        end = end + ((points @ along).min() - end @ along) * along
        wrist = (end - WRIST * reach_m * along)[:2] + place
        count += range_m[0] <= float(np.hypot(*wrist)) <= _FARTHEST * reach_m
    return count


def _negate(vector: Vector) -> Vector:
    x, y, z = vector
    return -x, -y, -z
