"""Option values on the command line, such as ``0.8:0.999:12``, ``0.01,0.1``, ``1:9:log``, ``*``."""

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
from skillplan.records.sweep.plan import Axis, Choice, Dimension, Span, Value, count_multiples

_MOST_VALUES = 1_000
ALL = "*"


@dataclass(frozen=True, slots=True)
class SolverValues:
    """Values of a solver's options for a design.

    Parameters
    ----------
    axes
        The options that vary.
    centre
        Their values while another option varies.
    fixed
        The other options.
    """

    axes: tuple[Axis, ...]
    centre: Mapping[str, Value]
    fixed: Mapping[str, Value]


def read_values(solver: str, given: list[tuple[str, str]]) -> SolverValues:
    """Read the axes, the centre and the fixed options of a solver.

    ``a:b:n`` is n evenly spaced values from a to b, ``a:b:n:log`` n values with evenly spaced
    logarithms; integer options get the nearest integers. ``a,b,c`` lists values. Text options are
    not split, because a comma may belong to them. A single value given next to several ones is the
    centre; the default centre is the option's default.

    Parameters
    ----------
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
        values = parse_list(solver, plugin, name, text)
        add_values(name, text, values, several if values is not None else single)
    around = check_options(solver, plugin, single, "")
    axes = []
    for name, values in several.items():
        known = check_values(solver, plugin, single, name, values)
        axes.append(Axis(name, known))
    return SolverValues(
        tuple(axes),
        {axis.option: around[axis.option] for axis in axes},
        {name: around[name] for name in single if name not in several},
    )


def add_values(name: str, text: str, values: Any, kept: dict[str, Any]) -> None:
    """Store the values of an option, or its text without values, once.

    Raises
    ------
    OptionError
        If the option is stored already.
    """
    if name in kept:
        raise OptionError(f"Option {name!r} is given twice: {text!r} is one too many.")
    kept[name] = text if values is None else values


def parse_list(
    solver: str, plugin: type[Any], name: str, text: str
) -> tuple[float | int | str, ...] | None:
    """Parse a list or range of values; return None for a single value.

    Raises
    ------
    OptionError
        If the option is unknown, or the text has the wrong form.
    """
    options: type[BaseModel] = plugin.Options
    if name not in options.model_fields:
        registry.make_options("solver", solver, plugin, {name: text})  # raises
    types = get_allowed_types(options.model_fields[name].annotation)
    numeric = bool(types & {int, float})
    if str in types and not numeric:
        return None
    if numeric and ":" in text:
        values = space_evenly(name, text)
        step = get_multiple(options.model_fields[name])
        if step is not None:
            low, high = narrow_ends(name, text, step, min(values), max(values))
            values = tuple(min(max(count_multiples(value, step)[1], low), high) for value in values)
        if float not in types:
            return tuple(dict.fromkeys(round(value) for value in values))
        return tuple(dict.fromkeys(values))
    if "," not in text:
        return None
    entries = [entry.strip() for entry in text.split(",")]
    if not all(entries):
        raise OptionError(f"Option {name}={text}: a value of the list is missing.")
    if len(entries) > _MOST_VALUES:
        raise OptionError(f"Option {name}: lists more than {_MOST_VALUES:,} values.")
    return tuple(dict.fromkeys(entries))


def get_multiple(field: FieldInfo) -> float | None:
    """Return the number that values of an option are multiples of; None without such a rule."""
    step: float | None = _find_limit(field, "multiple_of")
    return step


def _find_limit(field: FieldInfo, name: str) -> Any:
    """Return a limit of an option such as ``ge``; None if it has none."""
    # The limits of an option that may be null belong to one of its forms.
    forms = [form for form in get_args(field.annotation) if get_origin(form) is Annotated]
    entries = [*field.metadata, *(entry for form in forms for entry in get_args(form)[1:])]
    for entry in entries:
        for limit in entry.metadata if isinstance(entry, FieldInfo) else [entry]:
            value = getattr(limit, name, None)
            if value is not None:
                return value
    return None


def narrow_ends(
    name: str, text: str, multiple_of: float, low: float, high: float
) -> tuple[float, float]:
    """Return the lowest and highest multiple between two ends.

    Raises
    ------
    OptionError
        If there are fewer than two.
    """
    first = count_multiples(math.ceil(low / multiple_of) * multiple_of, multiple_of)[1]
    last = count_multiples(math.floor(high / multiple_of) * multiple_of, multiple_of)[1]
    if first < last:
        return first, last
    raise OptionError(
        f"Option {name}={text}: {name} must be a multiple of {multiple_of:g}, and the range has "
        f"{'none' if first > last else f'only one, {first:g}'}. Take a wider range."
    )


def get_allowed_types(annotation: Any) -> set[Any]:
    """Return the types that an annotation allows, without constraints."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return get_allowed_types(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return {kind for get_arg in get_args(annotation) for kind in get_allowed_types(get_arg)}
    return {origin or annotation}


