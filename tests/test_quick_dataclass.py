"""`skillplan.quick_dataclass` makes what the standard library makes, sooner."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import field
from typing import Any

import pytest

from skillplan import quick_dataclass

# Type checkers take both for the same, and so can this module only at run time.
quick: Any = vars(quick_dataclass)["dataclass"]
standard: Any = dataclasses.dataclass
BOARD = "configs/inverter_board.yaml"


def _plain(name: str = "") -> type[Any]:
    class Part:
        """A part."""

        name: str
        mass_kg: float = 0.5
        at_m: tuple[float, ...] = (0.0, 0.0)

    return Part


def _full(name: str = "") -> type[Any]:
    class Station:
        """Everything that our dataclasses ask for."""

        name: str
        parts: list[str] = field(default_factory=list)
        note: str = field(default="", compare=False, repr=False)
        key: int = field(default=3, hash=False)
        _index: dict[str, int] = field(init=False, repr=False, compare=False)
        log: list[str] = field(init=False, default_factory=list, compare=False)

        def __post_init__(self) -> None:
            if not self.name:
                raise ValueError("A station needs a name.")
            object.__setattr__(self, "_index", {n: i for i, n in enumerate(self.parts)})

    return Station


def _single(name: str = "") -> type[Any]:
    class Angle:
        """One field, and equality and words of its own."""

        rad: float

        def __eq__(self, other: object) -> bool:
            return isinstance(other, type(self)) and abs(self.rad - other.rad) < 1e-6

        def __repr__(self) -> str:
            return f"{self.rad} rad"

    return Angle


def _empty(name: str = "") -> type[Any]:
    class Nothing:
        """No field."""

    return Nothing


def _hashed(name: str = "") -> type[Any]:
    class Ticket:
        """A hash of its own."""

        number: int

        def __hash__(self) -> int:
            return 7

    return Ticket


CLASSES: list[tuple[Callable[..., type[Any]], tuple[Any, ...]]] = [
    (_plain, ("pcb", 0.2)),
    (_full, ("tray", ["pcb", "clock"], "left", 4)),
    (_single, (0.25,)),
    (_empty, ()),
    (_hashed, (12,)),
]


@pytest.fixture(params=[False, True], ids=["dict", "slots"])
def slots(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture(params=CLASSES, ids=lambda one: one[0].__name__)
def pair(request: pytest.FixtureRequest, slots: bool) -> tuple[Any, Any, tuple[Any, ...]]:
    """A class of ours, the same of the standard library's, and what to call both with."""
    make, values = request.param
    both = [one(frozen=True, slots=slots)(make()) for one in (quick, standard)]
    return both[0], both[1], values


