import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import SimulationError
from factorloc.simulation import primitives as shapes

COURT = shapely.box(0, 0, 6, 4).difference(shapely.box(1, 1, 2, 3)).difference(shapely.box(3, 1, 5, 2))
SIZES = st.floats(0.1, 9)


def assert_closed(mesh, volume=None):
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    if volume is not None:
        assert mesh.volume == pytest.approx(volume)


@given(SIZES, SIZES, SIZES, st.floats(-4, 4))
def test_a_box_stands_on_its_base(a, b, c, yaw):
    mesh = shapes.box((a, b, c), (1, 2, 3), yaw)
    assert_closed(mesh, a * b * c)
    assert mesh.center_mass == pytest.approx([1, 2, 3 + c / 2])
    assert mesh.bounds[:, 2] == pytest.approx([3, 3 + c])


@given(SIZES, st.floats(0, 9), SIZES, st.integers(3, 24))
def test_the_mean_width_of_a_round_section_is_its_diameter(low, high, height, sections):
    mesh = shapes.cone(low, high, height, (1, 2, 3), sections)
    assert_closed(mesh)
    assert mesh.bounds[:, 2] == pytest.approx([3, 3 + height])
    for z, diameter in ((3, low), (3 + height, high)):
        ring = mesh.vertices[np.isclose(mesh.vertices[:, 2], z)][:, :2]
        # Cauchy: the mean width of a convex outline is its perimeter divided by pi.
        hull = shapely.MultiPoint(ring).convex_hull
        assert hull.length == pytest.approx(np.pi * diameter if diameter > 1e-9 else 0, abs=1e-6)


def test_a_cone_ends_in_a_point():
    assert len(shapes.cone(1, 0, 2, sections=12).faces) == 24


@pytest.mark.parametrize("polygon", [COURT, COURT.reverse(), shapely.Point(1, 2).buffer(3)])
def test_a_prism_keeps_holes(polygon):
    mesh = shapes.prism(polygon, -1, 2.5)
    assert_closed(mesh, 3.5 * polygon.area)
    assert mesh.euler_number == 2 - 2 * len(polygon.interiors)


def test_corners_that_are_given_twice_or_in_line_do_no_harm():
    square = shapely.Polygon([(0, 0), (1, 0), (1, 0), (2, 0), (2, 2), (0, 2), (0, 1)])
    assert_closed(shapes.prism(square, 0, 1), 4)


def test_an_ellipsoid_and_a_hull_are_closed():
    assert_closed(shapes.sphere((1, 2, 3), subdivisions=3), pytest.approx(np.pi, rel=0.02))
    assert_closed(shapes.convex(np.random.default_rng(0).random((30, 3))))


def test_joined_parts_stay_closed_where_they_touch():
    parts = [shapes.box((1, 1, 1)), shapes.box((1, 1, 1), (1, 0, 0)), shapes.cylinder(1, 2)]
    mesh = shapes.joined(parts)
    assert_closed(mesh, sum(part.volume for part in parts))
    assert len(mesh.faces) == sum(len(part.faces) for part in parts)


def test_welding_restores_what_triangles_share():
    box = shapes.box((1, 2, 3), (4, 5, 6), 0.7)
    welded = shapes.welded(np.asarray(box.triangles))
    assert len(welded.vertices) == 8
    assert_closed(welded, 6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: shapes.box((1, 0, 1)), "size"),
        (lambda: shapes.boxes([[[0, 0, 0], [1, -1, 1]]]), "highest"),
        (lambda: shapes.cylinder(np.nan, 1), "diameter"),
        (lambda: shapes.cone(1, -1, 1), "top diameter"),
        (lambda: shapes.prism(COURT, 1, 1), "not above"),
        (lambda: shapes.prism(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), 0, 1), "Self-intersection"),
        (lambda: shapes.prism(shapely.Polygon(), 0, 1), "polygon"),
        (lambda: shapes.joined([]), "no mesh"),
    ],
)
def test_what_has_no_volume_is_refused(make, message):
    with pytest.raises(SimulationError, match=message):
        make()
