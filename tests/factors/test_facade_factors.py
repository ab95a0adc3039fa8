"""Facade factors against numerical derivatives, in the plane and in space."""

import gtsam
import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.factors import FacadeLineFactor, FacadePointFactor
from factorloc.geometry import se2, se3

KEY = 3


def scene(dimension, rng, count=40):
    points = rng.uniform(-20, 20, (count, dimension))
    alphas = rng.uniform(-np.pi, np.pi, count)
    normals = np.stack([np.cos(alphas), np.sin(alphas)], -1)
    pose = se2.exp(rng.normal(0, 1, 3)) if dimension == 2 else se3.exp(rng.normal(0, 0.5, 6))
    ends = (se2 if dimension == 2 else se3).transform(pose, points)[:, :2]
    distances = (normals * ends).sum(1) + rng.normal(0, 0.3, count)
    return points, alphas, normals, distances, pose


def measurements(dimension, rng, cauchy):
    points, alphas, normals, distances, pose = scene(dimension, rng)
    heading = pose[2] if dimension == 2 else np.arctan2(pose[1, 0], pose[0, 0])
    return pose, (
        FacadePointFactor(points, normals, distances, 0.2, cauchy),
        FacadeLineFactor(points, alphas - heading + rng.normal(0, 0.05, 40), alphas, distances, 0.02, 0.2, cauchy),
    )


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("cauchy", [1.5, np.inf])
def test_derivatives_agree_with_differences(dimension, cauchy):
    rng = np.random.default_rng(4)
    pose, factors = measurements(dimension, rng, cauchy)
    group = se2 if dimension == 2 else se3
    for measurement in factors:
        _, J = measurement.rows(pose)
        for axis in range(J.shape[1]):
            step = np.zeros(J.shape[1])
            step[axis] = 1e-6
            ahead = measurement.rows(group.compose(pose, group.exp(step)))[0]
            back = measurement.rows(group.compose(pose, group.exp(-step)))[0]
            np.testing.assert_allclose((ahead - back) / 2e-6, J[:, axis], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_gtsam_sees_the_same(dimension):
    rng = np.random.default_rng(5)
    pose, factors = measurements(dimension, rng, 2.0)
    values = gtsam.Values()
    values.insert(KEY, gtsam.Pose2(*pose) if dimension == 2 else gtsam.Pose3(pose))
    for measurement in factors:
        rows, J = measurement.rows(pose)
        factor = measurement.factor(KEY)
        assert factor.error(values) == pytest.approx(0.5 * rows @ rows)
        linear = factor.linearize(values)
        np.testing.assert_allclose(linear.jacobian()[0], J, atol=1e-9)


def test_rows_are_the_loss_of_each_point():
    rng = np.random.default_rng(6)
    _, (points, _) = measurements(2, rng, 2.0)
    pose = np.zeros(3)
    plain = FacadePointFactor(points.points, points.normals, points.distances, points.sigmas, np.inf)
    r, rows = plain.rows(pose)[0], points.rows(pose)[0]
    np.testing.assert_allclose(0.5 * rows**2, 2.0 * np.log1p(r * r / 4.0))


def test_a_far_point_hardly_moves_the_pose():
    # A square of walls around the body, and a point 5 m off one of them.
    side = np.linspace(-5, 5, 21)
    corners = [
        (side, np.full(21, 10.0)),
        (side, np.full(21, -10.0)),
        (np.full(21, 8.0), side),
        (np.full(21, -8.0), side),
    ]
    points = np.concatenate([np.stack(corner, -1) for corner in corners])
    normals = np.repeat([[0, 1], [0, -1], [1, 0], [-1, 0]], 21, axis=0).astype(float)
    distances = np.repeat([10.0, 10.0, 8.0, 8.0], 21)
    points = np.vstack([points, [[0.0, 15.0]]])
    normals, distances = np.vstack([normals, [[0.0, 1.0]]]), np.append(distances, 10.0)
    graph = gtsam.NonlinearFactorGraph()
    graph.push_back(FacadePointFactor(points, normals, distances, 0.1).factor(KEY))
    values = gtsam.Values()
    values.insert(KEY, gtsam.Pose2(0.3, -0.2, 0.05))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPose2(KEY)
    assert np.hypot(found.x(), found.y()) < 0.01
    assert abs(found.theta()) < 0.001


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"points": np.zeros((0, 2))}, "at least one"),
        ({"sigmas": 0.0}, "not positive"),
        ({"normals": [[1, 0]]}, "normals"),
    ],
)
def test_bad_points_get_one_line(change, word):
    good = {"points": [[1.0, 2.0], [2.0, 2.0]], "normals": [[0, 1], [0, 1]], "distances": [2, 2], "sigmas": 0.1}
    with pytest.raises(GeometryError, match=word):
        FacadePointFactor(**{**good, **change})
