"""Frozen dataclasses as the standard library makes them, in a quarter of the time.

A small search makes a hundred classes before it begins. For each of them `dataclasses` compiles
some six methods one by one. Here it finds the fields and makes the slots, and ``__init__`` is
compiled; the other methods are the same for all classes and written below.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, FrozenInstanceError
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any

Fields = Sequence[Field[Any]]
Methods = dict[str, Callable[..., Any]]
Values = Callable[[Any], tuple[Any, ...]]

if TYPE_CHECKING:  # who reads types sees the standard library's
    from dataclasses import dataclass as dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, slots=False, eq=True, **others):
        """Return a class, or a decorator, as `dataclasses.dataclass`.

        It makes itself what is not frozen, has no docstring, inherits from a dataclass or asks
        for more than slots and equality. There are no pseudo-fields `InitVar`.

        Parameters
        ----------
        cls
            The class; None where the decorator is called with arguments.
        frozen, slots, eq, others
            As `dataclasses.dataclass` takes them.
        """

        def made(plain):
            inherits = any(map(dataclasses.is_dataclass, plain.__mro__[1:]))
            if frozen and plain.__doc__ and not inherits and not others:
                return _frozen(plain, slots, eq)
            return dataclasses.dataclass(plain, frozen=frozen, slots=slots, eq=eq, **others)

        return made if cls is None else made(cls)


def _frozen(plain: type[Any], slots: bool, eq: bool) -> Any:
    own = dict(vars(plain))
    made: Any = dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots)(plain)
    made.__dataclass_params__.frozen = True  # for dataclasses that inherit from it
    fields = dataclasses.fields(made)
    methods = {
        "__init__": _initializer(plain, fields, slots),
        "__repr__": _representation(fields),
        **(_comparison(fields) if eq else {}),
        **(_pickling(fields) if slots else {}),
        **_freezing(made, fields),
    }
    for name, method in methods.items():
        # None: who defines __eq__ alone has a __hash__ of None.
        if own.get(name) is None:
            method.__name__ = name
            method.__qualname__ = f"{made.__qualname__}.{name}"
            setattr(made, name, method)
    return made


def _initializer(plain: type[Any], fields: Fields, slots: bool) -> Callable[..., None]:
    """Return ``__init__``, which takes the fields by place or name and ends in __post_init__."""
    known: dict[str, Any] = {"_put": object.__setattr__, "_absent": MISSING}
    parameters, lines = ["self"], []
    for one in fields:
        name = value = one.name
        parameter = name
        if one.default is not MISSING:
            known[f"_default_{name}"] = one.default
            parameter = f"{name}=_default_{name}"
            value = name if one.init else f"_default_{name}"
        elif one.default_factory is not MISSING:
            known[f"_make_{name}"] = one.default_factory
            parameter = f"{name}=_absent"
            value = f"_make_{name}()"
            if one.init:
                value = f"{value} if {name} is _absent else {name}"
        if one.init:
            parameters.append(parameter)
        # What is neither given nor made, __post_init__ sets, or the class has it.
        if one.init or (value != name and (slots or one.default is MISSING)):
            lines.append(f"_put(self, {name!r}, {value})")
    if hasattr(plain, "__post_init__"):
        lines.append("self.__post_init__()")
    return _compiled(parameters, lines or ["pass"], known, fields, plain.__module__)


def _compiled(
    parameters: Sequence[str],
    lines: Sequence[str],
    known: Mapping[str, Any],
    fields: Fields,
    module: str,
) -> Callable[..., None]:
    text = (
        f"def make({', '.join(known)}):\n"
        f" def __init__({', '.join(parameters)}):\n"
        f"  {'; '.join(lines)}\n"
        " return __init__"
    )
    found: dict[str, Any] = {}
    exec(text, vars(sys.modules[module]), found)
    made: Callable[..., None] = found["make"](**known)
    made.__annotations__ = {one.name: one.type for one in fields if one.init}
    made.__annotations__["return"] = None
    return made


def _representation(fields: Fields) -> Callable[[Any], str]:
    names = [one.name for one in fields if one.repr]

    @recursive_repr()
    def shown(self: Any) -> str:
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{self.__class__.__qualname__}({values})"

    return shown


def _comparison(fields: Fields) -> Methods:
    compared = _values([one for one in fields if one.compare])
    hashed = _values([one for one in fields if (one.compare if one.hash is None else one.hash)])

    def equal(self: Any, other: object) -> Any:
        if other.__class__ is self.__class__:
            return compared(self) == compared(other)
        return NotImplemented

    def number(self: Any) -> int:
        return hash(hashed(self))

    return {"__eq__": equal, "__hash__": number}


def _values(fields: Fields) -> Values:
    """Return what takes the values of fields as a tuple."""
    if not fields:
        return lambda instance: ()
    taken: Any = attrgetter(*(one.name for one in fields))
    return taken if len(fields) > 1 else lambda instance: (taken(instance),)


def _pickling(fields: Fields) -> Methods:
    names = [one.name for one in fields]

    def state(self: Any) -> list[Any]:
        return [getattr(self, name) for name in names]

    def restore(self: Any, values: Sequence[Any]) -> None:
        for name, value in zip(names, values, strict=False):
            object.__setattr__(self, name, value)

    return {"__getstate__": state, "__setstate__": restore}


def _freezing(made: Any, fields: Fields) -> Methods:
    names = frozenset(one.name for one in fields)

    def refuse_change(self: Any, name: str, value: Any) -> None:
        if type(self) is made or name in names:
            raise FrozenInstanceError(f"cannot assign to field {name!r}")
        super(made, self).__setattr__(name, value)

    def refuse_removal(self: Any, name: str) -> None:
        if type(self) is made or name in names:
            raise FrozenInstanceError(f"cannot delete field {name!r}")
        super(made, self).__delattr__(name)

    return {"__setattr__": refuse_change, "__delattr__": refuse_removal}
