"""The reference engine: reach."""

from dataclasses import replace

import pytest

from situations import assembly, config_content
from skillplan.physics import KinematicEngine
from skillplan.testing import EngineSuite


class TestKinematicEngine(EngineSuite):
    engine = "kinematic"


def test_a_part_beyond_reach_cannot_be_picked():
    """The verdict gives the figures, and rests on no fact: it is so in every state."""
    content = config_content("inverter_board")
    content["robot"]["reach_m"] = 0.5
    task = assembly(content)
    verdict = KinematicEngine(task).check(task.skill("pick(brace)"), task.initial)
    assert verdict.is_infeasible
    assert verdict.evidence["reach_m"] == 0.5
    # At safe height, gripped at the top: the farther of the two via points.
    assert verdict.evidence["distance_m"] == pytest.approx((0.58**2 + 0.006**2 + 0.196**2) ** 0.5)
    assert verdict.facts == []
    assert KinematicEngine(task).check(task.skill("pick(pcb)"), task.initial).is_feasible


def test_reach_is_measured_from_the_base():
    """A base beside the part reaches it."""
    content = config_content("inverter_board")
    content["robot"] |= {"reach_m": 0.5, "base_m": [0.4, 0.0, 0.0]}
    task = assembly(content)
    assert KinematicEngine(task).check(task.skill("pick(brace)"), task.initial).is_feasible
    content["robot"] |= {"base_m": [-0.4, 0.0, 0.0]}
    task = assembly(content)
    assert KinematicEngine(task).check(task.skill("pick(brace)"), task.initial).is_infeasible


def test_a_holder_beyond_reach_matters_only_on_the_way_that_visits_it():
    """What is put back depends on the tool in hand: that is the fact it rests on."""
    content = config_content("inverter_board")
    content["tools"]["far"] = {"holder_m": [0.9, 0.0]}
    task = assembly(content)
    engine, load = KinematicEngine(task), task.replace(skills=task.skills).skill("load(gripper)")
    far = task.facts.of("tool(far)", "hand_free", "at(home)")
    near = task.facts.of("tool(screwdriver)", "hand_free", "at(home)")
    assert engine.check(load, far).facts == ["tool(far)"]
    assert engine.check(load, far).is_infeasible
    assert engine.check(load, near).is_feasible


def test_a_hand_from_the_side_has_to_reach_where_it_begins_to_go_in():
    """Half a metre beside the goal, on the far side from the base."""
    content = config_content("inverter_board")
    content["parts"]["clock"]["goal_m"] = [0.56, 0.06]
    task = assembly(content)
    place = task.skill("place(clock)")
    (visit,) = place.motion.routes[0].visits
    from_afar = replace(visit, along=(-1.0, 0.0, 0.0), insert_m=0.5)
    motion = replace(place.motion, routes=(replace(place.motion.routes[0], visits=(from_afar,)),))
    state = task.facts.of("held(clock)", "tool(gripper)", "at(home)")
    assert KinematicEngine(task).check(place, state).is_feasible
    verdict = KinematicEngine(task).check(replace(place, motion=motion), state)
    assert verdict.is_infeasible
    assert verdict.evidence["via_point_m"][0] == pytest.approx(0.56 + 0.5)
