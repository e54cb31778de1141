"""Densities of materials, and the materials that options give to parts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from skillplan.errors import OptionError, name_hint
from skillplan_cad.product import Product
from skillplan_cad.reading.product_reader import STEEL_KG_M3, fits_pattern

# Metals, wood and glass: EN 1991-1-1:2002, tables A.3 to A.5, weight over g, means of ranges;
# stainless steel: EN 10088-1, 1.4301; titanium: ASTM F1472. Plastics and rubber: typical values of
# data sheets. FR4: typical laminate of IPC-4101.
DENSITIES_KG_M3: Mapping[str, float] = {
    "steel": STEEL_KG_M3,
    "stainless": 7900.0,
    "cast-iron": 7300.0,
    "aluminium": 2700.0,
    "brass": 8500.0,
    "bronze": 8600.0,
    "copper": 8900.0,
    "titanium": 4430.0,
    "zinc": 7200.0,
    "abs": 1050.0,
    "pla": 1240.0,
    "petg": 1270.0,
    "pa": 1140.0,
    "pom": 1410.0,
    "pc": 1200.0,
    "pmma": 1190.0,
    "pp": 910.0,
    "pe": 950.0,
    "pvc": 1400.0,
    "ptfe": 2170.0,
    "rubber": 1200.0,
    "fr4": 1850.0,
    "glass": 2500.0,
    "wood": 500.0,
    "plywood": 700.0,
}
"""Density of each material that `--material` names [kg/m3]."""

_LEAST_KG_M3, _MOST_KG_M3 = 1.0, 30_000.0


@dataclass(frozen=True, slots=True)
class Material:
    """The material of the parts whose names fit a pattern.

    Parameters
    ----------
    name
        Name as given, such as ``abs`` or ``1850``.
    """

    pattern: str
    name: str
    density_kg_m3: float


def parse_material(text: str) -> Material:
    """Return the material of ``PATTERN=MATERIAL``; a material is a name or a density in kg/m3.

    Raises
    ------
    OptionError
        If it has another form, an unknown name, or a density out of range.
    """
    pattern, equals, name = text.rpartition("=")
    pattern, name = pattern.strip(), name.strip().lower()
    if not (pattern and equals and name):
        raise OptionError(f"--material {text}: give a pattern and a material, as 'lid*=abs'.")
    if name in DENSITIES_KG_M3:
        return Material(pattern, name, DENSITIES_KG_M3[name])
    try:
        density_kg_m3 = float(name)
    except ValueError:
        raise OptionError(
            f"--material {text}: {name} is not one of {', '.join(DENSITIES_KG_M3)}, and no density "
            f"in kg/m3. {name_hint(name, DENSITIES_KG_M3)}".rstrip()
        ) from None
    if not (math.isfinite(density_kg_m3) and _LEAST_KG_M3 <= density_kg_m3 <= _MOST_KG_M3):
        raise OptionError(
            f"--material {text}: a density must be from {_LEAST_KG_M3:g} to {_MOST_KG_M3:g} kg/m3."
        )
    return Material(pattern, name, density_kg_m3)


def assign_materials(
    product: Product, options: Sequence[str], default_kg_m3: float
) -> tuple[Product, dict[str, str]]:
    """Return the product with densities, and the stated materials of parts by name.

    The last option that fits a part counts; parts without one get the default.

    Raises
    ------
    OptionError
        If an option is invalid or fits no part.
    """
    names = [part.name for part in product]
    stated: dict[str, Material] = {}
    for option in options:
        material = parse_material(option)
        fitting = [name for name in names if fits_pattern(name, material.pattern)]
        if not fitting:
            raise OptionError(
                f"--material {option}: no part has such a name. "
                f"{name_hint(material.pattern, names)}"
            )
        stated |= dict.fromkeys(fitting, material)
    parts = tuple(
        replace(
            part,
            density_kg_m3=stated[part.name].density_kg_m3 if part.name in stated else default_kg_m3,
        )
        for part in product
    )
    assumed = len(names) - len(stated)
    note = (
        f"masses assume {default_kg_m3:g} kg/m3"
        + (" (steel)" if default_kg_m3 == STEEL_KG_M3 else "")
        + f" for {assumed} of {len(names)} parts; --material PATTERN=MATERIAL states another"
    )
    notes = (*product.notes, note) if assumed else product.notes
    materials = {name: material.name for name, material in stated.items()}
    return replace(product, parts=parts, notes=notes), materials
