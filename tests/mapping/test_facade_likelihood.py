"""Facade likelihood: the nearer points are to walls, the likelier, as particle filters are told."""

import numpy as np
import pytest

from factorloc.errors import MapError
from factorloc.mapping.facade_likelihood import facade_field, facade_likelihood
from factorloc.mapping.facades import Facades
from factorloc.scan import Scan

WALLS = Facades([[[0, 5], [10, 5]], [[12, 8], [12, -8]]], [0, 1], [1.0, 1.0], [0.1, 0.1])


def test_field_is_the_distance_to_the_nearest_wall():
    field = facade_field(WALLS, resolution=0.1, farthest=3.0)
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -4], [14, 9], (500, 2))
    along = np.clip(points[:, 0], 0, 10)
    first = np.hypot(points[:, 0] - along, points[:, 1] - 5)
    second = np.hypot(points[:, 0] - 12, points[:, 1] - np.clip(points[:, 1], -8, 8))
    np.testing.assert_allclose(field.at(points), np.minimum(np.minimum(first, second), 3.0), atol=0.2)


def test_the_true_pose_is_likelier_than_poses_beside_it():
    points = np.concatenate(
        [np.stack([np.linspace(1, 9, 40), np.full(40, 5.0)], -1), [[12.0, y] for y in range(-6, 7)]]
    )
    model = facade_likelihood(WALLS, 0.3)
    scan = Scan.from_points(points - [5.0, 0.0], (0.1, 50.0))
    poses = np.array([[5.0, 0.0, 0.0], [5.0, 1.0, 0.0], [5.8, 0.0, 0.0], [5.0, 0.0, 0.15]])
    assert np.argmax(model.scan_log_likelihoods(scan, poses)) == 0


def test_a_map_without_facades_gets_one_line():
    with pytest.raises(MapError):
        facade_likelihood(WALLS.select(np.zeros(0, np.int64)))
