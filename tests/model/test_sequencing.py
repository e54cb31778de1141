"""The export of a model as a sequential ordering problem."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, event, given, reject, settings
from hypothesis import strategies as st

import situations
from example_count import examples
from sequencing_cases import changed_board, cheapest_order, sound, strict_back_end
from skillplan.chart import closure, derive_chart
from skillplan.errors import NotASequencing, OptionError
from skillplan.model import SequencingProblem, replay
from skillplan.pipeline import Setup, load_problem, make_model, solve
from skillplan.records import Status
from skillplan.task import Condition, Outcome, Verdict
from skillplan.testing import lid_task, shut_box_task
from thinned import slow_case


def model_of(config, *detectors):
    task = load_problem(f"configs/{config}.yaml").task
    return make_model(task, Setup(collision=detectors))


@pytest.mark.parametrize(
    ("config", "detector"),
    [
        ("inverter_board", "precedence"),
        ("inverter_board", "aabb"),
        ("motor_drive", "precedence"),
        slow_case("motor_drive", "aabb", reason="the largest; by chart in every run"),
    ],
)
def test_its_best_order_costs_what_exact_search_proves(config, detector):
    """Two methods that share nothing but the model prove the same optimum."""
    model = model_of(config, detector)
    cost, order = cheapest_order(SequencingProblem.from_model(model))
    proved = solve(model.task, "exact", Setup(collision=(detector,)))
    assert proved.cost == pytest.approx(cost, abs=1e-9)
    assert len(order) == len(model.task.operations)


def test_the_plan_of_an_order_costs_what_the_problem_says():
    """Jobs and tool changes, replayed in the model, add up to the order's cost."""
    model = model_of("motor_drive", "precedence")
    problem = SequencingProblem.from_model(model)
    _, order = cheapest_order(problem)
    walked = replay(model, [model.task.skill(name) for name in problem.plan(order)])
    assert walked.complete
    assert walked.cost == pytest.approx(problem.cost(order), abs=1e-9)


def test_exactly_the_orders_that_respect_the_precedence_are_feasible():
    """On the lid task every order of the jobs is replayed."""
    model = make_model(lid_task(), Setup(collision=("aabb",)))
    problem = SequencingProblem.from_model(model)
    for order in itertools.permutations(range(len(problem.jobs))):
        place = {job: position for position, job in enumerate(order)}
        allowed = all(place[i] < place[j] for i, j in problem.precedence)
        walked = replay(model, [model.task.skill(name) for name in problem.plan(order)])
        assert walked.complete == allowed, order


def test_a_stack_is_part_of_the_precedence():
    """The bridge lies on the heat sink at the start and has to go first."""
    problem = SequencingProblem.from_model(model_of("motor_drive", "aabb"))
    pair = (problem.jobs.index("bridge"), problem.jobs.index("heat_sink"))
    assert pair in problem.precedence


def test_a_task_without_any_plan_is_refused_in_words():
    """The message names the elements whose order runs in a circle."""
    model = make_model(shut_box_task(), Setup(collision=("precedence", "aabb")))
    with pytest.raises(NotASequencing, match=r"no order, \w+ before \w+"):
        SequencingProblem.from_model(model)


def test_chance_is_refused_in_words():
    """A skill with two outcomes cannot be one job among others."""
    task = lid_task()
    pick = task.skills[0]
    nothing = task.facts.none
    slippery = replace(
        pick,
        outcomes=(
            Outcome(0.5, pick.prediction.add, pick.prediction.delete),
            Outcome(0.5, nothing, nothing),
        ),
    )
    model = make_model(task.replace(skills=(slippery, *task.skills[1:])))
    with pytest.raises(NotASequencing, match="several outcomes"):
        SequencingProblem.from_model(model)


def test_shapes_that_do_not_fit_are_refused():
    """Every check of the type is tripped."""
    problem = SequencingProblem.from_model(make_model(lid_task()))
    with pytest.raises(ValueError, match="costs"):
        replace(problem, first=np.zeros(1))
    with pytest.raises(ValueError, match="unknown job"):
        replace(problem, precedence=frozenset({(0, 99)}))


BOARDS = ["inverter_board", "motor_drive", "relay_rail", "battery_module", "sensor_stack"]
INSTANCES = situations.CONFIGS.parent / "tests" / "instances" / "sop"


def named_pairs(problem):
    return {(problem.jobs[i], problem.jobs[j]) for i, j in problem.precedence}


