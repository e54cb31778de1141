"""The chain of checks: cheapest first, and the first that fails names itself."""

import math

import pytest

from situations import fake_back_end, make_skill, make_task, model_of
from skillplan.checks import Feasibility
from skillplan.errors import BackEndError, OptionError
from skillplan.physics import Engine
from skillplan.task import Facts, Verdict

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
    expensive = fake_back_end(TASK, yes(), name="expensive", expected_s=1.0, base=Engine)
    verdict = Feasibility(TASK, [expensive, cheap]).verdict(SKILL, START)
    assert (verdict.stage, verdict.reason) == ("cheap", "blocked")
    assert len(cheap.asked) == 1
    assert expensive.asked == []


def test_checks_run_in_the_order_of_their_expected_time():
    """Each exactly once; kinds do not matter."""
    order = []
    times = {"third": 1e-2, "first": 1e-7, "second": 1e-4}

    def making(name):
        def answer(skill, state):
            order.append(name)
            return yes()

        return fake_back_end(TASK, answer, name=name, expected_s=times[name])

    verdict = Feasibility(TASK, [making(name) for name in times]).verdict(SKILL, START)
    assert verdict.is_feasible
    assert order == ["first", "second", "third"]


def test_an_inapplicable_skill_asks_nobody():
    """The verdict names what is amiss and rests on just that."""
    back_end = fake_back_end(TASK)
    feasibility = Feasibility(TASK, [back_end])
    verdict = feasibility.verdict(SKILL, FACTS.of("done", "b"))
    assert (verdict.stage, verdict.reason) == ("precondition", "needs a, not done")
    assert verdict.facts == ["done", "not a"]
    assert verdict.applies_in(FACTS.of("done"))
    assert (back_end.asked, feasibility.checks, feasibility.hits) == ([], 0, 0)


def test_a_feasible_verdict_rests_on_the_facts_of_all_stages():
    """And on the precondition."""
    back_end = fake_back_end(TASK, yes(absent=("b",)), name="one")
    verdict = Feasibility(TASK, [back_end]).verdict(SKILL, START)
    assert verdict.present == FACTS.of("a")
    assert verdict.absent == FACTS.of("b", "done")


def test_an_infeasible_verdict_decides_over_an_unknown_one():
    """The search goes on after an unknown; what is impossible is impossible."""
    unknown = fake_back_end(TASK, Verdict.unknown("too slow"), name="cheap", expected_s=1e-6)
    impossible = fake_back_end(TASK, no("blocked"), name="expensive", expected_s=1.0)
    verdict = Feasibility(TASK, [unknown, impossible]).verdict(SKILL, START)
    assert (verdict.stage, verdict.is_infeasible) == ("expensive", True)


def test_the_first_unknown_verdict_is_returned_where_nothing_is_impossible():
    """Named after its stage."""
    chain = [
        fake_back_end(TASK, Verdict.unknown("first"), name="one", expected_s=1e-6),
        fake_back_end(TASK, Verdict.unknown("second"), name="two", expected_s=1e-5),
        fake_back_end(TASK, yes(), name="three", expected_s=1e-4),
    ]
    verdict = Feasibility(TASK, chain).verdict(SKILL, START)
    assert (verdict.status, verdict.stage, verdict.reason) == ("unknown", "one", "first")


def test_a_verdict_is_asked_for_once_where_its_facts_are_the_same():
    """Checks count questions that needed work, hits those that did not."""
    back_end = fake_back_end(TASK, yes(present=("a",)))
    feasibility = Feasibility(TASK, [back_end])
    for names in (("a",), ("a",), ("a", "b")):
        assert feasibility.verdict(SKILL, FACTS.of(*names)).is_feasible
    assert len(back_end.asked) == 1
    assert (feasibility.checks, feasibility.hits, feasibility.queried["fake"]) == (1, 2, 1)


def test_a_verdict_is_asked_for_again_where_its_facts_differ():
    """Here whether b holds."""

    def answer(skill, state):
        return no(present=("b",)) if "b" in state else yes(absent=("b",))

    back_end = fake_back_end(TASK, answer)
    feasibility = Feasibility(TASK, [back_end])
    results = [
        feasibility.verdict(SKILL, FACTS.of("a", *more)) for more in ((), ("b",), (), ("b",))
    ]
    assert [verdict.is_feasible for verdict in results] == [True, False, True, False]
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
        Feasibility(TASK, [fake_back_end(TASK, answer)]).verdict(SKILL, START)


def test_without_back_ends_what_is_applicable_is_feasible():
    """It rests on the precondition."""
    verdict = Feasibility(TASK).verdict(SKILL, START)
    assert verdict.is_feasible
    assert verdict.facts == ["a", "not done"]


def test_several_questions_are_answered_in_order():
    """As one after the other would be, inapplicable ones among them."""
    back_end = fake_back_end(TASK, yes(present=("a",)))
    feasibility = Feasibility(TASK, [back_end])
    polls = []
    questions = [(SKILL, FACTS.of(*names)) for names in (("a",), ("b",), ("a", "b"))]
    verdicts = feasibility.verdicts(questions, lambda: polls.append(1))
    assert [verdict.status for verdict in verdicts] == ["feasible", "infeasible", "feasible"]
    assert (len(back_end.asked), feasibility.checks, feasibility.hits) == (1, 1, 1)
    assert len(polls) == 3


