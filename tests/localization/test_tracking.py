"""Tracking follows a drive from a wrong start, over gaps, and knows how sure it is."""

import numpy as np
import pytest

from factorloc.errors import ConfigError, GeometryError
from factorloc.evaluation import absolute_errors, nees
from factorloc.factors import DecayRateTerm, OdometryNoise, PosePrior
from factorloc.geometry import se2
from factorloc.localization import RegistrationSettings, TrackingSettings, find_start, track
from factorloc.result import StopReason


def test_a_drive_is_followed_from_a_wrong_start(office, tracked) -> None:
    poses = tracked.trajectory.poses
    assert np.sqrt((office.errors(poses) ** 2).mean()) < 0.03
    assert office.errors(poses).max() < 0.08
    assert office.turns(poses).max() < np.radians(1.5)


def test_covariances_are_about_as_large_as_the_errors(office, tracked, smoothed) -> None:
    for result in (tracked, smoothed):
        errors = absolute_errors(result.trajectory, office.drive.truth)
        consistency = nees(errors.tangent, result.trajectory.covariances)
        assert 0.05 < consistency.mean < 2.0
        assert np.median(consistency.values) / 3 < 1.0


def test_the_result_says_what_was_done(office, tracked) -> None:
    n = len(office.drive)
    assert tracked.stop is StopReason.SEQUENTIAL
    assert not tracked.converged
    assert (tracked.history, tracked.iterations) == ((), 0)
    assert set(tracked.residuals) == {"scan"}
    assert tracked.residuals["scan"].shape == (n,)
    assert tracked.cost == pytest.approx(tracked.residuals["scan"].sum())
    assert set(tracked.rejected) == {"registrations not converged", "motions not measured"}
    assert tracked.rejected["motions not measured"] == 0
    assert 0 <= tracked.rejected["registrations not converged"] < 0.1 * n
    assert tracked.seconds > 0
    assert (tracked.trajectory.stamps == office.drive.stamps).all()
    assert np.linalg.eigvalsh(tracked.trajectory.covariances).min() > 0


def test_scans_are_numbered_and_frames_named_where_nothing_is_said(office) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:3], 0.2)
    heard = []
    result = track(term, office.drive.odometry[:2], office.prior, frame="building", progress=heard.append)
    assert result.trajectory.stamps.tolist() == [0, 1, 2]
    assert result.trajectory.world == "building"
    assert heard == [1, 2, 3]


def test_a_single_scan_is_a_drive(office) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:1], 0.2)
    result = track(term, np.zeros((0, 3)), office.prior)
    assert result.trajectory.poses[0] == pytest.approx(office.truth[0], abs=0.05)


def test_the_start_is_looked_for_all_over_its_prior(office) -> None:
    found = find_start(office.term, office.prior)
    assert len(found.poses) == 27
    assert found.poses[found.best] == pytest.approx(office.truth[0], abs=0.05)
    fixed = RegistrationSettings(max_iterations=1, max_translation=1e-9, max_rotation=1e-9)
    covariance = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.02], [0.0, 0.02, 0.05]])
    prior = PosePrior(office.prior.pose, covariance)
    starts = find_start(office.term, prior, 4, settings=TrackingSettings(start_grid=5), registration=fixed).poses
    offsets = se2.log(se2.between(prior.pose, starts))
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), offsets.T).T
    assert len(np.unique(np.round(whitened, 6), axis=0)) == 125
    assert np.unique(np.round(whitened, 6)) == pytest.approx([-1, -0.5, 0, 0.5, 1])
    (alone,) = find_start(office.term, prior, 4, settings=TrackingSettings(start_grid=1), registration=fixed).poses
    assert alone == pytest.approx(prior.pose, abs=1e-8)


def test_a_motion_nobody_measured_is_searched_for(office, gap) -> None:
    assert np.hypot(*np.diff(office.truth[[17, 20], :2], axis=0)[0]) > 1.4
    result = track(gap.term, gap.odometry, office.prior, known=gap.known)
    assert result.rejected["motions not measured"] == 1
    assert gap.errors(result.trajectory.poses).max() < 0.08
    # Taken for standing still, the gap leads astray.
    fooled = track(gap.term, gap.odometry, office.prior)
    assert fooled.rejected["motions not measured"] == 0
    assert gap.errors(fooled.trajectory.poses).max() > 0.5


def test_blind_scans_leave_what_odometry_and_prior_say(office) -> None:
    """Poses chain, and covariances are those of sampled chains."""
    rng = np.random.default_rng(4)
    noise = OdometryNoise()
    n = 5
    blind = [office.drive.scans[0].select(np.zeros(109, bool))] * n
    motions = np.tile([0.5, 0.02, 0.3], (n - 1, 1))
    prior = PosePrior(np.array([15.0, 4.0, 1.0]), np.diag([0.05, 0.02, 0.05]) ** 2)
    result = track(DecayRateTerm(office.pyramid, blind), motions, prior, noise=noise)
    samples = 40_000

    def drawn(covariance):
        return se2.exp(rng.multivariate_normal(np.zeros(3), covariance, samples))

    expected, cloud = prior.pose, se2.compose(prior.pose, drawn(prior.covariance))
    for k in range(n):
        if k:
            expected = se2.compose(expected, motions[k - 1])
            cloud = se2.compose(se2.compose(cloud, motions[k - 1]), drawn(noise.covariances(motions[k - 1][None])[0]))
        assert result.trajectory.poses[k] == pytest.approx(expected, abs=1e-9)
        sampled = np.cov(se2.log(se2.between(expected, cloud)).T)
        scale = np.sqrt(np.diag(sampled))
        # Far from the start, the cloud bends: the tangent space is only so flat.
        assert (np.abs(result.trajectory.covariances[k] - sampled) <= 0.06 * np.outer(scale, scale)).all()


def test_a_scan_adds_what_it_knows_to_the_prior(office) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:1], 0.2)
    result = track(term, np.zeros((0, 3)), office.prior)
    hessian = term.batch(result.trajectory.poses).hessian[0]
    expected = np.linalg.inv(hessian + office.prior.information)
    assert result.trajectory.covariances[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("motions", "arguments", "line"),
    [
        (np.zeros((3, 3)), {}, "expected 2 motions between 3 scans"),
        (np.zeros((1, 3)), {}, "expected 2 motions between 3 scans"),
        (np.zeros(6), {}, "odometry"),
        (np.full((2, 3), np.nan), {}, "odometry"),
        (np.zeros((2, 3)), {"known": [True]}, "known"),
        (np.zeros((2, 3)), {"known": [True] * 3}, "known"),
        (np.zeros((2, 3)), {"stamps": [0.0, 1.0]}, "stamps"),
    ],
)
def test_what_does_not_fit_is_refused(office, motions, arguments, line) -> None:
    term = DecayRateTerm(office.pyramid, office.drive.scans[:3])
    with pytest.raises(GeometryError, match=line):
        track(term, motions, office.prior, **arguments)


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"start_grid": 0}, {"track_blur": 0}, {"lost_position": -1}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            TrackingSettings(**wrong)
