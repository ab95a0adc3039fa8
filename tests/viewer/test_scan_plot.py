from itertools import pairwise

import numpy as np
import pytest
from matplotlib.collections import PathCollection

from factorloc.errors import ConfigError, GeometryError
from factorloc.geometry import se3
from factorloc.scan import Scan
from factorloc.viewer import plot_scan, save_figure
from factorloc.viewer.slant import Slant

CLOUD = np.array([[4.0, 1, 0], [-3, 2, 5], [1, -2, 2], [4, 1, 3], [0, 5, 1]])
LIMITS = (0.5, 20.0)


@pytest.fixture
def scan():
    return Scan.from_points(CLOUD, LIMITS, T_body_sensor=se3.from_se2([1.0, 0, 0]))


@pytest.fixture
def fan():
    return Scan.from_polar([0.0, np.pi / 2, np.pi], [2.0, 3.0, np.inf], LIMITS)


def clouds_of(figure):
    """Places and heights of the points in each view, in the order they are drawn."""
    scatters = [c for axes in figure.axes for c in axes.collections if isinstance(c, PathCollection)]
    return [(np.asarray(s.get_offsets()), s.get_array()) for s in scatters if s.get_array() is not None]


def test_the_view_from_above_is_the_world_with_the_highest_on_top(scan):
    pose = se3.from_se2([10.0, 20, np.pi / 2])
    figure = plot_scan(scan, pose, views=["above"])
    ((places, heights),) = clouds_of(figure)
    world = se3.transform(pose @ scan.T_body_sensor, CLOUD)
    np.testing.assert_allclose(places, world[np.argsort(world[:, 2]), :2], atol=1e-12)
    np.testing.assert_allclose(heights, np.sort(CLOUD[:, 2]))
    assert (figure.axes[0].get_xlabel(), figure.axes[1].get_ylabel()) == ("x (m)", "height (m)")
    sensor = figure.axes[0].collections[-1].get_offsets()
    np.testing.assert_allclose(sensor, [[10.0, 21.0]], atol=1e-12)


def test_both_views_share_points_and_colours(scan):
    figure = plot_scan(scan, heights=(0, 4), colormap="cividis")
    above, oblique = clouds_of(figure)
    np.testing.assert_array_equal(np.sort(above[1]), np.sort(oblique[1]))
    scatters = [axes.collections[0] for axes in figure.axes[:2]]
    assert {s.get_clim() for s in scatters} == {(0, 4)}
    assert {s.get_cmap().name for s in scatters} == {"cividis"}


def test_what_is_in_front_is_drawn_last_at_a_slant():
    wall, behind = [0.0, -5, 1], [0.0, 5, 0]
    (cloud,) = clouds_of(plot_scan([wall, behind], views=["oblique"], azimuth=-np.pi / 2))
    np.testing.assert_array_equal(cloud[1], [0, 1])
    (cloud,) = clouds_of(plot_scan([wall, behind], views=["oblique"], azimuth=np.pi / 2))
    np.testing.assert_array_equal(cloud[1], [1, 0])


def test_a_slant_keeps_lengths_and_sides():
    slant = Slant(-np.pi / 2, np.pi / 6, (0.0, 4.0, 0.0, 2.0), 0.0, 1.0)
    east, north, up = np.eye(3)
    np.testing.assert_allclose(
        slant.project(np.array([east, north, up])), [[1, 0], [0, 0.5], [0, np.sqrt(0.75)]], atol=1e-15
    )
    np.testing.assert_allclose(slant.depth(np.array([east, north, up])), [0, np.sqrt(0.75), -0.5], atol=1e-15)
    np.testing.assert_allclose(slant.limits, (0, 4, 0, 1 + np.sqrt(0.75)), atol=1e-15)
    turned = Slant(0.7, 1.1, (0.0, 1.0, 0.0, 1.0), 0.0, 1.0)
    rows = np.column_stack([turned.project(np.eye(3)), turned.depth(np.eye(3))])
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-15)


