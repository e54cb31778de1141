"""Recognising agents that move between places, or saying what stands against it."""

from __future__ import annotations

from typing import Any

import pytest

from fleet_instances import random_robots, task_of
from situations import make_skill, make_task
from skillplan.pipeline import make_model
from skillplan.task import Case, CaseCost, Condition, ConstantCost, Facts, Outcome, Skill, Task
from skillplan_swarmitfix import Bench, MultiAgentProblem, NotMultiAgent

BENCH = Bench(3, 7, 0.34)
FACTS = Facts(("a1", "a2", "b1", "b2"), (("a1", "a2"), ("b1", "b2")))


def recognise(task: Task) -> MultiAgentProblem:
    return MultiAgentProblem.from_model(make_model(task))


def going(agent: str, start: str, end: str, **more: Any) -> Skill:
    """Return a skill that takes an agent from one place to another."""
    facts = more.pop("facts", FACTS)
    nobody = more.pop("forbids", ())
    outcome = Outcome(
        1.0, facts.of(*more.pop("add", (end,))), facts.of(*more.pop("delete", (start,)))
    )
    case = Case(facts.of(start), more.pop("outcomes", (outcome,)), facts.of(*nobody))
    values: dict[str, Any] = {
        "name": f"{start}-{end}",
        "kind": "go",
        "agents": (agent,),
        "precondition": Condition(facts.none, facts.none),
        "outcomes": (),
        "cost": ConstantCost(2.0),
        "duration_s": ConstantCost(3.0),
        "cases": (case,),
    }
    return Skill(**(values | more))


def two_agents(first: Skill | None = None, facts: Facts = FACTS, **more: Any) -> Task:
    """Return a task of two agents with two places each."""
    skills = (first or going("a", "a1", "a2"), going("b", "b1", "b2", facts=facts))
    return make_task(facts, skills, **{"initial": ("a1", "b1"), "goal": ("a2", "b2"), **more})


class TestRecognition:
    def test_a_fleet_has_a_move_for_every_swing_of_every_robot(self):
        problem = recognise(task_of(BENCH, random_robots(BENCH, 3, 0)))
        swings = int((BENCH.successors[:, 1:] >= 0).sum())
        assert [swings] * 3 == [sum(map(len, moves)) for moves in problem.moves]
        assert problem.agents == ("r1", "r2", "r3")
        assert BENCH.n_pins == len(problem.resources)

    @pytest.mark.slow(
        reason="every two moves on a bench; every run has the rejected moves of two robots"
    )
    def test_moves_of_two_clash_where_they_sweep_a_common_pin(self):
        bench = Bench(4, 7, 0.34)
        problem = recognise(task_of(bench, random_robots(bench, 2, 0)))
        for item in (move for here in problem.moves[0] for move in here):
            for other in (move for here in problem.moves[1] for move in here):
                pins = bench.swept_pins(item.start, int(item.skill[4:])) & bench.swept_pins(
                    other.start, int(other.skill[4:])
                )
                assert bool(pins) == item.clashes(other) == other.clashes(item)

    def test_ways_alone_are_those_of_the_bench(self):
        robots = random_robots(BENCH, 3, 4)
        problem = recognise(task_of(BENCH, robots))
        for agent, (_, goal) in enumerate(robots.values()):
            assert BENCH.distances(goal).tolist() == list(problem.fewest_moves[agent])
            assert problem.fewest_moves[agent] == problem.least_costs[agent]

    def test_a_place_without_a_way_to_the_goal_is_infinitely_far(self):
        problem = recognise(two_agents(goal=("a1", "b2")))
        assert (0.0, float("inf")) == problem.least_costs[0]

    def test_costs_and_durations_may_depend_on_the_place(self):
        bit = FACTS.bit("a1")
        skill = going("a", "a1", "a2", cost=CaseCost({bit: 5.0}), duration_s=CaseCost({bit: 7.0}))
        ((move,), _) = recognise(two_agents(skill)).moves[0]
        assert (move.cost, move.duration_s) == (5.0, 7.0)

    def test_staying_is_no_move(self):
        task = two_agents(going("a", "a1", "a1", add=("a1",), delete=()), goal=("a1", "b2"))
        assert recognise(task).moves[0] == ((), ())

    def test_a_move_that_its_own_precondition_forbids_is_none(self):
        never = Condition(FACTS.none, FACTS.of("a1"))
        assert recognise(two_agents(going("a", "a1", "a2", precondition=never))).moves[0] == (
            (),
            (),
        )

    def test_a_move_passes_where_nobody_stands_on_what_it_forbids(self):
        problem = recognise(two_agents(going("a", "a1", "a2", forbids=("b1",))))
        ((move,), _) = problem.moves[0]
        assert not move.passes(problem.bits((0, 0)))
        assert move.passes(problem.bits((0, 1)))

    def test_a_move_clashes_with_one_that_starts_or_ends_on_what_it_forbids(self):
        for place in ("b1", "b2"):
            problem = recognise(two_agents(going("a", "a1", "a2", forbids=(place,))))
            ((first,), _), ((other,), _) = problem.moves
            assert first.clashes(other)
            assert other.clashes(first)
        ((first,), _), ((other,), _) = recognise(two_agents()).moves
        assert not first.clashes(other)


