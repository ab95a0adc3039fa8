from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.datasets import Drive
from factorloc.errors import DataError
from factorloc.geometry import se2, se3
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory


def drive(n: int, seed: int = 0, unknown: tuple[int, ...] = ()) -> Drive:
    rng = np.random.default_rng(seed)
    scans = tuple(Scan.from_polar([0.0, 1.0], [1.0, 2.0], (0, 5), stamp=k) for k in range(n))
    known = np.ones(n - 1, bool)
    known[list(unknown)] = False
    truth = Trajectory(np.arange(n), rng.normal(size=(n, 3)))
    return Drive("test", scans, rng.normal(size=(n - 1, 3)), known, truth, keys=10.0 * np.arange(n))


@given(st.sets(st.integers(0, 19), min_size=1), st.integers(0, 99))
def test_selection_composes_the_motions_left_out(chosen: set[int], seed: int) -> None:
    rows, whole = sorted(chosen), drive(20, seed)
    part = whole.select(rows)
    assert len(part) == len(part.truth) == len(rows)
    for k, (first, last) in enumerate(pairwise(rows)):
        motion = se2.identity()
        for step in whole.odometry[first:last]:
            motion = se2.compose(motion, step)
        np.testing.assert_allclose(se2.between(motion, part.odometry[k]), 0, atol=1e-12)
    np.testing.assert_array_equal(part.keys, 10.0 * np.array(rows))
    np.testing.assert_array_equal(part.truth.poses, whole.truth.poses[rows])
    assert [scan.stamp for scan in part.scans] == part.stamps.tolist() == rows


def test_a_composed_motion_is_known_only_if_all_of_it_is() -> None:
    part = drive(8, unknown=(2, 5)).select([0, 2, 3, 5, 7])
    assert part.odometry_known.tolist() == [True, False, True, False]
    assert (part.odometry[1] == 0).all() and (part.odometry[3] == 0).all()
    assert (part.odometry[[0, 2]] != 0).any(axis=1).all()


def test_masks_slices_and_indices_select_alike() -> None:
    whole = drive(9)
    for rows in (slice(1, None, 3), np.arange(9) % 3 == 1, [1, 4, -2]):
        np.testing.assert_array_equal(whole.select(rows).stamps, [1, 4, 7])


@pytest.mark.parametrize("rows", [[], [3, 2], [1, 1], [9], np.zeros(9, bool), np.ones(4, bool)])
def test_a_bad_selection_is_an_error(rows) -> None:
    with pytest.raises(DataError, match="select"):
        drive(9).select(rows)


def test_dead_reckoning_starts_where_told_and_moves_by_odometry() -> None:
    whole = drive(6)
    poses = whole.dead_reckoning([1, 2, 3]).poses
    np.testing.assert_array_equal(poses[0], [1, 2, 3])
    np.testing.assert_allclose(se2.between(poses[:-1], poses[1:]), se2.as_poses(whole.odometry), atol=1e-12)


def test_unknown_motion_is_zero() -> None:
    assert (drive(4, unknown=(1,)).odometry[1] == 0).all()


def test_what_does_not_fit_is_an_error() -> None:
    scans = drive(3).scans
    with pytest.raises(DataError, match="without scans"):
        Drive("test", (), np.zeros((0, 3)))
    with pytest.raises(DataError, match="3 rows of odometry for 3 scans; expected 2"):
        Drive("test", scans, np.zeros((3, 3)))
    with pytest.raises(DataError, match="odometry holds NaN"):
        Drive("test", scans, np.full((2, 3), np.nan))
    with pytest.raises(DataError, match="poses of truth"):
        Drive("test", scans, np.zeros((2, 3)), truth=Trajectory(np.zeros(2), np.zeros((2, 3))))
    assert len(Drive("test", scans[:1], np.zeros((0, 3)))) == 1


SPREADS = {2: np.array([0.1, 0.05, 0.02]), 3: np.array([0.01, 0.02, 0.03, 0.1, 0.05, 0.02])}


def moving(n: int, dimension: int, seed: int = 0, unknown: tuple[int, ...] = ()) -> Drive:
    """A drive in the plane or in space, whose motions have covariances."""
    rng = np.random.default_rng(seed)
    group, freedom = (se2, 3) if dimension == 2 else (se3, 6)
    scans = tuple(Scan.from_points(np.eye(dimension), (0, 5), stamp=k) for k in range(n))
    known = np.ones(n - 1, bool)
    known[list(unknown)] = False
    roots = rng.normal(size=(n - 1, freedom, freedom)) * SPREADS[dimension][:, None]
    covariances = roots @ np.swapaxes(roots, -1, -2) + 1e-6 * np.eye(freedom)
    truth = Trajectory(np.arange(n), group.exp(rng.normal(size=(n, freedom))))
    motions = group.exp(rng.normal(size=(n - 1, freedom)))
    return Drive("moving", scans, motions, known, truth, odometry_covariances=covariances)


