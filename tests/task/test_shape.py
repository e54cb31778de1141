"""Shapes of bodies: boxes, cylinders and convex meshes."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.task import Box, Cylinder, Mesh

# A wedge 2 m long, 1 m wide and, where it is highest, 1 m high.
WEDGE = Mesh(
    ((0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 1)),
    ((3, 2, 1), (3, 1, 0), (0, 1, 4), (1, 2, 5), (1, 5, 4), (2, 3, 5), (3, 0, 4), (3, 4, 5)),
)
CYLINDER = Cylinder(0.04, 0.1, (1.0, 2.0, 0.05))
BOX = Box((0.1, 0.2, 0.3), (1.0, 2.0, 0.15))
SHAPES = {"box": BOX, "cylinder": CYLINDER, "wedge": WEDGE}
every_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_cylinder_has_a_positive_diameter_and_height(value):
    """Both checks of its constructor."""
    with pytest.raises(ValueError, match="diameter_m must be > 0"):
        Cylinder(value, 1.0, (0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="height_m must be > 0"):
        Cylinder(1.0, value, (0.0, 0.0, 0.0))


def test_a_mesh_has_finite_corners_with_a_volume():
    """The four checks of its constructor."""
    corners = WEDGE.corners
    with pytest.raises(ValueError, match="at least 4 corners, not 3"):
        Mesh(corners[:3], ())
    with pytest.raises(ValueError, match="must name corners 0 to 5"):
        Mesh(corners, ((0, 1, 6),))
    with pytest.raises(ValueError, match="must be finite"):
        Mesh(((math.nan, 0, 0), *corners[1:]), ())
    with pytest.raises(ValueError, match="extent along every axis"):
        Mesh(corners[:4], ())


def test_the_box_about_a_shape_touches_its_ends():
    """Figures by hand."""
    assert BOX.box == BOX
    assert CYLINDER.box == Box((0.04, 0.04, 0.1), (1.0, 2.0, 0.05))
    assert WEDGE.box == Box((2, 1, 1), (1.0, 0.5, 0.5))


def test_the_core_of_a_cylinder_has_its_corners_on_the_rim():
    """Of a box it is the box itself."""
    core = CYLINDER.core
    assert math.hypot(core.size[0] / 2, core.size[1] / 2) == pytest.approx(0.02)
    assert (core.size[2], core.centre) == (0.1, CYLINDER.centre)
    assert BOX.core == BOX


@every_shape
def test_the_core_of_a_shape_lies_inside_it(shape):
    """Each of its corners is below the surface; and it is no speck."""
    core = shape.core
    for x_sign in (-1, 1):
        for y_sign in (-1, 1):
            x_m = core.centre[0] + x_sign * core.size[0] / 2 * (1 - 1e-9)
            y_m = core.centre[1] + y_sign * core.size[1] / 2 * (1 - 1e-9)
            top_m = shape.top_m(x_m, y_m)
            assert top_m is not None
            assert core.centre[2] + core.size[2] / 2 <= top_m + 1e-9
    assert min(core.size) > 0.3 * min(shape.box.size)


def test_the_core_of_a_surface_that_is_not_closed_is_a_speck():
    """Nothing is known to be inside."""
    inside_out = Mesh(WEDGE.corners, tuple(face[::-1] for face in WEDGE.faces))
    assert max(inside_out.core.size) < 1e-8


def test_the_top_of_a_shape_is_its_surface():
    """At a point of its plan, the rim included; there is none beside it."""
    assert BOX.top_m(1.05, 2.1) == pytest.approx(0.3)
    assert BOX.top_m(1.051, 2.0) is None
    assert CYLINDER.top_m(1.0, 2.02) == pytest.approx(0.1)
    # In the corner of the box about it.
    assert CYLINDER.top_m(1.019, 2.019) is None
    assert WEDGE.top_m(2.001, 0.5) is None


@given(x_m=st.floats(0, 2), y_m=st.floats(0, 1))
def test_a_wedge_falls_away_evenly(x_m, y_m):
    """By a metre over two."""
    assert WEDGE.top_m(x_m, y_m) == pytest.approx(1 - x_m / 2, abs=1e-9)
