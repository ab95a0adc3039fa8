"""Noise of odometry told by a drive: near the truth, never too sure, and enough to see a row that moved."""

import numpy as np
import pytest
from pole_street import make_street, position_errors

from factorloc.factors import OdometryNoise
from factorloc.geometry import se2
from factorloc.localization.drive_noise import DriveNoise
from factorloc.localization.pole_search import dead_reckoned
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles

OFF = np.array([1.8, -1.6, 0.08])


def noisy_drive(seed: int, length: int = 800) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    turns = 0.02 * np.sin(np.arange(length) / 25.0)
    truth = dead_reckoned(np.zeros(3), np.column_stack([np.ones(length), np.zeros(length), turns]))
    motions = se2.between(truth[:-1], truth[1:])
    return truth, se2.compose(motions, se2.exp(rng.normal(0, 1, motions.shape) * [0.02, 0.02, 0.003]))


def test_noise_is_found_below_the_error_of_the_path() -> None:
    lengths, turns = [], []
    for seed in range(20):
        truth, motions = noisy_drive(seed)
        path = truth + np.random.default_rng(seed).normal(0, [0.05, 0.05, 0.004], truth.shape)
        found = DriveNoise.of(path, motions, np.ones(len(motions), bool))
        assert found is not None
        lengths.append(np.sqrt(found.length))
        turns.append(np.sqrt(found.turn))
    # One standard error above the truth, of which some are left below.
    assert 0.02 < np.median(lengths) < 0.035
    assert 0.003 < np.median(turns) < 0.0055
    assert np.min(lengths) > 0.01
    assert np.min(turns) > 0.0015


def test_places_where_the_path_is_wrong_hardly_count() -> None:
    truth, motions = noisy_drive(1)
    wrong = truth.copy()
    wrong[300:360, 1] += 2.0
    known = np.ones(len(motions), bool)
    right, found = DriveNoise.of(truth, motions, known), DriveNoise.of(wrong, motions, known)
    assert right is not None
    assert found is not None
    assert found.turn < 4 * right.turn


def test_perfect_odometry_is_not_believed_and_a_short_drive_says_nothing() -> None:
    truth, _ = noisy_drive(0)
    motions = se2.between(truth[:-1], truth[1:])
    known = np.ones(len(motions), bool)
    found = DriveNoise.of(truth, motions, known)
    assert found == DriveNoise(pytest.approx(0.005**2), pytest.approx(0.0005**2))
    assert DriveNoise.of(truth[:80], motions[:79], known[:79]) is None
    assert DriveNoise.of(truth, motions, ~known) is None


def test_covariances_grow_with_the_way_and_standing_has_some() -> None:
    noise = DriveNoise(0.0004, 0.000009)
    covariances = noise.covariances([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [0, 0, 0.5]])
    assert (np.linalg.eigvalsh(covariances) > 0).all()
    assert np.diff(covariances[:3, 0, 0]) == pytest.approx(0.0004)
    assert np.diff(covariances[:3, 2, 2]) == pytest.approx(0.000009)
    assert covariances[3, 2, 2] > covariances[0, 2, 2]
    assert str(noise) == "2.0 cm and 0.17 deg per square root of m"


def test_a_moved_row_is_named_though_nobody_told_the_noise_of_odometry() -> None:
    street = make_street(bare=(110.0, 190.0), row_shift=1.5, seed=2)
    start = street.truth[0] + OFF
    done = smooth_poles(street.landmarks, street.local_maps, street.motions, start)
    assert position_errors(done.result.trajectory.poses, street.truth).max() < 0.5
    row = np.flatnonzero(np.hypot(*(street.there - street.mapped).T) > 1.0)
    assert np.isin(row, done.distrusted).mean() > 0.8
    assert "came without covariances; against the map it is good to" in done.account()
    # Taken for a small robot's, odometry would let the row pass.
    robot = smooth_poles(
        street.landmarks, street.local_maps, street.motions, start,
        settings=PoleSmootherSettings(odometry=OdometryNoise(huber=3.0)),
    )  # fmt: skip
    assert position_errors(robot.result.trajectory.poses, street.truth).max() > 1.0
    assert robot.odometry == "odometry: noise as set"


def test_right_landmarks_are_not_distrusted_by_a_noise_that_was_estimated() -> None:
    street = make_street(scale=1.03, seed=3)
    done = smooth_poles(street.landmarks, street.local_maps, street.motions, street.truth[0] + OFF)
    assert len(done.distrusted) == 0
    assert position_errors(done.result.trajectory.poses, street.truth).max() < 0.3


def test_a_drive_too_short_to_tell_says_so() -> None:
    street = make_street(length=80, seed=6)
    done = smooth_poles(street.landmarks, street.local_maps, street.motions, street.truth[0])
    assert "too short to tell its noise" in done.account()
    assert position_errors(done.result.trajectory.poses, street.truth).max() < 0.5
