"""Facts and the states made of them.

A task names its facts once, in a :class:`Facts` vocabulary. A :class:`State` is the set of facts
that hold, stored as the bits of one integer.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from skillplan.errors import OptionError, name_hint

AND: Final = " & "
"""Separator of the facts of a conjunction, such as ``placed(cover) & turned(flip.down)``."""


@dataclass(frozen=True)
class Facts:
    """The vocabulary of a task: a name and a bit for every fact.

    Parameters
    ----------
    names
        Distinct names; the i-th fact is bit ``1 << i``.
    exclusive
        Groups of facts that exclude each other, such as the places of an arm. Solvers derive bounds
        from them.
    """

    names: tuple[str, ...]
    exclusive: tuple[tuple[str, ...], ...] = ()
    _bits: dict[str, int] = field(init=False, repr=False, compare=False)
    _masks: dict[str, int] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        bits = {name: 1 << i for i, name in enumerate(self.names)}
        if len(bits) != len(self.names):
            twice = sorted({name for name in self.names if self.names.count(name) > 1})
            raise ValueError(f"Facts named twice: {', '.join(twice)}.")
        for name in (name for group in self.exclusive for name in group):
            if name not in bits:
                raise ValueError(f"Unknown fact {name!r} in an exclusive group.")
        object.__setattr__(self, "_bits", bits)

    def __contains__(self, name: object) -> bool:
        return name in self._bits

    def __len__(self) -> int:
        return len(self.names)

    def bit(self, name: str) -> int:
        """Return the bit of one fact, or the bits of a conjunction ``A & B``.

        Raises
        ------
        OptionError
            If the fact is unknown; the message suggests the nearest name.
        """
        try:
            return self._bits[name]
        except KeyError:
            return self._mask(name)

    def _mask(self, name: str) -> int:
        """Return the bits of a conjunction; raises as `bit`."""
        if name in self._masks:
            return self._masks[name]
        terms = name.split(AND)
        if len(terms) == 1:
            hint = name_hint(name, self.names)
            raise OptionError(f"Unknown fact {name!r}. {hint}") from None
        mask = 0
        for term in terms:
            mask |= self.bit(term)
        self._masks[name] = mask
        return mask

    def of(self, *names: str) -> State:
        """Return the state in which exactly the named facts hold."""
        bits = 0
        for name in names:
            bits |= self.bit(name)
        return State(bits, self)

    def state(self, bits: int) -> State:
        """Return the state with the given bits."""
        return State(bits, self)

    @property
    def none(self) -> State:
        """The state in which no fact holds."""
        return State(0, self)

    @property
    def all_bits(self) -> int:
        """The bits of every fact."""
        return (1 << len(self.names)) - 1

    def names_of(self, bits: int) -> list[str]:
        """Return the names of the facts in `bits`, in the order of the vocabulary."""
        names = []
        while bits:
            low = bits & -bits
            names.append(self.names[low.bit_length() - 1])
            bits ^= low
        return names


# The second largest prime below 2 ** 61; Python itself uses the largest.
_PRIME = 2_305_843_009_213_693_921


class State:
    """The symbolic situation: the set of the facts that hold.

    Hashable and immutable. It also represents any other set of facts, such as the effects of an
    outcome.

    Parameters
    ----------
    bits
        Bit i is set if fact i of `facts` holds.

    Examples
    --------
    >>> facts = Facts(("held(a)", "placed(a)"))
    >>> print(facts.of("placed(a)"))
    {placed(a)}
    """

    __slots__ = ("bits", "facts")

    bits: int
    facts: Facts

    def __init__(self, bits: int, facts: Facts) -> None:
        if bits < 0 or bits >> len(facts.names):
            raise ValueError(f"State bits {bits:#x} lie outside the {len(facts)} facts.")
        # Twice as fast as `object.__setattr__`; searches make millions of states.
        _set_bits(self, bits)
        _set_facts(self, facts)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"State is immutable; cannot set {name!r}.")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"State is immutable; cannot delete {name!r}.")

    def __reduce__(self) -> tuple[type[State], tuple[int, Facts]]:
        return State, (self.bits, self.facts)

    def __hash__(self) -> int:
        # Python hashes integers modulo 2 ** 61 - 1, which maps all powers of two to 61 hashes.
        return self.bits % _PRIME

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, State):
            return NotImplemented
        return self.bits == other.bits and (
            self.facts is other.facts or self.facts.names == other.facts.names
        )

    def __contains__(self, fact: str) -> bool:
        mask = self.facts.bit(fact)
        return self.bits & mask == mask

    def __iter__(self) -> Iterator[str]:
        return iter(self.facts.names_of(self.bits))

    def __len__(self) -> int:
        return self.bits.bit_count()

    def __str__(self) -> str:
        return "{" + ", ".join(self) + "}"

    def __repr__(self) -> str:
        return f"State({self})"

    def __or__(self, other: State) -> State:
        return State(self.bits | other.bits, self.facts)

    def __and__(self, other: State) -> State:
        return State(self.bits & other.bits, self.facts)

    def __sub__(self, other: State) -> State:
        return State(self.bits & ~other.bits, self.facts)

    def find_missing(self, *facts: str) -> State:
        """Return the facts that do not hold; of a conjunction, one of them."""
        bits = 0
        for fact in facts:
            missing = self.facts.bit(fact) & ~self.bits
            bits |= missing & -missing
        return State(bits, self.facts)

    def complement(self) -> State:
        """Return the set of facts that do not hold."""
        return State(self.facts.all_bits & ~self.bits, self.facts)


_set_bits = vars(State)["bits"].__set__
_set_facts = vars(State)["facts"].__set__


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition on states: required facts hold, and forbidden facts do not."""

    requires: State
    forbids: State

    def __post_init__(self) -> None:
        if self.requires.bits & self.forbids.bits:
            both = self.requires & self.forbids
            raise ValueError(f"Condition requires and forbids the same facts: {both}.")

    def holds(self, state: State) -> bool:
        """Return whether the condition holds in `state`."""
        bits = state.bits
        return bits & self.requires.bits == self.requires.bits and not bits & self.forbids.bits

    def why_not(self, state: State) -> list[str]:
        """Return the violated terms: missing facts by name, forbidden ones as ``not NAME``."""
        missing = self.requires - state
        forbidden = self.forbids & state
        return [*missing, *(f"not {name}" for name in forbidden)]

    def __str__(self) -> str:
        terms = [*self.requires, *(f"not {name}" for name in self.forbids)]
        return " and ".join(terms) or "always"
