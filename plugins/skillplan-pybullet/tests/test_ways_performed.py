"""A plan with several grasps to choose from, executed by the one that is granted."""

import pytest

from situations import assembly
from skillplan.pipeline import choose_variants
from skillplan_pybullet import PybulletEngine, SimulationSettings
from skillplan_simulation import PlannedPaths
from way_boards import pin_content

GRANTED = "grasp top closing along x"


def test_pick_and_place_by_one_grasp_have_the_hand_turned_alike():
    """And each grasp has a turn of its own."""
    task = assembly(pin_content())
    paths = PlannedPaths(task, SimulationSettings())
    pick, place = task.skill("pick(pin)"), task.skill("place(pin)")
    for taken, left in zip(pick.ways, place.ways, strict=True):
        rotations = []
        for skill, way in ((pick, taken), (place, left)):
            state = skill.precondition.requires | task.facts.of("at(home)")
            (motion,) = paths.of(skill.by(way), state).motions
            rotations.append(motion.rotation)
        assert rotations[0] == pytest.approx(rotations[1], abs=1e-9)


@pytest.mark.slow(reason="executes four skills; the turns of the hand in every run")
def test_the_grasp_that_is_free_at_the_goal_is_performed():
    """By the other, a finger would meet the wall."""
    task = assembly(pin_content())
    engine = PybulletEngine(task)
    plan = ["pick(wall)", "place(wall)", "pick(pin)", "place(pin)"]
    named = [None, None, GRANTED, GRANTED]
    skills = choose_variants(task, [task.skill(name) for name in plan], [engine], named)
    perform = engine.perform(skills)
    assert perform.failed is None
    assert perform.skills[-1].skill == f"place(pin) {GRANTED}"
    assert all(arrival.offset_m < 5e-4 for arrival in perform.arrivals)
