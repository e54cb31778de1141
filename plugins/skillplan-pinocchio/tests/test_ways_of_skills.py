"""Directions and grasps that the hand and the arm of ``swept`` choose between."""

import pytest

from situations import assembly
from skillplan.chart import derive_chart
from skillplan.checks import Feasibility
from skillplan.model import SkillModel, replay
from skillplan.physics import KinematicEngine
from skillplan.solvers import AutoSolver
from skillplan_pinocchio import SweptDetector
from way_boards import pin_content, rails_content


def checks_of(content):
    """Return the checks of a board by swept hulls."""
    task = assembly(content)
    return Feasibility(task, [KinematicEngine(task), SweptDetector(task)])


@pytest.mark.parametrize(("first", "way"), [("front", "along -x"), ("back", "along +x")])
def test_a_drawer_comes_from_the_end_that_is_open(first, way):
    """The plate at one end stands in the way of the other direction."""
    checks = checks_of(rails_content())
    task = checks.task
    plan = ["pick(rails)", "place(rails)", f"pick({first})", f"place({first})"]
    plan += ["pick(drawer)", "place(drawer)"]
    walked = replay(SkillModel(checks), [task.skill(name) for name in plan])
    assert walked.feasible
    assert walked.steps[-1].way == way


def test_the_chart_leaves_a_choice_and_search_proves_the_best_of_both():
    """One of the plates waits for the drawer."""
    checks = checks_of(rails_content())
    (choice,) = derive_chart(checks).alternatives
    assert set(choice.any_of) == {(("drawer", "back"),), (("drawer", "front"),)}
    solution = AutoSolver().solve(SkillModel(checks))
    assert solution.proved
    assert solution.plan.cost == pytest.approx(1.80376, abs=1e-5)


def test_a_grasp_that_is_free_at_the_start_alone_is_not_taken():
    """Beside the wall there is no room for a finger, where the pin is picked there is."""
    checks = checks_of(pin_content())
    task = checks.task
    plan = ["pick(wall)", "place(wall)", "pick(pin)", "place(pin)"]
    walked = replay(SkillModel(checks), [task.skill(name) for name in plan])
    assert walked.feasible
    ways = [step.way for step in walked.steps]
    assert ways == [None, None, *["grasp top closing along x"] * 2]
    free = checks.verdict(task.skill("pick(pin)"), task.initial)
    assert free.evidence["way"] == "grasp top closing along y"
