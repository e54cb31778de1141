"""Bodies at rest, in a world of their own."""

from __future__ import annotations

import tempfile

import numpy as np
import pytest

from skillplan.task import Body, Box, Cylinder, Mesh, Pose
from skillplan_pinocchio import compute_mass_properties
from skillplan_pybullet import World
from skillplan_simulation import STEPS_PER_S

PYRAMID = Mesh(
    ((0.0, 0.0, 0.0), (0.04, 0.0, 0.0), (0.0, 0.04, 0.0), (0.04, 0.04, 0.0), (0.02, 0.02, 0.03)),
    ((0, 1, 3), (0, 3, 2), (0, 4, 1), (1, 4, 3), (3, 4, 2), (2, 4, 0)),
)
BODIES = {
    "box": Body("box", (Box((0.04, 0.06, 0.02), (0.0, 0.0, 0.01)),), (), 0.1),
    "cylinder": Body("cylinder", (Cylinder(0.03, 0.05, (0.0, 0.0, 0.025)),), (), 0.05),
    "mesh": Body("mesh", (PYRAMID,), (), 0.05),
    "compound": Body(
        "compound",
        (
            Box((0.02, 0.096, 0.006), (0.0, 0.0, 0.043)),
            Box((0.02, 0.016, 0.04), (0.0, -0.04, 0.02)),
            Cylinder(0.016, 0.04, (0.0, 0.04, 0.02)),
        ),
        (),
        0.045,
    ),
}


@pytest.mark.parametrize("name", BODIES)
def test_a_body_at_rest_stays_within_a_fiftieth_of_a_millimetre(name):
    with World(0.6) as world:
        world.add(BODIES[name], Pose.upright((0.4, 0.1, 0.0), 0.3))
        for _ in range(2 * STEPS_PER_S):
            world.step()
        pose = world.pose(name)
    assert np.allclose(pose.position, (0.4, 0.1, 0.0), atol=2e-5)
    assert pose.yaw_rad == pytest.approx(0.3, abs=1e-3)


TEETH = 40
WEDGE = Mesh(
    tuple((x, y, z) for z, half in ((0.0, 0.002), (0.02, 0.001)) for x, y in
          ((-half, -half), (half, -half), (half, half), (-half, half))),
    ((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5),
     (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)),
)  # fmt: skip


def tooth(kind, number):
    x = 0.005 * (number - TEETH // 2)
    if kind == "mesh":
        moved = tuple((x + own, y, z) for own, y, z in WEDGE.corners)
        return Mesh(moved, WEDGE.faces)
    centre = (x, 0.0, 0.01)
    return Box((0.004, 0.004, 0.02), centre) if kind == "box" else Cylinder(0.004, 0.02, centre)


@pytest.mark.parametrize("kind", ["mesh", "box", "cylinder"])
def test_a_body_may_have_any_number_of_pieces_and_gaps_between_them(kind):
    """Each is a hull of its own: a blade between two touches neither, one on a tooth does."""
    comb = Body("comb", tuple(tooth(kind, number) for number in range(TEETH)), (), 0.1)
    blade = Body("blade", (Box((0.0006, 0.01, 0.02), (0.0, 0.0, 0.01)),), (), 0.01)
    with World(0.6) as world:
        world.add(comb, Pose((0.4, 0.1, 0.0)))
        world.add(blade, Pose((0.4 + 0.0025 + 0.005 * 15, 0.1, 0.001)))
        assert not world.is_near("blade", "comb", 1e-4)
        world.put("blade", Pose((0.4 + 0.005 * 15, 0.1, 0.001)))
        assert world.is_near("blade", "comb", 0.0)
        world.put("blade", Pose((0.4, 0.0, 0.2)))
        for _ in range(STEPS_PER_S // 4):
            world.step()
        assert np.allclose(world.pose("comb").position, (0.4, 0.1, 0.0), atol=5e-5)


def test_a_round_body_that_is_let_go_off_level_stays_where_it_comes_down():
    """It rolled away, pushed at a point of contact that stayed where it had been."""
    lying = Pose.turned((0.4, 0.1, 0.0153), (np.pi / 2 - 0.003, 0.0, 0.0))
    with World(0.6) as world:
        world.add(BODIES["cylinder"], lying)
        for _ in range(3 * STEPS_PER_S):
            world.step()
        pose = world.pose("cylinder")
    assert np.allclose(pose.position[:2], lying.position[:2], atol=1e-4)


def test_a_body_that_nothing_bears_falls_as_physics_has_it():
    with World(0.6) as world:
        world.add(BODIES["box"], Pose((0.4, 0.1, 0.5)))
        for _ in range(STEPS_PER_S // 10):
            world.step()
        fallen_m = 0.5 - world.pose("box").position[2]
    assert fallen_m == pytest.approx(0.5 * 9.81 * 0.1**2, rel=0.06)


def test_mass_is_where_the_shapes_are():
    mass_properties = compute_mass_properties(
        Body(
            "l", (Box((0.1, 0.1, 0.1), (0, 0, 0.05)), Box((0.1, 0.1, 0.1), (0.1, 0, 0.05))), (), 2.0
        )
    )
    assert np.allclose(mass_properties.centre, (0.05, 0.0, 0.05))
    # Two cubes side by side are one box.
    assert np.allclose(mass_properties.inertia_kg_m2, np.array([0.02, 0.05, 0.05]) * 2 / 12)


def test_a_cylinder_has_the_inertia_of_a_cylinder():
    mass_properties = compute_mass_properties(BODIES["cylinder"])
    along = 0.05 * 0.015**2 / 2
    across = 0.05 * (3 * 0.015**2 + 0.05**2) / 12
    assert np.allclose(mass_properties.inertia_kg_m2, (across, across, along))


def test_a_world_that_blows_up_is_noticed():
    with World(0.6) as world:
        world.add(BODIES["box"], Pose((0.4, 0.1, 0.5)))
        assert world.is_sane()
        world.put("box", Pose((1000.0, 0.0, 0.0)))
        assert not world.is_sane()


@pytest.mark.parametrize("name", BODIES)
def test_files_are_written_for_meshes_only(name, monkeypatch):
    folders = []
    make = tempfile.mkdtemp
    monkeypatch.setattr(tempfile, "mkdtemp", lambda *args: folders.append(name) or make(*args))
    with World(0.6) as world:
        world.add(BODIES[name], Pose((0.4, 0.1, 0.0)))
    assert folders == ["mesh"] * (name == "mesh")


def test_nothing_is_printed(capfd):
    with World(0.6) as world:
        for name, body in BODIES.items():
            world.add(body, Pose((0.4, {"box": 0.1}.get(name, 0.3), 0.0)))
        world.step()
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""
