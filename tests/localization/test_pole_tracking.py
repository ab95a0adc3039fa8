"""Tracking among poles: a scale that is wrong all along, and a start that several places explain."""

import numpy as np
import pytest
from pole_street import SIGMAS, make_street, poles_at, position_errors

from factorloc.factors import OdometryNoise, PoleDetections, PoleLandmarks, PoleMixture, PosePrior
from factorloc.geometry import se2
from factorloc.localization.calibration_belief import CalibrationBelief
from factorloc.localization.initialization import NormalStart
from factorloc.localization.optimizer import OptimizerSettings
from factorloc.localization.pole_hypothesis import PoleHypothesis, propagated, select_hypotheses
from factorloc.localization.pole_search import dead_reckoned
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles
from factorloc.localization.pole_tracking import PoleTrackingSettings, track_poles
from factorloc.localization.pole_window import PoleWindow, WindowModel
from factorloc.mapping.poles import Poles


def model_of(landmarks: PoleLandmarks) -> WindowModel:
    return WindowModel(landmarks, PoleMixture(), 0.3, OdometryNoise(huber=3.0), OptimizerSettings())


def window_of(seed: int, scale: float, length: int = 60) -> tuple[PoleWindow, np.ndarray, np.ndarray]:
    street = make_street(length=length, scale=scale, seed=seed)
    prior = PosePrior(street.truth[0], np.diag([0.1, 0.1, 0.01]) ** 2)
    window = PoleWindow(
        model_of(street.landmarks), PoleDetections.of(street.local_maps), street.motions, street.covariances,
        np.ones(length, bool), prior, CalibrationBelief.from_sigmas(0.03, 3e-4),
    )  # fmt: skip
    return window, dead_reckoned(street.truth[0], street.motions), street.truth


def test_a_window_finds_scale_and_poses_and_says_how_well() -> None:
    nees, of_scale = [], []
    for seed in range(20):
        window, guess, truth = window_of(seed, 1.03)
        found = window.solve(guess, 0)
        e = se2.log(se2.between(found.poses, truth))
        nees.append(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.covariances), e).mean() / 3)
        total = found.learned + window.calibration.information
        of_scale.append((found.step[0] - (1 / 1.03 - 1)) * np.sqrt(1 / np.linalg.inv(total)[0, 0]))
        assert found.poses[:, :2] == pytest.approx(truth[:, :2], abs=0.6)
        assert found.matched[::2].mean() > 0.8
        assert not found.matched[1::2].any()
    assert 0.1 < np.mean(nees) < 2.0
    assert np.mean(np.abs(of_scale)) < 1.5


def test_costs_of_a_window_are_those_of_its_graph() -> None:
    window, guess, _ = window_of(0, 1.0)
    found = window.solve(guess, 0)
    motions = window.calibration.shifted(found.step).applied(window.motions)
    left = se2.log(se2.between(motions, se2.between(found.poses[:-1], found.poses[1:])))
    plain = np.einsum("ni,nij,nj->n", left, np.linalg.inv(window.covariances), left) / 2
    assert found.motion_costs.sum() == pytest.approx(plain.sum(), rel=0.1)
    assert found.scan_costs == pytest.approx(window.term.cost(found.poses))


def test_errors_that_odometry_has_all_along_do_not_lose_a_drive_in_a_sparse_map() -> None:
    street = make_street(length=500, scale=1.035, seed=8, every=3)
    rng = np.random.default_rng(8)
    sparse = [p.select(rng.random(len(p)) < 0.6) for p in street.local_maps]
    off = street.truth[0] + [1.8, -1.6, 0.08]

    def largest(**of_tracking: float) -> float:
        settings = PoleSmootherSettings(tracking=PoleTrackingSettings(**of_tracking))
        done = smooth_poles(
            street.landmarks, sparse, street.motions, off, covariances=street.covariances, settings=settings
        )
        return float(position_errors(done.result.trajectory.poses, street.truth).max())

    assert largest() < 0.5
    assert largest(scale=1e-6, drift=1e-8) > 1.0


