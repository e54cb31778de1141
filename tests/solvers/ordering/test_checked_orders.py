"""Sequencing where the way between two parts matters: orders are checked one by one."""

import random

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

import situations
from example_count import examples
from situations import fake_back_end, model_of
from skillplan.domains.assembly import AssemblyDomain
from skillplan.errors import NotASequencing
from skillplan.model import SequencingProblem, replay
from skillplan.pipeline import load_problem, make_solver
from skillplan.solvers import Stop
from skillplan.task import Verdict


def rule_by(task, clauses, **attributes):
    """Return a back end that refuses a skill where all facts of one of its clauses are so."""

    def rule(skill, state):
        present, absent = set(), set()
        for clause in clauses.get(skill.name, ()):
            wrong = [name for name, holds in clause if (name in state) != holds]
            if not wrong:
                present |= {name for name, holds in clause if holds}
                absent |= {name for name, holds in clause if not holds}
                facts = task.facts.of(*present), task.facts.of(*absent)
                return Verdict.infeasible("in the way", *facts)
            (present if wrong[0] in state else absent).add(wrong[0])
        return Verdict.feasible(task.facts.of(*present), task.facts.of(*absent))

    return fake_back_end(task, rule, **attributes)


def draw_clauses(task, seed, share):
    """Return clauses about where the arm comes from, and about one or two parts."""
    rng = random.Random(seed)
    places = [name for name in task.facts.names if name.startswith("at(")]
    parts = [name for name in task.facts.names if name.startswith(("placed", "fastened"))]
    clauses = {}
    for skill in task.skills:
        clauses[skill.name] = drawn = []
        while rng.random() < share:
            chosen = rng.sample(parts, min(len(parts), rng.randint(0, 2)))
            chosen += [rng.choice(places)] if rng.random() < 0.6 or not chosen else []
            drawn.append([(name, name in places or rng.random() < 0.6) for name in chosen])
    return clauses


@settings(max_examples=examples(150))
@given(
    content=situations.small_assemblies(),
    seed=st.integers(0, 2**32),
    share=st.sampled_from([0.1, 0.3, 0.5]),
)
def test_it_proves_what_exact_search_proves_wherever_paths_are_refused(content, seed, share):
    """Both say the same of random boards, also that there is no plan."""
    task = situations.assembly(content).replace(step_limit=200)
    clauses = draw_clauses(task, seed, share)
    solver = make_solver("portfolio", {})
    model = model_of(task, rule_by(task, clauses))
    try:
        SequencingProblem.from_model(model)
        event("every order is a plan")
    except NotASequencing:
        event("orders are checked" if solver.relax(model) is not None else "refused")
    if solver.refuses(model) is not None:
        return
    exact = make_solver("exact", {}).solve(model_of(task, rule_by(task, clauses)))
    solution = solver.solve(model)
    assert solution.proved
    assert (solution.plan is None) == (exact.plan is None)
    if exact.plan is not None:
        assert solution.plan.cost == pytest.approx(exact.plan.cost, abs=1e-6)
        walked = replay(model, [task.skill(name) for name in solution.plan.skills])
        assert walked.complete
        assert walked.cost == pytest.approx(solution.plan.cost, abs=1e-9)


def board():
    return load_problem("configs/inverter_board.yaml").task


def solve_by(task, clauses, name="portfolio"):
    return make_solver(name, {}).solve(model_of(task, rule_by(task, clauses)))


def test_a_path_that_is_refused_is_replaced_by_the_cheapest_other_one():
    """The arm may not come from where the best plan comes from."""
    task = board()
    free = solve_by(task, {})
    names = free.plan.skills
    first = next(name for name in names if name.startswith("pick("))
    later = next(name for name in names[names.index(first) + 1 :] if name.startswith("pick("))
    before = names[names.index(later) - 1]
    state = task.initial
    for name in names[: names.index(before) + 1]:
        state = task.skill(name).prediction.apply(state)
    place = next(fact for fact in state if fact.startswith("at("))
    clauses = {later: [[(place, True)]]}
    solution = solve_by(task, clauses)
    assert solution.proved
    assert solution.plan.cost == pytest.approx(solve_by(task, clauses, "exact").plan.cost)
    assert solution.plan.cost >= free.plan.cost - 1e-9


