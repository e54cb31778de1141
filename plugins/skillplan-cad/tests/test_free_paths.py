"""What no straight line frees is free by a path, closed, or not decided within the budget."""

from __future__ import annotations

import numpy as np
import pytest

from cad_fixtures import box, part_of, rod
from skillplan_cad import Face, find_free_path, shrink_mesh

TUNNEL = box(0, 0, 0, 40, 40, 12) - box(5, 5, 3, 35, 15, 9)
L_TUNNEL = TUNNEL - box(25, 5, 3, 35, 40, 9)
KEY = box(6, 6, 3, 14, 14, 9)
LYING = box(-15, -15, -2.5, 15, 15, 2.5) - box(-10, -10, -2.5, 10, 10, 2.5)
UPRIGHT = box(4, -2.5, -10, 21, 2.5, 10) - box(8, -2.5, -6, 17, 2.5, 6)
BUSH = rod(0, 0, 0, 15, 20) - rod(0, 0, 5, 8, 15) - rod(0, 0, 5, 11.5, 4)
BAYONET = BUSH - box(0, -2.4, 5, 11.4, 2.4, 20)
SHAFT = rod(0, 0, 5, 7.5, 20) + box(-2, 0, 5, 2, 11, 8.6)
ROUND = Face(
    "cylinder",
    np.zeros(0, dtype=np.int64),
    (0.0, 0.0, 0.0),
    radius_m=0.0075,
    extent_m=(0.005, 0.025),
)


def test_two_moves_free_a_key_from_an_l_shaped_tunnel():
    path = find_free_path([part_of("key", KEY)], [part_of("body", L_TUNNEL)])
    assert (path.outcome, path.turned) == ("free", False)
    first, second = (np.asarray(move.offset_m) for move in path.moves)
    # To where the tunnel bends, and out of it.
    assert first == pytest.approx([first[0], 0, 0])
    assert 0.0189 < first[0] < 0.0211
    assert second == pytest.approx([0, second[1], 0])
    assert second[1] > 0.034


def test_a_key_as_wide_as_its_tunnel_finds_the_one_place_where_it_goes_on():
    tight = box(0, 0, 0, 40, 40, 12) - box(5, 6, 3, 35, 14, 9) - box(26, 6, 3, 34, 40, 9)
    path = find_free_path([part_of("key", KEY)], [part_of("body", tight)])
    assert path.outcome == "free"
    assert path.moves[0].offset_m[0] == pytest.approx(0.020, abs=2e-4)


def test_a_key_in_a_closed_tunnel_is_closed_in_and_the_body_is_named_with_a_point():
    path = find_free_path([part_of("key", KEY)], [part_of("body", TUNNEL)], turns=False)
    assert path.outcome == "closed"
    (met,) = path.in_the_way
    assert met.part == "body"
    assert np.all(np.asarray(met.point_m) > -0.001)
    assert np.all(np.asarray(met.point_m) < 0.041)


def test_a_budget_that_is_spent_says_so():
    path = find_free_path([part_of("key", KEY)], [part_of("body", L_TUNNEL)], budget=3, turns=False)
    assert (path.outcome, path.iterations, path.moves) == ("budget spent", 3, ())


def test_links_of_a_chain_are_closed_by_translations():
    links = part_of("upright", UPRIGHT), part_of("lying", LYING)
    path = find_free_path([links[0]], [links[1]], turns=False)
    assert path.outcome == "closed"


@pytest.mark.slow(reason="3 s of turns; that translations lead nowhere is left in every run")
def test_a_quarter_turn_frees_a_bayonet():
    path = find_free_path([part_of("shaft", SHAFT, [ROUND])], [part_of("bush", BAYONET)])
    assert (path.outcome, path.turned) == ("free", True)
    turn, lift = path.moves
    assert turn.angle_rad == pytest.approx(-np.pi / 2)
    assert turn.axis.direction == (0.0, 0.0, 1.0)
    assert lift.offset_m[2] > 0.0149


@pytest.mark.slow(reason="6 s of turns; that translations lead nowhere is left in every run")
def test_links_of_a_chain_are_closed_by_turns_too():
    links = part_of("upright", UPRIGHT), part_of("lying", LYING)
    path = find_free_path([links[0]], [links[1]])
    assert (path.outcome, path.turned) == ("closed", True)


def test_a_shrunk_box_is_smaller_by_the_inset_on_each_side():
    part = part_of("key", KEY)
    points = shrink_mesh(part.vertices_m, part.triangles, 1e-4)
    assert np.ptp(points, axis=0) == pytest.approx([0.0078, 0.0078, 0.0058], abs=1e-7)
