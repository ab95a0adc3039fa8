"""Sampled motions have the moments their models promise."""

import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.factors import OdometryNoise
from factorloc.geometry import group_of, se2, se3
from factorloc.localization.motion_model import LostMotion, TangentMotion, TurnDriveTurn

SAMPLES = 40_000
SMALL = OdometryNoise(
    turn_per_turn=0.02, turn_per_metre=0.01, length_per_metre=0.02, length_per_turn=0.01, least_turn=0.004,
    least_length=0.008,
)  # fmt: skip
SPATIAL = se3.exp(np.array([0.02, -0.01, 0.3, 0.8, 0.05, 0.02]))


def tangents(model, motion, covariance=None, seed: int = 1) -> np.ndarray:
    """Where samples lie about the motion, in the tangent space of the body after it."""
    group = group_of(3 if np.ndim(motion) == 2 else 2)
    drawn = model.sample(motion, SAMPLES, np.random.default_rng(seed), covariance)
    return group.log(group.between(motion, drawn))


def assert_moments(sample: np.ndarray, covariance: np.ndarray, bend: float = 0.0) -> None:
    """Means within 5 standard errors (and what motions bend), covariances within 5 as well."""
    scale = np.sqrt(np.diag(covariance))
    assert (np.abs(sample.mean(0)) < (5 / np.sqrt(SAMPLES) + bend) * scale).all()
    second = sample.T @ sample / SAMPLES
    assert (np.abs(second - covariance) < (5 * np.sqrt(2 / SAMPLES) + bend) * np.outer(scale, scale)).all()


@pytest.mark.parametrize(
    "motion",
    [[0.8, 0, 0], [0.8, 0.3, 0.6], [-0.5, 0.05, 0.1], [0.0, 0.0, 0.0], [0.005, 0.002, 0.4], [0.2, 0.7, -1.0]],
)
def test_turns_and_drives_spread_as_the_smoother_believes(motion: list[float]) -> None:
    assert_moments(tangents(TurnDriveTurn(SMALL), motion), SMALL.covariances([motion])[0], bend=0.04)


def test_long_motions_bend() -> None:
    """Beyond first order: a wrong turn at the beginning makes the way shorter, never longer."""
    noise = SMALL.replaced(turn_per_metre=0.3)
    drawn = TurnDriveTurn(noise).sample([2.0, 0, 0], SAMPLES, np.random.default_rng(3))
    flat = TangentMotion(noise).sample([2.0, 0, 0], SAMPLES, np.random.default_rng(3))
    sigma = noise.turn_per_metre * 2 + noise.least_turn
    assert drawn[:, 0].mean() == pytest.approx(2 * np.exp(-(sigma**2) / 2), abs=0.02)
    assert np.hypot(*drawn[:, :2].T).std() < 0.1
    assert np.hypot(*flat[:, :2].T).std() > 0.1


@pytest.mark.parametrize("motion", [np.array([0.8, 0.3, 0.6]), SPATIAL], ids=["plane", "space"])
def test_tangents_are_gaussian_of_the_covariance(motion: np.ndarray) -> None:
    assert_moments(tangents(TangentMotion(), motion), OdometryNoise().covariances(motion[None])[0])
    size = 3 if motion.ndim == 1 else 6
    root = np.random.default_rng(7).normal(0, 0.1, (size, size))
    for model in (TangentMotion(), TurnDriveTurn()) if size == 3 else (TangentMotion(),):
        assert_moments(tangents(model, motion, root @ root.T), root @ root.T)


def test_noise_in_space_grows_with_the_motion() -> None:
    near, far = (tangents(TangentMotion(), se3.exp([0, 0, 0, d, 0, 0])).std(0) for d in (0.1, 3.0))
    assert (far > 1.05 * near).all()
    assert far[3] > 4 * near[3]


def test_a_singular_covariance_moves_nothing_across() -> None:
    drawn = TangentMotion().sample([1.0, 0, 0], 100, np.random.default_rng(1), np.diag([0.04, 0, 0]))
    assert drawn[:, 1:] == pytest.approx(np.zeros((100, 2)), abs=1e-12)
    assert drawn[:, 0].std() > 0.1


def test_a_motion_nobody_measured_is_wide_and_on_wheels() -> None:
    plane = tangents(LostMotion(1.5, 0.4), np.zeros(3), np.eye(3) * 1e-9)
    assert_moments(plane, np.diag([1.5, 1.5, 0.4]) ** 2)
    space = tangents(LostMotion(1.5, 0.4), np.eye(4))
    assert_moments(space, np.diag([0.04, 0.04, 0.4, 1.5, 1.5, 0.15]) ** 2)


def test_the_same_seed_draws_the_same() -> None:
    for model, motion in ((TurnDriveTurn(), [1.0, 0, 0.1]), (TangentMotion(), SPATIAL), (LostMotion(), SPATIAL)):
        one, same, other = (model.sample(motion, 5, np.random.default_rng(s)) for s in (1, 1, 2))
        assert (one == same).all()
        assert not np.allclose(one, other)


def test_headings_stay_within_a_turn() -> None:
    drawn = TurnDriveTurn().sample([0, 0, 3.1], 1000, np.random.default_rng(1))
    assert (np.abs(drawn[:, 2]) <= np.pi).all()
    assert drawn[:, 2].min() < 0
    assert np.abs(se2.between([0, 0, 3.1], drawn)[:, 2]).max() < 4.5


@pytest.mark.parametrize(
    ("model", "motion", "covariance", "line"),
    [
        (TurnDriveTurn(), np.eye(4), None, "in the plane"),
        (TurnDriveTurn(), np.zeros((2, 3)), None, "motion"),
        (TangentMotion(), [0, np.nan, 0], None, "motion"),
        (TangentMotion(), np.zeros(3), np.eye(6), "expected a finite 3 x 3"),
        (TangentMotion(), np.eye(4), np.eye(3), "expected a finite 6 x 6"),
        (TangentMotion(), np.zeros(3), np.diag([1, 1, np.inf]), "finite"),
        (TangentMotion(), np.zeros(3), np.diag([1, 1, -1.0]), "negative"),
        (TangentMotion(), np.zeros(3), np.eye(3) + np.eye(3, k=1), "not symmetric"),
    ],
)
def test_what_is_no_motion_is_refused(model, motion, covariance, line: str) -> None:
    with pytest.raises(GeometryError, match=line):
        model.sample(motion, 3, np.random.default_rng(0), covariance)
