from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import EvaluationError
from factorloc.evaluation import relative_errors, step_pairs, transform_trajectory
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

GROUPS = {2: (se2, 3), 3: (se3, 6)}


def along(path):
    """A planar trajectory along x that has come so far at each row."""
    path = np.asarray(path, float)
    return Trajectory(np.arange(len(path)), np.column_stack([path, np.zeros((len(path), 2))]))


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=st.integers(0, 10**6), delta=st.integers(1, 5))
def test_a_global_motion_changes_nothing(drive, dimension, seed, delta):
    group, freedom = GROUPS[dimension]
    estimate, truth = drive(dimension, poses=20, seed=seed)
    T = group.exp(np.random.default_rng(seed).normal(0, 2, freedom))
    here = relative_errors(estimate, truth, delta)
    there = relative_errors(transform_trajectory(T, estimate, "odom"), truth, delta)
    np.testing.assert_allclose(there.T_truth_estimate, here.T_truth_estimate, atol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_equal_trajectories_have_no_error(drive, dimension):
    _, truth = drive(dimension)
    for options in ({"delta": 7}, {"delta": 3.0, "unit": "m"}, {"delta": 3.0, "unit": "m", "all_pairs": True}):
        errors = relative_errors(truth, truth, **options)
        assert errors.statistics("translation").max < 1e-9
        assert errors.statistics("rotation").max < 1e-7


def test_drift_is_what_is_measured():
    truth = along(np.arange(11.0))
    errors = relative_errors(along(np.arange(11) * 1.02), truth, 5)
    np.testing.assert_allclose(errors.longitudinal, 0.1)
    np.testing.assert_array_equal(errors.pairs, [[0, 5], [5, 10]])
    np.testing.assert_array_equal(errors.stamps, [5, 10])
    assert (errors.delta, errors.unit) == (5, "frames")


def test_frames_in_turn_and_all():
    run = along(range(6))
    assert step_pairs(run, 2).tolist() == [[0, 2], [2, 4]]
    assert step_pairs(run, 2, all_pairs=True).tolist() == [[0, 2], [1, 3], [2, 4], [3, 5]]


def test_metres_in_turn_end_at_the_first_pose_far_enough():
    assert step_pairs(along([0, 0.4, 1.1, 1.1, 1.5, 2.3]), 1.0, "m").tolist() == [[0, 2], [2, 5]]
    # Three steps of 0.2 m are 0.6 m, however their sum is rounded.
    assert step_pairs(along(np.arange(13) * 0.2), 0.6, "m").tolist() == [[0, 3], [3, 6], [6, 9], [9, 12]]


@given(
    st.lists(st.integers(0, 5), min_size=1, max_size=30),
    st.integers(1, 12),
    st.sampled_from([0.0, 0.1, 0.5]),
)
def test_all_pairs_in_metres_are_the_nearest_ones(steps, delta, tolerance):
    path = np.concatenate([[0], np.cumsum(steps)])
    expected = []
    for i in range(len(path) - 1):
        apart = np.abs(path[i + 1 :] - path[i] - delta)
        if apart.min() <= tolerance * delta + 1e-9:
            expected.append([i, i + 1 + int(apart.argmin())])
    if expected:
        assert step_pairs(along(path), delta, "m", all_pairs=True, tolerance=tolerance).tolist() == expected
    else:
        with pytest.raises(EvaluationError, match="no two poses"):
            step_pairs(along(path), delta, "m", all_pairs=True, tolerance=tolerance)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"delta": 0}, "delta: 0 frames"),
        ({"delta": 1.5}, "whole number"),
        ({"delta": float("nan")}, "delta: nan"),
        ({"delta": 100}, "no two poses are 100 frames apart; the trajectory has 5 poses"),
        ({"delta": 100, "unit": "m"}, "4 m long"),
        ({"delta": 1, "unit": "km"}, "unit: 'km'"),
    ],
)
def test_impossible_steps_are_refused(options, message):
    with pytest.raises(EvaluationError, match=message):
        relative_errors(along(range(5)), along(range(5)), **options)


def test_other_bodies_are_refused():
    with pytest.raises(EvaluationError, match="body"):
        relative_errors(replace(along(range(5)), body="laser"), along(range(5)))
