"""Conditions on states."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import any_state
from skillplan.task import Condition, Facts

FACTS = Facts(tuple("abcdef"))
bits = st.integers(0, FACTS.all_bits)


def test_a_condition_cannot_contradict_itself():
    """No fact is both required and forbidden."""
    with pytest.raises(ValueError, match=r"requires and forbids the same facts: \{b\}"):
        Condition(FACTS.of("a", "b"), FACTS.of("b", "c"))


@given(bits, bits, bits)
def test_it_holds_exactly_where_nothing_is_amiss(requires, forbids, here):
    """What holds and what is amiss agree, and each is what set theory says."""
    required, forbidden = any_state(FACTS, requires), any_state(FACTS, forbids & ~requires)
    condition, state = Condition(required, forbidden), any_state(FACTS, here)
    amiss = condition.why_not(state)
    missing = set(required) - set(state)
    present = set(forbidden) & set(state)
    assert set(amiss) == missing | {f"not {name}" for name in present}
    assert condition.holds(state) == (not amiss)


def test_it_prints_in_words():
    """Required facts first; nothing at all is always."""
    assert str(Condition(FACTS.of("a", "c"), FACTS.of("b"))) == "a and c and not b"
    assert str(Condition(FACTS.none, FACTS.none)) == "always"