class TestRefusal:
    @pytest.mark.parametrize(
        ("make", "reason"),
        [
            (lambda: two_agents(going("a", "a1", "a2", agents=("a", "b"))), "2 agents at once"),
            (
                lambda: two_agents(make_skill(FACTS, "jump", add=("a2",), delete=("a1",))),
                "does not depend on where",
            ),
            (
                lambda: two_agents(
                    going(
                        "a",
                        "a1",
                        "a2",
                        outcomes=(
                            Outcome(0.5, FACTS.of("a2"), FACTS.of("a1")),
                            Outcome(0.5, FACTS.none, FACTS.none),
                        ),
                    )
                ),
                "several outcomes",
            ),
            (lambda: make_task(FACTS, ()), "it has no skills"),
            (lambda: two_agents(facts=Facts(FACTS.names)), "not one exclusive group"),
            (lambda: two_agents(going("c", "a1", "a2"), goal=("a2",)), "b has to reach 0 places"),
            (lambda: two_agents(initial=("a1",)), "b starts at 0 places"),
            (
                lambda: two_agents(going("a", "a1", "a2", add=("a2", "b2"))),
                "does more than take a to another place",
            ),
            (
                lambda: two_agents(
                    going("a", "a1", "a2", precondition=Condition(FACTS.of("b1"), FACTS.none))
                ),
                "has a precondition other than",
            ),
            (
                lambda: two_agents(going("a", "a1", "a2", cost=CaseCost({FACTS.bit("b1"): 1.0}))),
                "the cost of a1-a2 depends on more",
            ),
            (
                lambda: two_agents().replace(goal=Condition(FACTS.of("a2", "b2"), FACTS.of("a1"))),
                "its goal forbids facts",
            ),
            (
                lambda: make_task(
                    FACTS,
                    (going("a", "a1", "a2"), going("b", "a2", "a1")),
                    initial=("a1",),
                    goal=("a2",),
                ),
                "two agents share places",
            ),
            (
                lambda: make_task(FACTS, (going("a", "a1", "a2"),), initial=("a1",), goal=("a2",)),
                "b1 is not the place of an agent",
            ),
        ],
    )
    def test_what_stands_against_it_is_said(self, make, reason):
        with pytest.raises(NotMultiAgent, match="'made-by-hand' is not a multi-agent") as refused:
            recognise(make())
        assert reason in str(refused.value)

    def test_an_assembly_is_none(self, lid_task):
        with pytest.raises(NotMultiAgent, match="does not depend on where its agent stands"):
            recognise(lid_task)

    def test_numbers_that_do_not_agree_are_refused(self):
        with pytest.raises(ValueError, match="n = 1 of everything"):
            MultiAgentProblem(("a",), (), (), (0,), (0,), (((),),), (), 1)
        with pytest.raises(ValueError, match="a bit and a list of moves"):
            MultiAgentProblem(("a",), (("a1",),), ((1, 2),), (0,), (0,), (((),),), (), 1)


class TestRejection:
    def test_a_move_rejected_for_its_own_place_is_dropped(self):
        problem = recognise(two_agents())
        ((move,), _) = problem.moves[0]
        assert problem.without(move, FACTS.bit("a1"), FACTS.bit("a2")).moves[0] == ((), ())

    def test_a_move_rejected_for_anothers_place_passes_elsewhere_but_alone(self):
        problem = recognise(two_agents())
        ((move,), _) = problem.moves[0]
        problem = problem.without(move, FACTS.bit("a1") | FACTS.bit("b1"), 0)
        ((kept,), _), ((other,), _) = problem.moves
        assert not kept.passes(problem.bits((0, 0)))
        assert kept.passes(problem.bits((0, 1)))
        assert kept.clashes(other)
        assert other.clashes(kept)

    def test_other_moves_stay_as_they_are(self):
        problem = recognise(task_of(BENCH, random_robots(BENCH, 2, 0)))
        move = problem.moves[0][5][0]
        less = problem.without(move, move.start_bit, 0)
        assert set(problem.all_moves()) - set(less.all_moves()) == {move}