@pytest.mark.parametrize("detector", ["precedence", "aabb"])
@pytest.mark.parametrize("config", BOARDS)
def test_its_precedence_is_that_of_the_derived_chart_at_fewer_questions(config, detector):
    """The chart is worked out without knowing what the jobs are."""
    model = model_of(config, detector)
    problem = SequencingProblem.from_model(model)
    other = model_of(config, detector).feasibility
    chart = derive_chart(other)
    assert closure(named_pairs(problem)) == closure((r.before, r.after) for r in chart.relations)
    queries = model.feasibility
    assert queries.checks + queries.hits < other.checks + other.hits


def served(task, setup):
    """Return the model of a task, unless boxes refuse to judge its round parts."""
    try:
        return make_model(task, setup)
    except OptionError:
        event("boxes refuse")
        reject()


@settings(max_examples=examples(150))
@given(
    content=st.one_of(
        situations.small_assemblies(), situations.crowded_assemblies(odd_turns=False)
    ),
    charted=st.booleans(),
)
def test_on_random_boards_its_precedence_is_that_of_the_derived_chart(content, charted):
    """Wherever the chart says that there is an order and nothing but an order."""
    task = situations.assembly(content)
    setup = Setup(collision=("precedence",) if charted and task.chart else ("aabb",))
    chart = derive_chart(served(task, setup).feasibility)
    assume(not (chart.impossible or chart.undecided or chart.conditional or chart.cycle))
    try:
        problem = SequencingProblem.from_model(make_model(task, setup))
    except NotASequencing as error:
        # What is refused all the same is no matter of the order of the elements.
        other_matters = ("depends on what has been done", "nothing leads to")
        message = any(words in str(error) for words in other_matters)
    else:
        pairs = named_pairs(problem)
        message = closure(pairs) == closure((r.before, r.after) for r in chart.relations)
    assert message


def big_board(parts, lines):
    """Return the content of a board without any geometry that matters, and with a long chart."""
    names = [f"part_{i}" for i in range(parts)]
    where = [[0.3 + 0.004 * i, 0.003 * (i * 7 % 50)] for i in range(parts)]
    return {
        "kind": "assembly",
        "name": "big",
        "robot": {"home_m": [0.3, 0.0], "reach_m": 2.0},
        "tools": {f"tool_{i}": {"holder_m": [0.2, 0.1 * i]} for i in range(3)},
        "initial_tool": "tool_0",
        "tool_change": {"style": "separate"},
        "parts": {
            name: {
                "tool": f"tool_{i % 3}",
                "size_m": [0.002, 0.002, 0.002],
                "start_m": [where[i][0], where[i][1] - 0.3],
                "goal_m": where[i],
            }
            for i, name in enumerate(names)
        },
        "chart": [
            {"before": name, "after": names[i + 1 : i + 1 + lines]}
            for i, name in enumerate(names[:-1])
        ],
        "step_limit": 6 * parts,
    }


def test_a_big_board_takes_about_one_check_a_skill_and_line_of_its_chart():
    """Neither pairs of parts nor sets of them are gone through."""
    task = situations.assembly(big_board(60, 5))
    model = make_model(task, Setup(collision=("precedence",)))
    problem = SequencingProblem.from_model(model)
    lines = len(task.chart)
    assert len(problem.precedence) == lines
    assert model.feasibility.checks + model.feasibility.hits < 2 * (lines + len(task.skills))


def test_a_sop_file_is_recognised_as_what_it_is():
    """Costs are the file's, coming before is its own, and the last node comes last."""
    task = load_problem(INSTANCES / "ESC07.sop").task
    model = make_model(task)
    problem = SequencingProblem.from_model(model)
    assert problem.jobs == tuple(task.operations)
    assert problem.paths == {}
    cost, order = cheapest_order(problem)
    assert cost == 2125
    assert order[-1] == len(problem.jobs) - 1
    assert replay(model, [task.skill(name) for name in problem.plan(order)]).cost == cost
    # One question a skill: nothing but preconditions stands in the way.
    assert model.feasibility.checks == len(task.skills)


def test_a_plan_gives_its_order_back():
    """Tool changes between jobs are passed over; what is no run of jobs has no order."""
    problem = SequencingProblem.from_model(model_of("motor_drive", "aabb"))
    _, order = cheapest_order(problem)
    plan = problem.plan(order)
    assert problem.order(plan) == order
    assert problem.order(plan[:-1]) is None
    assert problem.order(plan + problem.skills[order[-1]]) is None
    swapped = list(plan)
    at = swapped.index("place(housing)")
    swapped[at], swapped[at + 1] = swapped[at + 1], swapped[at]
    assert problem.order(swapped) is None


def test_an_order_whose_plan_is_too_long_does_not_fit():
    """An order knows nothing of the step limit."""
    problem = SequencingProblem.from_model(model_of("motor_drive", "aabb"))
    _, order = cheapest_order(problem)
    length = len(problem.plan(order))
    assert replace(problem, step_limit=length).fits(order)
    assert not replace(problem, step_limit=length - 1).fits(order)


