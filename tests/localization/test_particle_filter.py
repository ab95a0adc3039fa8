"""The filter propagates, reweights, resamples and estimates as Bayes would."""

import numpy as np
import pytest
from analytic_models import PLANE, SPACE, Answer, Position, fan

from factorloc.errors import ConfigError, GeometryError, MapError
from factorloc.factors import OdometryNoise, PosePrior
from factorloc.geometry import se3
from factorloc.localization.initialization import AroundPose, FreeSpace, NormalStart
from factorloc.localization.kld import KldSettings
from factorloc.localization.motion_model import TangentMotion
from factorloc.localization.particle_filter import ParticleFilter, ParticleFilterSettings
from factorloc.localization.reweighting import choose_rays
from factorloc.mapping import RayStatistics
from factorloc.mapping.sensor_model import SensorModel
from factorloc.scan import RayStatus

MANY = KldSettings(least=20_000, most=20_000)
PLAIN = ParticleFilterSettings(information=1, tempering=None, kld=MANY)
START = NormalStart.from_sigmas([0.0, 0, 0], [1.0, 0.5, 1e-4])


def test_test_models_are_sensor_models() -> None:
    assert isinstance(Position((0, 0)), SensorModel)


@pytest.mark.parametrize("dimension", [2, 3])
def test_gaussian_times_gaussian_is_gaussian(dimension: int) -> None:
    """One scan, a motion, another scan: a Kalman filter knows the answer."""
    sigmas = np.array([1.0, 0.5]) if dimension == 2 else np.array([1.0, 0.5, 0.7])
    still = [1e-4] if dimension == 2 else [1e-4] * 3
    if dimension == 2:
        start, grid = NormalStart.from_sigmas(np.zeros(3), [*sigmas, *still]), PLANE
    else:
        start, grid = NormalStart.from_sigmas(np.eye(4), [*still, *sigmas]), SPACE
    where = np.array([0.8, -0.4, 0.3])[:dimension]
    model = Position(tuple(where), 0.6, grid)
    particle_filter = ParticleFilter(model, start, settings=PLAIN, motion_model=TangentMotion(), seed=3)
    scan = fan(dimension=dimension)
    evidence = particle_filter.reweight(scan).log_likelihood
    variance = sigmas**2
    total = variance + 0.36
    expected = -0.5 * (where**2 / total).sum() + 0.5 * np.log(0.36 / total).sum()
    assert evidence == pytest.approx(expected, abs=0.03)
    mean, variance = variance / total * where, variance * 0.36 / total

    assert particle_filter.resample() == (particle_filter.resamplings == 1)
    step = np.array([0.3, 0.1, 0.0])[:dimension]
    moved, noise = (np.append(step, 0), [0.2, 0.1, 1e-4])
    if dimension == 3:
        moved, noise = se3.exp([0, 0, 0, *step]), [1e-4] * 3 + [0.2, 0.1, 0.1]
    particle_filter.propagate(moved, covariance=np.diag(noise) ** 2)
    mean = mean + step
    variance = variance + np.array(noise[:2] if dimension == 2 else noise[3:]) ** 2
    particle_filter.reweight(scan)
    gain = variance / (variance + 0.36)
    mean, variance = mean + gain * (where - mean), (1 - gain) * variance

    found = particle_filter.estimate().mean
    position = found.pose[:2] if dimension == 2 else found.pose[:3, 3]
    block = slice(0, 2) if dimension == 2 else slice(3, 6)
    tolerance = 6 * np.sqrt(variance / particle_filter.particles.effective_size)
    assert (np.abs(position - mean) < tolerance).all()
    assert np.diag(found.covariance)[block] == pytest.approx(variance, rel=0.08)


def test_information_is_the_exponent() -> None:
    logs = []
    for information in (1.0, 0.25):
        settings = PLAIN.replaced(information=information)
        particle_filter = ParticleFilter(Position((0.5, 0.2)), START, settings=settings, seed=1)
        particle_filter.reweight(fan())
        logs.append(particle_filter.particles.log_weights)
    assert logs[1] - logs[1][0] == pytest.approx(0.25 * (logs[0] - logs[0][0]), abs=1e-9)


