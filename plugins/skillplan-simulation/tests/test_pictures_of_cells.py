"""Pictures of simulated cells: what they show, without an engine; one look for all of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from board_situations import BOARD
from skillplan.physics import HEIGHT, WIDTH, Angle, Image, View
from skillplan.pipeline import load_problem
from skillplan_simulation import Film, PaintedCamera, Projection, Touch, get_kinematics


@pytest.fixture(scope="module")
def scene():
    return load_problem(BOARD).task.scene


def cell(scene, *, touches=()):
    """Return a world of the board's parts where they begin, and an arm at home."""
    bodies = [body for body in scene.bodies if body.placements[0].solid]
    poses = {body.name: body.placements[0].pose for body in bodies}
    world = SimpleNamespace(
        bodies=tuple(poses), numbers=dict(poses), pose=poses.get, touches=lambda: list(touches)
    )
    robot = scene.robots[0]
    arm = SimpleNamespace(
        hand=robot.hand,
        kinematics=get_kinematics(robot),
        joints_rad=lambda: robot.home_rad,
        jaw_width_m=lambda: 0.05,
        shows_hand=True,
    )
    return world, arm


def pixels(image: Image):
    return np.frombuffer(image.rgb, np.uint8).reshape(image.height, image.width, 3).astype(int)


def camera(scene, angle="side", *, labels=False):
    points = [(0.3, -0.3, 0.0), (0.7, 0.2, 0.0), (0.0, 0.0, 0.8)]
    return PaintedCamera(scene, View.about(points, Angle.parse(angle)), labels=labels)


def test_a_part_is_where_the_view_has_it_in_its_own_colour(scene):
    """The board is green, and its middle is where its pose says; the picture is 1280x720."""
    world, arm = cell(scene)
    view = View.about([(0.3, -0.3, 0.0), (0.7, 0.2, 0.0)], Angle.parse("top"))
    image = PaintedCamera(scene, view).shot(world, arm)()
    assert (image.width, image.height) == (WIDTH, HEIGHT)
    seen = pixels(image)
    rows, columns = np.nonzero(seen[:, :, 1] - seen[:, :, 0] > 50)
    pixel = Projection(view, WIDTH, HEIGHT).pixel(world.pose("pcb").position)
    assert pixel is not None
    assert columns.min() < pixel[0] < columns.max()
    assert rows.min() < pixel[1] < rows.max()


def test_two_that_touch_are_red_and_orange_and_all_else_is_pale(scene):
    """A finger counts as one of them; an arrow leads to where they touch."""
    place = np.array(scene.at(load_problem(BOARD).task.initial)["pcb"].position)
    touch = Touch("left finger", "pcb", place, np.array((0, 0, 1.0)), 2.0, np.zeros(3))
    world, arm = cell(scene, touches=[touch])
    seen = pixels(camera(scene).shot(world, arm, "a skill", ("left finger", "pcb"))())
    red, green, blue = seen[:, :, 0], seen[:, :, 1], seen[:, :, 2]
    assert ((red > 100) & (green < 60) & (blue < 60)).sum() > 20
    assert ((red > 150) & (green > 70) & (green < 170) & (blue < 60)).sum() > 500
    assert ((blue > 150) & (red < 60) & (green < 60)).sum() > 100
    # Nothing is green, as the board would be, or has another part's colour.
    assert (green - red > 20).sum() == 0


def test_captions_and_name_tags_are_written(scene):
    """A caption is a dark strip in the lower left corner; tags are white, and hide no other."""
    world, arm = cell(scene)
    plain = pixels(camera(scene).shot(world, arm)())
    message = pixels(camera(scene).shot(world, arm, "1. pick(pcb)   0.50 s")())
    named = pixels(camera(scene, labels=True).shot(world, arm)())
    rows, columns = np.nonzero((message != plain).any(axis=2))
    assert rows.min() > 0.9 * HEIGHT
    assert columns.max() < WIDTH / 2
    assert ((named.min(axis=2) > 235) & (plain.min(axis=2) < 235)).sum() > 2000


def test_a_picture_shows_its_moment_whenever_it_is_painted(scene):
    """What moves on afterwards changes nothing of it."""
    world, arm = cell(scene)
    shot = camera(scene).shot(world, arm)
    at_once = shot()
    arm.joints_rad = lambda: tuple(angle + 0.3 for angle in scene.robots[0].home_rad)
    assert shot() == at_once
    assert camera(scene).shot(world, arm)() != at_once


def test_a_film_keeps_its_order_and_raises_what_went_wrong():
    """Pictures are made on another thread."""
    images = [Image(1, 1, bytes([number] * 3)) for number in range(40)]
    shown: list[Image] = []
    with Film(shown.append) as film:
        for image in images:
            film.add(lambda image=image: image)
    assert shown == images

    def full(image: Image) -> None:
        raise OSError("the disk is full")

    def filming() -> None:
        with Film(full) as film:
            for image in images:
                film.add(lambda image=image: image)

    with pytest.raises(OSError, match="disk is full"):
        filming()