def refusal(task, *answers):
    """Return why a task is refused where fakes answer so."""
    setup = situations.FakeSetup(
        make=lambda task: [situations.fake_back_end(task, answer) for answer in answers]
    )
    with pytest.raises(NotASequencing) as refused:
        SequencingProblem.from_model(make_model(task, setup))
    return str(refused.value)


def board_task(**changes):
    return situations.assembly({**situations.config_content("inverter_board"), **changes})


def without_goal(task, element):
    left = task.goal.requires - task.facts.of(task.operations[element])
    return task.replace(goal=Condition(left, task.facts.none))


def test_an_element_that_is_only_needed_is_a_job_too():
    """The goal does not ask for the circuit board, on which everything is placed."""
    task = without_goal(board_task(), "pcb")
    setup = Setup(collision=("precedence",))
    problem = SequencingProblem.from_model(make_model(task, setup))
    assert "pcb" in problem.jobs
    cost, _ = cheapest_order(problem)
    assert solve(task, "exact", setup).cost == pytest.approx(cost, abs=1e-6)


def test_an_element_that_nothing_needs_is_left_out():
    """No way that is shorter leads past it."""
    task = without_goal(board_task(), "clock")
    setup = Setup(collision=("precedence",))
    problem = SequencingProblem.from_model(make_model(task, setup))
    assert "clock" not in problem.jobs
    cost, _ = cheapest_order(problem)
    assert solve(task, "exact", setup).cost == pytest.approx(cost, abs=1e-6)


def test_an_element_that_may_pay_without_being_asked_for_is_refused():
    """Placing it costs nothing and takes the arm where it has to go."""
    task = without_goal(board_task(), "clock")
    skills = [
        replace(skill, cost=situations.make_skill(task.facts, "free", cost=0.0).cost)
        if skill.name in ("pick(clock)", "place(clock)")
        else skill
        for skill in task.skills
    ]
    assert "clock is not in the goal, and doing it might make a plan cheaper" in refusal(
        task.replace(skills=tuple(skills))
    )


def test_an_element_that_is_done_from_the_start_is_no_job():
    """The others are put into order."""
    task = board_task()
    started = task.initial - task.facts.of("at_start(pcb)") | task.facts.of("placed(pcb)")
    task = task.replace(initial=started)
    setup = Setup(collision=("precedence",))
    problem = SequencingProblem.from_model(make_model(task, setup))
    assert "pcb" not in problem.jobs
    cost, _ = cheapest_order(problem)
    assert solve(task, "exact", setup).cost == pytest.approx(cost, abs=1e-6)


def test_two_ways_of_doing_an_element_are_refused():
    """Which of them is best depends on where the arm comes from."""
    task = board_task()
    other = replace(task.skill("place(clock)"), name="throw(clock)")
    assert "2 skills bring about placed(clock)" in refusal(
        task.replace(skills=(*task.skills, other))
    )


def test_a_skill_that_may_come_between_pick_and_place_is_refused():
    """The tool might be changed with a part in the hand."""
    task = board_task()
    load = task.skill("load(screwdriver)")
    anywhere = Condition(
        load.precondition.requires - task.facts.of("hand_free"), load.precondition.forbids
    )
    skills = tuple(replace(s, precondition=anywhere) if s is load else s for s in task.skills)
    assert "load(screwdriver) may come between pick(" in refusal(task.replace(skills=skills))


def test_a_cost_of_which_nothing_is_known_is_refused():
    """It may depend on everything."""

    class Odd:
        def at(self, state):
            return float(len(state))

        def least(self, true_bits, false_bits):
            return 0.0

    task = board_task()
    skills = (replace(task.skills[0], cost=Odd()), *task.skills[1:])
    assert "nothing is known of what the cost of pick(" in refusal(task.replace(skills=skills))


def test_what_a_back_end_does_not_know_is_refused():
    """An order that rests on it would be a guess."""
    message = refusal(board_task(), lambda skill, state: Verdict.unknown("too dark"))
    assert "could not be worked out" in message or "is unknown" in message


def test_a_verdict_that_depends_on_where_the_arm_comes_from_is_refused():
    """No relation of elements tells that."""
    task = board_task()

    def rule(skill, state):
        here = task.facts.of("at(home)")
        if skill.name != "pick(pcb)":
            return Verdict.feasible(task.facts.none, task.facts.none)
        if "at(home)" in state:
            return Verdict.infeasible("too near", here, task.facts.none)
        return Verdict.feasible(task.facts.none, here)

    assert "pick(pcb) depends on where the arm comes from: at(home)" in refusal(task, rule)


