"""A search that starts from a plan: it knows of it, and is never worse."""

import pytest
from hypothesis import given

from situations import make_skill, make_task, retry_task, small_tasks, two_roads_task
from skillplan.errors import OptionError
from skillplan.pipeline import solve
from skillplan.records import Status
from skillplan.solvers import Plan, Policy, Solution, Solver, Stop

CHEAP = Plan(("to_a", "a_to_b", "finish"), 3.0)
DEAR = Plan(("to_b", "finish"), 4.0)


class Saying(Solver):
    """Returns what it is told to, and keeps what it knew before."""

    name = "saying"

    def __init__(self, answer):
        super().__init__()
        self.answer = answer
        self.knew = None

    def solve(self, model, *, seed=0):
        self.knew = self.stop.best
        return self.answer(model) if callable(self.answer) else self.answer


def skills(result):
    return tuple(step.skill for step in result.steps)


def test_the_solver_knows_the_plan_and_what_it_costs():
    """Before it begins; what the plan itself says of its cost does not count."""
    solver = Saying(Solution(CHEAP))
    solve(two_roads_task(), solver, start=Plan(DEAR.skills, 99.0))
    assert solver.knew == DEAR


@pytest.mark.parametrize(
    "answer",
    [
        Solution(DEAR),
        Solution(Plan(DEAR.skills)),
        Solution(None),
        Solution(Plan(("to_a",))),
        lambda model: Solution(Policy({})),
        lambda model: Solution(
            Policy(
                {
                    model.initial: model.task.skill("to_b"),
                    model.task.facts.of("b"): model.task.skill("finish"),
                }
            )
        ),
    ],
    ids=["costlier", "of no named cost", "nothing", "half a plan", "no policy", "costlier policy"],
)
def test_nothing_worse_is_returned(answer):
    """Whatever the solver is and however it answers."""
    result = solve(two_roads_task(), Saying(answer), start=CHEAP)
    assert (result.status, result.cost, skills(result)) == (Status.SOLVED, 3.0, CHEAP.skills)
    assert result.trace["start"] == "from a plan of 3.00000 J"


def test_what_is_better_is_returned():
    """And so is the solver's own plan of the same cost."""
    result = solve(two_roads_task(), Saying(Solution(CHEAP)), start=DEAR)
    assert skills(result) == CHEAP.skills
    result = solve(two_roads_task(), Saying(Solution(DEAR)), start=DEAR)
    assert skills(result) == DEAR.skills


def test_the_solvers_bound_is_kept():
    """Together with the plan that was there before."""
    result = solve(two_roads_task(), Saying(Solution(DEAR, 2.5)), start=CHEAP)
    assert (result.cost, result.lower_bound, result.bound_method) == (3.0, 2.5, "saying")


@pytest.mark.parametrize("claim", [Solution(DEAR, 4.0, proved=True), Solution(None, proved=True)])
def test_a_claim_that_the_plan_refutes_is_wrong(claim):
    """It is not covered up."""
    assert solve(two_roads_task(), Saying(claim), start=CHEAP).status is Status.WRONG


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        (("to_a", "finish"), "fails at step 2 (finish): precondition: needs b"),
        (("to_a",), "fails at the end: goal: the goal is not reached"),
        ((), "fails at the end: goal: the goal is not reached"),
    ],
)
def test_a_plan_that_does_not_hold_is_not_used(plan, why):
    """The search goes on without it, and the trace says why."""
    solver = Saying(Solution(DEAR))
    result = solve(two_roads_task(), solver, start=Plan(plan))
    assert solver.knew is None
    assert result.cost == 4.0
    assert why in result.trace["start"]


def test_a_plan_of_other_skills_is_refused():
    """It cannot be meant."""
    with pytest.raises(OptionError, match="fly"):
        solve(two_roads_task(), "exact", start=Plan(("fly",)))


def test_under_chance_it_is_refused():
    """No fixed sequence is a plan there."""
    with pytest.raises(OptionError, match="of no use under chance"):
        solve(retry_task(0.5), "value-iteration", start=Plan(("try",)))


@pytest.mark.parametrize("start", [CHEAP, DEAR])
def test_exact_search_proves_the_same_optimum_from_any_plan(start):
    """And says so."""
    result = solve(two_roads_task(), "exact", start=start)
    assert (result.status, result.cost) == (Status.OPTIMAL, 3.0)


@pytest.mark.slow(reason="searches twelve parts twice; other warm starts in every run")
def test_exact_search_looks_at_less_from_a_good_plan(motor_drive_task):
    """What costs as much as the plan is not kept."""
    cold = solve(motor_drive_task, "exact")
    plan = Plan(skills(cold), cold.cost)
    warm = solve(motor_drive_task, "exact", start=plan)
    assert (warm.status, warm.cost) == (Status.OPTIMAL, pytest.approx(cold.cost, abs=1e-12))
    assert warm.trace["generated"] < cold.trace["generated"]


@given(small_tasks())
def test_a_start_changes_no_optimum(task):
    """On any task, and from the costliest plan that brute force meets first."""
    cold = solve(task, "exact")
    if cold.status is not Status.OPTIMAL:
        return
    stop = Stop()
    first = []
    keep = stop.incumbent
    # The first is all that is wanted: to enumerate the rest would take most of a minute.
    stop.incumbent = lambda plan: (first.append(plan), keep(plan), stop.interrupt())
    solve(task, "exhaustive", stop=stop)
    warm = solve(task, "exact", start=first[0])
    assert warm.status is Status.OPTIMAL
    assert warm.cost == pytest.approx(cold.cost, abs=1e-9)
    assert len(warm.steps) <= len(cold.steps)


def test_an_empty_plan_serves_a_task_that_is_done():
    """At no cost."""
    facts = two_roads_task().facts
    rest = make_skill(facts, "rest", add=("a",))
    task = make_task(facts, [rest], initial=("done",), goal=("done",))
    assert solve(task, "exact", start=Plan(())).cost == 0.0