def test_a_peaked_likelihood_is_tempered_to_the_share_asked_for() -> None:
    model = Position((0.5, 0.2), 1e-3)
    plain = ParticleFilter(model, START, settings=PLAIN, seed=1)
    assert not plain.reweight(fan()).tempered
    assert plain.particles.effective_size < 20
    tempered = ParticleFilter(model, START, settings=PLAIN.replaced(tempering=0.05), seed=1)
    done = tempered.reweight(fan())
    assert done.tempered
    assert done.exponent < 1
    assert tempered.particles.effective_size == pytest.approx(0.05 * 20_000, rel=0.01)
    wide = ParticleFilter(Position((0.5, 0.2), 1.0), START, settings=PLAIN.replaced(tempering=0.05), seed=1)
    done = wide.reweight(fan())
    assert (done.tempered, done.exponent) == (False, 1.0)


def test_resampling_waits_until_weights_are_uneven() -> None:
    particle_filter = ParticleFilter(Position((0.0, 0.0), 5.0), START, settings=PLAIN, seed=1)
    particle_filter.reweight(fan())
    before = particle_filter.particles
    assert not particle_filter.resample()
    assert particle_filter.particles is before
    always = ParticleFilter(Position((0, 0), 5.0), START, settings=PLAIN.replaced(resample_below=1.0), seed=1)
    always.reweight(fan())
    assert always.resample()
    assert always.particles.weights == pytest.approx(np.full(20_000, 1 / 20_000))


@pytest.mark.parametrize("policy", ["systematic", "stratified", "residual", "multinomial"])
def test_no_policy_of_resampling_moves_the_mean(policy: str) -> None:
    particle_filter = ParticleFilter(Position((1.0, 0.4)), START, settings=PLAIN.replaced(resampling=policy), seed=1)
    particle_filter.reweight(fan())
    before = particle_filter.estimate().mean
    assert particle_filter.resample()
    after = particle_filter.estimate().mean
    assert after.pose == pytest.approx(before.pose, abs=0.02)
    assert after.covariance == pytest.approx(before.covariance, abs=0.02)


def test_the_number_of_particles_follows_the_spread() -> None:
    settings = PLAIN.replaced(kld=KldSettings(least=100, most=30_000))
    wide = ParticleFilter(Position((0.0, 0.0), 0.05), AroundPose([0.0, 0, 0], 6.0), settings=settings)
    narrow = ParticleFilter(
        Position((0.0, 0.0), 0.05), NormalStart.from_sigmas([0, 0, 0], [0.01] * 3), settings=settings
    )
    assert len(wide.particles) == 30_000
    assert 100 <= len(narrow.particles) < 200
    wide.reweight(fan())
    wide.resample()
    assert 400 < len(wide.particles) < 4000  # the position is known, the heading is not


def test_a_lost_filter_draws_particles_elsewhere_and_recovers() -> None:
    anywhere = AroundPose([0.0, 0, 0], (15.0, 15.0))
    settings = ParticleFilterSettings(information=1, kld=KldSettings(least=200, most=5000))
    home, away = Position((0.0, 0.0)), Position((9.0, -8.0))
    outcomes = []
    for free_space in (anywhere, None):
        particle_filter = ParticleFilter(home, START, settings=settings, free_space=free_space, seed=2)
        for model in [home] * 10 + [away] * 25:
            particle_filter.model = model
            particle_filter.reweight(fan())
            estimate = particle_filter.estimate().mode
            particle_filter.resample()
            particle_filter.propagate(np.zeros(3))
        outcomes.append((particle_filter.recoveries, float(np.hypot(*(estimate.pose[:2] - away.where)))))
    assert 1 <= outcomes[0][0] < 8
    assert outcomes[0][1] < 0.3
    assert outcomes[1][0] == 0
    off = ParticleFilter(home, START, settings=settings.replaced(recovery=None), free_space=anywhere, seed=2)
    for model in [home] * 10 + [away] * 10:
        off.model = model
        off.reweight(fan())
        off.resample()
    assert off.recoveries == 0


