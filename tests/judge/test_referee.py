"""Solvers never grade themselves: whoever lies is found out."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import situations
from example_count import examples
from skillplan.collision import PrecedenceDetector
from skillplan.errors import BackEndError, SkillplanError
from skillplan.judge import cross_examine, find_counterexample, referee
from skillplan.pipeline import Setup, solve
from skillplan.records import Result, Status
from skillplan.solvers import Plan, Policy, Solution, Stop
from skillplan.solvers import stop as stops
from skillplan.task import Condition, Facts, Verdict
from skillplan.testing import lid_content

BARE = situations.FakeSetup()
GOOD, DEAR = ("to_a", "a_to_b", "finish"), ("to_b", "finish")


def verdict_on(solution, task=None, setup=BARE, **arguments):
    """Return what the referee makes of a solution to the task of two roads."""
    task = situations.two_roads_task() if task is None else task
    result = solution if callable(solution) else lambda solver, model: solution
    return solve(task, situations.solver_that(result), setup, **arguments)


def test_an_honest_solver_is_granted_its_proof():
    """Cost, steps and bound are the replay's."""
    result = verdict_on(Solution(Plan(GOOD, 3.0), 3.0, proved=True))
    assert (result.status, result.cost, result.gap, result.reason) == ("optimal", 3.0, 0.0, "")
    assert [step.skill for step in result.steps] == list(GOOD)


def test_an_honest_solver_without_a_proof_has_solved_the_task():
    """Its bound is granted, where it claims one."""
    result = verdict_on(Solution(Plan(DEAR, 4.0), 2.0))
    assert (result.status, result.cost, result.lower_bound, result.gap) == ("solved", 4.0, 2.0, 0.5)
    result = verdict_on(Solution(Plan(DEAR)))
    assert (result.status, result.cost, result.lower_bound) == ("solved", 4.0, None)


