"""The verdict on a skill with several ways, and which way is taken."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from audits import audit
from example_count import examples
from expensive_back_ends import CheapDetector, ExpensiveDetector, ExpensiveEngine
from situations import imagined_state
from skillplan.checks import (
    DiskVerdictCache,
    Feasibility,
    VerdictCache,
    VerdictFolder,
    list_queried_skills,
    recheck_kept,
)
from skillplan.errors import NotASequencing
from skillplan.model import SequencingProblem, SkillModel
from skillplan.solvers import ExactSolver, ExhaustiveSolver
from skillplan.task import VerdictStatus
from skillplan.testing import reachable_states
from way_boards import CLOSED, closing, drawer_task

GRASPS = [{"type": "suction"}, {"closing_axis": "y"}, {"closing_axis": "x"}]
TOP = "top closing along"
SUCTION, ALONG_Y, ALONG_X = f"{TOP} y by suction", f"{TOP} y by jaws", f"{TOP} x"


def feasibility_of(closed=CLOSED, **changes):
    """Return the checks of the drawer by the detector of what closes its directions."""
    task = drawer_task(**changes)
    return Feasibility(task, [closing(task, closed)])


def holding(task, *placed, part="drawer"):
    """Return the state in which a part has just been picked and others are placed."""
    state = task.initial
    for name in (*placed, part):
        state = task.skill(f"pick({name})").prediction.apply(state)
        if name != part:
            state = task.skill(f"place({name})").prediction.apply(state)
    return state


def verdict_of(feasibility, skill, state):
    return feasibility.verdict(feasibility.task.skill(skill), state)


def test_the_first_way_that_is_granted_is_taken():
    """Its evidence names the way, and what is against those before."""
    checks = feasibility_of()
    free = verdict_of(checks, "place(drawer)", holding(checks.task))
    assert (free.is_feasible, free.evidence) == (True, {"way": "along +x"})
    closed = verdict_of(checks, "place(drawer)", holding(checks.task, "left"))
    assert closed.is_feasible
    assert closed.evidence == {"way": "along -x", "refused": {"along +x": "runs into placed(left)"}}


def test_it_rests_on_the_facts_of_all_ways_that_were_looked_at():
    """And on what makes the skill applicable."""
    checks = feasibility_of()
    task = checks.task
    free = verdict_of(checks, "place(drawer)", holding(task))
    assert set(free.facts) == {"held(drawer)", "tool(hand)", "not placed(left)"}
    closed = verdict_of(checks, "place(drawer)", holding(task, "left"))
    expected = {"held(drawer)", "tool(hand)", "placed(left)", "not placed(right)"}
    assert set(closed.facts) == expected


def test_only_where_every_way_is_refused_is_it_infeasible():
    """The reason says why each is."""
    checks = feasibility_of()
    verdict = verdict_of(checks, "place(drawer)", holding(checks.task, "left", "right"))
    assert verdict.is_infeasible
    assert verdict.stage == "closing"
    assert verdict.reason == "along +x: runs into placed(left); along -x: runs into placed(right)"
    assert set(verdict.facts) == {"placed(left)", "placed(right)"}


def test_one_way_that_is_unknown_makes_it_unknown_where_none_is_granted():
    """A granted one goes before it, wherever it stands in the file."""
    closed = {**CLOSED, "place(drawer) along +x": ("?placed(left)",)}
    checks = feasibility_of(closed)
    by_the_other = verdict_of(checks, "place(drawer)", holding(checks.task, "left"))
    assert by_the_other.evidence["way"] == "along -x"
    neither = verdict_of(checks, "place(drawer)", holding(checks.task, "left", "right"))
    assert neither.status is VerdictStatus.UNKNOWN
    assert "nobody knows whether placed(left) is in the way" in neither.reason


def test_what_is_asked_of_back_ends_has_one_motion_and_a_name_of_its_own():
    """They never see a skill with ways."""
    task = drawer_task()
    detector = closing(task)
    Feasibility(task, [detector]).verdict(task.skill("place(drawer)"), holding(task, "left"))
    assert [name for name, _ in detector.asked] == [
        "place(drawer) along +x",
        "place(drawer) along -x",
    ]
    assert all(not skill.ways for skill in list_queried_skills(task))
    assert len(list_queried_skills(task)) == len(task.skills) + 1


def test_a_task_without_ways_is_asked_about_its_own_skills():
    """The very same objects."""
    task = drawer_task(insert_along=[0, 0, -1])
    assert list_queried_skills(task) is task.skills


def test_a_grasp_counts_only_if_it_is_free_at_start_and_goal():
    """Both skills take the first that is, whichever of them is asked."""
    closed = {
        f"place(drawer) along +x, grasp {SUCTION}": ("placed(left)",),
        f"place(drawer) along -x, grasp {SUCTION}": ("placed(left)",),
        f"pick(drawer) grasp {ALONG_Y}": ("placed(right)",),
    }
    checks = feasibility_of(closed, grasp=GRASPS)
    task = checks.task

    def ways(*placed):
        held = holding(task, *placed)
        lying = holding(task, *placed[:-1], part=placed[-1]) if placed else None
        before = task.initial
        if lying is not None:
            before = task.skill(f"place({placed[-1]})").prediction.apply(lying)
        pick = verdict_of(checks, "pick(drawer)", before)
        place = verdict_of(checks, "place(drawer)", held)
        return pick.evidence["way"], place.evidence["way"]

    assert ways() == (f"grasp {SUCTION}", f"along +x, grasp {SUCTION}")
    assert ways("left") == (f"grasp {ALONG_Y}", f"along +x, grasp {ALONG_Y}")
    assert ways("left", "right") == (f"grasp {ALONG_X}", f"along +x, grasp {ALONG_X}")


def test_a_part_that_no_grasp_can_both_take_and_leave_is_not_picked():
    """Its hand could not be freed again."""
    task = drawer_task(grasp=GRASPS[:2], insert_along=[0, 0, -1])
    names = [grasp.name for grasp in task.scene.body("drawer").grasps]
    closed = {
        f"place(drawer) grasp {names[0]}": ("placed(left)",),
        f"pick(drawer) grasp {names[1]}": ("placed(left)",),
    }
    checks = Feasibility(task, [closing(task, closed)])
    before = task.skill("place(left)").prediction.apply(holding(task, part="left"))
    verdict = verdict_of(checks, "pick(drawer)", before)
    assert verdict.is_infeasible
    assert set(verdict.facts) == {"placed(left)"}
    assert verdict_of(checks, "pick(drawer)", task.initial).is_feasible


def test_where_the_grasp_of_the_place_cannot_be_taken_from_here_another_is_no_answer():
    """The state after the pick does not tell where the arm came from: that is unknown."""
    task = drawer_task(grasp=GRASPS, insert_along=[0, 0, -1])
    closed = {f"pick(drawer) grasp {SUCTION}": ("at(home)",)}
    checks = Feasibility(task, [closing(task, closed)])
    verdict = verdict_of(checks, "pick(drawer)", task.initial)
    assert verdict.status is VerdictStatus.UNKNOWN
    assert verdict_of(checks, "place(drawer)", holding(task)).evidence["way"] == f"grasp {SUCTION}"


def test_explaining_names_the_way_and_shows_its_stages():
    """Where none is granted, those of all."""
    checks = feasibility_of()
    place = checks.task.skill("place(drawer)")
    granted = checks.stages(place, holding(checks.task, "left"))
    assert [verdict.stage for verdict in granted] == ["precondition", "ways", "closing"]
    assert granted[1].evidence["way"] == "along -x"
    denied = checks.stages(place, holding(checks.task, "left", "right"))
    assert [verdict.stage for verdict in denied] == ["precondition", "ways", "closing", "closing"]
    assert denied[1].is_infeasible


def test_the_skill_by_its_way_is_what_is_executed():
    """A skill with one motion is itself."""
    checks = feasibility_of()
    place = checks.task.skill("place(drawer)")
    taken = checks.taken(place, holding(checks.task, "left"))
    assert taken.name == "place(drawer) along -x"
    assert taken.motion == place.ways[1].motion
    pick = checks.task.skill("pick(drawer)")
    assert checks.taken(pick, checks.task.initial) is pick


def timed(task, seconds, closed=CLOSED):
    """Return a detector that also tells how long skills take, by name; others take a second."""

    def duration_s(self, skill, state):
        return seconds.get(skill.name, 1.0)

    return closing(task, closed, duration_s=duration_s)


SECONDS = {"place(drawer) along +x": 9.0, "place(drawer) along -x": 4.0}


def test_of_the_ways_that_are_granted_the_quickest_is_taken_where_time_is_the_cost():
    """What is refused is no choice; where the cost is the distance, the first is taken."""
    task = drawer_task(cost="time")
    checks = Feasibility(task, [timed(task, SECONDS)])
    held = holding(task)
    assert verdict_of(checks, "place(drawer)", held).evidence["way"] == "along -x"
    closed = holding(task, "right")
    assert verdict_of(checks, "place(drawer)", closed).evidence["way"] == "along +x"
    by_distance = drawer_task()
    checks = Feasibility(by_distance, [timed(by_distance, SECONDS)])
    assert verdict_of(checks, "place(drawer)", holding(by_distance)).evidence["way"] == "along +x"


def test_a_plan_costs_the_time_of_the_ways_that_it_takes():
    """Exact search proves it; orders of jobs cannot say it."""
    task = drawer_task(cost="time")
    model = SkillModel(Feasibility(task, [timed(task, SECONDS)]))
    solution = ExactSolver().solve(model)
    assert solution.proved
    assert solution.plan.cost == pytest.approx(5 * 1.0 + 4.0)
    with pytest.raises(NotASequencing, match="depends on the way"):
        SequencingProblem.from_model(model)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=examples(25), deadline=None)
def test_exact_search_by_time_proves_what_brute_force_over_all_sequences_finds(seed):
    """Whatever each way takes, whatever closes it, with grasps and directions to choose from."""
    rng = random.Random(seed)
    task = drawer_task(cost="time", grasp=GRASPS[:2])
    queries = [list_queried_skill.name for list_queried_skill in list_queried_skills(task)]
    seconds = {name: rng.choice([1.0, 2.0, 3.5, 9.0]) for name in queries}
    stops = ("placed(left)", "placed(right)")
    closed = {
        name: rng.sample(stops, rng.choice([0, 0, 1, 2])) for name in queries if "drawer" in name
    }

    def model():
        return SkillModel(Feasibility(task, [timed(task, seconds, closed)]))

    solution, every = ExactSolver().solve(model()), ExhaustiveSolver().solve(model())
    assert solution.proved
    assert (solution.plan is None) == (every.plan is None)
    if solution.plan is not None:
        assert solution.plan.cost == solution.lower_bound == pytest.approx(every.plan.cost)


def ruled(task, seed):
    """Return back ends whose answers are drawn at random."""
    kinds = (CheapDetector, ExpensiveEngine, ExpensiveDetector)
    return [kind(task, kind.Options(seed=seed)) for kind in kinds]


@given(seed=st.integers(0, 2**32))
@settings(max_examples=examples(25), deadline=None)
def test_reused_verdicts_say_the_same_as_fresh_ones(seed):
    """In any state, by whatever way, and the way is the same as well."""
    rng = random.Random(seed)
    task = drawer_task(grasp=GRASPS)
    kept = Feasibility(task, ruled(task, seed))
    for skill in [item for item in task.skills if item.ways]:
        for _ in range(12):
            state = imagined_state(task, skill, rng)
            if state is None:
                continue
            verdict = kept.verdict(skill, state)
            fresh = Feasibility(task, ruled(task, seed), VerdictCache()).verdict(skill, state)
            assert (verdict.status, verdict.reason) == (fresh.status, fresh.reason)
            assert verdict.evidence == fresh.evidence
            assert verdict.applies_in(state)


@given(seed=st.integers(0, 2**32))
@settings(max_examples=examples(25), deadline=None)
def test_the_facts_that_it_names_are_all_it_rests_on(seed):
    """Where they are the same, so is the verdict."""
    rng = random.Random(seed)
    task = drawer_task(grasp=GRASPS)
    checks = Feasibility(task, ruled(task, seed))
    for skill in [item for item in task.skills if item.ways]:
        states = [imagined_state(task, skill, rng) for _ in range(12)]
        states = [state for state in states if state is not None]
        for state in states:
            verdict = checks.verdict(skill, state)
            for other in states:
                if verdict.applies_in(other):
                    message = checks.verdict(skill, other)
                    # Of several reasons against one way, the cheapest back end's is given.
                    assert message.status is verdict.status
                    assert message.evidence.get("way") == verdict.evidence.get("way")


@given(seed=st.integers(0, 2**32))
@settings(max_examples=examples(25), deadline=None)
def test_a_pick_that_is_granted_is_followed_by_a_place_of_the_same_grasp(seed):
    """In every state that can be reached."""
    task = drawer_task(grasp=GRASPS)
    checks = Feasibility(task, ruled(task, seed))
    pick, place = task.skill("pick(drawer)"), task.skill("place(drawer)")
    for state in reachable_states(SkillModel(checks)):
        if not pick.applicable(state):
            continue
        taken = checks.verdict(pick, state)
        if taken.is_feasible:
            left = checks.verdict(place, pick.prediction.apply(state))
            assert left.is_feasible
            assert left.evidence["way"].endswith(taken.evidence["way"])


@pytest.mark.parametrize("seed", [1, 2])
def test_neither_verdicts_nor_counts_depend_on_the_number_of_processes(seed):
    """Pick and place of a part share answers, so that they are asked one after the other."""
    task = drawer_task(grasp=GRASPS)
    queries = [
        (skill, state)
        for state in reachable_states(SkillModel(Feasibility(task)))[:40]
        for skill in task.skills
        if skill.applicable(state)
    ]
    alone = Feasibility(task, ruled(task, seed))
    verdicts = alone.verdicts(queries)
    together = Feasibility(task, ruled(task, seed), jobs=2)
    try:
        assert together.verdicts(queries) == verdicts
    finally:
        together.close()
    assert (together.checks, together.hits) == (alone.checks, alone.hits)
    assert together.queried == alone.queried


def test_kept_verdicts_are_found_and_tried_again_by_the_way(tmp_path):
    """On disk each stands under the name of its way."""
    task = drawer_task()
    cache = DiskVerdictCache(tmp_path)
    checks = Feasibility(task, [closing(task, expensive=True)], cache)
    checks.verdict(task.skill("place(drawer)"), holding(task, "left"))
    again = Feasibility(task, [closing(task, expensive=True)], DiskVerdictCache(tmp_path))
    again.verdict(task.skill("place(drawer)"), holding(task, "left"))
    assert (again.checks, again.hits) == (0, 1)
    kept = VerdictFolder(tmp_path).kept_for(again.back_ends)
    names = sorted(record.record.skill for own in kept for record in own)
    assert names == ["place(drawer) along +x", "place(drawer) along -x"]
    trials = recheck_kept(checks, [(0, item) for own in kept for item in own])
    assert [trial.same for trial in trials] == [True, True]
    assert audit(checks, 4, 0, expensive=True) == 2