def test_a_filter_that_never_was_right_finds_out() -> None:
    """No likelihood drops: it is poor from the first scan on, and strangers do better."""
    anywhere = AroundPose([0.0, 0, 0], (15.0, 15.0))
    settings = ParticleFilterSettings(information=1, kld=KldSettings(least=500, most=2000))
    errors, recoveries = [], []
    for free_space in (anywhere, None):
        particle_filter = ParticleFilter(
            Position((9.0, -8.0)), START, settings=settings, free_space=free_space, seed=2
        )  # fmt: skip
        for _ in range(20):
            particle_filter.reweight(fan())
            estimate = particle_filter.estimate().mean
            particle_filter.resample()
            particle_filter.propagate(np.zeros(3))
        errors.append(float(np.hypot(*(estimate.pose[:2] - [9, -8]))))
        recoveries.append(particle_filter.recoveries)
    assert errors[0] < 0.3
    assert errors[1] > 3
    assert 1 <= recoveries[0] < 5
    assert recoveries[1] == 0


def test_a_filter_that_is_right_looks_nowhere_else() -> None:
    anywhere = AroundPose([0.0, 0, 0], (15.0, 15.0))
    settings = ParticleFilterSettings(information=1, kld=KldSettings(least=500, most=2000))
    particle_filter = ParticleFilter(Position((0.3, 0.0)), START, settings=settings, free_space=anywhere, seed=2)
    for sigma in [0.5] * 10 + [5.0] * 10 + [0.5] * 10:  # what the lidar sees comes and goes
        particle_filter.model = Position((0.3, 0.0), sigma)
        particle_filter.reweight(fan())
        particle_filter.resample()
        particle_filter.propagate(np.zeros(3))
    assert particle_filter.recoveries == 0


def test_poses_asked_before_a_motion_are_not_drawn_after_it() -> None:
    anywhere = AroundPose([0.0, 0, 0], (15.0, 15.0))
    settings = ParticleFilterSettings(information=1, kld=KldSettings(least=500, most=2000))
    particle_filter = ParticleFilter(Position((9.0, -8.0)), START, settings=settings, free_space=anywhere, seed=2)
    for meanwhile in (lambda: particle_filter.propagate([2.0, 0, 0]), lambda: particle_filter.reweight(fan(0))):
        particle_filter.reweight(fan())
        meanwhile()
        particle_filter.resample()
        assert particle_filter.recoveries == 0


def test_scans_nobody_explains_change_nothing() -> None:
    never = Answer((0.0, 0.0), function=lambda poses: np.full(len(poses), -np.inf))
    particle_filter = ParticleFilter(never, START, settings=PLAIN)
    before = particle_filter.particles
    done = particle_filter.reweight(fan())
    assert (done.excluded, done.informative) == (True, True)
    assert particle_filter.particles is before
    assert not particle_filter.resample()
    particle_filter.propagate([0.5, 0, 0])
    assert particle_filter.estimate().mean.pose == pytest.approx([0.5, 0, 0], abs=0.05)


def test_particles_outside_the_map_have_no_weight() -> None:
    asked = []
    model = Answer((0.0, 0.0), function=lambda poses: asked.append(poses) or np.zeros(len(poses)))
    particle_filter = ParticleFilter(model, NormalStart.from_sigmas([19.9, 0, 0], [1.0, 1.0, 0.1]), settings=PLAIN)
    particle_filter.reweight(fan())
    inside = model.grid.contains(particle_filter.particles.positions)
    assert 0.3 < inside.mean() < 0.7
    assert (particle_filter.particles.weights[~inside] == 0).all()
    assert model.grid.contains(asked[0][:, :2]).all()
    # All of them out: nothing explains the scan, and odometry goes on.
    particle_filter.propagate([60.0, 0, 0], covariance=np.eye(3) * 1e-6)
    assert particle_filter.reweight(fan()).excluded
    assert np.isfinite(particle_filter.estimate().mean.pose).all()


