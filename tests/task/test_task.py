"""Tasks, and sequences of their skills."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import any_state, make_skill, make_task, two_roads_task
from skillplan.errors import OptionError
from skillplan.task import Facts, Literal, Precedence, Verdict, VerdictStatus

FACTS = Facts(("a", "b"))
SKILLS = (make_skill(FACTS, "pick(a)", add=("a",)), make_skill(FACTS, "pick(b)", add=("b",)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"skills": SKILLS + SKILLS[:1]}, "skill names must be distinct"),
        ({"step_limit": 0}, "step limit must be >= 1, not 0"),
        ({"observation": (Literal("c"),)}, "unknown fact 'c' observed"),
        ({"operations": {"x": "c"}}, "'x' has unknown fact 'c'"),
        ({"operations": {"x": "a"}, "chart": (Precedence("x", "y"),)}, "names unknown 'y'"),
        ({"operations": {"x": "a"}, "chart": (Precedence("y", "x"),)}, "names unknown 'y'"),
    ],
)
def test_an_unsound_task_is_refused(changes, message):
    """Each check of its constructor."""
    with pytest.raises(ValueError, match=message):
        make_task(FACTS, **{"skills": SKILLS, **changes})


def test_a_variant_differs_in_what_was_replaced_only():
    """It is no longer the task of the file, so that it loses the file's hash."""
    task = make_task(FACTS, SKILLS, sha256="abc")
    variant = task.replace(step_limit=3)
    assert (variant.step_limit, variant.sha256) == (3, "")
    assert variant.replace(step_limit=20, sha256="abc") == task
    with pytest.raises(ValueError, match="step limit"):
        task.replace(step_limit=-1)


def test_skills_are_found_by_name_and_by_number():
    """As the user may write them."""
    task = make_task(FACTS, SKILLS)
    for reference in ("pick(b)", " pick(b) ", 1, "1", "01"):
        assert task.skill(reference) is SKILLS[1]
    assert task.action("pick(b)") == task.action(SKILLS[1]) == 1


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        (2, "No action 2; the task has actions 0 to 1"),
        (-1, "No action -1"),
        ("2", "No action 2"),
        ("9" * 30, "No action"),
        ("pick(c)", r"Unknown skill 'pick\(c\)'. Did you mean 'pick\("),
        ("-1", "Unknown skill '-1'"),
        ("²", "Unknown skill '²'"),
        ("", "Unknown skill ''"),
    ],
)
def test_an_unknown_skill_is_a_user_error(reference, message):
    """Digits beyond ASCII, signs and huge numbers included."""
    with pytest.raises(OptionError, match=message):
        make_task(FACTS, SKILLS).skill(reference)


def test_a_sequence_mixes_numbers_and_names():
    """Spaces do not matter."""
    task = make_task(FACTS, SKILLS)
    assert [s.name for s in task.parse_sequence("0, pick(b) ,0")] == [
        "pick(a)",
        "pick(b)",
        "pick(a)",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "sequence is empty"),
        ("  ", "sequence is empty"),
        ("0,,1", "Entry 2 of the sequence is empty"),
        ("0,1,", "Entry 3 of the sequence is empty"),
        ("0,7", "Entry 2 of the sequence: No action 7"),
        ("pik(a)", r"Entry 1 of the sequence: Unknown skill 'pik\(a\)'. Did you mean 'pick\(a\)'"),
    ],
)
def test_a_bad_sequence_says_which_entry(text, message):
    """And what to write instead."""
    with pytest.raises(OptionError, match=message):
        make_task(FACTS, SKILLS).parse_sequence(text)


def test_a_task_prints_as_one_short_line():
    """Also one of many skills: a notebook shows what print gives."""
    skills = [make_skill(FACTS, f"pick({number})", add=("a",)) for number in range(500)]
    text = repr(make_task(FACTS, skills))
    assert "500 skills" in text
    assert len(text) < 120