def test_executions_are_counted_of_expensive_back_ends_only():
    """Beside them how many questions came as far as they did."""
    cheap = fake_back_end(TASK, lambda k, s: no() if "b" in s else yes(absent=("b",)), name="cheap")
    expensive = fake_back_end(TASK, yes(), name="expensive", expected_s=1.0, expensive=True)
    feasibility = Feasibility(TASK, [cheap, expensive])
    for names in (("a",), ("a",), ("a", "b")):
        feasibility.verdict(SKILL, FACTS.of(*names))
    assert (feasibility.checks, feasibility.executions, feasibility.reached) == (2, 1, 2)
    without = Feasibility(TASK, [cheap])
    without.verdict(SKILL, START)
    assert (without.executions, without.reached) == (1, 1)


def test_every_back_end_is_told_once_what_is_beside_it():
    """Before it is asked anything."""
    messages = []

    class Social(Engine):
        name = "social"

        def beside(self, others):
            messages.append([other.name for other in others])

        def check(self, skill, state):
            return Verdict.feasible()

    feasibility = Feasibility(TASK, [Social(TASK), fake_back_end(TASK, name="other")])
    assert messages == [["other"]]
    feasibility.verdict(SKILL, START)
    assert len(messages) == 1


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"beside": boom}, "Back end 'odd' failed: ZeroDivisionError: in the solver of contacts"),
        ({"basis": {"a": math.nan}}, "The basis of back end 'odd' is not JSON"),
    ],
)
def test_a_back_end_that_does_not_get_on_with_others_is_named(attributes, message):
    """Before anything is asked."""
    odd = type("Odd", (Engine,), {"name": "odd", "check": boom, **attributes})
    with pytest.raises(BackEndError, match=message):
        Feasibility(TASK, [odd(TASK)])


def test_evidence_is_as_a_file_or_another_process_would_give_it_back():
    """Lists for tuples: what is kept equals what was said."""
    feasible = Verdict.feasible(FACTS.none, FACTS.none, {"point": (1, 2.5), 3: "three"})
    back_end = fake_back_end(TASK, feasible)
    (_, verdict) = Feasibility(TASK, [back_end]).stages(SKILL, START)
    assert verdict.evidence == {"point": [1, 2.5], "3": "three"}


def timing(answer, name="clock"):
    """Return a back end that times skills, and counts how often it was asked to."""

    def duration_s(self, skill, state):
        self.timed.append((skill.name, str(state)))
        return answer(skill, state) if callable(answer) else answer

    created = fake_back_end(TASK, name=name, expected_s=1e-3, duration_s=duration_s)
    created.timed = []
    return created


def test_a_back_end_that_can_says_how_long_a_skill_takes():
    """Once for where the robot stands and what it holds; the first that knows counts."""
    ignorant, clock = timing(None, "ignorant"), timing(2.5)
    model = model_of(TASK, ignorant, clock)
    for names in (("a",), ("a", "b"), ("a",)):
        assert model.transition(FACTS.of(*names), SKILL).duration_s == 2.5
    assert model.duration_s(START, SKILL) == 2.5
    assert (len(ignorant.timed), len(clock.timed)) == (1, 1)


def test_where_no_back_end_knows_the_tasks_figure_counts():
    """One that does not time anything is never asked."""
    model = model_of(TASK, timing(None))
    assert model.transition(START, SKILL).duration_s == 1.0
    plain = model_of(TASK, fake_back_end(TASK))
    assert not plain.feasibility.times.sources
    assert plain.transition(START, SKILL).duration_s == plain.duration_s(START, SKILL) == 1.0


def test_time_is_asked_again_where_the_robot_stands_elsewhere(board_task):
    """And where it holds another tool; not for what has been done meanwhile."""
    task, queries = board_task, []

    def duration_s(self, skill, state):
        queries.append(state)
        return 1.0

    clock = fake_back_end(task, name="clock", duration_s=duration_s)
    model = model_of(task, clock)
    skill = task.skills[0]
    robot = task.scene.robots[0]
    here, there, *_ = robot.places
    state = task.initial - task.facts.of(*robot.places) | task.facts.of(here)
    done = task.facts.of(next(iter(task.operations.values())))
    for item in (state, state | done, state - task.facts.of(here) | task.facts.of(there)):
        model.feasibility.times.duration_s(skill, item)
    assert len(queries) == 2
    tools = task.facts.of(*(tool.fact for tool in robot.tools))
    model.feasibility.times.duration_s(skill, state - tools | (tools - state))
    assert len(queries) == 3


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (boom, "'clock' failed to time finish in {a}: ZeroDivisionError: in the solver of"),
        (-1.0, "'clock' says that finish takes -1.0 s in {a}"),
        (math.nan, "'clock' says that finish takes nan s in {a}"),
        ("soon", "'clock' says that finish takes 'soon' s in {a}"),
    ],
)
def test_a_time_that_makes_no_sense_names_the_back_end(answer, message):
    """It is the plugin author's to repair."""
    with pytest.raises(BackEndError) as caught:
        model_of(TASK, timing(answer)).transition(START, SKILL)
    assert message in str(caught.value)
