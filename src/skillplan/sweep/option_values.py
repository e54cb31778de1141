"""Values of a solver's options as they are written: ``0.8:0.999:12``, ``0.01,0.1``, ``0.5``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from skillplan.errors import OptionError
from skillplan.pipeline import registry
from skillplan.records.sweep.plan import Axis, Choice, Dimension, Span, Value

_MOST_VALUES = 1_000


@dataclass(frozen=True, slots=True)
class SolverValues:
    """Which values of a solver's options are to be tried.

    Parameters
    ----------
    axes
        The options that vary.
    centre
        A value of each of them, for while another one varies.
    fixed
        The other options that were given.
    """

    axes: tuple[Axis, ...]
    centre: Mapping[str, Value]
    fixed: Mapping[str, Value]


def read_values(solver: str, given: list[tuple[str, str]]) -> SolverValues:
    """Return the axes, the centre and the fixed options of a solver.

    ``a:b:n`` is n evenly spaced values from a to b, ``a:b:n:log`` evenly spaced logarithms;
    whole-numbered options get the nearest whole values. ``a,b,c`` lists values. Options that
    take any text are taken as they stand, for a comma may belong to them. An option given
    twice, with several values and with one, varies around the latter; otherwise the centre is
    the default.

    Parameters
    ----------
    solver
        The solver's name.
    given
        Option and text, in order.

    Raises
    ------
    OptionError
        If an option is unknown or given twice, or a value is wrong.
    PluginError
        If the solver is unknown or broken.
    """
    plugin = registry.load("solver", solver)
    several: dict[str, tuple[Any, ...]] = {}
    single: dict[str, str] = {}
    for name, text in given:
        values = listed(solver, plugin, name, text)
        keep(name, text, values, several if values is not None else single)
    around = checked(solver, plugin, single, "")
    axes = []
    for name, values in several.items():
        known = checked_values(solver, plugin, single, name, values)
        axes.append(Axis(name, known))
    return SolverValues(
        tuple(axes),
        {axis.option: around[axis.option] for axis in axes},
        {name: around[name] for name in single if name not in several},
    )


def keep(name: str, text: str, values: Any, kept: dict[str, Any]) -> None:
    """Keep what was given for an option, or the text where there are no values; but not twice.

    Raises
    ------
    OptionError
        If it is there already.
    """
    if name in kept:
        raise OptionError(f"Option {name!r} is given twice: {text!r} is one too many.")
    kept[name] = text if values is None else values


def listed(
    solver: str, plugin: type[Any], name: str, text: str
) -> tuple[float | int | str, ...] | None:
    """Return the values that a text lists, or None where it is a single one.

    Raises
    ------
    OptionError
        If the option is unknown, or the text has the wrong form.
    """
    options: type[BaseModel] = plugin.Options
    if name not in options.model_fields:
        registry.make_options("solver", solver, plugin, {name: text})  # names what is known
    types = kinds(options.model_fields[name].annotation)
    numeric = bool(types & {int, float})
    if str in types and not numeric:
        return None
    if numeric and ":" in text:
        values = spaced(name, text)
        if float not in types:
            return tuple(dict.fromkeys(round(value) for value in values))
        return values
    if "," not in text:
        return None
    entries = [entry.strip() for entry in text.split(",")]
    if not all(entries):
        raise OptionError(f"Option {name}={text}: a value of the list is missing.")
    if len(entries) > _MOST_VALUES:
        raise OptionError(f"Option {name}: lists more than {_MOST_VALUES:,} values.")
    return tuple(dict.fromkeys(entries))


def kinds(annotation: Any) -> set[Any]:
    """Return the types that an annotation allows, without what constrains them."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return kinds(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return {kind for get_arg in get_args(annotation) for kind in kinds(get_arg)}
    return {origin or annotation}


def spaced(name: str, text: str) -> tuple[float, ...]:
    """Return the values of ``a:b:n`` or ``a:b:n:log``.

    Raises
    ------
    OptionError
        If the text has another form, or describes no such values.
    """
    where = f"Option {name}={text}"
    parts = [part.strip() for part in text.split(":")]
    logarithmic = len(parts) == 4 and parts[3] == "log"
    if len(parts) != 3 and not logarithmic:
        raise OptionError(
            f"{where}: a range has the form FROM:TO:COUNT or FROM:TO:COUNT:log, as 0.8:0.999:12."
        )
    try:
        first, last = float(parts[0]), float(parts[1])
    except ValueError:
        raise OptionError(f"{where}: the ends of a range are numbers.") from None
    if not (math.isfinite(first) and math.isfinite(last)):
        raise OptionError(f"{where}: the ends of a range are finite numbers.")
    count = int(parts[2]) if parts[2].isascii() and parts[2].isdigit() and len(parts[2]) < 9 else 0
    if not 2 <= count <= _MOST_VALUES:
        raise OptionError(
            f"{where}: the count of values is a whole number from 2 to {_MOST_VALUES:,}, not "
            f"{parts[2]!r}."
        )
    if first == last:
        raise OptionError(f"{where}: the ends of a range differ; write {name}={parts[0]} for one.")
    if logarithmic and min(first, last) <= 0:
        raise OptionError(f"{where}: the ends of a logarithmic range are > 0.")
    values = []
    for i in range(count):
        part = i / (count - 1)
        value = first + (last - first) * part
        if logarithmic:
            value = math.exp(math.log(first) + (math.log(last) - math.log(first)) * part)
        values.append(float(f"{value:.10g}"))
    values[0], values[-1] = first, last
    return tuple(dict.fromkeys(values))


def checked_values(
    solver: str,
    plugin: type[Any],
    single: Mapping[str, Any],
    name: str,
    values: Sequence[Any],
) -> tuple[Value, ...]:
    """Return distinct values of an option as JSON values, beside the single ones given.

    Raises
    ------
    OptionError
        If one is wrong.
    """
    known = [
        checked(solver, plugin, {**single, name: value}, f"{name}={value}")[name]
        for value in values
    ]
    return tuple({json.dumps(value): value for value in known}.values())


def checked(
    solver: str, plugin: type[Any], values: Mapping[str, Any], entry: str
) -> dict[str, Any]:
    """Return all options of a solver as JSON values.

    Raises
    ------
    OptionError
        If one is wrong.
    """
    model_dump = registry.make_options("solver", solver, plugin, values).model_dump(mode="json")
    for name in values:
        if isinstance(model_dump[name], float) and not math.isfinite(model_dump[name]):
            raise OptionError(f"Option {entry or name}: must be a finite number.")
    return model_dump


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
    numbers = [
        value for value in values if isinstance(value, int | float) and not isinstance(value, bool)
    ]
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
