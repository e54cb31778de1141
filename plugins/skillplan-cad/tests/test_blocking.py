"""What blocks what in products whose truth is known by construction."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from cad_products import ALONG, links, moved, product, related, relation, true_links, truth
from skillplan_cad import Confirmation, RayMesh, ReadOptions, find_blocked, read_product
from thinned import thinned

SOLID = ("dovetail", "floating", "interlocked", "l_slot", "mirrored", "nested", "threads")
LARGER = ("bracket", "eight", "fastened")


def assert_true(name, expected):
    """Hold a relation against the truth of a fixture, along all three axes."""
    for axis, direction in ALONG.items():
        assert true_links(name, axis) == links(expected, direction), (name, axis)
        backwards = {(by, part) for part, by in true_links(name, axis)}
        assert backwards == links(expected, direction + 1), (name, axis)


def turned(degrees):
    """Return the turn about x, then y, then z."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        item, two = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[item, item] = turn[two, two] = np.cos(angle)
        turn[two, item], turn[item, two] = np.sin(angle), -np.sin(angle)
        matrix = turn @ matrix
    return matrix


@pytest.mark.parametrize("name", thinned(SOLID, "l_slot", "interlocked"))
def test_what_blocks_what_is_what_was_built(name):
    """All links and no other, along each axis and against it."""
    if "blocked" in truth(name):
        assert_true(name, relation(name))


@pytest.mark.slow(reason="rays through eight parts; smaller products are held in every run")
@pytest.mark.parametrize("name", LARGER)
def test_what_blocks_what_is_what_was_built_in_larger_products(name):
    assert_true(name, relation(name))