LIES = {
    "its cost is too low": (Solution(Plan(GOOD, 2.0)), "says its plan costs 2.0; it costs 3.0"),
    "its cost is too high": (Solution(Plan(GOOD, 3.5)), "says its plan costs 3.5"),
    "its cost is no number": (Solution(Plan(GOOD, math.nan)), "says its plan costs nan"),
    "its plan is not the best": (
        Solution(Plan(DEAR, 4.0), 4.0, proved=True),
        "claims that no plan costs less than 4.0, but: 0,1,3",
    ),
    "its bound is above its own plan": (
        Solution(Plan(DEAR, 4.0), 4.5),
        "claims the bound 4.5 for a plan of 4.0",
    ),
    "its bound is above a better plan": (
        Solution(Plan(DEAR, 4.0), 3.5),
        "no plan costs less than 3.5, but: 0,1,3",
    ),
    "its proof has no bound": (
        Solution(Plan(GOOD, 3.0), proved=True),
        "a proof with the bound None",
    ),
    "its proof has a gap": (
        Solution(Plan(GOOD, 3.0), 2.0, proved=True),
        "a proof with the bound 2.0",
    ),
    "a step is not applicable": (
        Solution(Plan(("to_a", "finish"), 2.0)),
        "fails at step 2 (finish): precondition: needs b",
    ),
    "the goal is not reached": (
        Solution(Plan(("to_b",), 3.0)),
        "fails at the end: goal: the goal is not reached: done",
    ),
    "there is no plan at all": (Solution(Plan((), 0.0)), "fails at the end: goal"),
    "a skill does not exist": (
        Solution(Plan(("to_c",))),
        "not one of this task: Unknown skill 'to_c'",
    ),
    "a policy names a skill of its own": (
        lambda solver, model: Solution(
            Policy({model.initial: situations.make_skill(model.task.facts, "jump", add=("done",))})
        ),
        "the policy is not one of this task: Unknown skill 'jump'",
    ),
    "there is a plan": (
        Solution(proved=True),
        "claims that no plan costs less than inf, but: 0,1,3",
    ),
    "a bound without a plan is too high": (Solution(None, 3.1), "no plan costs less than 3.1, but"),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_solver_is_caught_where(lie):
    """The result is wrong, says why, and carries no figure of the lie."""
    solution, message = LIES[lie]
    result = verdict_on(solution)
    assert result.status == "wrong"
    assert message in result.reason
    assert (result.cost, result.lower_bound, result.steps) == (None, None, ())


def test_a_plan_over_the_step_limit_is_caught():
    """However cheap it is."""
    result = verdict_on(
        Solution(Plan(GOOD, 3.0), 3.0, proved=True), situations.two_roads_task(step_limit=2)
    )
    assert result.status == "wrong"
    assert "step-limit: the sequence has 3 skills, the limit is 2" in result.reason


def test_the_shorter_plan_is_optimal_where_the_cheaper_one_is_too_long():
    """The referee's own search respects the step limit as well."""
    result = verdict_on(
        Solution(Plan(DEAR, 4.0), 4.0, proved=True), situations.two_roads_task(step_limit=2)
    )
    assert result.status == "optimal"


def test_a_task_whose_start_is_its_goal_is_proved_at_cost_0():
    """The empty plan is no counterexample to itself."""
    done = situations.make_task(Facts(("done",)), [], initial=("done",), goal=("done",))
    for result in (
        verdict_on(Solution(Plan((), 0.0), 0.0, proved=True), done),
        solve(done, "exact", BARE),
    ):
        assert (result.status, result.cost, result.lower_bound, result.reason) == (
            "optimal",
            0.0,
            0.0,
            "",
        )
        assert result.steps == ()


def test_no_bound_above_0_is_granted_where_the_start_is_the_goal():
    """Then the empty plan does refute it."""
    done = situations.make_task(Facts(("done",)), [], initial=("done",), goal=("done",))
    for solution in (Solution(None, 1.0), Solution(None, proved=True)):
        result = verdict_on(solution, done)
        assert result.status == "wrong"
        assert "claims that no plan costs less than" in result.reason
    assert find_counterexample(situations.model_of(done), 0.0) is None
    assert find_counterexample(situations.model_of(done), 1e-3) == []


def test_an_infeasible_step_is_caught():
    """With the stage and the reason of the back end."""

    def blocked(task):
        facts = task.facts

        def answer(skill, state):
            if skill.name == "a_to_b":
                return Verdict.infeasible("hits the wall", facts.none, facts.none)
            return Verdict.feasible(facts.none, facts.none)

        return [situations.fake_back_end(task, answer)]

    result = verdict_on(
        Solution(Plan(GOOD, 3.0), 3.0, proved=True), setup=situations.FakeSetup(make=blocked)
    )
    assert result.status == "wrong"
    assert "fails at step 2 (a_to_b): fake: hits the wall" in result.reason


def test_a_forged_skill_is_replayed_as_the_task_knows_it():
    """A policy whose skill of the same name has a weaker precondition gains nothing."""

    def forge(solver, model):
        task = model.task
        free = replace(
            task.skill("finish"), precondition=Condition(task.facts.none, task.facts.none)
        )
        return Solution(Policy({model.initial: free}))

    result = verdict_on(forge)
    assert result.status == "wrong"
    assert (
        "takes a step that is infeasible: step 1 (finish): precondition: needs b" in result.reason
    )


def test_a_forged_skill_cannot_be_cheaper_either():
    """The cost is the task's own."""

    def forge(solver, model):
        task = model.task
        cheap = {
            task.facts.none: situations.make_skill(task.facts, "to_b", add=("b",), cost=0.0),
            task.facts.of("b"): situations.make_skill(
                task.facts, "finish", add=("done",), cost=0.0
            ),
        }
        return Solution(Policy(cheap))

    result = verdict_on(forge)
    assert (result.status, result.cost) == ("solved", 4.0)


def test_a_policy_is_worth_what_its_steps_cost():
    """On a task without chance: as its plan."""

    def walk(solver, model):
        task, facts = model.task, model.task.facts
        return Solution(
            Policy({facts.none: task.skill("to_b"), facts.of("b"): task.skill("finish")}), 3.0
        )

    result = verdict_on(walk)
    assert (result.status, result.cost, result.makespan) == ("solved", 4.0, 2)


def test_a_policy_that_does_not_arrive_leaves_the_task_unsolved():
    """It claims nothing, so that nothing is wrong."""
    result = verdict_on(lambda solver, model: Solution(Policy({})))
    assert (result.status, result.cost) == ("unsolved", None)
    assert "does not complete the task" in result.reason


def test_a_policy_on_a_task_with_chance_is_worth_its_expected_cost():
    """Trying at 2 until it works with probability 1/4 costs 8."""
    result = verdict_on(
        lambda solver, model: Solution(Policy({model.initial: model.task.skills[0]})),
        situations.retry_task(0.25),
    )
    assert result.status == "solved"
    assert result.cost == pytest.approx(8.0)
    assert result.makespan_s == pytest.approx(4.0)


def test_a_sequence_for_a_task_with_chance_is_wrong():
    """It says nothing of what to do when it fails."""
    result = verdict_on(Solution(Plan(("try",), 2.0)), situations.retry_task(0.25))
    assert result.status == "wrong"
    assert "needs a policy" in result.reason


def test_a_policy_on_a_task_with_chance_that_steps_into_the_impossible_is_wrong():
    """Also where only an unlikely outcome leads there."""
    facts = Facts(("slipped", "done"))
    skills = [
        situations.make_skill(
            facts,
            "try",
            forbids=("slipped",),
            outcomes=[(0.9, ("done",), ()), (0.1, ("slipped",), ())],
        )
    ]
    task = situations.make_task(facts, skills, goal=("done",))
    policy = {facts.none: skills[0], facts.of("slipped"): skills[0]}
    result = verdict_on(lambda solver, model: Solution(Policy(policy)), task)
    assert result.status == "wrong"
    assert "infeasible: try in {slipped}: precondition: needs not slipped" in result.reason


def undecided(task):
    """Return back ends that cannot decide on one skill."""

    def answer(skill, state):
        return Verdict.unknown("too slow") if skill.name == "to_a" else Verdict.feasible()

    return [situations.fake_back_end(task, answer)]


@pytest.mark.parametrize(
    ("solution", "status"),
    [(Solution(Plan(DEAR, 4.0), 4.0, proved=True), "solved"), (Solution(proved=True), "unsolved")],
)
def test_an_unknown_met_on_the_way_takes_the_proof_away(solution, status):
    """Optimal becomes solved, infeasible becomes unsolved; nothing is wrong."""

    def look(solver, model):
        model.transitions(model.initial)
        return solution

    result = verdict_on(look, setup=situations.FakeSetup(make=undecided))
    assert (result.status, result.lower_bound) == (status, None)
    assert "unknown" in result.reason
    assert result.reason.endswith(": too slow")
    assert "to_a: " in result.reason


@pytest.mark.parametrize("solver", ["exact", "exhaustive"])
def test_the_built_in_solvers_prove_nothing_beyond_what_is_known(solver):
    """They find the expensive road and claim no more."""
    result = solve(situations.two_roads_task(), solver, situations.FakeSetup(make=undecided))
    assert (result.status, result.cost) == ("solved", 4.0)


def test_a_false_proof_that_there_is_no_plan_is_caught_on_the_board(board_task):
    """By a plan that the referee finds itself."""
    result = verdict_on(Solution(proved=True), board_task, Setup(collision=("precedence",)))
    assert result.status == "wrong"
    assert "no plan costs less than inf" in result.reason


def test_a_bound_a_hair_too_high_is_caught_on_the_board(board_task):
    """By a part in a million."""
    names = tuple(
        board_task.skills[i].name for i in (0, 1, 4, 5, 2, 3, 8, 9, 10, 11, 6, 7, 13, 14, 15)
    )
    for bound, status in ((1.867086, "solved"), (1.867088, "wrong")):
        solution = Solution(Plan(names), bound)
        assert verdict_on(solution, board_task, Setup(collision=("precedence",))).status == status


@settings(max_examples=examples(60))
@given(content=situations.small_assemblies(), factor=st.sampled_from([0.5, 0.999, 1.0, 1.001, 2.0]))
def test_a_counterexample_is_found_exactly_where_there_is_one(content, factor):
    """On random assemblies without step limits that bind."""
    task = situations.assembly({**content, "step_limit": 40})

    def model():
        return situations.model_of(task, PrecedenceDetector(task))

    best = situations.optimum(situations.cheapest_by_length(model()))
    bound = math.inf if best is None else best[0] * factor
    cheaper = find_counterexample(model(), bound)
    assert (cheaper is not None) == (best is not None and best[0] < bound - 1e-9)


# Claims under chance.

TRY, SURE = 0, 1


def two_tries_task(**arguments):
    """Return a task with a cheap skill that fails three times in four, and a sure one at 5."""
    facts = Facts(("done",))
    outcomes = [(0.25, ("done",), ()), (0.75, (), ())]
    skills = [
        situations.make_skill(facts, "try", forbids=("done",), outcomes=outcomes, cost=2.0),
        situations.make_skill(facts, "sure", forbids=("done",), add=("done",), cost=5.0),
    ]
    return situations.make_task(facts, skills, goal=("done",), **arguments)


def claims(skill, bound=None, proved=False):
    """Return a solver's answer that always takes one skill, or has no policy for None."""

    def answer(solver, model):
        result = None if skill is None else Policy({model.initial: model.task.skills[skill]})
        return Solution(result, bound, proved=proved)

    return answer


def test_a_proof_under_chance_is_granted_where_the_referee_comes_to_the_same():
    """It works the optimum out itself."""
    result = verdict_on(claims(SURE, 5.0, proved=True), two_tries_task())
    assert (result.status, result.cost, result.lower_bound) == ("optimal", 5.0, 5.0)
    assert result.reason == ""


def test_a_bound_under_chance_is_granted_up_to_the_least_cost():
    """Without a proof the task is solved."""
    result = verdict_on(claims(TRY, 4.5), two_tries_task())
    assert (result.status, result.lower_bound) == ("solved", 4.5)
    assert result.cost == pytest.approx(8.0)
    result = verdict_on(claims(None, 5.0), two_tries_task())
    assert (result.status, result.lower_bound) == ("unsolved", 5.0)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (claims(TRY, 8.0, proved=True), "no policy costs less than 8.0; the best costs 5.0"),
        (claims(TRY, 5.00001), "no policy costs less than 5.00001; the best costs 5.0"),
        (claims(None, 5.1), "no policy costs less than 5.1; the best costs 5.0"),
        (claims(None, proved=True), "no policy costs less than inf; the best costs 5.0"),
        (claims(SURE, 4.9, proved=True), "claims a proof with the bound 4.9, not 5.0"),
        (claims(SURE, 5.1, proved=True), "claims the bound 5.1 for a plan of 5.0"),
    ],
    ids=["a worse policy", "a hair", "a bound alone", "no policy", "a gap", "above itself"],
)
def test_a_false_claim_under_chance_is_caught(answer, message):
    """Also where no sequence of skills could refute it."""
    result = verdict_on(answer, two_tries_task())
    assert result.status == "wrong"
    assert message in result.reason
    assert (result.cost, result.lower_bound, result.steps) == (None, None, ())


