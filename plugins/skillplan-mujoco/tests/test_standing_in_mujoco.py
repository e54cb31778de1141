"""What contact forces prove to stand, stands in MuJoCo with the same friction."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from skillplan.collision import Solid, decide_standing, find_touches, weigh
from skillplan.task import Box, Pose

FRICTION = 0.3


def random_scene(rng):
    """Return firm and loose bodies: a tower, or a block on a slope with or without a lid."""
    if rng.random() < 0.5:
        slope = Pose.turned((0, 0, 0.3), (0, math.radians(rng.uniform(5, 30)), 0))
        width_m, height_m = rng.uniform(0.02, 0.1), rng.uniform(0.01, 0.08)
        plate = [Box((0.4, 0.4, 0.02), (0, 0, -0.01))]
        firm = {"slope": Solid(plate, slope)}
        if rng.random() < 0.5:
            firm["lid"] = Solid([Box((0.4, 0.4, 0.02), (0, 0, height_m + 0.01))], slope)
        return firm, {"it": Solid([Box((width_m, 0.05, height_m), (0, 0, height_m / 2))], slope)}
    loose, top_m = {}, 0.0
    for number in range(3):
        x_m, y_m, height_m = rng.uniform((0.02, 0.02, 0.01), (0.12, 0.12, 0.08))
        at_m = (rng.uniform(-0.03, 0.03), rng.uniform(-0.03, 0.03), top_m)
        shape = Box((x_m, y_m, height_m), (0, 0, height_m / 2))
        loose[f"block_{number}"] = Solid([shape], Pose.upright(at_m, rng.uniform(-3, 3)))
        top_m += height_m
    return {"table": Solid([Box((1, 1, 0.1), (0, 0, -0.05))], Pose((0, 0, 0)))}, loose


def moves_m(firm, loose):
    """Return the largest shift of a body within half a second [m]."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.impratio = 0.001, 20
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.noslip_iterations = 3
    for name, solid in {**firm, **loose}.items():
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, np.array(solid.pose.rotation).ravel())
        body = spec.worldbody.add_body(name=name, pos=solid.pose.position, quat=turn)
        if name in loose:
            body.add_freejoint()
        for shape in solid.shapes:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[side / 2 for side in shape.size],
                pos=shape.centre,
                friction=[FRICTION, 1e-4, 1e-4],
                solref=[0.004, 1],
            )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    begin = data.xipos.copy()
    while data.time < 0.5:
        mujoco.mj_step(model, data)
    return float(np.linalg.norm(data.xipos - begin, axis=1).max())


@pytest.mark.slow
def test_bodies_that_stand_by_contact_forces_do_not_move():
    """Of random scenes, as many fall as stand; none that is proved to stand moves."""
    rng, shifts_m = np.random.default_rng(7), []
    for _ in range(40):
        firm, loose = random_scene(rng)
        weights = {
            name: weigh(solid, 1000 * math.prod(solid.shapes[0].size))
            for name, solid in loose.items()
        }
        touches = find_touches({**firm, **loose})
        if decide_standing(weights, touches, friction=FRICTION).stands:
            shifts_m.append(moves_m(firm, loose))
    assert len(shifts_m) >= 10
    assert max(shifts_m) < 1e-3