def test_places_that_look_alike_are_kept_until_they_differ() -> None:
    # Two poles beside the way every 3 m, for 60 m: six places explain them. One more at the end tells which.
    spaced = np.arange(-30.0, 100.0, 3.0)
    row = np.concatenate([np.column_stack([spaced, np.full(len(spaced), side)]) for side in (4.0, -4.0)])
    mapped = np.concatenate([row, [[84.0, 7.0], [88.3, -6.0], [91.0, 6.4], [95.7, -7.0]]])
    truth = np.column_stack([np.arange(0.0, 100.0), np.zeros((100, 2))])
    rng = np.random.default_rng(3)
    motions = se2.compose(se2.between(truth[:-1], truth[1:]), se2.exp(rng.normal(0, 1, (99, 3)) * SIGMAS / 3))
    local = []
    for k, pose in enumerate(truth):
        seen = mapped[np.hypot(*(mapped - pose[:2]).T) < 10.0]
        local.append(poles_at(seen - pose[:2] + rng.normal(0, 0.05, seen.shape)) if k % 2 == 0 else Poles.none())
    start = NormalStart.from_sigmas(truth[0] + [3.4, 0.3, 0.01], [4.0, 0.5, 0.02])

    def tracked(**options: int) -> np.ndarray:
        return track_poles(
            model_of(PoleLandmarks(poles_at(mapped))), PoleDetections.of(local), motions,
            np.tile(np.diag(SIGMAS**2), (99, 1, 1)), np.ones(99, bool), start, PoleTrackingSettings(**options), seed=1,
        ).poses  # fmt: skip

    assert position_errors(tracked(), truth).max() < 0.5
    assert position_errors(tracked(hypotheses=1), truth)[:60].min() > 2.0


def test_hypotheses_are_ordered_parted_and_given_up() -> None:
    def at(x: float, cost: float) -> PoleHypothesis:
        one = PoleHypothesis.start(3, CalibrationBelief.from_sigmas(0.02, 3e-4))
        one.poses[2, 0], one.scan_costs[1] = x, cost
        return one

    many = [at(0.0, 3.0), at(0.1, 1.0), at(5.0, 2.0), at(9.0, 20.0), at(7.0, 2.5)]
    kept = select_hypotheses(many, 2, most=6, margin=8.0)
    assert [one.poses[2, 0] for one in kept] == [0.1, 5.0, 7.0]
    assert [one.cost for one in select_hypotheses(many, 2, most=1, margin=8.0)] == [1.0]


def test_a_motion_carries_the_covariance_into_its_new_body() -> None:
    covariance = np.diag([0.1, 0.2, 0.05]) ** 2
    motion = np.array([10.0, 0.0, np.pi / 2])
    after = propagated(covariance, motion, np.zeros((3, 3)))
    rng = np.random.default_rng(0)
    drawn = se2.compose(se2.exp(rng.normal(0, 1, (200_000, 3)) * [0.1, 0.2, 0.05]), motion)
    assert np.cov(se2.log(se2.between(motion, drawn)).T) == pytest.approx(after, abs=0.01)


def test_wheels_that_slip_are_noticed_by_what_does_not_fit_and_the_place_is_found_again() -> None:
    street = make_street(length=300, seed=11)
    motions = street.motions.copy()
    motions[150] = se2.compose(motions[150], [1.0, 2.2, 0.12])  # far more than its covariance has it
    off = street.truth[0] + [1.0, -1.0, 0.04]

    def errors(**of_tracking: float) -> np.ndarray:
        track = track_poles(
            model_of(street.landmarks), PoleDetections.of(street.local_maps), motions, street.covariances,
            np.ones(300, bool), NormalStart.from_sigmas(off, [1.5, 1.5, 0.05]), PoleTrackingSettings(**of_tracking),
        )  # fmt: skip
        return position_errors(track.poses, street.truth)

    assert errors()[:110].max() < 0.3
    assert errors()[190:].max() < 0.5
    assert errors(doubt=0.0)[170:240].max() > 1.0