def test_an_observation_is_its_literals_in_order():
    """Without any it is all facts."""
    task = make_task(FACTS, SKILLS)
    assert task.observe(FACTS.of("b")) == (0, 1)
    task = task.replace(observation=(Literal("b"), Literal("a", positive=False)))
    assert task.observe(FACTS.of("b")) == (1, 1)
    assert task.observe(FACTS.of("a")) == (0, 0)
    assert [str(literal) for literal in task.observation] == ["b", "not a"]


def test_a_task_is_deterministic_if_all_its_skills_are():
    """One skill with chance is enough."""
    assert two_roads_task().deterministic
    chance = make_skill(FACTS, "try", outcomes=[(0.5, ("a",), ()), (0.5, (), ())])
    assert not make_task(FACTS, (*SKILLS, chance)).deterministic


def test_a_cost_is_printed_with_its_unit():
    """Nothing, and infinity, as a dash."""
    task = make_task(FACTS, SKILLS)
    assert task.cost_text(1.5) == "1.50000 J"
    assert task.cost_text(None) == task.cost_text(math.inf) == "-"


# Verdicts and the facts they rest on.


FLAGS = Facts(tuple("abcdef"))
bits = st.integers(0, FLAGS.all_bits)


@pytest.mark.parametrize("status", [VerdictStatus.INFEASIBLE, VerdictStatus.UNKNOWN])
def test_whatever_is_not_feasible_has_a_reason(status):
    """Only a feasible skill needs none."""
    with pytest.raises(ValueError, match="needs a reason"):
        Verdict(status)
    assert Verdict(VerdictStatus.FEASIBLE).reason == ""


def test_it_names_both_kinds_of_facts_or_neither():
    """Half an answer cannot be reused."""
    for half in ({"present": FLAGS.none}, {"absent": FLAGS.none}):
        with pytest.raises(ValueError, match="both present and absent facts, or neither"):
            Verdict(VerdictStatus.FEASIBLE, **half)


def test_it_cannot_rest_on_a_contradiction():
    """No fact is both present and absent."""
    with pytest.raises(ValueError, match=r"facts both present and absent: \{b\}"):
        Verdict.feasible(FLAGS.of("a", "b"), FLAGS.of("b"))


@given(bits, bits, bits)
def test_it_applies_exactly_where_its_facts_are_the_same(present, absent, here):
    """What else holds does not matter."""
    present, absent = any_state(FLAGS, present), any_state(FLAGS, absent & ~present)
    verdict, state = Verdict.infeasible("no", present, absent), any_state(FLAGS, here)
    expected = set(present) <= set(state) and not set(absent) & set(state)
    assert expected == verdict.applies_in(state)


@given(bits, bits)
def test_one_that_cannot_say_rests_on_all_facts(here, there):
    """Once grounded it applies in the same state and in no other."""
    state, other = any_state(FLAGS, here), any_state(FLAGS, there)
    verdict = Verdict.unknown("too slow")
    assert not verdict.applies_in(state)
    grounded = verdict.grounded(state, "physics")
    assert grounded.stage == "physics"
    assert grounded.applies_in(state)
    assert grounded.applies_in(other) == (state == other)


def test_grounding_keeps_the_facts_that_were_named():
    """Only the stage is added."""
    verdict = Verdict.feasible(FLAGS.of("a"), FLAGS.of("b"), {"force_n": 3.0})
    grounded = verdict.grounded(FLAGS.of("a", "c"), "aabb")
    assert (grounded.present, grounded.absent) == (FLAGS.of("a"), FLAGS.of("b"))
    assert grounded.facts == ["a", "not b"]
    assert grounded.evidence == {"force_n": 3.0}
    assert (grounded.is_feasible, grounded.is_infeasible) == (True, False)
    assert Verdict.infeasible("no").is_infeasible
    assert not Verdict.unknown("?").is_feasible
    assert not Verdict.unknown("?").is_infeasible
