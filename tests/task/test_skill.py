"""Skills and their outcomes."""

import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import any_state, make_skill
from skillplan.task import Condition, Facts, Outcome, Skill

FACTS = Facts(tuple("abcdef"))
bits = st.integers(0, FACTS.all_bits)


def changed(**values):
    """Return the arguments of a sound skill with some changed."""
    sound = make_skill(FACTS, "pick(a)", add=("a",))
    fields = ("name", "kind", "agents", "precondition", "outcomes", "cost", "duration_s")
    return {**{name: getattr(sound, name) for name in fields}, **values}


@pytest.mark.parametrize("probability", [0.0, -0.1, 1.1, float("nan")])
def test_a_probability_lies_between_0_and_1(probability):
    """0 is no outcome."""
    with pytest.raises(ValueError, match="probability"):
        Outcome(probability, FACTS.none, FACTS.none)


def test_an_outcome_cannot_add_and_delete_a_fact():
    """The message names it."""
    with pytest.raises(ValueError, match=r"adds and deletes the same facts: \{a\}"):
        Outcome(1.0, FACTS.of("a"), FACTS.of("a", "b"))


@given(bits, bits, bits)
def test_an_outcome_adds_and_deletes(added, deleted, here):
    """What is added holds after it, what is deleted does not, the rest is as it was."""
    outcome = Outcome(0.5, any_state(FACTS, added), any_state(FACTS, deleted & ~added))
    state = any_state(FACTS, here)
    expected = (set(state) - set(outcome.delete)) | set(outcome.add)
    assert expected == set(outcome.apply(state))
    assert outcome.apply(outcome.apply(state)) == outcome.apply(state)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"name": ""}, "name must not be empty"),
        ({"agents": ()}, "at least one agent"),
        ({"outcomes": ()}, "at least one outcome"),
        ({"outcomes": (Outcome(0.5, FACTS.none, FACTS.none),)}, "sum to 0.5, not 1"),
        ({"outcomes": (Outcome(0.6, FACTS.none, FACTS.none),) * 2}, "sum to 1.2, not 1"),
    ],
)
def test_an_unsound_skill_is_refused(values, message):
    """Each check of its constructor."""
    with pytest.raises(ValueError, match=message):
        Skill(**changed(**values))


def test_its_postcondition_is_what_it_predicts():
    """What is added must hold, what is deleted must not."""
    skill = make_skill(FACTS, "swap", add=("a",), delete=("b",))
    assert skill.postcondition.holds(skill.prediction.apply(FACTS.of("b", "c")))
    assert skill.postcondition.why_not(FACTS.of("b")) == ["a", "not b"]


def test_the_nominal_outcome_comes_first():
    """It is the prediction; a skill with two is not deterministic."""
    skill = make_skill(FACTS, "try", outcomes=[(0.2, ("a",), ()), (0.8, (), ("a",))])
    assert list(skill.prediction.add) == ["a"]
    assert not skill.deterministic
    assert make_skill(FACTS, "do").deterministic


def test_its_parameters_cannot_be_changed():
    """Not through the skill, nor through the mapping it was given."""
    given_parameters = {"part": "a"}
    skill = make_skill(FACTS, "pick(a)", parameters=given_parameters)
    given_parameters["part"] = "b"
    assert skill.parameters == {"part": "a"}
    with pytest.raises(TypeError):
        skill.parameters["part"] = "b"
    with pytest.raises(AttributeError):
        skill.name = "place(a)"


def test_skills_of_an_assembly_can_be_hashed_and_pickled(lid_task):
    """They serve as keys, and travel to other processes."""
    assert len(set(lid_task.skills)) == len(lid_task.skills)
    again = pickle.loads(pickle.dumps(lid_task))
    assert again == lid_task
    assert again.skills[0].parameters == {"part": "box", "tool": "gripper"}
    assert str(again.skills[0]) == "pick(box)"


# Conditions on states.


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