def test_that_nothing_is_certain_to_arrive_can_be_proved_under_chance():
    """Where one slip in ten is for good."""
    facts = Facts(("slipped", "done"))
    outcomes = [(0.9, ("done",), ()), (0.1, ("slipped",), ())]
    skills = [situations.make_skill(facts, "try", forbids=("slipped", "done"), outcomes=outcomes)]
    task = situations.make_task(facts, skills, goal=("done",))
    assert verdict_on(claims(None, proved=True), task).status == "infeasible"


def test_a_proof_under_chance_is_not_granted_where_the_model_is_too_large(monkeypatch):
    """The claim is not refuted either: solved, or unsolved."""
    monkeypatch.setattr(referee, "CHANCE_STATES", 1)
    for skill, status in ((TRY, "solved"), (None, "unsolved")):
        bound = None if skill is None else 8.0
        result = verdict_on(claims(skill, bound, proved=True), two_tries_task())
        assert result.status == status
        assert "a proof under chance is audited up to 1 states" in result.reason


def test_a_proof_under_chance_is_not_granted_where_asking_is_dear():
    """Its audit would ask about every state."""

    def expensive(task):
        return [situations.fake_back_end(task, expensive=True)]

    result = verdict_on(
        claims(SURE, 5.0, proved=True), two_tries_task(), situations.FakeSetup(make=expensive)
    )
    assert (result.status, result.lower_bound) == ("solved", 5.0)
    assert result.reason == "where checks are expensive, a proof under chance is not audited"


