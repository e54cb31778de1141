"""What options may be, as it is written for a sampler: ``0.8:0.999``, ``1e-4:1:log``, ``*``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from skillplan.errors import OptionError
from skillplan.pipeline import registry
from skillplan.records.sweep.plan import Value
from skillplan.records.sweep.space import Choice, Dimension, Span
from skillplan.sweep.parameter_values import checked, checked_values, keep, kinds, listed

ALL = "*"


@dataclass(frozen=True, slots=True)
class OptionSpace:
    """What a sampler may choose of a solver's options.

    Parameters
    ----------
    dimensions
        The options that vary, at least one.
    centre
        A value of each of them that is tried first, where it is one of those allowed.
    fixed
        The other options that were given.
    """

    dimensions: tuple[Dimension, ...]
    centre: Mapping[str, Value]
    fixed: Mapping[str, Value]


def read_space(solver: str, given: Sequence[tuple[str, str]]) -> OptionSpace:
    """Return what the options of a solver may be.

    ``a:b`` is all values from a to b, ``a:b:log`` too, with evenly drawn logarithms; ``a:b:n``,
    ``a:b:n:log`` and ``a,b,c`` are the values that `read_values` makes of them; ``*`` is all that
    the option allows. One value holds in all trials, or beside several is the first that is tried.

    Parameters
    ----------
    solver
        The solver's name.
    given
        Option and text, in order.

    Raises
    ------
    OptionError
        If an option is unknown or given twice, a value is wrong, or no option varies.
    PluginError
        If the solver is unknown or broken.
    """
    plugin = registry.load("solver", solver)
    several: dict[str, Dimension | tuple[Any, ...]] = {}
    single: dict[str, str] = {}
    for name, text in given:
        if name not in plugin.Options.model_fields:
            registry.make_options("solver", solver, plugin, {name: text})  # names what is known
        values = _span(plugin, name, text) or listed(solver, plugin, name, text)
        keep(name, text, values, several if values is not None else single)
    if not several:
        raise OptionError(
            f"A sampler needs options of {solver} that vary, as -O gamma=0.8:0.999, "
            "-O alpha=0.001:1:log, -O policy=a,b or -O KEY='*' for all that an option allows."
        )
    around = checked(solver, plugin, single, "")
    dimensions: list[Dimension] = []
    for name, values in several.items():
        ends = (values.low, values.high) if isinstance(values, Span) else _values_of(values)
        known = checked_values(solver, plugin, single, name, ends)
        if isinstance(values, Span):
            dimensions.append(values)
        elif len(known) < 2:
            raise OptionError(f"Option {name}: is one value only; name it as {name}={known[0]}.")
        else:
            dimensions.append(Choice(name, known, ordered=_ascend(known)))
    return OptionSpace(
        tuple(dimensions),
        {name: around[name] for name in several},
        {name: around[name] for name in single if name not in several},
    )


def _values_of(values: Dimension | tuple[Any, ...]) -> tuple[Any, ...]:
    return values.values if isinstance(values, Choice) else tuple(values)  # type: ignore[arg-type]


def _ascend(values: Sequence[Value]) -> bool:
    """Whether these are numbers that ascend."""
    numbers = [one for one in values if isinstance(one, int | float) and not isinstance(one, bool)]
    return len(numbers) == len(values) and sorted(numbers) == numbers


def _span(plugin: type[Any], name: str, text: str) -> Dimension | None:
    """Return what ``a:b``, ``a:b:log`` or ``*`` says; None for another form."""
    options: type[BaseModel] = plugin.Options
    field = options.model_fields[name]
    types = kinds(field.annotation)
    if text.strip() == ALL:
        return _all_of(name, field)
    parts = [part.strip() for part in text.split(":")]
    logarithmic = len(parts) == 3 and parts[2] == "log"
    if not types & {int, float} or not (len(parts) == 2 or logarithmic):
        return None
    whole = float not in types
    where = f"Option {name}={text}"
    try:
        low, high = (int(part) if whole else float(part) for part in parts[:2])
    except ValueError:
        what = "whole numbers" if whole else "numbers"
        raise OptionError(f"{where}: the ends of a range are {what}.") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise OptionError(f"{where}: a range goes from a lower to a higher finite number.")
    if logarithmic and low <= 0:
        raise OptionError(f"{where}: the ends of a logarithmic range are > 0.")
    return Span(name, low, high, whole, logarithmic)


def _all_of(name: str, field: FieldInfo) -> Dimension:
    """Return all values that an option allows.

    Raises
    ------
    OptionError
        If these have no ends.
    """
    types = kinds(field.annotation)
    for form in (field.annotation, *get_args(field.annotation)):
        # Also of an option that may be null.
        if get_origin(form) is Literal:
            return Choice(name, tuple(get_args(form)))
    if types - {type(None)} == {bool}:
        return Choice(name, (False, True))
    low = next((one.ge for one in field.metadata if hasattr(one, "ge")), None)
    high = next((one.le for one in field.metadata if hasattr(one, "le")), None)
    if not types & {int, float} or low is None or high is None:
        raise OptionError(
            f"Option {name}={ALL}: what the option allows has no two ends that belong to it. Name "
            f"them, as {name}=LOW:HIGH, or values, as {name}=A,B."
        )
    return Span(name, low, high, whole=float not in types)
