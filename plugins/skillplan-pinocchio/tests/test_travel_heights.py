"""How low straight travels lead."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.robots import UR5E
from skillplan_pinocchio import ArmModel, SweptDetector, TravelHeights, Unreachable, iterate_elbows
from thinned import slow_case

SAFE_M = 0.2
BOARDS = ["inverter_board", "battery_module", "motor_drive", "relay_rail", "sensor_stack"]


@pytest.mark.parametrize("arm", [ArmModel(), ArmModel(description=UR5E)], ids=["panda", "ur5e"])
@settings(max_examples=examples(30), deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_is_ever_lower(arm, seed):
    """Links, and points about the hand's axis, at 200 places of travels between hands down."""
    rng = np.random.default_rng(seed)
    ends = []
    while len(ends) < 2:
        away_m, bearing = rng.uniform(0.3, 0.6), rng.uniform(-1.5, 1.5)
        place = (float(away_m * np.cos(bearing)), float(away_m * np.sin(bearing)), SAFE_M)
        result = next(iter(iterate_elbows(arm, place, float(rng.uniform(-3, 3)))))
        if not isinstance(result, Unreachable):
            ends.append(result)
    width_m = 0.1
    lowest_m = TravelHeights(arm, width_m).lowest_m(*ends, SAFE_M)
    joints, centres, halves = arm.boxes
    for share in np.linspace(0, 1, 200):
        posture = ends[0] + share * (ends[1] - ends[0])
        tip, turned = arm.tip(posture)
        sideways = width_m * float(np.hypot(turned[2, 0], turned[2, 1]))
        assert tip[2] - sideways >= lowest_m - 1e-9
        rotations, origins = arm.frames([posture])
        for joint, centre, half in zip(joints, centres, halves, strict=True):
            row = rotations[0, joint][2]
            low_m = origins[0, joint, 2] + row @ centre - np.abs(row) @ half
            assert low_m >= lowest_m - 1e-9


@pytest.mark.parametrize(
    "name",
    [
        BOARDS[0],
        *(slow_case(name, reason="plans a board; one in every run") for name in BOARDS[1:]),
    ],
)
def test_no_travel_of_a_shipped_board_needs_a_check(product_task, name):
    """All of them are above everything, so that no verdict asks where the arm comes from."""
    task = product_task(name)
    detector = SweptDetector(task)
    for skill in task.skills:
        state = task.facts.state(
            skill.motion.routes[0].when.bits | skill.precondition.requires.bits
        )
        places = detector.check(skill, _standing(task, state)).facts
        assert not any(fact.removeprefix("not ").startswith("at(") for fact in places)


def _standing(task, state):
    """Return a state in which it is known where the arm stands, and with which tool."""
    bits = state.bits
    for group in task.facts.exclusive:
        if not any(bits & task.facts.bit(fact) for fact in group):
            bits |= task.facts.bit(next(iter(group)))
    return task.facts.state(bits)
