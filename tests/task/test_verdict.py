"""Verdicts and the facts they rest on."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import any_state
from skillplan.task import Facts, Verdict, VerdictStatus

FACTS = Facts(tuple("abcdef"))
bits = st.integers(0, FACTS.all_bits)


@pytest.mark.parametrize("status", [VerdictStatus.INFEASIBLE, VerdictStatus.UNKNOWN])
def test_whatever_is_not_feasible_has_a_reason(status):
    """Only a feasible skill needs none."""
    with pytest.raises(ValueError, match="needs a reason"):
        Verdict(status)
    assert Verdict(VerdictStatus.FEASIBLE).reason == ""


def test_it_names_both_kinds_of_facts_or_neither():
    """Half an answer cannot be reused."""
    for half in ({"present": FACTS.none}, {"absent": FACTS.none}):
        with pytest.raises(ValueError, match="both present and absent facts, or neither"):
            Verdict(VerdictStatus.FEASIBLE, **half)


def test_it_cannot_rest_on_a_contradiction():
    """No fact is both present and absent."""
    with pytest.raises(ValueError, match=r"facts both present and absent: \{b\}"):
        Verdict.feasible(FACTS.of("a", "b"), FACTS.of("b"))


@given(bits, bits, bits)
def test_it_applies_exactly_where_its_facts_are_the_same(present, absent, here):
    """What else holds does not matter."""
    present, absent = any_state(FACTS, present), any_state(FACTS, absent & ~present)
    verdict, state = Verdict.infeasible("no", present, absent), any_state(FACTS, here)
    expected = set(present) <= set(state) and not set(absent) & set(state)
    assert expected == verdict.applies_in(state)


@given(bits, bits)
def test_one_that_cannot_say_rests_on_all_facts(here, there):
    """Once grounded it applies in the same state and in no other."""
    state, other = any_state(FACTS, here), any_state(FACTS, there)
    verdict = Verdict.unknown("too slow")
    assert not verdict.applies_in(state)
    grounded = verdict.grounded(state, "physics")
    assert grounded.stage == "physics"
    assert grounded.applies_in(state)
    assert grounded.applies_in(other) == (state == other)


def test_grounding_keeps_the_facts_that_were_named():
    """Only the stage is added."""
    verdict = Verdict.feasible(FACTS.of("a"), FACTS.of("b"), {"force_n": 3.0})
    grounded = verdict.grounded(FACTS.of("a", "c"), "aabb")
    assert (grounded.present, grounded.absent) == (FACTS.of("a"), FACTS.of("b"))
    assert grounded.facts == ["a", "not b"]
    assert grounded.evidence == {"force_n": 3.0}
    assert (grounded.is_feasible, grounded.is_infeasible) == (True, False)
    assert Verdict.infeasible("no").is_infeasible
    assert not Verdict.unknown("?").is_feasible
    assert not Verdict.unknown("?").is_infeasible
