"""The nest that a written task puts its base into, so that later parts do not push it aside."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from skillplan.errors import OptionError
from skillplan_cad.nests.nest import NestSettings
from skillplan_cad.nests.nest_check import drop_bad_coarse
from skillplan_cad.nests.nest_document import build_nest_document, find_origin_m, format_nest_files
from skillplan_cad.nests.planned_nests import (
    NEST_FOLDER,
    Way,
    build_checked_nest,
    divide_room,
    get_body,
    goes_down,
)
from skillplan_cad.planning.watch import Attempt, call_at_once
from skillplan_cad.product import GRAVITY_M_PER_S2, Part, Vector
from skillplan_cad.relation import Relation
from skillplan_cad.writing.task_document import TaskNest
from skillplan_cad.writing.upright import compute_rotation_to_z

# Push of a part that is led into a fit or comes from a side [N], and friction on the table.
_PUSH_N, _FRICTION = 3.0, 0.3
# Height by which corners of a foot may differ, and parts on the same floor [m].
_GROUND_M, _LEVEL_M = 2e-4, 1e-5
# Height of the base that the nest holds: a share of it, within limits, or the shallow one [m].
_DEPTH_SHARE, _SHALLOW_M, _DEEPEST_M, _THINNEST_M = 0.5, 0.002, 0.015, 8e-4
# Depth to which parts may hang below the base [m].
_MOST_BELOW_M = 0.05
# Height by which a base stands higher if the arm meets the table: from 60 mm on, arms of the
# catalogue drive level screws [m].
_RAISE_M = 0.06
# Samples of the check, and height of layers on slopes: a fifth and four times those of
# `skillplan nest`, as imports wait for them [m].
_SAMPLES, _LAYER_M = 30_000, 2e-3
# Share of the time limit at which cutting is interrupted.
_SHARE = 0.75
# Largest number of triangles of the parts that it leaves room for.
_MOST_TRIANGLES = 20_000
_NO_TIME = "none was cut in the time"


@dataclass(frozen=True, slots=True)
class Coming:
    """A part of the task and the directions in which it may come, in the product's frame.

    Parameters
    ----------
    stands
        True if the table bears it, and nothing holds it.
    """

    part: Part
    ways: tuple[Vector, ...]
    stands: bool = False

    def comes_down(self, up: Vector) -> bool:
        """Return whether it comes straight down only."""
        return all(goes_down(way, up) for way in self.ways)


class NestChoice:
    """The nest of a task: as deep as usual, shallow, or none, until the arm does not meet it.

    Attributes
    ----------
    why_none
        Why a base that needs a nest has none, as a clause; empty otherwise.
    raise_m
        Height by which the product stands higher than usual [m].
    """

    def __init__(self, relation: Relation, up: Vector, heading: int = 0) -> None:
        self._relation, self._up, self._heading = relation, up, heading
        self._is_shallow = self._is_over = False
        self.raise_m, self._failed = 0.0, -1
        # With why there is none, as a clause.
        self._cut: dict[tuple[str, bool, float], tuple[TaskNest | None, str]] = {}
        self.why_none = ""

    def choose(
        self,
        name: str,
        base: Coming,
        others: Sequence[Coming],
        attempt: Attempt = call_at_once,
        *,
        is_fixed: bool,
    ) -> TaskNest | None:
        """Return the nest of a base, or None. It is cut once for all parts that may come.

        Parameters
        ----------
        name
            Name of the fixture.
        others
            The other parts, and the screws.
        attempt
            Calls a function, and interrupts it at a share of the time limit.
        is_fixed
            True for a base in place from the start, which nothing pushes.
        """
        if self._is_over:
            return None
        key = (base.part.name, self._is_shallow, self.raise_m)
        if key not in self._cut:
            reason = "stands so low that the arm meets the table beside it"
            if not self.raise_m:
                pushed = explain_need(base.part, others, self._relation, self._up)
                reason = "" if pushed is None or is_fixed else pushed
            self._cut[key] = None, _NO_TIME if reason else ""
            if reason:
                cut = partial(
                    cut_task_nest,
                    name,
                    reason,
                    base.part,
                    others,
                    self._up,
                    is_shallow=self._is_shallow,
                    raise_m=self.raise_m,
                    heading=self._heading,
                )
                self._cut[key] = attempt(cut, _SHARE) or self._cut[key]
        nest, self.why_none = self._cut[key]
        return nest

    def retreat(self, words: str) -> None:
        """Take a shallow nest, or else none.

        Parameters
        ----------
        words
            How the arm met the nest.
        """
        self._is_shallow, self._is_over = True, self._is_shallow
        self.why_none = words if self._is_over else ""

    def lift(self, failed: int, *, is_low: bool) -> bool:
        """Stand the base higher, and lower again if that does not help; return whether it moves.

        Parameters
        ----------
        failed
            Number of parts that the arm cannot bring.
        is_low
            True if it meets the table where it brings one.
        """
        if self._is_over:
            return False
        if self._failed < 0 and is_low:
            self.raise_m, self._failed = _RAISE_M, failed
            return True
        if self.raise_m and self._failed > 0:
            helps = failed < self._failed
            self._failed = 0
            if not helps:
                self.raise_m = 0.0
                return True
        return False


def explain_need(
    base: Part, others: Iterable[Coming], relation: Relation, up: Vector
) -> str | None:
    """Return why other parts would push the base out of its place, or None.

    Friction and weight must keep it there against a push of 3 N at its top. Parts that come
    straight down onto level faces do not push.
    """
    pushing = [
        coming.part.name
        for coming in others
        if not coming.comes_down(up) or _is_led(coming.part.name, relation)
    ]
    if not pushing:
        return None
    weight_n = base.mass_kg * GRAVITY_M_PER_S2
    by = f"{pushing[0]}{' and others' if pushing[1:] else ''}"
    if _FRICTION * weight_n < _PUSH_N:
        return f"weighs {base.mass_kg:.3g} kg, so {by} would push it aside"
    turn = compute_rotation_to_z(up)
    corners, centre = base.vertices_m @ turn.T, turn @ np.asarray(base.centre_m)
    low, high = corners[:, 2].min(), corners[:, 2].max()
    feet = corners[corners[:, 2] < low + _GROUND_M]
    reaches = np.concatenate([feet.max(axis=0) - centre, centre - feet.min(axis=0)])[[0, 1, 3, 4]]
    if weight_n * float(reaches.min()) < _PUSH_N * float(high - low):
        return f"is tall on a small foot, so {by} would tip it"
    return None


def _is_led(name: str, relation: Relation) -> bool:
    """Return whether a part is a shaft in a hole, or has a hole for a shaft."""
    return any(
        name in contact.parts and contact.kind == "cylinder" for contact in relation.contacts
    )


def cut_task_nest(
    name: str,
    reason: str,
    base: Part,
    others: Sequence[Coming],
    up: Vector,
    *,
    is_shallow: bool = False,
    raise_m: float = 0.0,
    heading: int = 0,
) -> tuple[TaskNest | None, str]:
    """Return a nest that passes its check, or None and why there is none.

    Parameters
    ----------
    name
        Name of the fixture.
    reason
        Why the base needs it, as a clause.
    others
        Parts that come later; the nest leaves room for them and for their ways.
    is_shallow
        True for a nest that holds as little as can be.
    raise_m
        Height by which its floor is thicker than usual.
    heading
        Quarter turns of the product about the vertical.
    """
    axis = np.asarray(up)
    low_m, high_m = ((base.vertices_m @ axis).min(), (base.vertices_m @ axis).max())
    seated, usual = [base], NestSettings()
    for coming in others:
        lowest_m = float((coming.part.vertices_m @ axis).min())
        if coming.stands and coming.comes_down(up) and abs(lowest_m - low_m) < _LEVEL_M:
            seated.append(coming.part)
    ways = (Way((coming.part,), coming.ways) for coming in others)
    room, free = divide_room(ways, up, usual.clearance_m, heading)
    room = [get_body(base), *room]
    count = sum(len(triangles) for _, triangles in room)
    if count > _MOST_TRIANGLES:
        return None, f"it is not cut at import for {count:,} triangles; `skillplan nest` cuts one"
    below_m = float(low_m - min((vertices @ axis).min() for vertices, _ in room))
    if below_m > _MOST_BELOW_M:
        return None, f"other parts hang {below_m * 1e3:.0f} mm lower"
    height_m = float(high_m - low_m)
    held_m = min(max(_DEPTH_SHARE * height_m, _SHALLOW_M), _DEEPEST_M, height_m)
    held_m = max(min(held_m, _SHALLOW_M) if is_shallow else held_m, _THINNEST_M)
    settings = replace(
        usual, depth_m=below_m + held_m, base_m=usual.base_m + raise_m, layer_m=_LAYER_M, pin_m=0.0
    )
    try:
        nest, check = build_checked_nest(seated, room, settings, up, free, _SAMPLES, heading)
    except OptionError as error:
        return None, str(error)
    faults = list(check.faults)
    if check.held_by_walls:
        faults.append("it would lean against a wall of the nest")
    files = format_nest_files(name, drop_bad_coarse(room, nest, free))
    if f"{name}.obj" not in files:
        faults.append("a task accepts fewer corners and pieces than the nest has")
    if faults:
        return None, faults[0]
    entry = build_nest_document(name, nest, check, seated)
    entry["files"] = {
        file.removeprefix(f"{name}.").replace(".", "_"): f"{NEST_FOLDER}/{file}" for file in files
    }
    entry["without"] = []
    x, y, z = (float(value) for value in find_origin_m(nest))
    paths = {f"{NEST_FOLDER}/{file}": content for file, content in files.items()}
    names = tuple(part.name for part in seated)
    return TaskNest(name, reason, names, (x, y, z), paths, entry), ""
