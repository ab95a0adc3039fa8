from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import EvaluationError
from factorloc.evaluation import absolute_errors, transform_trajectory
from factorloc.geometry import se2, se3
from factorloc.trajectory import Trajectory

GROUPS = {2: (se2, 3), 3: (se3, 6)}


def test_components_in_the_body_frame_of_the_truth():
    truth = Trajectory([0.0], [[10.0, 5.0, np.pi / 2]])  # looks along +y
    estimate = Trajectory([0.0], [[9.0, 7.0, np.pi / 2 + 0.1]])
    errors = absolute_errors(estimate, truth)
    assert errors.longitudinal[0] == pytest.approx(2)
    assert errors.lateral[0] == pytest.approx(1)
    assert errors.heading[0] == pytest.approx(0.1)
    assert errors.translation[0] == pytest.approx(np.sqrt(5))
    assert errors.statistics("rotation").unit == "rad"
    spatial = absolute_errors(estimate.to_3d(), truth.to_3d())
    for name in ("longitudinal", "lateral", "vertical", "heading", "translation", "rotation"):
        np.testing.assert_allclose(getattr(spatial, name), getattr(errors, name), atol=1e-12)


def test_heading_error_across_the_cut_is_small():
    errors = absolute_errors(Trajectory([0.0], [[0, 0, np.pi - 0.01]]), Trajectory([0.0], [[0, 0, 0.01 - np.pi]]))
    assert errors.heading[0] == pytest.approx(-0.02)
    assert errors.rotation[0] == pytest.approx(0.02)


@pytest.mark.parametrize("align", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_equal_trajectories_have_no_error(drive, dimension, align):
    _, truth = drive(dimension)
    errors = absolute_errors(truth, truth, align)
    for name in errors.names:
        assert errors.statistics(name).max < 1e-7
    assert (errors.T_world_estimate is None) == (not align)


@pytest.mark.parametrize("dimension", [2, 3])
@given(st.integers(0, 10**6))
def test_errors_do_not_depend_on_the_choice_of_world(drive, dimension, seed):
    group, freedom = GROUPS[dimension]
    estimate, truth = drive(dimension, poses=20, seed=seed)
    T = group.exp(np.random.default_rng(seed).normal(0, 2, freedom))
    plain = absolute_errors(estimate, truth)
    both = absolute_errors(transform_trajectory(T, estimate, "map"), transform_trajectory(T, truth, "map"))
    aligned = absolute_errors(estimate, truth, align=True)
    one = absolute_errors(transform_trajectory(T, estimate, "odom"), truth, align=True)
    np.testing.assert_allclose(both.T_truth_estimate, plain.T_truth_estimate, atol=1e-9)
    np.testing.assert_allclose(one.T_truth_estimate, aligned.T_truth_estimate, atol=1e-8)
    assert aligned.statistics("translation").rmse <= plain.statistics("translation").rmse + 1e-12


@pytest.mark.parametrize("dimension", [2, 3])
def test_tangent_errors_lead_from_the_estimate_to_the_truth(drive, dimension):
    group, _ = GROUPS[dimension]
    estimate, truth = drive(dimension)
    reached = group.compose(estimate.poses, group.exp(absolute_errors(estimate, truth).tangent))
    np.testing.assert_allclose(reached, truth.poses, atol=1e-9)


def test_statistics_are_those_of_magnitudes():
    truth = Trajectory([0.0, 1.0], np.zeros((2, 3)))
    errors = absolute_errors(replace(truth, poses=[[0, -3.0, 0], [0, 1.0, 0]]), truth)
    lateral = errors.statistics("lateral")
    assert (lateral.mean, lateral.max, lateral.min) == (2, 3, 1)
    assert errors.lateral.mean() == -1


def test_refusals(drive):
    estimate, truth = drive(2)
    with pytest.raises(EvaluationError, match="length"):
        absolute_errors(estimate.select(slice(5)), truth)
    with pytest.raises(EvaluationError, match="dimension"):
        absolute_errors(estimate.to_3d(), truth)
    elsewhere = replace(estimate, world="odom")
    with pytest.raises(EvaluationError, match="world"):
        absolute_errors(elsewhere, truth)
    assert len(absolute_errors(elsewhere, truth, align=True)) == len(truth)
    late = replace(estimate, stamps=estimate.stamps + 0.05)
    with pytest.raises(EvaluationError, match="stamps"):
        absolute_errors(late, truth)
    assert len(absolute_errors(late, truth, max_difference=0.06)) == len(truth)
    with pytest.raises(EvaluationError, match="no 'vertical' of 2-D poses; known: translation"):
        absolute_errors(estimate, truth).statistics("vertical")
