"""Facts and the states made of them."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import any_state
from skillplan.errors import OptionError
from skillplan.task import Facts, State

FACTS = Facts(tuple(f"fact_{i}" for i in range(70)), (("fact_0", "fact_1"),))
names = st.lists(st.sampled_from(FACTS.names), unique=True)
states = st.integers(0, FACTS.all_bits).map(lambda bits: any_state(FACTS, bits))


def test_a_fact_cannot_be_named_twice():
    """The message names the doubled fact."""
    with pytest.raises(ValueError, match="named twice: a"):
        Facts(("a", "b", "a"))


def test_an_exclusive_group_names_known_facts_only():
    """A slip in a group is refused."""
    with pytest.raises(ValueError, match="Unknown fact 'c' in an exclusive group"):
        Facts(("a", "b"), (("a", "c"),))


@pytest.mark.parametrize("bits", [-1, 1 << 70, 1 << 200])
def test_bits_outside_the_vocabulary_are_refused(bits):
    """Neither negative nor too large."""
    with pytest.raises(ValueError, match="outside the 70 facts"):
        State(bits, FACTS)


def test_an_unknown_fact_is_named_with_the_nearest():
    """As a user error with a suggestion."""
    facts = Facts(("placed(pcb)", "held(pcb)"))
    with pytest.raises(OptionError, match=r"'plcaed\(pcb\)'. Did you mean 'placed\(pcb\)'"):
        facts.of("plcaed(pcb)")


@given(names)
def test_a_state_names_exactly_the_facts_it_was_made_of(chosen):
    """Naming facts and reading them off are inverse, and iteration follows the vocabulary."""
    state = FACTS.of(*chosen)
    assert FACTS.names_of(state.bits) == sorted(chosen, key=FACTS.names.index) == list(state)
    assert FACTS.of(*state) == state
    assert len(state) == len(chosen)
    assert all((name in state) == (name in chosen) for name in FACTS.names)


@given(states, states)
def test_states_combine_like_sets(one, other):
    """Union, intersection, difference and complement are those of the fact names."""
    assert set(one | other) == set(one) | set(other)
    assert set(one & other) == set(one) & set(other)
    assert set(one - other) == set(one) - set(other)
    assert set(one.complement()) == set(FACTS.names) - set(one)
    assert one.facts.of(*one, *other) == one | other


@given(states)
def test_a_state_survives_pickling(state):
    """With its vocabulary, and equal to itself."""
    again = pickle.loads(pickle.dumps(state))
    assert again == state
    assert hash(again) == hash(state)
    assert again.facts == state.facts


@given(states, states)
def test_equal_states_are_those_with_the_same_facts(one, other):
    """Equality, hashing and bits agree."""
    assert (one == other) == (set(one) == set(other))
    if one == other:
        assert hash(one) == hash(other)


def test_states_of_other_vocabularies_differ():
    """The same bits mean other facts."""
    assert Facts(("a",)).of("a") != Facts(("b",)).of("b")
    assert Facts(("a",)).of("a") == Facts(("a",)).of("a")
    assert Facts(("a",)).of("a") != 1


def test_a_state_cannot_be_changed():
    """Neither by setting nor by deleting, nor with a new attribute."""
    state = FACTS.of("fact_3")
    with pytest.raises(AttributeError, match="immutable"):
        state.bits = 0
    with pytest.raises(AttributeError, match="immutable"):
        del state.facts
    with pytest.raises(AttributeError):
        state.other = 1
    assert list(state) == ["fact_3"]


def test_a_state_prints_as_its_facts():
    """In the order of the vocabulary."""
    state = FACTS.of("fact_12", "fact_2")
    assert str(state) == "{fact_2, fact_12}"
    assert repr(state) == "State({fact_2, fact_12})"


def test_a_vocabulary_knows_its_facts():
    """By name, by number and by bit."""
    assert "fact_69" in FACTS
    assert "fact_70" not in FACTS
    assert len(FACTS) == 70
    assert FACTS.bit("fact_5") == 32
    assert FACTS.none.bits == 0
    assert list(FACTS.state(0b101)) == ["fact_0", "fact_2"]


def test_single_facts_have_hashes_of_their_own():
    """Whole numbers would not do: of the powers of two Python makes 61 hashes."""
    facts = Facts(tuple(f"at({i})" for i in range(2_000)))
    assert len({hash(facts.state(1 << i)) for i in range(2_000)}) == 2_000