def test_scans_without_a_return_say_nothing() -> None:
    model = Position((1.0, 0.0))
    particle_filter = ParticleFilter(model, START, settings=PLAIN)
    for blind in (fan(reach=11.0), fan(0), fan(reach=0.05)):
        done = particle_filter.reweight(blind)
        assert (done.informative, done.excluded, done.log_likelihood, done.rays) == (False, False, 0.0, 0)
    assert model.asked == []
    assert particle_filter.particles.effective_size == pytest.approx(20_000)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_likelihoods_that_are_none_are_refused(bad: float) -> None:
    broken = Answer((0.0, 0.0), function=lambda poses: np.where(poses[:, 0] > 0, 0.0, bad))
    with pytest.raises(MapError, match=r"Answer: log-likelihood NaN or infinite at \d+ of 20000 poses"):
        ParticleFilter(broken, START, settings=PLAIN).reweight(fan())


def test_a_single_particle_is_followed() -> None:
    settings = PLAIN.replaced(kld=KldSettings(least=1, most=1), tempering=0.5)
    particle_filter = ParticleFilter(Position((0.0, 0.0)), START, settings=settings)
    for _ in range(5):
        particle_filter.reweight(fan())
        particle_filter.resample()
        particle_filter.propagate([0.1, 0, 0])
        assert len(particle_filter.particles) == 1
        assert np.isfinite(particle_filter.estimate().mode.pose).all()


def test_a_motion_nobody_measured_widens_the_belief() -> None:
    spreads = []
    for known in (True, False):
        particle_filter = ParticleFilter(Position((0.0, 0.0)), START, settings=PLAIN)
        particle_filter.propagate(np.zeros(3), covariance=np.eye(3) * 1e-8, known=known)
        spreads.append(np.sqrt(np.diag(particle_filter.estimate().mean.covariance)))
    assert spreads[0][:2] == pytest.approx([1.0, 0.5], abs=0.03)
    assert spreads[1][:2] == pytest.approx([np.hypot(1, 1), np.hypot(0.5, 1)], abs=0.06)
    assert spreads[1][2] == pytest.approx(0.35, abs=0.01)


def test_the_same_seed_is_the_same_filter() -> None:
    def after(seed: int) -> np.ndarray:
        particle_filter = ParticleFilter(Position((0.5, 0.0)), START, settings=PLAIN, seed=seed)
        for _ in range(3):
            particle_filter.reweight(fan())
            particle_filter.resample()
            particle_filter.propagate([0.1, 0.0, 0.05])
        return particle_filter.particles.poses

    assert (after(1) == after(1)).all()
    assert not np.array_equal(after(1), after(2))


def test_rays_are_chosen_evenly_in_the_plane() -> None:
    scan = fan(100)
    assert choose_rays(scan, 100) is scan
    few = choose_rays(scan, 10)
    rows = [int(np.flatnonzero((scan.directions == d).all(1))[0]) for d in few.directions]
    assert len(rows) == 10
    assert (np.diff(rows) == 10).all()
    assert rows[0] == pytest.approx(99 - rows[-1], abs=1)
    odd = choose_rays(fan(7), 3)
    assert len(np.unique(odd.directions, axis=0)) == 3


def test_rays_are_spread_in_space_and_of_the_body() -> None:
    rng = np.random.default_rng(1)
    mount = se3.exp([0.1, 0.2, 0.3, 1.0, 0.5, 0.2])
    points = rng.normal(0, 4, (400, 3))
    scan = fan(dimension=3).from_points(points, (0.5, 6.0), T_body_sensor=mount)
    few = choose_rays(scan, 50)
    assert len(few) == 50
    assert (few.status == RayStatus.RETURN).all()
    ends = se3.transform(mount, scan.points())
    nearest = np.linalg.norm(few.points()[:, None] - ends, axis=-1).min(1)
    assert nearest.max() < 1e-9
    assert choose_rays(scan.select(scan.status == RayStatus.NO_RETURN), 50).is_return.sum() == 0