def test_the_floor_names_its_ticks(scan):
    axes = plot_scan(scan, views=["oblique"], limits=(-4, 6, -3, 6)).axes[0]
    texts = [text.get_text() for text in axes.texts]
    assert texts == [*("−4", "−2", "0", "2", "4", "6", "x (m)"), *("−2", "0", "2", "4", "6", "y (m)")]
    places = [np.array(text.xy) for text in axes.texts[:6]]
    steps = np.array([b - a for a, b in pairwise(places)])
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-12)


def test_scans_are_asked_for_once_and_their_way_is_drawn(scan):
    class Asked(list):
        def __iter__(self):
            for one in super().__iter__():
                asked.append(one)
                yield one

    asked = []
    poses = se3.from_se2([[0.0, 0, 0], [5, 0, 0], [5, 5, 0]])
    figure = plot_scan(Asked([scan] * 3), poses, views=["above"])
    assert len(asked) == 3
    assert len(clouds_of(figure)[0][0]) == 15
    np.testing.assert_allclose(figure.axes[0].lines[-1].get_xydata(), [[1, 0], [6, 0], [6, 5]])


def test_planar_scans_show_their_rays_and_no_heights(fan):
    figure = plot_scan(fan, [1.0, 0, 0])
    (axes,) = figure.axes
    rays = next(c for c in axes.collections if hasattr(c, "get_segments"))
    np.testing.assert_allclose(
        rays.get_segments(), [[[1, 0], [3, 0]], [[1, 0], [1, 3]], [[1, 0], [-19, 0]]], atol=1e-12
    )
    points = next(c for c in axes.collections if c.get_rasterized() and c is not rays)
    np.testing.assert_allclose(points.get_offsets(), [[3, 0], [1, 3]], atol=1e-12)


def test_limits_cut_the_points_and_frame_them():
    figure = plot_scan(CLOUD, limits=(0, 2, -3, 6))
    for _, heights in clouds_of(figure):
        np.testing.assert_array_equal(np.sort(heights), [1, 2])
    assert (figure.axes[0].get_xlim(), figure.axes[0].get_ylim()) == ((0, 2), (-3, 6))


def test_the_way_ends_where_the_limits_do(scan):
    poses = se3.from_se2([[-20.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    for axes in plot_scan([scan] * 3, poses, limits=(-4, 6, -3, 6)).axes[:2]:
        way = np.ma.filled(axes.lines[-1].get_xydata(), np.nan)
        np.testing.assert_array_equal(np.isfinite(way).all(1), [False, True, True])


def test_flat_clouds_and_single_points_are_drawn(tmp_path):
    for number, points in enumerate([[[1.0, 2, 3]], [[1.0, 2], [4, 4]], np.zeros((4, 3))]):
        save_figure(plot_scan(points, views=["above", "oblique"]), tmp_path / f"{number}.png", dpi=40)


def test_what_cannot_be_drawn_says_why(scan, fan):
    for arguments, message in [
        (([scan, scan],), "2 scans need one each"),
        (([scan, scan], np.eye(4)), "1 for 2 scans"),
        (([scan, fan], np.stack([np.eye(4)] * 2)), "scan 1: has 2 dimensions"),
        ((fan, np.eye(4)), "poses"),
        ((CLOUD, np.eye(4)), "points have none"),
        (([],), "finite points"),
        (([[0.0, np.nan]],), "finite points"),
        ((scan.select([False] * 5),), "without a return"),
    ]:
        with pytest.raises(GeometryError, match=message):
            plot_scan(*arguments)
    for settings, message in [
        ({"limits": (1, 0, 0, 1)}, "x_min < x_max"),
        ({"limits": (100, 101, 0, 1)}, "no point lies within"),
        ({"heights": (2, 1)}, "lowest < highest"),
    ]:
        with pytest.raises(GeometryError, match=message):
            plot_scan(scan, **settings)
    for settings, message in [
        ({"views": []}, "views"),
        ({"views": ["below"]}, "views"),
        ({"views": ["above", "above"]}, "views"),
        ({"colormap": "rainbows"}, "unknown to matplotlib"),
        ({"point_size": 0}, "point_size"),
        ({"elevation": 0}, "elevation"),
        ({"azimuth": np.nan}, "azimuth"),
    ]:
        with pytest.raises(ConfigError, match=message):
            plot_scan(scan, **settings)