class TestIsTheStandardLibrarys:
    def test_in_words(self, pair: tuple[Any, Any, tuple[Any, ...]]) -> None:
        ours, theirs, values = pair
        assert repr(theirs(*values)) == repr(ours(*values))

    def test_in_its_signature(self, pair: tuple[Any, Any, tuple[Any, ...]]) -> None:
        """Down to names, annotations and defaults."""
        ours, theirs, _ = pair
        seen, meant = (inspect.signature(one) for one in (ours, theirs))
        assert list(meant.parameters) == list(seen.parameters)
        for name, parameter in meant.parameters.items():
            assert parameter.annotation == seen.parameters[name].annotation
            assert parameter.kind == seen.parameters[name].kind
            has_one = parameter.default is not parameter.empty
            assert has_one == (seen.parameters[name].default is not parameter.empty)
        assert ours.__match_args__ == theirs.__match_args__

    def test_in_its_fields(self, pair: tuple[Any, Any, tuple[Any, ...]]) -> None:
        ours, theirs, values = pair
        assert [repr(one) for one in dataclasses.fields(theirs)] == [
            repr(one) for one in dataclasses.fields(ours)
        ]
        names = [one.name for one in dataclasses.fields(ours)]
        seen, meant = (one(*values) for one in (ours, theirs))
        assert [getattr(meant, name) for name in names] == [getattr(seen, name) for name in names]
        assert hasattr(meant, "__dict__") == hasattr(seen, "__dict__")

    def test_in_equality_and_hash(self, pair: tuple[Any, Any, tuple[Any, ...]]) -> None:
        ours, theirs, values = pair
        one, same = ours(*values), ours(*values)
        assert one == same
        assert one != theirs(*values)
        try:
            meant: Any = hash(theirs(*values))
        except TypeError as error:
            with pytest.raises(TypeError, match=str(error)):
                hash(one)
        else:
            assert meant == hash(one) == hash(same)

    def test_in_being_frozen(self, pair: tuple[Any, Any, tuple[Any, ...]]) -> None:
        """No field can be set or deleted, in the same words, and nothing else either."""
        ours, theirs, values = pair
        ways: list[Callable[[Any, str], None]] = [lambda one, n: setattr(one, n, 1), delattr]
        for change in ways:
            for name in (one.name for one in dataclasses.fields(ours)):
                with pytest.raises(dataclasses.FrozenInstanceError) as meant:
                    change(theirs(*values), name)
                with pytest.raises(dataclasses.FrozenInstanceError, match=str(meant.value)):
                    change(ours(*values), name)
            with pytest.raises(dataclasses.FrozenInstanceError, match="field 'other'"):
                change(ours(*values), "other")

    def test_in_replacement_and_copies(self, pair: tuple[Any, Any, tuple[Any, ...]]) -> None:
        ours, _, values = pair
        one = ours(*values)
        assert one == copy.copy(one) == copy.deepcopy(one) == dataclasses.replace(one)
        assert ours is type(dataclasses.replace(one))


@quick(frozen=True, slots=True)
class Sent:
    """Sent to another process."""

    name: str
    limits: tuple[float, float] = (0.0, 1.0)


@quick(frozen=True)
class Base:
    """A dataclass that another inherits from."""

    name: str


def test_it_is_pickled() -> None:
    made: Any = Sent
    sent = made("arm", (0.0, 2.0))
    assert sent == pickle.loads(pickle.dumps(sent))


@pytest.mark.parametrize("maker", [quick, standard], ids=["ours", "the standard library's"])
def test_a_frozen_dataclass_of_either_make_inherits_from_it(maker: Any) -> None:
    @maker(frozen=True)
    class Own(Base):
        """With one more field."""

        size: int = 1

    made: Any = Own
    assert ("arm", 2) == (made("arm", 2).name, made("arm", 2).size)
    with pytest.raises(dataclasses.FrozenInstanceError):
        made("arm").name = "leg"


@pytest.mark.parametrize("maker", [quick, standard], ids=["ours", "the standard library's"])
def test_one_without_equality_is_the_same_only_as_itself(maker: Any, slots: bool) -> None:
    made = maker(frozen=True, eq=False, slots=slots)(_plain())
    one = made("pcb")
    assert one != made("pcb")
    assert {one} == {one, one}


def test_each_instance_has_a_default_of_its_own() -> None:
    made = quick(frozen=True, slots=True)(_full())
    assert made("a").parts is not made("b").parts


def test_a_check_after_the_fields_are_set_refuses() -> None:
    made = quick(frozen=True, slots=True)(_full())
    with pytest.raises(ValueError, match="needs a name"):
        made("")


def test_a_missing_value_is_named() -> None:
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'name'"):
        Sent()


def test_what_is_not_frozen_is_left_to_the_standard_library() -> None:
    made = quick(_plain())
    one = made("pcb")
    one.mass_kg = 2.0
    assert made("pcb", 2.0) == one


def test_the_board_is_checked_and_solved_without_the_slow_ones() -> None:
    """No dataclass that the shortest commands load comes from the standard library directly."""
    code = f"""
import contextlib, dataclasses, io, sys
from skillplan.cli.app import run
with contextlib.redirect_stdout(io.StringIO()):
    assert [0, 0] == [run([word, {BOARD!r}]) for word in ("check", "search-optimal")]
own = [m for name, m in sys.modules.items() if name.partition(".")[0] == "skillplan"]
print(*sorted(m.__name__ for m in own if vars(m).get("dataclass") is dataclasses.dataclass))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert [] == done.stdout.split()
