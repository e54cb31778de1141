"""Layouts of a family: the same product with randomly shifted starts and goals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.domains.assembly.consistency import find_issues
from skillplan.domains.assembly.geometry_faults import measure_distances_m
from skillplan.domains.assembly.resting import find_bearers
from skillplan.domains.assembly.schema import AssemblyConfig, FamilyConfig
from skillplan.errors import OptionError

# Number of layouts drawn until one is faultless, and of repairs of each: in most draws of many
# parts some pair is too close, and parts of such pairs are drawn again.
_DRAWS = 100
_REPAIRS = 20
# Shifts have steps of 0.1 mm, finer than any layout on a real table.
_DECIMALS = 4
_ROUNDING_M = 1e-9

_Distances = Mapping[tuple[str, str, str], float]
_Shift = tuple[float, float]


def draw_layouts(config: AssemblyConfig, seed: int, count: int) -> list[AssemblyConfig]:
    """Return random layouts of a file's family, each without faults.

    Parts that are closer in the file than the family demands come no closer: hand and fingers need
    the room, and a part on another's goal would need another order than the file's chart.

    Parameters
    ----------
    seed
        Random seed, >= 0. A layout depends on the seed and its own index alone.
    count
        Number of layouts, >= 1.

    Raises
    ------
    OptionError
        If the assembly has no block ``family``, or too many draws of a layout have faults.
    """
    if config.family is None:
        raise OptionError(
            f"The task {config.name!r} describes no family of layouts. Give it a block such as "
            "family: {start_shift_m: 0.03}."
        )
    known_m = measure_distances_m(config)
    layouts = []
    for index in range(count):
        draw = _Draw(config, config.family, seed, index)
        fault = ""
        for _ in range(_DRAWS):
            drawn, fault = draw.draw_layout(known_m)
            if not fault:
                layouts.append(drawn)
                break
        else:
            raise OptionError(
                f"The family of {config.name!r} has no faultless layout {index} with seed "
                f"{seed}, of {_DRAWS} that were drawn; the last: {fault} Lower the lengths of its "
                "block 'family'."
            )
    return layouts


class _Draw:
    """Random shifts of one layout: one of all goals, and one of each start on the table."""

    def __init__(self, config: AssemblyConfig, family: FamilyConfig, seed: int, index: int) -> None:
        # Imports numpy, which a search of the file's own layout does not need.
        import numpy as np

        self.config, self.family = config, family
        self.generator = np.random.default_rng([seed, index])
        self.movable = [name for name, part in config.parts.items() if part.start_m is not None]

    def draw_layout(self, known_m: _Distances) -> tuple[AssemblyConfig, str]:
        """Return a layout and its first fault; empty for a faultless layout."""
        goals = self._draw_shift(self.family.goal_shift_m)
        starts = {name: self._draw_shift(self.family.start_shift_m) for name in self.movable}
        for _ in range(_REPAIRS):
            drawn = self._move(starts, goals)
            close = self._close_pairs(drawn, known_m)
            if not close:
                return drawn, next((str(issue) for issue in find_issues(drawn)), "")
            # Goals stay together, so only the start of a pair with a goal is drawn again.
            lying = (pair[:2] if pair[2] == "start" else pair[:1] for pair in close)
            for name in dict.fromkeys(self._carrier(part) for parts in lying for part in parts):
                if name in starts:
                    starts[name] = self._draw_shift(self.family.start_shift_m)
        part, other, where = close[0]
        at = "lies" if where == "start" else "belongs"
        return drawn, f"{part!r} lies too close to where {other!r} {at}."

    def _draw_shift(self, most_m: float) -> _Shift:
        x_m, y_m = self.generator.uniform(-most_m, most_m, 2).tolist()
        return round(x_m, _DECIMALS), round(y_m, _DECIMALS)

    def _move(self, starts: Mapping[str, _Shift], goals: _Shift) -> AssemblyConfig:
        parts, screws = {}, {}
        for name, part in self.config.parts.items():
            changes: dict[str, Any] = {"goal_m": _add(part.goal_m, goals)}
            if part.start_m is not None:
                # A part on another part moves with it.
                changes["start_m"] = _add(part.start_m, starts[self._carrier(name)])
            parts[name] = part.model_copy(update=changes)
        for name, screw in self.config.screws.items():
            screws[name] = screw.model_copy(update={"hole_m": _add(screw.hole_m, goals)})
        return self.config.model_copy(update={"parts": parts, "screws": screws})

    def _close_pairs(
        self, drawn: AssemblyConfig, known_m: _Distances
    ) -> list[tuple[str, str, str]]:
        return [
            pair
            for pair, distance_m in measure_distances_m(drawn).items()
            if distance_m < min(self.family.gap_m, known_m[pair]) - _ROUNDING_M
        ]

    def _carrier(self, name: str) -> str:
        """Return the lowest part that carries a body at the start, or the body itself."""
        while name in self.config.parts and (beneath := find_bearers(self.config, name)):
            name = beneath[0]
        return name


def _add(place_m: list[float], shift_m: _Shift) -> list[float]:
    # Rounded to a nanometre, which keeps sums of short decimals short.
    moved = [round(a + b, 9) for a, b in zip(place_m, shift_m, strict=False)]
    return [*moved, *place_m[2:]]
