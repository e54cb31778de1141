"""Meshes that are not convex: as exact as the boxes they are the union of, and in pieces."""

import math
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from concave_shapes import channel, channel_boxes
from skillplan import collision
from skillplan.collision import decomposition
from skillplan.task import Box, Cylinder, Pose

ORIGIN = (0.0, 0.0, 0.0)
places = st.floats(-0.05, 0.05)
angles = st.floats(-3.1, 3.1)
shapes = st.builds(Box, st.tuples(*[st.floats(0.01, 0.04)] * 3), st.just(ORIGIN)) | st.builds(
    Cylinder, st.floats(0.01, 0.04), st.floats(0.01, 0.04), st.just(ORIGIN)
)
turns = st.tuples(st.just(0.0), st.just(0.0), angles) | st.tuples(angles, angles, angles)


@given(shapes, places, places, turns)
@settings(max_examples=20, deadline=None)
def test_what_falls_into_a_channel_falls_as_far_as_into_its_boxes(shape, x_m, y_m, turn):
    """Onto the floor, or onto a wall."""
    falling = collision.Solid((shape,), Pose.turned((x_m, y_m, 0.2), turn))
    mesh, boxes = (
        collision.Solid((channel(),), Pose(ORIGIN)),
        collision.Solid(channel_boxes(), Pose(ORIGIN)),
    )
    first, other = falling.fall_m(mesh), falling.fall_m(boxes)
    assert (first is None) == (other is None)
    if first is not None and other is not None:
        assert first == pytest.approx(other, abs=1e-4)


@given(shapes, places, places, st.floats(-0.01, 0.07), turns)
@settings(max_examples=15, deadline=None)
def test_what_overlaps_a_channel_overlaps_its_boxes(shape, x_m, y_m, z_m, turn):
    """Whatever is much deeper than what counts as touching."""
    there = collision.Solid((shape,), Pose.turned((x_m, y_m, z_m), turn))
    in_mesh = there.depth_m(collision.Solid((channel(),), Pose(ORIGIN)))
    in_boxes = there.depth_m(collision.Solid(channel_boxes(), Pose(ORIGIN)))
    if in_boxes > 3 * collision.TOUCH_M:
        assert in_mesh > collision.TOUCH_M / 2
    if in_mesh > 3 * collision.TOUCH_M:
        assert in_boxes > collision.TOUCH_M / 2


def test_points_are_as_deep_as_they_are_far_from_the_surface():
    """In the floor, in a wall, in between, and far away."""
    points = np.array([[0, 0, 0.001], [0.0485, 0, 0.03], [0, 0, 0.014], [0, 0, 0.5]])
    result = collision.measure_depths(collision.make_polyhedron(channel(), Pose(ORIGIN)), points)
    assert result == pytest.approx([0.001, 0.0015, -0.01, -math.hypot(0.45, 0.046)], abs=1e-9)


def test_of_points_the_outermost_outside_counts_however_deep_others_are():
    """The middle of the floor is deeper than the outer point is far away."""
    surface = collision.make_polyhedron(channel(), Pose(ORIGIN))
    points = np.array([[0, 0, 0.001], [0, 0, 0.0025], [0, 0, -0.0005]])
    assert collision.measure_outermost(surface, points) == pytest.approx(0.0005, abs=1e-9)
    assert collision.measure_outermost(surface, points[:2]) == 0.0


@given(st.lists(st.tuples(*[st.floats(-0.06, 0.06)] * 6), min_size=1, max_size=4))
def test_the_deepest_point_of_edges_is_as_deep_as_that_of_many_points_on_them(ends):
    """Whatever bounds leave out; what is shallower than 0.2 mm counts as none."""
    surface, edges = (
        collision.make_polyhedron(channel(), Pose(ORIGIN)),
        np.array(ends).reshape(-1, 2, 3),
    )
    shares = np.linspace(0, 1, 201)[:, None]
    points = np.concatenate([begin + shares * (end - begin) for begin, end in edges])
    deepest = max(0.0, float(collision.measure_depths(surface, points).max()))
    assert deepest - 2e-4 <= collision.measure_deepest(surface, edges) <= deepest + 5e-4