def test_free_space_is_where_rays_crossed_and_ended_nowhere() -> None:
    scan = fan(720, reach=4.0)
    statistics = RayStatistics.from_scans([scan], [[0.0, 0, 0]], resolution=0.25)
    drawn = FreeSpace.of(statistics).sample(4000, np.random.default_rng(1))
    at = tuple(statistics.grid.index(drawn[:, :2]).T)
    assert (statistics.hits[at] == 0).all()
    assert (statistics.misses[at] > 0).all()
    assert np.hypot(*drawn[:, :2].T).max() < 4.3
    assert np.histogram(drawn[:, 2], 8, (-np.pi, np.pi))[0] == pytest.approx(np.full(8, 500), abs=110)
    with pytest.raises(MapError, match="nowhere to start"):
        FreeSpace.of(RayStatistics.empty(PLANE))


def test_starts_around_a_pose_fill_their_disc_or_box() -> None:
    rng = np.random.default_rng(2)
    disc = AroundPose([3.0, 1.0, 3.0], 2.0, 0.4).sample(20_000, rng)
    radius = np.hypot(*(disc[:, :2] - [3, 1]).T)
    assert radius.max() <= 2
    assert (radius < np.sqrt(2)).mean() == pytest.approx(0.5, abs=0.02)
    assert np.abs(np.angle(np.exp(1j * (disc[:, 2] - 3)))).max() <= 0.4 + 1e-12
    box = AroundPose([3.0, 1.0, 3.0], (2.0, 0.5)).sample(20_000, rng)
    assert np.abs(box[:, :2] - [3, 1]).max(0) == pytest.approx([2, 0.5], abs=0.01)
    pose = se3.compose(se3.from_se2([3.0, 1.0, 3.0]), se3.exp([0.05, 0, 0, 0, 0, 0]))
    pose[2, 3] = 1.5
    level = AroundPose(pose, 2.0).sample(500, rng)
    assert level[:, 2, 3] == pytest.approx(np.full(500, 1.5))
    assert level[:, 2, :3] == pytest.approx(np.repeat(pose[None, 2, :3], 500, 0))
    swayed = AroundPose(pose, 2.0, height_sigma=0.2, tilt_sigma=0.1).sample(5000, rng)
    assert swayed[:, 2, 3].std() == pytest.approx(0.2, rel=0.1)
    assert swayed[:, 2, 0].std() == pytest.approx(0.1, rel=0.1)
    assert isinstance(NormalStart(PosePrior(np.zeros(3), np.eye(3))).sample(1, rng), np.ndarray)


def test_what_does_not_fit_is_refused() -> None:
    model = Position((0.0, 0.0))
    with pytest.raises(MapError, match="start: of 3 dimensions"):
        ParticleFilter(model, NormalStart.from_sigmas(np.eye(4), [0.1] * 6))
    with pytest.raises(MapError, match="free_space: of 3 dimensions"):
        ParticleFilter(model, START, free_space=AroundPose(np.eye(4), 1.0))
    with pytest.raises(MapError, match="outside the map"):
        ParticleFilter(model, NormalStart.from_sigmas([90.0, 0, 0], [0.1] * 3))
    particle_filter = ParticleFilter(model, START, settings=PLAIN)
    with pytest.raises(MapError, match="scan: of 3 dimensions"):
        particle_filter.reweight(fan(dimension=3))
    with pytest.raises(GeometryError, match="motion"):
        particle_filter.propagate(np.eye(4))
    with pytest.raises(GeometryError, match="covariance"):
        particle_filter.propagate(np.zeros(3), covariance=np.eye(2))
    for wrong in ({"reach": -1.0}, {"reach": np.inf}, {"reach": (1.0, 2.0, 3.0)}, {"reach": 1.0, "heading": -1.0}):
        with pytest.raises(GeometryError, match="reach"):
            AroundPose([0.0, 0, 0], **wrong)
    with pytest.raises(GeometryError, match="prior covariance"):
        NormalStart.from_sigmas([0.0, 0, 0], [1.0, 0.0, 1.0])
    for wrong in ({"tempering": 0}, {"resampling": "some"}, {"resample_below": 0}, {"rays": 0}, {"information": 2}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            ParticleFilterSettings(**wrong)
    assert ParticleFilterSettings().odometry == OdometryNoise()