@pytest.mark.slow(reason="reads and tests a product six times; one of them in every run")
@pytest.mark.parametrize("tolerance", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("chord", [0.1, 0.02])
@pytest.mark.parametrize("name", ["bracket", "nested"])
def test_tolerance_and_tessellation_change_nothing(name, tolerance, chord):
    """None of the fixtures is made to hang on either."""
    assert_true(name, relation(name, tolerance, chord))


@pytest.mark.parametrize(
    "name", thinned(["dovetail", "l_slot"], "dovetail", why="another in every run")
)
def test_a_product_turned_in_space_has_the_same_links(name):
    """Along the turned axes."""
    turn = turned((17, 31, 43))
    whole = moved(product(name), turn)
    directions = [tuple(sign * row) for row in turn.T for sign in (1, -1)]
    entries = find_blocked(whole, directions, 1e-4).entries
    for axis, number in ALONG.items():
        results = {(entry.part, entry.by) for entry in entries if entry.direction == number}
        assert true_links(name, axis) == results


@pytest.mark.parametrize("degrees", [(0, 0, 0), (17, 31, 43)])
def test_a_link_far_narrower_than_the_parts_is_found(tmp_path, degrees):
    """A lid of 100 mm rests on a rail by 0.4 mm, between two rays of any lattice."""
    lid, rail = trimesh.creation.box((100, 100, 5)), trimesh.creation.box((10, 130, 10))
    rail.apply_translation((54.6, 3.0, -7.5))
    lid.export(tmp_path / "lid.stl")
    rail.export(tmp_path / "rail.stl")
    turn = turned(degrees)
    whole = moved(read_product(tmp_path, ReadOptions(unit="mm")), turn)
    result = find_blocked(whole, [tuple(turn[:, 2]), tuple(-turn[:, 2])], 1e-4).entries
    assert {("lid", "rail", 1), ("rail", "lid", 0)} == {
        (item.part, item.by, item.direction) for item in result
    }
    assert all(2e-4 <= entry.width_m <= 4.1e-4 for entry in result)


def test_names_and_order_of_parts_change_nothing():
    """Parts are told apart by their shapes alone."""
    whole = product("l_slot")
    renamed = dataclasses.replace(
        whole,
        parts=tuple(
            dataclasses.replace(part, name=f"part {number}", design="")
            for number, part in enumerate(reversed(whole.parts))
        ),
    )
    names = {f"part {number}": part.name for number, part in enumerate(reversed(whole.parts))}
    result = related(renamed)
    for axis, direction in ALONG.items():
        pairs = {(names[part], names[by]) for part, by in links(result, direction)}
        assert true_links("l_slot", axis) == pairs


def test_a_link_says_how_far_and_where_the_parts_meet():
    """The block, 10 mm above nothing but the plate, meets it at once; the balloon only later."""
    results = {
        (link.part, link.by): link for link in relation("floating").blocked if link.direction == 5
    }
    parts = {part.name: part for part in product("floating").parts}
    for (part, by), result in results.items():
        gap = parts[part].bounds_m[0, 2] - parts[by].bounds_m[1, 2]
        assert gap == pytest.approx(result.distance_m, abs=1e-6)
        assert parts[by].bounds_m[1, 2] == pytest.approx(result.point_m[2], abs=1e-6)
        assert result.width_m > 1e-3


@pytest.mark.slow(reason="rays through a product more; what blocks what in every run")
def test_what_hangs_on_the_tolerance_is_listed():
    """The pin is 0.5 mm too thick: a disc of 0.2 mm fits into that ring, one of 0.4 mm does not."""
    coarse = related(product("interfering"), 0.2)
    assert coarse.sensitive
    assert {"block", "pin"} == {link.part for link in coarse.sensitive}
    assert not related(product("interfering"), 0.04).sensitive


@pytest.mark.slow(reason="starts processes; orders of answers are made one in every run")
def test_processes_change_nothing():
    """Whichever answers first."""
    whole = product("threads")
    directions = relation("threads").directions
    alone, together = (find_blocked(whole, directions, 1e-4, jobs=jobs) for jobs in (1, 3))
    assert alone == together


class TestThreads:
    """A bolt with a modelled thread, in a block."""

    def test_a_thread_blocks_the_way_out_unless_it_is_unscrewed(self):
        """Along its axis it comes out; as a solid it does not."""
        assert ("bolt", "block") not in links(relation("threads"), 4)
        assert ("bolt", "block") in links(related(product("threads"), threads="solid"), 4)

    def test_a_thread_blocks_across_its_axis_unless_it_is_ignored(self):
        """It is unscrewed along the axis, and nowhere else."""
        assert ("bolt", "block") in links(relation("threads"), 0)
        assert ("bolt", "block") not in links(related(product("threads"), threads="ignore"), 0)


class TestConfirmation:
    """Shrunk meshes that are moved, as a second opinion on rays."""

    @pytest.mark.parametrize(
        "name",
        thinned(
            ["dovetail", "floating", "interlocked", "l_slot", "threads"], "dovetail", "threads"
        ),
    )
    def test_meshes_agree_with_rays(self, name):
        """On each pair that blocks, and each that touches and does not."""
        result = relation(name)
        touching = [contact.parts for contact in result.contacts if contact.kind != "thread"]
        confirmation = Confirmation(product(name), 1e-4)
        assert confirmation.find_doubts(result.blocked, touching, result.directions) == ()

    def test_what_rays_got_wrong_is_listed(self):
        """A link that is not there, and one that is missing."""
        result = relation("l_slot")
        missing = Confirmation(product("l_slot"), 1e-4).find_doubts(
            [], [("body", "key")], result.directions
        )
        assert missing
        assert not any(item.rays_say_blocked for item in missing)
        link = relation("floating").blocked[0]
        invented = dataclasses.replace(link, part="balloon", by="plate", direction=0)
        (wrong,) = Confirmation(product("floating"), 1e-4).find_doubts(
            [invented], [], relation("floating").directions
        )
        assert wrong.rays_say_blocked


def test_rays_in_the_planes_of_walls_end_at_the_part():
    """Rounding decides which triangle they hit, and the plane of a wall gives no distance."""
    box = trimesh.creation.box((0.02, 0.02, 0.02))
    for step in range(20):
        turn = turned((31.0 * step, 17.0 * step, 53.0 * step))
        part = SimpleNamespace(vertices_m=box.vertices @ turn.T, triangles=box.faces)
        origins = np.array([(10.0, -50.0, z_mm) for z_mm in range(-9, 10, 2)]) @ turn.T
        directions = np.tile(turn @ (0.0, 1.0, 0.0), (len(origins), 1))
        hit, distances = RayMesh(part, np.zeros(3)).trace(origins, directions)
        struck = distances[hit >= 0]
        assert len(struck)
        assert ((struck > 40 - 1e-3) & (struck < 60 + 1e-3)).all()