def test_a_proof_under_chance_is_not_granted_where_the_audit_meets_an_unknown():
    """Of which the solver, which asked nothing, knew nothing."""

    def undecided_about_sure(task):
        def answer(skill, state):
            return Verdict.unknown("too slow") if skill.name == "sure" else Verdict.feasible()

        return [situations.fake_back_end(task, answer)]

    setup = situations.FakeSetup(make=undecided_about_sure)
    result = verdict_on(claims(TRY, 8.0, proved=True), two_tries_task(), setup)
    assert result.status == "solved"
    assert "unknown" in result.reason


@pytest.mark.parametrize("solver", ["value-iteration", "policy-iteration"])
@pytest.mark.parametrize("failure", [0.0, 0.1, 0.5, 0.9])
def test_the_dynamic_programs_are_believed_on_boards_whose_grasps_fail(solver, failure):
    """Their proofs stand, and chance makes nothing cheaper."""
    content = lid_content()
    content["robot"]["look_m"] = [0.3, 0.0]
    content["parts"]["fuse"]["grasp_failure"] = failure
    result = solve(situations.assembly(content), solver)
    sure = solve(situations.assembly(lid_content()))
    assert result.status == "optimal"
    # To try again at once, home and back, is one of the policies.
    more = 2 * math.dist((0.4, 0.2), (0.3, 0.0)) * failure / (1 - failure)
    assert sure.cost - 1e-9 <= result.cost <= sure.cost + more + 1e-9


