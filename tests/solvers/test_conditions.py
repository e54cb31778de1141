"""What actions ask for, learned as conjunctions of literals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.solvers import Conditions, Words

BITS = 12
ASKED = st.sets(st.integers(0, 2 * BITS - 1), max_size=4)
OBSERVATIONS = st.lists(st.integers(0, 2**BITS - 1), min_size=1, max_size=40)


def literals(bits: int) -> Words:
    """Return what holds: bits that are set, and in a second word those that are not."""
    return np.array([bits, ~bits & (2**64 - 1)], dtype=np.uint64)


def holds(queries: set[int], bits: int) -> bool:
    """Whether all literals asked for hold."""
    return all(
        bool(bits >> query & 1) if query < BITS else not bits >> query - BITS & 1
        for query in queries
    )


def learned(queries: set[int], observations: list[int]) -> Conditions:
    """Return what is known of an action that was tried where all this was observed."""
    known = Conditions(1, 2)
    for bits in observations:
        if holds(queries, bits):
            known.succeed(np.array([0]), literals(bits))
        else:
            known.fail(0, literals(bits))
    return known


@given(asked=ASKED, observations=OBSERVATIONS, other=st.integers(0, 2**BITS - 1))
def test_an_action_that_is_refuted_fails(asked, observations, other):
    """Whatever was seen: where the action is known to fail, what it asks for does not hold."""
    if learned(asked, observations).refutes(0, literals(other)):
        assert not holds(asked, other)


@given(asked=ASKED, observations=OBSERVATIONS, other=st.integers(0, 2**BITS - 1))
def test_an_action_that_is_sure_succeeds(asked, observations, other):
    """Where all holds that held at every success, what it asks for does, too."""
    known = learned(asked, observations)
    if known.succeeded[0] and not (known.compile().sure[0] & ~literals(other)).any():
        assert holds(asked, other)


@given(asked=ASKED, observations=OBSERVATIONS)
def test_what_was_seen_to_fail_is_refuted(asked, observations):
    known = learned(asked, observations)
    for bits in observations:
        assert known.refutes(0, literals(bits)) != holds(asked, bits)


def test_without_a_conjunction_only_what_was_seen_to_fail_is_refuted():
    """An action that succeeds with either of two bits, and fails without both."""
    known = Conditions(1, 2)
    known.succeed(np.array([0]), literals(0b01))
    known.succeed(np.array([0]), literals(0b10))
    known.fail(0, literals(0b00))
    assert known.refutes(0, literals(0b00))
    assert not known.refutes(0, literals(0b100))


def test_the_failure_of_one_literal_names_it():
    known = Conditions(1, 2)
    known.succeed(np.array([0]), literals(0b011))
    known.fail(0, literals(0b010))
    assert known.needed[0].tolist() == [0b001, 0]


def test_it_goes_on_from_what_was_kept():
    known = learned({0, 3, BITS + 5}, [0b1001, 0b1000, 0b101001, 0b1, 0b11])
    twin = Conditions(1, 2)
    twin.read("one", known.arrays("one"))
    for bits in range(64):
        assert known.refutes(0, literals(bits)) == twin.refutes(0, literals(bits))


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"one\.held"):
        Conditions(2, 2).read("one", Conditions(1, 2).arrays("one") | {"one.succeeded": np.ones(2)})
