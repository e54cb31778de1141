"""Options of `skillplan import-cad`, validated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from skillplan.errors import OptionError, name_hint
from skillplan.robots.catalogue import ARMS
from skillplan_cad.build_relation import Threads
from skillplan_cad.importing.materials import parse_material
from skillplan_cad.joints.directions import Source
from skillplan_cad.joints.fasteners_of import FastenerOptions
from skillplan_cad.joints.fits import FitOptions
from skillplan_cad.reading.mesh_folder import resolve_unit_m
from skillplan_cad.reading.product_reader import STEEL_KG_M3, ReadOptions, fits_pattern
from skillplan_cad.writing.arm_choice import AUTO_ARM

_LEAST_MM, _MOST_MM = 0.001, 10.0


@dataclass(frozen=True, slots=True)
class ImportSettings:
    """Options of an import.

    Parameters
    ----------
    unit
        Unit of meshes; of STEP, a unit in place of the stated one; None for that.
    tolerance_mm
        Lateral tolerance: smallest radius of a disc that counts as blocked.
    chord_mm
        Greatest distance of triangles from curved faces of STEP; None for half the tolerance.
    up
        Axis of the file that points up; ``auto`` for z, or the axis that supports more parts.
    base
        Part that the others are put on; None to choose one.
    threads
        Treatment of threads: screws turn out, block as drawn, or never block.
    split_bodies
        True to make each body a part.
    thickness_mm
        Thickness of open surfaces; None for the mass of their boxes.
    leave_out, only, as_one
        Patterns of part names: parts left out, the only ones read, and those joined to one.
    uniting
        True to join the parts of bought-in units, and to split parts that close others in.
    units, split_parts
        Names of the parts of these units, and of the parts that are split.
    fit_allowance_mm
        Greatest depth of an overlap that is a fit, on each side; None for ISO 286.
    press_fit
        Pairs of patterns of part names, as ``A,B``, that are fits of any depth.
    fastener, not_fastener
        Patterns of names of parts that are screws, nuts, washers or pins, and that are none.
    density_kg_m3
        Density of the parts without a material, 1 to 30,000.
    material
        Materials of parts, as ``PATTERN=MATERIAL``.
    nests
        True to cut a nest for each orientation of the plan.
    nesting
        True if the base of the task may stand in a nest.
    holding
        True if parts that do not stay where they are put may be held by supports of their own.
    turning
        True if a workholder may turn the product.
    keep
        True to cache stages on disk.
    """

    unit: str | None = None
    tolerance_mm: float = 0.1
    chord_mm: float | None = None
    up: str = "auto"
    base: str | None = None
    robot: str = AUTO_ARM
    directions: Source = "cylinders"
    threads: Threads = "unscrew"
    split_bodies: bool = False
    thickness_mm: float | None = None
    leave_out: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    as_one: tuple[str, ...] = ()
    uniting: bool = True
    units: tuple[tuple[str, ...], ...] = ()
    split_parts: tuple[str, ...] = ()
    fit_allowance_mm: float | None = None
    press_fit: tuple[str, ...] = ()
    fastener: tuple[str, ...] = ()
    not_fastener: tuple[str, ...] = ()
    density_kg_m3: float = STEEL_KG_M3
    material: tuple[str, ...] = ()
    nests: bool = False
    nesting: bool = True
    jobs: int = 1
    holding: bool = True
    turning: bool = True
    keep: bool = True

    def __post_init__(self) -> None:
        if self.unit is not None:
            resolve_unit_m(self.unit)
        for option, value in (
            ("--tolerance", self.tolerance_mm),
            ("--chord", self.chord_mm),
            ("--thickness", self.thickness_mm),
            ("--fit-allowance", self.fit_allowance_mm),
        ):
            if value is not None and not _LEAST_MM <= value <= _MOST_MM:
                raise OptionError(
                    f"{option} {value:g}: must be from {_LEAST_MM} to {_MOST_MM:g} mm."
                )
        for pair, sides in zip(self.press_fit, self.press_fit_sides, strict=True):
            if len(sides) != 2:
                raise OptionError(f"--press-fit {pair}: give two part names, as A,B.")
        if self.robot not in (arms := (AUTO_ARM, *ARMS)):
            raise OptionError(
                f"--robot {self.robot}: must be one of {', '.join(arms)}. "
                f"{name_hint(self.robot, arms)}"
            )
        for material in self.material:
            parse_material(material)
        if not 1 <= self.density_kg_m3 <= 30000:
            raise OptionError(
                f"--density {self.density_kg_m3:g}: must be from 1 to 30000 kg/m3; steel has "
                f"{STEEL_KG_M3:g}."
            )

    @property
    def press_fit_sides(self) -> list[list[str]]:
        """Name patterns of both sides of each press fit."""
        return [
            [side.strip() for side in pair.split(",") if side.strip()] for pair in self.press_fit
        ]

    def resolve_fits(self, names: Sequence[str]) -> FitOptions:
        """Return the options of fits for the parts of a product.

        Raises
        ------
        OptionError
            If a pair names a part that is missing.
        """
        pairs: list[tuple[str, str]] = []
        for patterns in self.press_fit_sides:
            sides = []
            for pattern in patterns:
                sides.append([name for name in names if fits_pattern(name, pattern)])
                if not sides[-1]:
                    raise OptionError(
                        f"--press-fit {','.join(patterns)}: there is no part {pattern}. "
                        f"{name_hint(pattern, names)}"
                    )
            pairs += [(first, second) for first, second in product(*sides) if first != second]
        allowance = self.fit_allowance_mm
        return FitOptions(None if allowance is None else allowance / 1000, tuple(pairs))

    def resolve_fasteners(self, names: Sequence[str]) -> FastenerOptions:
        """Return the parts that are declared as fasteners, and as none.

        Raises
        ------
        OptionError
            If a pattern fits no part, or a part fits patterns of both options.
        """
        chosen: dict[str, list[str]] = {}
        for option, patterns in (
            ("--fastener", self.fastener),
            ("--not-fastener", self.not_fastener),
        ):
            chosen[option] = []
            for pattern in patterns:
                fitting = [name for name in names if fits_pattern(name, pattern)]
                if not fitting:
                    raise OptionError(
                        f"{option} {pattern}: no part has such a name. {name_hint(pattern, names)}"
                    )
                chosen[option] += fitting
        fasteners, others = (tuple(dict.fromkeys(parts)) for parts in chosen.values())
        both = [name for name in fasteners if name in others]
        if both:
            raise OptionError(
                f"{both[0]} is named by --fastener and by --not-fastener. Drop one of them."
            )
        return FastenerOptions(fasteners, others)

    @property
    def reading(self) -> ReadOptions:
        """Options of the reader."""
        chord = self.chord_mm if self.chord_mm is not None else self.tolerance_mm / 2
        return ReadOptions(
            self.unit,
            chord / 1000,
            self.split_bodies,
            None if self.thickness_mm is None else self.thickness_mm / 1000,
            self.leave_out,
            self.only,
            self.as_one,
            self.units,
            self.split_parts,
        )


def parse_settings(given: dict[str, Any]) -> ImportSettings:
    """Return settings from command-line options; None keeps a default.

    Raises
    ------
    OptionError
        If a value is out of range, or an option is unknown.
    """
    known = ImportSettings.__dataclass_fields__
    for name in given:
        if name not in known:
            raise OptionError(f"import-cad has no option {name!r}. {name_hint(name, known)}")
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in given.items()
        if value is not None
    }
    return ImportSettings(**values)