# Claims held together.


def result_of(solver, status, cost=None, lower_bound=None):
    return Result(
        "t", "assembly", "", solver, 0, "p", "c", status, cost=cost, lower_bound=lower_bound
    )


def test_a_bound_that_another_solvers_plan_refutes_is_wrong():
    """So is a proof of optimality, and one that there is no plan."""
    results = [
        result_of("lucky", Status.SOLVED, 3.0),
        result_of("liar", Status.OPTIMAL, 4.0, 4.0),
        result_of("denier", Status.INFEASIBLE),
        result_of("modest", Status.SOLVED, 5.0, 2.5),
        result_of("lost", Status.UNSOLVED, None, 3.5),
        result_of("absent", Status.REFUSED),
    ]
    judged = cross_examine(results)
    statuses = ["solved", "wrong", "wrong", "solved", "wrong", "refused"]
    assert statuses == [result.status for result in judged]
    assert judged[1].reason == "claims that no plan costs less than 4.0; lucky found one of 3.0"
    assert [r for r, status in zip(judged, statuses, strict=True) if status != "wrong"] == [
        r for r, status in zip(results, statuses, strict=True) if status != "wrong"
    ]


def test_claims_that_agree_are_left_alone():
    """Also where nobody found a plan."""
    for results in (
        [result_of("a", Status.OPTIMAL, 3.0, 3.0), result_of("b", Status.SOLVED, 3.0, 1.0)],
        [result_of("a", Status.INFEASIBLE), result_of("b", Status.UNSOLVED)],
        [],
    ):
        assert cross_examine(results) == results


# Solvers that do not stop, or break.


def test_a_solver_that_ignores_the_stop_is_cut_off_and_its_incumbent_kept(monkeypatch):
    """By the model, once it has been told for long enough."""
    monkeypatch.setattr(stops, "_GRACE_S", 0.05)

    def never_ends(solver, model):
        solver.stop.incumbent(Plan(DEAR, 4.0))
        solver.stop.bound(1.5)
        while True:
            model.transitions(model.initial)

    begin_s = time.monotonic()
    result = verdict_on(never_ends, stop=Stop(time_limit_s=0.1))
    assert time.monotonic() - begin_s < 5
    assert (result.status, result.cost, result.lower_bound) == ("solved", 4.0, 1.5)
    assert result.reason == "time limit"


def test_a_cut_off_solver_is_not_believed_either(monkeypatch):
    """Its incumbent is replayed like any plan."""
    monkeypatch.setattr(stops, "_GRACE_S", 0.0)

    def never_ends(solver, model):
        solver.stop.incumbent(Plan(DEAR, 1.0))
        while True:
            model.transitions(model.initial)

    result = verdict_on(never_ends, stop=Stop(time_limit_s=0.01))
    assert result.status == "wrong"


def boom(solver, model):
    raise ZeroDivisionError("no states")


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (boom, "The solver 'fake' failed: ZeroDivisionError: no states"),
        (lambda solver, model: None, "The solver 'fake' returned NoneType, not a Solution"),
        (lambda solver, model: ["to_a"], "The solver 'fake' returned list, not a Solution"),
        (
            lambda solver, model: Solution(Plan([0, 1, 3])),
            "The solver 'fake' failed: ValueError: A plan is a tuple of skill names",
        ),
        (
            lambda solver, model: Solution(None, math.nan),
            "The solver 'fake' failed: ValueError: A lower bound must be a number",
        ),
        (
            lambda solver, model: solver.stop.bound(math.nan),
            "The solver 'fake' failed: ValueError: A lower bound must be a number",
        ),
    ],
)
def test_a_solver_that_breaks_is_named(act, message):
    """In one sentence, as its author's to repair."""
    with pytest.raises(SkillplanError) as caught:
        verdict_on(act)
    assert str(caught.value).startswith(message)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("rubbish", ["to_a", 7, {"a": 1}.items()])
def test_what_is_neither_plan_nor_policy_is_wrong(rubbish):
    """The referee makes nothing of it."""
    assert verdict_on(Solution(rubbish)).status == "wrong"