def test_one_of_two_supports_is_no_precedence_and_refused():
    """Either would do, which no relation says."""
    task = board_task()
    supports = ("placed(switch_1)", "placed(switch_2)")

    def rule(skill, state):
        if skill.name != "place(brace)":
            return Verdict.feasible(task.facts.none, task.facts.none)
        there = [fact for fact in supports if fact in state]
        if there:
            return Verdict.feasible(task.facts.of(there[0]), task.facts.none)
        return Verdict.infeasible("nothing beneath", task.facts.none, task.facts.of(*supports))

    assert "place(brace) depends on more than the order of parts" in refusal(task, rule)


@settings(max_examples=examples(150))
@given(
    content=st.one_of(
        situations.small_assemblies(), situations.crowded_assemblies(odd_turns=False)
    ),
    detectors=st.sampled_from([("aabb",), ("precedence", "aabb"), ("precedence",)]),
)
def test_it_is_refused_or_exactly_the_orders_it_allows_are_feasible(content, detectors):
    """On random assemblies, every order of the jobs is replayed in the model."""
    task = situations.assembly(content).replace(step_limit=100)
    if not task.chart:
        detectors = ("aabb",)
    model = served(task, Setup(collision=detectors))
    try:
        problem = SequencingProblem.from_model(model)
    except NotASequencing:
        event("refused")
        return
    assume(len(problem.jobs) <= 5)
    event("recognised")
    for order in itertools.permutations(range(len(problem.jobs))):
        place = {job: position for position, job in enumerate(order)}
        allowed = all(place[i] < place[j] for i, j in problem.precedence)
        allowed = allowed and math.isfinite(problem.cost(order))
        walked = replay(model, [model.task.skill(name) for name in problem.plan(order)])
        assert walked.complete == allowed, order
        if allowed:
            assert walked.cost == pytest.approx(problem.cost(order), abs=1e-9)


# The best order of the jobs is the best plan of the model, or the model is refused.


def check_against_exact_search(task, setup):
    """Compare the best order with what exact search proves, and replay its plan."""
    model = make_model(task, setup)
    try:
        problem = SequencingProblem.from_model(model)
    except NotASequencing as error:
        event("refused: " + str(error).partition("problem: ")[2][:60])
        return
    proved = solve(task, "exact", setup)
    best = cheapest_order(problem)
    event(f"recognised, {proved.status}")
    if best is None:
        assert proved.status is Status.INFEASIBLE
        return
    cost, order = best
    if not problem.fits(order):
        # The bound holds all the same.
        assert proved.cost is None or proved.cost >= cost - 1e-9
        return
    assert proved.status is Status.OPTIMAL
    assert proved.cost == pytest.approx(cost, abs=1e-6)
    plan = problem.plan(order)
    walked = replay(model, [task.skill(name) for name in plan])
    assert walked.complete
    assert walked.cost == pytest.approx(problem.cost(order), abs=1e-9)
    assert problem.order(plan) == order
    assert problem.order([step.skill for step in proved.steps]) is not None


@settings(max_examples=examples(100))
@given(
    content=st.one_of(
        situations.small_assemblies(), situations.crowded_assemblies(odd_turns=False)
    ),
    detectors=st.sampled_from([("aabb",), ("precedence", "aabb"), ("precedence",)]),
)
def test_the_best_order_of_a_board_is_its_best_plan(content, detectors):
    """Boards with feeders, stacks, any tool change, collisions and tight step limits."""
    assume(len(content["parts"]) + len(content["screws"]) <= 5)
    task = situations.assembly(content)
    check_against_exact_search(task, Setup(collision=detectors if task.chart else ("aabb",)))


@settings(max_examples=examples(200))
@given(content=situations.small_assemblies(), seed=st.integers(0, 2**32), changes=st.integers(1, 3))
def test_what_is_almost_a_board_is_refused_or_its_best_order_is_its_best_plan(
    content, seed, changes
):
    """Skills that undo, repeat or stand in for others, odd costs, elements left out of the goal."""
    task = changed_board(content, seed, changes)
    assume(sound(task))
    check_against_exact_search(task, situations.FakeSetup(make=lambda task: []))


@settings(max_examples=examples(200))
@given(content=situations.small_assemblies(), seed=st.integers(0, 2**32), changes=st.integers(0, 1))
def test_whatever_back_ends_rule_the_best_order_is_the_best_plan(content, seed, changes):
    """Verdicts that rest on any facts, also on such as no order decides about."""
    task = changed_board(content, seed, changes)
    assume(sound(task))
    check_against_exact_search(
        task, situations.FakeSetup(make=lambda task: [strict_back_end(task, seed)])
    )