def space_evenly(name: str, text: str) -> tuple[float, ...]:
    """Return the values of ``a:b:n`` or ``a:b:n:log``.

    Raises
    ------
    OptionError
        If the text has another form, or a number is out of range.
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


def check_values(
    solver: str, plugin: type[Any], single: Mapping[str, Any], name: str, values: Sequence[Any]
) -> tuple[Value, ...]:
    """Return distinct values of an option as JSON values, each checked with the single ones.

    Raises
    ------
    OptionError
        If a value is wrong.
    """
    known = [
        check_options(solver, plugin, {**single, name: value}, f"{name}={value}")[name]
        for value in values
    ]
    return tuple({json.dumps(value): value for value in known}.values())


def check_options(
    solver: str, plugin: type[Any], values: Mapping[str, Any], entry: str
) -> dict[str, Any]:
    """Return all options of a solver as JSON values.

    Raises
    ------
    OptionError
        If a value is wrong.
    """
    model_dump = registry.make_options("solver", solver, plugin, values).model_dump(mode="json")
    for name in values:
        if isinstance(model_dump[name], float) and not math.isfinite(model_dump[name]):
            raise OptionError(f"Option {entry or name}: must be a finite number.")
    return model_dump


@dataclass(frozen=True, slots=True)
class OptionSpace:
    """Ranges of a solver's options for a sampler.

    Parameters
    ----------
    dimensions
        The options that vary, at least one.
    centre
        Their values in the first trial, if allowed.
    fixed
        The other options.
    """

    dimensions: tuple[Dimension, ...]
    centre: Mapping[str, Value]
    fixed: Mapping[str, Value]


def read_space(solver: str, given: Sequence[tuple[str, str]]) -> OptionSpace:
    """Read the ranges of a solver's options.

    ``a:b`` is the range from a to b, ``a:b:log`` on a logarithmic scale; ``a:b:n``, ``a:b:n:log``
    and ``a,b,c`` are the values of `read_values`; ``*`` is everything that the option allows. A
    single value holds in all trials. Given next to several values, it is the first to try.

    Parameters
    ----------
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
            registry.make_options("solver", solver, plugin, {name: text})  # raises
        values = _parse_span(plugin, name, text) or parse_list(solver, plugin, name, text)
        add_values(name, text, values, several if values is not None else single)
    if not several:
        raise OptionError(
            f"A sampler needs options of {solver} that vary, as -O gamma=0.8:0.999, "
            "-O alpha=0.001:1:log, -O policy=a,b or -O KEY='*' for all values that it allows."
        )
    around = check_options(solver, plugin, single, "")
    dimensions: list[Dimension] = []
    for name, values in several.items():
        ends = (values.low, values.high) if isinstance(values, Span) else _values_of(values)
        known = check_values(solver, plugin, single, name, ends)
        if isinstance(values, Span):
            dimensions.append(values)
        elif len(known) < 2:
            raise OptionError(f"Option {name}: is one value only; name it as {name}={known[0]}.")
        else:
            dimensions.append(Choice(name, known, ordered=_is_ascending(known)))
    return OptionSpace(
        tuple(dimensions),
        {name: around[name] for name in several},
        {name: around[name] for name in single if name not in several},
    )


def _values_of(values: Dimension | tuple[Any, ...]) -> tuple[Any, ...]:
    return values.values if isinstance(values, Choice) else tuple(values)  # type: ignore[arg-type]


def _is_ascending(values: Sequence[Value]) -> bool:
    """Return True for numbers in ascending order."""
    numbers = [
        value for value in values if isinstance(value, int | float) and not isinstance(value, bool)
    ]
    return len(numbers) == len(values) and sorted(numbers) == numbers


def _parse_span(plugin: type[Any], name: str, text: str) -> Dimension | None:
    """Parse ``a:b``, ``a:b:log`` or ``*``; return None for another form."""
    options: type[BaseModel] = plugin.Options
    field = options.model_fields[name]
    types = get_allowed_types(field.annotation)
    if text.strip() == ALL:
        return _allow_all(name, field)
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
    return _make_span(field, name, text, low, high, logarithmic=logarithmic)


def _make_span(
    field: FieldInfo, name: str, text: str, low: float, high: float, *, logarithmic: bool = False
) -> Span:
    """Return the values of an option between two ends, if need be only multiples."""
    whole, step = float not in get_allowed_types(field.annotation), get_multiple(field)
    if step is not None:
        low, high = narrow_ends(name, text, step, low, high)
    return Span(name, low, high, whole, logarithmic, step)


def _allow_all(name: str, field: FieldInfo) -> Dimension:
    """Return all values that an option allows."""
    types = get_allowed_types(field.annotation)
    for form in (field.annotation, *get_args(field.annotation)):
        # An option that may be null has several forms.
        if get_origin(form) is Literal:
            return Choice(name, tuple(get_args(form)))
    if types - {type(None)} == {bool}:
        return Choice(name, (False, True))
    low, high = _find_limit(field, "ge"), _find_limit(field, "le")
    if not types & {int, float} or low is None or high is None:
        raise OptionError(
            f"Option {name}={ALL}: the values of the option have no two ends. Name "
            f"them, as {name}=LOW:HIGH, or values, as {name}=A,B."
        )
    return _make_span(field, name, ALL, low, high)
