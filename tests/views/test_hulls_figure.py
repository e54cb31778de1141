"""Hulls in three dimensions: each in the colour of its role, and nothing but what there is."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import pytest
from matplotlib.figure import Figure

from skillplan.collision import Hull, HullRole, HullScene
from skillplan.task import Point
from skillplan.views.figures import Heading, draw_hulls, render_image

HEADING = Heading("swept: place(lid)", "runs into box")
FACES = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))


def tetrahedron(name: str, role: HullRole, x_m: float = 0.0) -> Hull:
    """Return a small hull."""
    corners: Sequence[Point] = (
        (x_m, 0.0, 0.0),
        (x_m + 0.1, 0.0, 0.0),
        (x_m, 0.1, 0.0),
        (x_m, 0.0, 0.1),
    )
    return Hull(name, role, corners, FACES)


@pytest.fixture
def figure():
    """Something swept that runs into a box, beside a post."""
    scene = HullScene(
        [
            tetrahedron("the hand", HullRole.MOVING),
            tetrahedron("box", HullRole.MET, 0.05),
            tetrahedron("post", HullRole.STANDING, 0.2),
        ],
        [(0.06, 0.01, 0.01)],
    )
    return draw_hulls(scene, HEADING)


def gids(figure: Figure) -> set[str]:
    return {get_child.get_gid() or "" for get_child in figure.axes[0].get_children()}


def test_every_hull_is_drawn_and_where_it_is_touched(figure):
    assert {"moving the hand", "met box", "standing post", "touches"} <= gids(figure)


def test_bodies_are_named_and_what_moves_is_not(figure):
    """The hand is told by its colour."""
    texts = {text.get_text() for text in figure.axes[0].texts}
    assert {"box", "post"} <= texts
    assert "the hand" not in texts


def test_the_bodies_of_a_verdict_and_no_others_are_named():
    """The load that would tip is named, too, though it moves."""
    scene = HullScene(
        [
            tetrahedron("lid", HullRole.MOVING),
            tetrahedron("box", HullRole.MET, 0.05),
            tetrahedron("post", HullRole.STANDING, 0.2),
        ],
        reason="lid would tip off box",
        subjects=frozenset({"lid", "box"}),
    )
    (axes,) = draw_hulls(scene, HEADING).axes
    assert [text.get_text() for text in axes.texts] == ["lid", "box"]


def test_names_stand_before_all_hulls_and_not_across_each_other():
    """Also of what stands in the same place, and however many hulls there are."""
    scene = HullScene(
        [tetrahedron("the hand", HullRole.MOVING)]
        + [tetrahedron(name, HullRole.STANDING) for name in ("case", "cover", "board")]
    )
    drawn = draw_hulls(scene, HEADING)
    drawn.canvas.draw()
    (axes,) = drawn.axes
    assert min(text.zorder for text in axes.texts) > max(
        collection.zorder for collection in axes.collections
    )
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 3
    assert not any(first.overlaps(other) for first, other in combinations(boxes, 2))


def test_what_stands_far_off_is_not_drawn_beyond_the_axes():
    scene = HullScene(
        [tetrahedron("the hand", HullRole.MOVING), tetrahedron("far", HullRole.STANDING, 0.5)]
    )
    drawn = draw_hulls(scene, HEADING)
    assert "standing far" not in gids(drawn)
    assert "far" not in {text.get_text() for text in drawn.axes[0].texts}


def test_the_legend_holds_only_what_there_is():
    scene = HullScene([tetrahedron("the hand", HullRole.MOVING)])
    (legend,) = draw_hulls(scene, HEADING).legends
    assert ["swept by hand, load and arm"] == [text.get_text() for text in legend.get_texts()]


def test_no_hull_is_no_figure():
    with pytest.raises(ValueError, match="No hull"):
        draw_hulls(HullScene([]), HEADING)


def test_a_triangle_needs_its_corners():
    with pytest.raises(ValueError, match="'box' has a corner without a place"):
        Hull("box", HullRole.MET, ((0.0, 0.0, 0.0),), ((0, 1, 2),))


def test_a_figure_becomes_a_picture_of_its_size(figure):
    """In pixels, as the dots per inch have it."""
    wide_in, tall_in = figure.get_size_inches()
    image = render_image(figure, dpi=50)
    assert image.width == pytest.approx(50 * wide_in, abs=1)
    assert image.height == pytest.approx(50 * tall_in, abs=1)
    assert 2 < len(set(image.rgb))
