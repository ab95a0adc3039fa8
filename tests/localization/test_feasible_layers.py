"""Layers of a drive: what a scan speaks against is carried along, and a start in pieces is the start."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from facade_street import crossing
from hypothesis import given
from hypothesis import strategies as st
from test_facade_localization import facing, line_of

from factorloc.errors import GeometryError
from factorloc.localization._cell_kernels import mark_polygon, spread_corners
from factorloc.localization.feasible_layers import Layer, as_layers, hull_of_layers, hull_of_points
from factorloc.localization.feasible_set import intersect_correspondences, intersect_pieces
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.start_pieces import split_layers
from factorloc.localization.wall_lines import WallLines
from factorloc.result import Bounds


def holding(layers, pose):
    """Costs of the layers that hold a pose."""
    return [layer.cost for layer in layers if any(one.contains(pose) for one in layer.slices)]


@pytest.fixture(scope="module")
def scene():
    facades, true = crossing(np.random.default_rng(4))
    walls, pose = WallLines(facades), np.array([0.4, -0.7, 0.2])
    rows = facing(walls, pose)[:6]
    return walls, pose, [line_of(walls, true, row, pose) for row in rows]


def test_a_pose_that_a_false_line_speaks_against_is_carried_along_at_its_cost(scene):
    walls, pose, found = scene
    start = Bounds.around(pose, 4.0, np.radians(4.0))
    # Of the first wall, another 5 m away was found, and it looks right: doubt 0.002, weight 6.2.
    wrong = (replace(found[0], d=found[0].d + 5.0, doubt=0.002), *found[1:])
    feasible = intersect_correspondences(wrong, walls, start, FeasibleSettings(confidence=0.5), carried=True)
    costs = holding(feasible.layers, pose)
    assert costs == sorted(costs)
    again = intersect_correspondences(tuple(found), walls, feasible.layers, FeasibleSettings(confidence=0.9999))
    assert again.bounds.contains(pose)
    assert again.failed == 0


def test_layers_are_one_within_the_next(scene):
    walls, pose, found = scene
    start = Bounds.around(pose, 4.0, np.radians(4.0))
    layers = intersect_correspondences(tuple(found), walls, start, carried=True).layers
    assert [layer.cost for layer in layers] == sorted(layer.cost for layer in layers)
    rng = np.random.default_rng(1)
    for place in pose + rng.uniform(-1, 1, (300, 3)) * [4.0, 4.0, np.radians(4.0)]:
        inside = [any(one.contains(place) for one in layer.slices) for layer in layers]
        assert inside == sorted(inside)


def test_what_costs_more_is_kept_only_if_more_speaks_for_it(scene):
    walls, pose, found = scene
    left = Bounds.around(pose + np.array([-2.0, 0.0, 0.0]), 0.5, np.radians(1.0))
    right = Bounds.around(pose + np.array([2.0, 0.0, 0.0]), 0.5, np.radians(1.0))
    layers = (Layer(0.0, (left,)), Layer(60.0, (left, right)))
    settings = FeasibleSettings(memory=1.0)
    # Walls along one axis say nothing against either; the cost decides.
    along = [one for one in found if abs(walls.normals[one.facade][1]) > 0.9]
    feasible = intersect_correspondences(tuple(along), walls, layers, settings)
    assert feasible.bounds.contains(pose + np.array([-2.0, 0.0, 0.0]))
    assert not feasible.bounds.contains(pose + np.array([2.0, 0.0, 0.0]))


def test_pieces_hold_all_of_the_start_and_give_what_it_gives(scene):
    walls, pose, found = scene
    start = Bounds.around(pose + np.array([3.0, -2.0, 0.03]), 9.0, np.radians(7.0))
    layers = as_layers(start)
    pieces = split_layers(layers, 5.0, np.radians(5.0), 100)
    assert len(pieces) == 8
    rng = np.random.default_rng(2)
    for place in pose + np.array([3.0, -2.0, 0.03]) + rng.uniform(-1, 1, (300, 3)) * [9.0, 9.0, np.radians(7.0)]:
        assert sum(bool(holding(piece, place)) for piece in pieces) >= 1
    assert split_layers(layers, 5.0, np.radians(5.0), 7) == []
    assert split_layers(layers, 10.0, np.radians(10.0), 1) == [layers]
    parts = intersect_pieces([(tuple(found), piece) for piece in pieces], walls)
    whole = intersect_correspondences(tuple(found), walls, start)
    assert parts.bounds.contains(pose)
    assert whole.bounds.contains(pose)
    assert parts.failed == whole.failed == 0
    assert np.ptp(parts.bounds.orientation) == pytest.approx(np.ptp(whole.bounds.orientation), abs=np.radians(0.8))


@pytest.mark.parametrize("size", [(0.0, 0.0), (12.0, 0.0), (0.0, 12.0), (12.0, 1e-8)])
def test_a_start_without_an_area_is_parted_too(size):
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * size + [3.0, 4.0]
    layers = as_layers(Bounds((0.1, 0.5), (corners,)))
    pieces = split_layers(layers, 5.0, np.radians(5.0), 100)
    assert len(pieces) == 3 * (3 if max(size) else 1)
    for share in np.linspace(0.0, 1.0, 7):
        place = corners[0] + share * (corners[2] - corners[0])
        for heading in (0.1, 0.31, 0.5):
            near = [
                piece for piece in pieces for layer in piece for one in layer.slices
                if one.contains([*place, heading], 1e-6)
            ]  # fmt: skip
            assert near


def test_lines_from_other_pieces_count(scene):
    """From one piece a wall was not found, from the other all were: the truth in the first one is not given up."""
    walls, pose, found = scene
    here = Bounds.around(pose, 1.0, np.radians(2.0))
    there = Bounds.around(pose + np.array([2.0, 0.0, 0.0]), 1.0, np.radians(2.0))
    pieces = [(tuple(found[:1]), as_layers(here)), (tuple(found), as_layers(there))]
    assert intersect_pieces(pieces, walls).bounds.contains(pose)


def test_no_layer_is_no_place():
    with pytest.raises(GeometryError, match="no pose is possible"):
        as_layers(())
    slices = Bounds((0.0, 0.1), (np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),))
    assert hull_of_layers(as_layers([slices])).contains([0.2, 0.2, 0.05])


@given(st.integers(0, 2**31))
def test_cells_that_hold_a_point_of_a_polygon_are_marked(seed):
    rng = np.random.default_rng(seed)
    polygon = hull_of_points(rng.uniform(-3, 3, (rng.integers(3, 9), 2)) * rng.choice([1.0, 1e-3], 2))
    flags = np.zeros((13, 11), np.bool_)
    mark_polygon(polygon, -2.5, -3.1, 0.5, 1e-9, flags)
    points = rng.dirichlet(np.ones(len(polygon)) * 0.4, 200) @ polygon
    x, y = np.floor((points - [-2.5, -3.1]) / 0.5).astype(int).T
    inside = (x >= 0) & (x < 11) & (y >= 0) & (y < 13)
    assert flags[y[inside], x[inside]].all()
    # And no cell is that is farther from it than its own diagonal.
    for row, column in np.argwhere(flags):
        centre = np.array([-2.5, -3.1]) + 0.5 * (np.array([column, row]) + 0.5)
        edge, away = np.roll(polygon, -1, 0) - polygon, centre - polygon
        beyond = edge[:, 1] * away[:, 0] - edge[:, 0] * away[:, 1]
        assert (beyond <= (0.25 + 1e-6) * np.abs(edge).sum(1) + 1e-6).all()


@given(st.lists(st.tuples(st.sampled_from([0.0, 1e-9, 1.0, 2.0]), st.sampled_from([0.0, 1e-9, 1.0])), min_size=1))
def test_corners_are_kept_apart(corners):
    given_corners = np.array(corners)
    out = np.empty_like(given_corners)
    count = spread_corners(given_corners, 1e-6, out)
    kept = out[:count]
    assert 1 <= count <= len(given_corners)
    for a, b in itertools.pairwise(kept):
        assert np.abs(a - b).max() > 1e-6
    for corner in given_corners:
        assert np.abs(kept - corner).max(1).min() <= 1e-6