@pytest.mark.slow(reason="many depths; other walls in every run")
def test_a_wall_that_a_board_goes_through_is_told_by_the_way_out():
    """Sideways through the wall, not half of its thickness."""
    board = Box((0.08, 0.06, 0.004), (0, 0, 0.002))
    case = collision.Solid((channel(),), Pose(ORIGIN))
    assert collision.Solid((board,), Pose((0.0, 0.0, 0.004))).way_out_m(case) == pytest.approx(
        0, abs=1e-9
    )
    through = collision.Solid((board,), Pose((0.01, 0.0, 0.004)))
    assert through.way_out_m(case) == pytest.approx(0.004, abs=2e-4)


class Provider:
    """Takes the channel apart into its boxes, and counts how often."""

    version = "1"

    def __init__(self, pieces):
        self.asked, self.pieces = 0, pieces

    def __call__(self, corners, faces):
        self.asked += 1
        created = [collision.make_polyhedron(box, Pose(ORIGIN)) for box in self.pieces]
        return [(item.corners, item.faces) for item in created]


@pytest.fixture
def provided(monkeypatch, tmp_path):
    """Install a provider of pieces, or none, with an empty cache."""

    def install(provider):
        monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path))
        decomposition._get_cache_slot.cache_clear()
        entry = EntryPoint("boxes", "nowhere:boxes", "skillplan.decomposition")
        listed = [] if provider is None else [entry]
        monkeypatch.setattr(decomposition, "list_decompositions", lambda: listed)
        monkeypatch.setattr(EntryPoint, "load", lambda self: provider)
        return tmp_path / "pieces"

    yield install
    decomposition._get_cache_slot.cache_clear()


def test_pieces_are_made_once_and_kept_by_hash(provided):
    """In memory, and on disk; what is spoilt there is made again."""
    provider = Provider(channel_boxes())
    folder = provided(provider)
    created = collision.decompose(channel())
    assert (3, 1) == (len(created.pieces), provider.asked)
    assert created.error_m < 1e-6
    decomposition._get_cache_slot.cache_clear()
    assert created == collision.decompose(channel())
    assert provider.asked == 1
    (kept,) = folder.iterdir()
    kept.write_text("{")
    decomposition._get_cache_slot.cache_clear()
    assert created == collision.decompose(channel())
    assert provider.asked == 2
    provider.version = "2"
    decomposition._get_cache_slot.cache_clear()
    collision.decompose(channel())
    assert (2, 3) == (len(list(folder.iterdir())), provider.asked)


def test_a_line_announces_pieces_that_are_made_and_none_those_that_are_kept(provided, caplog):
    """With the name that the caller gives, and how many faces there are to take apart."""
    provided(Provider(channel_boxes()))
    collision.decompose(channel(), "'case', mesh 2 of 9")
    (line,) = caplog.messages
    assert line.startswith("skillplan: making convex pieces of 'case', mesh 2 of 9 (28 faces)")
    decomposition._get_cache_slot.cache_clear()
    collision.decompose(channel(), "'case', mesh 2 of 9")
    assert caplog.messages == [line]


def test_the_error_of_pieces_is_measured_both_ways(provided):
    """A block that fills the channel stands out of it, and one wall alone falls short."""
    provided(Provider([Box((0.10, 0.08, 0.05), (0.0, 0.0, 0.025))]))
    filled = collision.decompose(channel())
    assert filled.outside_m > 0.02
    assert filled.missing_m == 0
    floor = Provider(channel_boxes()[:1])
    floor.version = "floor"
    provided(floor)
    short = collision.decompose(channel())
    assert short.missing_m == pytest.approx(0.046, abs=1e-6)
    assert short.outside_m == 0


def test_without_a_provider_or_with_a_broken_one_words_say_so(provided):
    """And what to install, or to do instead."""
    provided(None)
    with pytest.raises(collision.NoPieces, match="Install skillplan-pinocchio, or split it"):
        collision.decompose(channel())
    provider = Provider([])
    provider.version = "none"
    provided(provider)
    with pytest.raises(collision.NoPieces, match="boxes could not take it apart"):
        collision.decompose(channel())
