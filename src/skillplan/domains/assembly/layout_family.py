"""Layouts of a family: the same product, its starts and goals moved at random."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from skillplan.domains.assembly.consistency import issues
from skillplan.domains.assembly.geometry_faults import distances_m
from skillplan.domains.assembly.resting import bearers_at_start
from skillplan.domains.assembly.schema import AssemblyConfig, FamilyConfig
from skillplan.errors import OptionError

# How many layouts are drawn from scratch until one is faultless, and how often what lies too close
# in one of them is moved elsewhere: most draws of many parts have a pair that is too close.
_DRAWS = 100
_REPAIRS = 20
# Shifts are drawn in steps of a tenth of a millimetre, finer than anybody lays out parts.
_DECIMALS = 4
_ROUNDING_M = 1e-9

_Distances = Mapping[tuple[str, str, str], float]
_Shift = tuple[float, float]


def layouts(config: AssemblyConfig, seed: int, count: int) -> list[AssemblyConfig]:
    """Return layouts of a file's family; each is drawn again until it has no fault.

    Where parts are nearer to each other in the file than the family demands, they come no
    nearer: hand and fingers need the room, and what lies where another belongs would need
    another order than the file's chart.

    Parameters
    ----------
    config
        A faultless assembly.
    seed
        The i-th layout depends on it and i alone, >= 0.
    count
        How many, >= 1.

    Raises
    ------
    OptionError
        If the assembly has no block ``family``, or one of the layouts cannot be had.
    """
    if config.family is None:
        raise OptionError(
            f"The task {config.name!r} describes no family of layouts. Give it a block such as "
            "family: {start_shift_m: 0.03}."
        )
    known_m = distances_m(config)
    made = []
    for index in range(count):
        draw = _Draw(config, config.family, seed, index)
        fault = ""
        for _ in range(_DRAWS):
            drawn, fault = draw.layout(known_m)
            if not fault:
                made.append(drawn)
                break
        else:
            raise OptionError(
                f"The family of {config.name!r} has no faultless layout {index} with seed "
                f"{seed}, of {_DRAWS} that were drawn; the last: {fault} Lower the lengths of its "
                "block 'family'."
            )
    return made


class _Draw:
    """What is drawn for one layout: a shift of all goals, and one of every start on the table."""

    def __init__(self, config: AssemblyConfig, family: FamilyConfig, seed: int, index: int) -> None:
        # Takes numpy, which a search of the file's own layout does without.
        import numpy as np

        self.config, self.family = config, family
        self.generator = np.random.default_rng([seed, index])
        self.movable = [name for name, part in config.parts.items() if part.start_m is not None]

    def layout(self, known_m: _Distances) -> tuple[AssemblyConfig, str]:
        """Return a layout and what is wrong with it, which is nothing if it is faultless."""
        goals = self._shift(self.family.goal_shift_m)
        starts = {name: self._shift(self.family.start_shift_m) for name in self.movable}
        for _ in range(_REPAIRS):
            drawn = self._moved(starts, goals)
            close = self._too_close(drawn, known_m)
            if not close:
                return drawn, next((str(issue) for issue in issues(drawn)), "")
            # What is close to where another belongs moves by itself: goals stay together.
            lying = (pair[:2] if pair[2] == "start" else pair[:1] for pair in close)
            for name in dict.fromkeys(self._carrier(part) for parts in lying for part in parts):
                if name in starts:
                    starts[name] = self._shift(self.family.start_shift_m)
        part, other, where = close[0]
        at = "lies" if where == "start" else "belongs"
        return drawn, f"{part!r} lies too close to where {other!r} {at}."

    def _shift(self, most_m: float) -> _Shift:
        x_m, y_m = self.generator.uniform(-most_m, most_m, 2).tolist()
        return round(x_m, _DECIMALS), round(y_m, _DECIMALS)

    def _moved(self, starts: Mapping[str, _Shift], goals: _Shift) -> AssemblyConfig:
        parts, screws = {}, {}
        for name, part in self.config.parts.items():
            changes: dict[str, Any] = {"goal_m": _sum(part.goal_m, goals)}
            if part.start_m is not None:
                # What lies on another part is moved with it.
                changes["start_m"] = _sum(part.start_m, starts[self._carrier(name)])
            parts[name] = part.model_copy(update=changes)
        for name, screw in self.config.screws.items():
            screws[name] = screw.model_copy(update={"hole_m": _sum(screw.hole_m, goals)})
        return self.config.model_copy(update={"parts": parts, "screws": screws})

    def _too_close(self, drawn: AssemblyConfig, known_m: _Distances) -> list[tuple[str, str, str]]:
        return [
            pair
            for pair, apart_m in distances_m(drawn).items()
            if apart_m < min(self.family.gap_m, known_m[pair]) - _ROUNDING_M
        ]

    def _carrier(self, name: str) -> str:
        """Return the part on the table that a part lies on at the start, or itself."""
        while beneath := bearers_at_start(self.config, name):
            name = beneath[0]
        return name


def _sum(place_m: list[float], shift_m: _Shift) -> list[float]:
    # To a nanometre, so that a sum of short decimals stays one.
    moved = [round(a + b, 9) for a, b in zip(place_m, shift_m, strict=False)]
    return [*moved, *place_m[2:]]
