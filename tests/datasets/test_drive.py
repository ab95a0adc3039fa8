from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.datasets import Drive
from factorloc.errors import DataError
from factorloc.geometry import se2
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
