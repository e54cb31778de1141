"""The chain of checks: cheapest first, and the first that fails names itself."""

import pytest

from situations import fake_back_end, make_skill, make_task, model_of
from skillplan.errors import BackEndError, OptionError
from skillplan.model.feasibility import Feasibility
from skillplan.physics.engine import Engine
from skillplan.task.state import Facts
from skillplan.task.verdict import Verdict

FACTS = Facts(("a", "b", "done"))
SKILL = make_skill(FACTS, "finish", requires=("a",), forbids=("done",), add=("done",))
TASK = make_task(FACTS, [SKILL], initial=("a",), goal=("done",))
START = TASK.initial


def no(reason="no", present=(), absent=()):
    return Verdict.infeasible(reason, FACTS.of(*present), FACTS.of(*absent))


def yes(present=(), absent=()):
    return Verdict.feasible(FACTS.of(*present), FACTS.of(*absent))


def test_a_failing_cheap_check_never_calls_a_dear_one():
    """However the back ends are listed."""
    cheap = fake_back_end(TASK, no("blocked"), name="cheap", expected_s=1e-6)
    dear = fake_back_end(TASK, yes(), name="dear", expected_s=1.0, base=Engine)
    verdict = Feasibility(TASK, [dear, cheap]).rule(SKILL, START)
    assert (verdict.stage, verdict.reason) == ("cheap", "blocked")
    assert len(cheap.asked) == 1
    assert dear.asked == []


def test_checks_run_in_the_order_of_their_expected_time():
    """Each exactly once; kinds do not matter."""
    order = []
    times = {"third": 1e-2, "first": 1e-7, "second": 1e-4}

    def making(name):
        def answer(skill, state):
            order.append(name)
            return yes()

        return fake_back_end(TASK, answer, name=name, expected_s=times[name])

    verdict = Feasibility(TASK, [making(name) for name in times]).rule(SKILL, START)
    assert verdict.is_feasible
    assert order == ["first", "second", "third"]


def test_an_inapplicable_skill_asks_nobody():
    """The verdict names what is amiss and rests on just that."""
    back_end = fake_back_end(TASK)
    feasibility = Feasibility(TASK, [back_end])
    verdict = feasibility.rule(SKILL, FACTS.of("done", "b"))
    assert (verdict.stage, verdict.reason) == ("precondition", "needs a, not done")
    assert verdict.facts == ["done", "not a"]
    assert verdict.applies_in(FACTS.of("done"))
    assert (back_end.asked, feasibility.checks, feasibility.hits) == ([], 0, 0)


def test_a_feasible_verdict_rests_on_the_facts_of_all_stages():
    """And on the precondition."""
    one = fake_back_end(TASK, yes(absent=("b",)), name="one")
    verdict = Feasibility(TASK, [one]).rule(SKILL, START)
    assert verdict.present == FACTS.of("a")
    assert verdict.absent == FACTS.of("b", "done")


def test_an_infeasible_verdict_decides_over_an_unknown_one():
    """The search goes on after an unknown; what is impossible is impossible."""
    unknown = fake_back_end(TASK, Verdict.unknown("too slow"), name="cheap", expected_s=1e-6)
    impossible = fake_back_end(TASK, no("blocked"), name="dear", expected_s=1.0)
    verdict = Feasibility(TASK, [unknown, impossible]).rule(SKILL, START)
    assert (verdict.stage, verdict.is_infeasible) == ("dear", True)


def test_the_first_unknown_verdict_is_returned_where_nothing_is_impossible():
    """Named after its stage."""
    chain = [
        fake_back_end(TASK, Verdict.unknown("first"), name="one", expected_s=1e-6),
        fake_back_end(TASK, Verdict.unknown("second"), name="two", expected_s=1e-5),
        fake_back_end(TASK, yes(), name="three", expected_s=1e-4),
    ]
    verdict = Feasibility(TASK, chain).rule(SKILL, START)
    assert (verdict.status, verdict.stage, verdict.reason) == ("unknown", "one", "first")


def test_a_verdict_is_asked_for_once_where_its_facts_are_the_same():
    """Checks count questions that needed work, hits those that did not."""
    back_end = fake_back_end(TASK, yes(present=("a",)))
    feasibility = Feasibility(TASK, [back_end])
    for names in (("a",), ("a",), ("a", "b")):
        assert feasibility.rule(SKILL, FACTS.of(*names)).is_feasible
    assert len(back_end.asked) == 1
    assert (feasibility.checks, feasibility.hits, feasibility.asked["fake"]) == (1, 2, 1)


def test_a_verdict_is_asked_for_again_where_its_facts_differ():
    """Here whether b holds."""

    def answer(skill, state):
        return no(present=("b",)) if "b" in state else yes(absent=("b",))

    back_end = fake_back_end(TASK, answer)
    feasibility = Feasibility(TASK, [back_end])
    found = [feasibility.rule(SKILL, FACTS.of("a", *more)) for more in ((), ("b",), (), ("b",))]
    assert [verdict.is_feasible for verdict in found] == [True, False, True, False]
    assert len(back_end.asked) == 2


def test_all_stages_are_shown_even_beyond_the_first_that_fails():
    """For those who want to know why."""
    chain = [
        fake_back_end(TASK, no("blocked"), name="one", expected_s=1e-6),
        fake_back_end(TASK, yes(), name="two", expected_s=1e-5),
    ]
    stages = Feasibility(TASK, chain).stages(SKILL, START)
    assert [(v.stage, str(v.status)) for v in stages] == [
        ("precondition", "feasible"),
        ("one", "infeasible"),
        ("two", "feasible"),
    ]
    assert [v.stage for v in Feasibility(TASK, chain).stages(SKILL, FACTS.none)] == ["precondition"]


def boom(skill, state):
    raise ZeroDivisionError("in the solver of contacts")


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (boom, "'broken' failed on finish in {a}: ZeroDivisionError: in the solver of contacts"),
        (lambda skill, state: None, "'broken' returned NoneType for finish, not a Verdict"),
        (lambda skill, state: True, "'broken' returned bool for finish, not a Verdict"),
        (yes(present=("b",)), "'broken' says its verdict on finish rests on facts that do not"),
        (no(absent=("a",)), "'broken' says its verdict on finish rests on facts that do not"),
    ],
)
def test_a_back_end_that_misbehaves_is_named(answer, message):
    """It is the plugin author's to repair; no such verdict is kept."""
    model = model_of(TASK, fake_back_end(TASK, answer, name="broken"))
    for _ in range(2):
        with pytest.raises(BackEndError) as caught:
            model.transitions(START)
        assert message in str(caught.value)
        assert caught.value.exit_code == 3


def test_an_error_in_words_is_passed_on_with_the_name_of_the_back_end():
    """A back end may say itself what is amiss; who said it, and where, stands before."""

    def answer(skill, state):
        raise OptionError("no licence file")

    with pytest.raises(BackEndError, match=r"'fake' failed on finish in \{a\}: no licence file"):
        Feasibility(TASK, [fake_back_end(TASK, answer)]).rule(SKILL, START)


def test_without_back_ends_what_is_applicable_is_feasible():
    """It rests on the precondition."""
    verdict = Feasibility(TASK).rule(SKILL, START)
    assert verdict.is_feasible
    assert verdict.facts == ["a", "not done"]