class LittleTime(Stop):
    """A stop that never ends a search, but reports that its time is almost over."""

    left_s = 0.0


def test_orders_are_checked_if_the_precedence_takes_too_much_of_the_time():
    """A plan is better than the proof that every order is one."""
    solver = make_solver("portfolio", {}, LittleTime())
    quick = make_solver("portfolio", {}, LittleTime())
    assert quick.problem(model_of(board(), rule_by(board(), {}))).jobs
    model = model_of(board(), rule_by(board(), {}, expected_s=0.01))
    with pytest.raises(NotASequencing, match="could not be worked out in the time"):
        solver.problem(model)
    solution = solver.solve(model)
    assert solution.proved
    assert solution.plan.cost == pytest.approx(solve_by(board(), {}).plan.cost)


class NoNode(Stop):
    """A stop that ends a search with its first bound, and keeps the costs of its plans."""

    def __init__(self):
        super().__init__()
        self.costs, self.has_bound = [], False

    def __call__(self):
        return self.has_bound or super().__call__()

    def bound(self, lower_bound, nodes=None):
        super().bound(lower_bound, nodes)
        self.has_bound = True

    def incumbent(self, plan):
        super().incumbent(plan)
        self.costs.append(plan.cost)


def obstructed_board(path, parts):
    """Return a random board, and clauses: each part is refused after one part, before another."""
    options = {"parts": parts, "density": 0.2, "tools": 2, "seed": 1}
    path.write_text(AssemblyDomain().generate(options))
    task = load_problem(path).task
    names = [name for name in task.facts.names if name.startswith("placed(")]
    rng, clauses = random.Random(1), {}
    for name in names:
        needed, obstacle, _ = rng.sample([other for other in names if other != name], 3)
        clauses[f"pick({name[7:-1]})"] = [[(needed, False), (obstacle, True)]]
    return task, clauses


def test_a_search_that_is_stopped_proves_nothing_wrong(tmp_path):
    """Wherever it is stopped: an order that was not checked is no cheapest plan."""
    task, clauses = obstructed_board(tmp_path / "board.yaml", 6)
    cost = solve_by(task, clauses, "exact").plan.cost
    is_proved = False
    for number in range(1, 200):
        solver = make_solver("portfolio", {}, situations.PatientStop(number))
        solution = solver.solve(model_of(task, rule_by(task, clauses)))
        assert (solution.lower_bound or 0.0) <= cost + 1e-9
        if solution.proved:
            is_proved = True
            assert solution.plan.cost == pytest.approx(cost)
    assert is_proved


def test_the_first_plan_is_improved_before_there_is_a_bound(tmp_path):
    """Its conflicts, and those of better orders, lead local search to a plan near the optimum."""
    task, clauses = obstructed_board(tmp_path / "board.yaml", 16)
    optimum = solve_by(task, clauses)
    stop = NoNode()
    make_solver("portfolio", {}, stop).solve(model_of(task, rule_by(task, clauses)))
    assert optimum.proved
    assert stop.costs[0] > 1.25 * optimum.plan.cost
    assert stop.costs[-1] < 1.03 * optimum.plan.cost


def test_one_of_two_supports_is_enough():
    """No precedence says so, but a conflict does."""
    task = board()
    parts = [name for name in task.facts.names if name.startswith("placed(")]
    last = parts[-1][len("placed(") : -1]
    clauses = {f"place({last})": [[(parts[0], False), (parts[1], False)]]}
    solution, exact = solve_by(task, clauses), solve_by(task, clauses, "exact")
    assert solution.proved
    assert solution.plan.cost == pytest.approx(exact.plan.cost)


def test_without_any_order_the_proof_is_that_there_is_none():
    """Each of two parts must come before the other, wherever the arm is."""
    task = board()
    one, other = [name for name in task.facts.names if name.startswith("placed(")][:2]
    clauses = {
        f"pick({one[7:-1]})": [[(other, False), ("at(home)", True)], [(other, False)]],
        f"pick({other[7:-1]})": [[(one, False)]],
    }
    solution = solve_by(task, clauses)
    assert solution.proved
    assert solution.plan is None
