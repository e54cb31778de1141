"""Whole plans in one continuous world of MuJoCo, and pictures of them."""

import numpy as np
import pytest

from board_situations import BOARD, OPTIMAL, imagined
from skillplan.physics import HEIGHT, WIDTH, Angle
from skillplan.pipeline import load_problem
from skillplan_mujoco import MujocoEngine


@pytest.fixture(scope="module")
def engine():
    return MujocoEngine(load_problem(BOARD).task)


def pixels(image):
    return np.frombuffer(image.rgb, np.uint8).reshape(image.height, image.width, 3).astype(int)


def test_the_first_skill_of_a_plan_is_filmed_and_traced(engine):
    """A part is picked up; rows of the trace are 1/60 s apart, pictures 1 s."""
    images, samples = [], []
    perform = engine.perform(
        [engine.task.skills[OPTIMAL[0]]],
        frames_per_s=1.0,
        show=images.append,
        note=samples.append,
        angle=Angle.parse("top"),
        labels=True,
    )
    assert perform.failed is None
    assert {(image.width, image.height) for image in images} == {(WIDTH, HEIGHT)}
    assert len(images) == pytest.approx(perform.simulated_s, abs=1.0)
    assert len(samples) == pytest.approx(60 * perform.simulated_s, abs=2)
    assert pixels(images[-1]).std() > 10.0


@pytest.mark.slow(reason="executes a skill twice; a film in every run")
def test_a_picture_of_failure_colours_the_two_that_touch(engine):
    """The transformer is red, the brace that it hits orange, the board and the hand are grey."""
    seen = pixels(engine.picture(*imagined(engine.task, "place(transformer)", "pcb", "brace")))
    red, green, blue = seen[:, :, 0], seen[:, :, 1], seen[:, :, 2]
    assert ((red > 120) & (green < 60) & (blue < 60)).sum() > 500
    assert ((red > 150) & (green > 70) & (green < 160) & (blue < 60)).sum() > 500
    # The board would be green.
    assert ((green - red) > 20).sum() == 0