@given(st.sets(st.integers(0, 11), min_size=1), st.integers(0, 99), st.sampled_from([2, 3]))
def test_motions_and_covariances_are_composed_one_by_one(chosen: set[int], seed: int, dimension: int) -> None:
    rows, whole = sorted(chosen), moving(12, dimension, seed)
    group = se2 if dimension == 2 else se3
    part = whole.select(rows)
    assert part.dimension == whole.dimension == dimension
    assert part.odometry_known.all()
    for k, (first, last) in enumerate(pairwise(rows)):
        motion, covariance = group.identity(), np.zeros((3 * dimension - 3, 3 * dimension - 3))
        for step, more in zip(whole.odometry[first:last], whole.odometry_covariances[first:last], strict=True):
            carry = group.adjoint(group.inverse(step))
            motion, covariance = group.compose(motion, step), carry @ covariance @ carry.T + more
        np.testing.assert_allclose(group.between(motion, part.odometry[k]), group.identity(), atol=1e-10)
        np.testing.assert_allclose(part.odometry_covariances[k], covariance, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("dimension", [2, 3])
def test_composed_covariances_are_those_of_sampled_motions(dimension: int) -> None:
    group, whole = (se2, moving(4, 2)) if dimension == 2 else (se3, moving(4, 3))
    rng, scale = np.random.default_rng(3), 0.05  # small, as covariances are composed to first order
    motion = group.identity()
    for step, covariance in zip(whole.odometry, whole.odometry_covariances, strict=True):
        noise = scale * rng.multivariate_normal(np.zeros(len(covariance)), covariance, 20_000)
        motion = group.compose(motion, group.compose(step, group.exp(noise)))
    end = whole.select([0, 3])
    sampled = np.cov(group.log(group.between(end.odometry[0], motion)).T) / scale**2
    deviation = np.sqrt(np.diag(end.odometry_covariances[0]))
    np.testing.assert_allclose((sampled - end.odometry_covariances[0]) / np.outer(deviation, deviation), 0, atol=0.05)


def test_spatial_dead_reckoning_chains_the_motions() -> None:
    whole = moving(6, 3)
    start = se3.exp([1, 0, 0.5, 3, 2, 1])
    path = whole.dead_reckoning(start)
    np.testing.assert_allclose(path.poses[0], start, atol=1e-12)
    np.testing.assert_allclose(se3.between(path.poses[:-1], path.poses[1:]), whole.odometry, atol=1e-12)
    assert (path.world, whole.dead_reckoning().world) == ("map", "odom")


def test_printed_rotations_do_not_spoil_a_long_chain() -> None:
    n = 3000
    scans = moving(2, 3).scans[:1] * n
    printed = np.round(se3.exp(np.tile([0.01, 0.02, 0.3, 1, 0, 0], (n - 1, 1))), 7)
    poses = Drive("long", scans, printed).dead_reckoning().poses  # refuses poses that are not rigid
    assert np.abs(poses[-1, :3, :3] @ poses[-1, :3, :3].T - np.eye(3)).max() < 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_not_known_is_no_motion_and_has_no_covariance(dimension: int) -> None:
    whole = moving(8, dimension, unknown=(2, 5))
    group = se2 if dimension == 2 else se3
    assert (whole.odometry_covariances[[2, 5]] == 0).all()
    np.testing.assert_array_equal(whole.odometry[[2, 5]], group.identity((2,)))
    part = whole.select([0, 2, 3, 5, 7])
    assert part.odometry_known.tolist() == [True, False, True, False]
    np.testing.assert_array_equal(part.odometry[[1, 3]], group.identity((2,)))
    assert (part.odometry_covariances[[1, 3]] == 0).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_drive_of_one_scan_has_empty_odometry(dimension: int) -> None:
    alone = moving(3, dimension).select([1])
    freedom = 3 * dimension - 3
    assert alone.odometry.shape == ((0, 3) if dimension == 2 else (0, 4, 4))
    assert alone.odometry_covariances.shape == (0, freedom, freedom)
    assert len(alone.dead_reckoning()) == 1


def test_dimensions_do_not_mix() -> None:
    planar, spatial = moving(3, 2), moving(3, 3)
    with pytest.raises(DataError, match="planar and spatial scans"):
        Drive("test", (planar.scans[0], spatial.scans[0]), np.zeros((1, 3)))
    with pytest.raises(DataError, match=r"shape \(2, 3\) of odometry; expected \(2, 4, 4\)"):
        Drive("test", spatial.scans, planar.odometry)
    with pytest.raises(DataError, match="truth and scans differ in dimension"):
        Drive("test", spatial.scans, spatial.odometry, truth=planar.truth)
    with pytest.raises(DataError, match=r"odometry_covariances; expected \(2, 6, 6\)"):
        Drive("test", spatial.scans, spatial.odometry, odometry_covariances=planar.odometry_covariances)


def test_motions_and_covariances_must_be_possible() -> None:
    spatial = moving(3, 3)
    with pytest.raises(DataError, match="no rigid motions"):
        Drive("test", spatial.scans, 2 * spatial.odometry)
    for wrong in (-spatial.odometry_covariances, np.triu(spatial.odometry_covariances)):
        with pytest.raises(DataError, match="not symmetric and positive definite"):
            Drive("test", spatial.scans, spatial.odometry, odometry_covariances=wrong)
    with pytest.raises(DataError, match="1 rows of odometry_covariances for 3 scans; expected 2"):
        Drive("test", spatial.scans, spatial.odometry, odometry_covariances=spatial.odometry_covariances[:1])