def test_a_solver_that_fails_to_say_whether_it_serves_is_named():
    """A refusal is a sentence, not an exception."""
    solver = situations.solver_that(lambda solver, model: Solution())
    type(solver).refuses = lambda self, model: 1 / 0
    with pytest.raises(SkillplanError, match="The solver 'fake' failed: ZeroDivisionError"):
        solve(situations.two_roads_task(), solver, BARE)


def test_a_back_end_that_breaks_is_not_blamed_on_the_solver():
    """The error names the back end and has an exit code of its own."""

    def broken(task):
        return [situations.fake_back_end(task, lambda skill, state: 1 / 0, name="wobbly")]

    with pytest.raises(BackEndError, match="'wobbly' failed"):
        solve(situations.two_roads_task(), "exact", situations.FakeSetup(make=broken))


def test_the_referee_queries_cheap_back_ends_again_but_no_expensive_ones():
    """A cheap back end that changes its mind is caught; an expensive one is not asked twice."""
    for expensive in (False, True):
        created = []

        def counting(task, expensive=expensive, made=created):
            made.append(
                situations.fake_back_end(
                    task, Verdict.feasible(), name="counted", expensive=expensive
                )
            )
            return [made[-1]]

        result = solve(situations.two_roads_task(), "exact", situations.FakeSetup(make=counting))
        assert result.status == "optimal"
        (back_end,) = created
        assert (len(back_end.asked) == result.checks) is expensive
        assert len(back_end.asked) >= result.checks > 0


@pytest.mark.slow(reason="walks the board by both solvers; every run proves so of the lid task")
def test_a_config_changed_into_one_without_a_plan_is_proved_so():
    """By both solvers, and granted by the referee: a chart against the geometry."""
    content = situations.config_content("inverter_board")
    content["chart"] = [{"before": "brace", "after": ["transformer"]}]
    task = situations.assembly(content)
    setup = Setup(collision=("precedence", "aabb"))
    for solver in ("exact", "exhaustive"):
        assert solve(task, solver, setup).status == "infeasible"


# The referee believes no claim, and a solution that cannot be read is a failure of its solver.


def cheapest() -> tuple[tuple[str, ...], float]:
    """Return the best plan of the task of two roads and what it costs."""
    result = solve(situations.two_roads_task(), "exact")
    assert result.cost is not None
    return tuple(step.skill for step in result.steps), result.cost


class TestPlainValues:
    @pytest.mark.parametrize("claimed", [0.0, math.nan, math.inf, -1.0])
    def test_a_wrong_cost_is_refuted(self, claimed):
        """The referee replays the plan and adds its costs up itself."""
        skills, _ = cheapest()
        lie = situations.solver_that(lambda solver, model: Solution(Plan(skills, claimed)))
        result = solve(situations.two_roads_task(), lie)
        assert "wrong" == result.status
        assert "the solver says its plan costs" in result.reason

    def test_a_false_bound_proves_nothing(self):
        """A bound below the cost of the plan does not prove it to be the best."""
        skills, cost = cheapest()
        lie = situations.solver_that(
            lambda solver, model: Solution(Plan(skills, cost), cost / 2, True)
        )
        result = solve(situations.two_roads_task(), lie)
        assert "wrong" == result.status
        assert f"with the bound {cost / 2!r}" in result.reason

    def test_numbers_of_numpy_become_those_of_python(self):
        """The messages and the JSON document show plain figures."""
        skills, cost = cheapest()
        honest = situations.solver_that(
            lambda solver, model: Solution(Plan(skills, np.float64(cost)), np.float64(cost), True)
        )
        result = solve(situations.two_roads_task(), honest)
        assert ("optimal", cost) == (result.status, result.cost)
        assert float is type(result.lower_bound)

    @pytest.mark.parametrize(
        ("solution", "words"),
        [
            (lambda: Solution(Plan(("a",), "cheap")), "its cost is a str, not a number"),
            (lambda: Solution(lower_bound=[1]), "cannot be read|must be a number|real number"),
            (lambda: Solution(None, None, "yes"), "its claim of a proof is 'yes'"),
            (lambda: Solution(trace={"figure": math.nan}), "its trace is not JSON"),
        ],
    )
    def test_what_is_no_claim_is_a_failure(self, solution, words):
        """The solver has failed, in words."""
        from skillplan.errors import SolverError

        with pytest.raises(SolverError, match=words):
            solve(
                situations.two_roads_task(),
                situations.solver_that(lambda solver, model: solution()),
            )
