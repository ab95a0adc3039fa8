"""A simulated office and a furnished room are localized by particles; what is degenerate ends well."""

import numpy as np
import pytest
from analytic_models import Answer, Position, fan
from spatial_room import distances, room, turns

from factorloc.errors import ConfigError, GeometryError, MapError
from factorloc.factors import PosePrior
from factorloc.geometry import se2
from factorloc.localization import FreeSpace, MonteCarloSettings, NormalStart, localize_by_particles
from factorloc.localization.kld import KldSettings
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.sensor_models import make_sensor_model
from factorloc.result import StopReason

FEW = MonteCarloSettings(kld=KldSettings(least=300, most=8000))
MEAN = MonteCarloSettings(estimate="mean")


@pytest.fixture(scope="module")
def ends(office) -> EndPointModel:
    return EndPointModel.from_statistics(office.statistics)


def localized(office, model, start, seed: int, scans: int = 25, **arguments):
    drive = office.drive
    return localize_by_particles(model, drive.scans[:scans], drive.odometry[: scans - 1], start, seed=seed, **arguments)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drive_is_followed_from_far_away(office, ends, seed: int) -> None:
    """From 2.5 m and 5 degrees beside."""
    rng = np.random.default_rng(seed)
    towards = rng.uniform(-np.pi, np.pi)
    wrong = office.truth[0] + [2.5 * np.cos(towards), 2.5 * np.sin(towards), np.radians(5) * rng.choice([-1, 1])]
    start = NormalStart.standing(wrong, 2.5, np.radians(5))
    result = localized(office, ends, start, seed, settings=FEW)
    poses = result.trajectory.poses[10:]
    assert np.hypot(*(poses - office.truth[10:25])[:, :2].T).max() < 0.15
    assert np.abs(se2.between(office.truth[10:25], poses)[:, 2]).max() < np.radians(3)
    assert result.residuals["particles"][0] > 3000
    assert result.residuals["particles"][-1] < 1000


@pytest.mark.parametrize("name", ["decay-rate-posterior", "reflection-posterior"])
def test_posteriors_follow_it_as_well(office, name: str) -> None:
    model = make_sensor_model(office.statistics, name)
    result = localized(office, model, office.prior, 1, 12, settings=FEW)
    errors = np.hypot(*(result.trajectory.poses - office.truth[:12])[:, :2].T)
    assert errors[6:].max() < 0.1


def test_the_start_may_be_unknown(office, ends) -> None:
    anywhere = FreeSpace.of(office.statistics)
    settings = MonteCarloSettings(kld=KldSettings(most=30_000))
    result = localized(office, ends, anywhere, 2, 15, settings=settings, free_space=anywhere)
    assert np.hypot(*(result.trajectory.poses[-1] - office.truth[14])[:2]) < 0.15


def test_a_room_in_space_is_localized() -> None:
    here = room()
    model = EndPointModel.from_statistics(here.statistics)
    start = NormalStart.standing(here.prior.pose, 0.5, np.radians(5))
    result = localize_by_particles(
        model, here.scans, here.odometry, start, covariances=here.covariances, settings=FEW, seed=1
    )
    errors = here.errors(result.trajectory.poses)
    assert distances(errors)[4:].max() < 0.25
    assert turns(errors)[4:].max() < np.radians(4)
    assert result.rejected["rays unused"] > 0
    assert result.trajectory.covariances.shape == (len(here.scans), 6, 6)


def test_a_room_is_found_from_anywhere_in_it() -> None:
    here = room()
    model = EndPointModel.from_statistics(here.statistics)
    anywhere = FreeSpace.of(here.statistics, height_sigma=0.05, tilt_sigma=0.02)
    drawn = anywhere.sample(500, np.random.default_rng(1))
    assert (np.abs(drawn[:, :2, 3]) < [7.2, 5.2]).all()
    assert drawn[:, 2, 3].std() == pytest.approx(0.05, rel=0.2)
    settings = MonteCarloSettings(kld=KldSettings(least=500, most=10_000))
    result = localize_by_particles(
        model, here.scans, here.odometry, anywhere, covariances=here.covariances, settings=settings, seed=3
    )
    assert distances(here.errors(result.trajectory.poses))[-3:].max() < 0.3


def test_the_result_says_what_was_done(office, ends) -> None:
    heard, clouds = [], []
    result = localized(
        office, ends, office.prior, 1, 6, settings=FEW, progress=heard.append, on_particles=clouds.append
    )
    assert result.stop is StopReason.FILTERED
    assert not result.converged
    assert heard == [1, 2, 3, 4, 5, 6]
    assert [len(cloud) for cloud in clouds] == result.residuals["particles"].tolist()
    assert result.cost == pytest.approx(result.residuals["scan"].sum())
    assert set(result.rejected) == {
        "rays unused", "scans without information", "scans no particle explains", "scans tempered",
        "motions not measured", "resamplings", "recoveries",
    }  # fmt: skip
    assert result.rejected["rays unused"] == 6 * (109 - 60)
    assert result.rejected["resamplings"] > 0
    assert (result.trajectory.stamps == office.drive.stamps[:6]).all()
    assert result.trajectory.world == office.statistics.grid.frame
    # Never below what the map itself is wrong by.
    assert np.linalg.eigvalsh(result.trajectory.covariances).min() >= 0.003**2 - 1e-12


def test_the_same_seed_gives_the_same_trajectory(office, ends) -> None:
    one, same, other = (localized(office, ends, office.prior, seed, 5, settings=FEW) for seed in (4, 4, 5))
    assert (one.trajectory.poses == same.trajectory.poses).all()
    assert one.cost == same.cost
    assert not np.array_equal(one.trajectory.poses, other.trajectory.poses)


def test_the_cost_is_the_evidence_of_the_scans() -> None:
    """Of a Gaussian belief and a Gaussian likelihood it is known."""
    settings = MonteCarloSettings(information=1, tempering=None, kld=KldSettings(least=20_000, most=20_000))
    prior = PosePrior(np.zeros(3), np.diag([0.5, 0.5, 1e-4]) ** 2)
    result = localize_by_particles(Position((0.3, 0.0), 0.4), [fan()], np.zeros((0, 3)), prior, settings=settings)
    total = 0.25 + 0.16
    assert result.cost == pytest.approx(0.5 * 0.09 / total - np.log(0.16 / total), abs=0.03)


@pytest.mark.parametrize("estimate", ["mean", "best", "mode"])
def test_estimates_are_by_choice(estimate: str) -> None:
    settings = MonteCarloSettings(estimate=estimate, kld=KldSettings(least=5000, most=5000))
    result = localize_by_particles(
        Position((0.5, 0.0), 0.1), [fan()] * 8, np.zeros((7, 3)), np.zeros(3), settings=settings
    )
    assert result.trajectory.poses[-1, :2] == pytest.approx([0.5, 0.0], abs=0.06)


def test_a_motion_nobody_measured_is_searched_for(office, gap, ends) -> None:
    n = 25
    scans = (office.drive.scans[:18] + office.drive.scans[20:])[:n]
    arguments = {"known": gap.known[: n - 1], "settings": FEW, "seed": 1}
    result = localize_by_particles(ends, scans, gap.odometry[: n - 1], office.prior, **arguments)
    assert result.rejected["motions not measured"] == 1
    assert np.hypot(*(result.trajectory.poses - gap.truth[:n])[-3:, :2].T).max() < 0.15
    assert result.residuals["particles"][18] == result.residuals["particles"][17] or result.rejected["resamplings"] > 1


def test_a_kidnapped_vehicle_is_found_again(office, ends) -> None:
    """Odometry says it stood still, while it was carried 3 m."""
    scans, odometry = office.drive.scans, office.drive.odometry
    taken = [*scans[:22], *scans[30:]]
    path = np.concatenate([odometry[:21], np.zeros((1, 3)), odometry[30:]])
    truth = np.concatenate([office.truth[:22], office.truth[30:]])
    anywhere = FreeSpace.of(office.statistics)
    assert np.hypot(*(truth[22] - truth[21])[:2]) > 3
    found = localize_by_particles(ends, taken, path, office.prior, free_space=anywhere, seed=1)
    errors = np.hypot(*(found.trajectory.poses - truth)[:, :2].T)
    assert found.rejected["recoveries"] >= 1
    assert errors[5:22].max() < 0.15
    assert errors[22] > 2
    assert errors[-5:].max() < 0.15
    alone = localize_by_particles(ends, taken, path, office.prior, seed=1)
    assert alone.rejected["recoveries"] == 0


def test_blind_scans_leave_what_odometry_and_start_say() -> None:
    blind = fan(reach=11.0)
    result = localize_by_particles(
        Position((9.0, 9.0)), [blind] * 4, np.tile([0.5, 0, 0], (3, 1)), np.zeros(3), settings=MEAN
    )
    assert result.rejected["scans without information"] == 4
    assert result.rejected["rays unused"] == 20
    assert result.trajectory.poses[-1] == pytest.approx([1.5, 0, 0], abs=0.3)
    assert result.cost == 0
    spread = result.trajectory.covariances.trace(axis1=1, axis2=2)
    assert (np.diff(spread) > 0).all()


def test_scans_no_particle_explains_are_counted() -> None:
    never = Answer((0.0, 0.0), function=lambda poses: np.full(len(poses), -np.inf))
    result = localize_by_particles(never, [fan()] * 3, np.zeros((2, 3)), np.zeros(3), settings=MEAN)
    assert result.rejected["scans no particle explains"] == 3
    assert result.cost == 0
    assert result.trajectory.poses == pytest.approx(np.zeros((3, 3)), abs=0.2)


def test_a_drive_that_leaves_the_map_goes_on_by_odometry() -> None:
    motions = np.tile([10.0, 0, 0], (4, 1))
    tight = np.tile(np.eye(3) * 1e-4, (4, 1, 1))
    result = localize_by_particles(Position((0.0, 0.0), 50.0), [fan()] * 5, motions, np.zeros(3), covariances=tight)
    assert result.rejected["scans no particle explains"] == 2
    assert result.trajectory.poses[-1, 0] == pytest.approx(40, abs=2.5)


def test_a_single_particle_runs() -> None:
    settings = MonteCarloSettings(kld=KldSettings(least=1, most=1))
    result = localize_by_particles(Position((0.0, 0.0)), [fan()] * 3, np.zeros((2, 3)), np.zeros(3), settings=settings)
    assert result.residuals["particles"].tolist() == [1, 1, 1]
    assert np.isfinite(result.trajectory.poses).all()


@pytest.mark.parametrize(
    ("scans", "motions", "start", "arguments", "error", "line"),
    [
        ([], np.zeros((0, 3)), np.zeros(3), {}, GeometryError, "scans: none"),
        ([fan(), fan(dimension=3)], np.zeros((1, 3)), np.zeros(3), {}, MapError, "number 1 has 3 dimensions"),
        ([fan(dimension=3)], np.zeros((0, 3)), np.zeros(3), {}, MapError, "number 0 has 3 dimensions"),
        ([fan()] * 3, np.zeros((1, 3)), np.zeros(3), {}, GeometryError, "expected 2 motions between 3 scans"),
        ([fan()] * 2, np.zeros((1, 4, 4)), np.zeros(3), {}, GeometryError, "odometry"),
        ([fan()] * 2, np.full((1, 3), np.nan), np.zeros(3), {}, GeometryError, "odometry"),
        ([fan()] * 2, np.zeros((1, 3)), np.zeros(3), {"known": [True] * 2}, GeometryError, "known"),
        ([fan()] * 2, np.zeros((1, 3)), np.zeros(3), {"covariances": np.eye(3)}, GeometryError, "covariances"),
        ([fan()], np.zeros((0, 3)), [90.0, 0, 0], {}, MapError, r"start: \(90.00, 0.00\) m lies outside"),
        ([fan()], np.zeros((0, 3)), np.eye(4), {}, MapError, "start"),
        ([fan()], np.zeros((0, 3)), NormalStart.from_sigmas(np.eye(4), [0.1] * 6), {}, MapError, "start: of 3"),
        ([fan()], np.zeros((0, 3)), [np.nan, 0, 0], {}, GeometryError, "NaN"),
    ],
)
def test_what_does_not_fit_is_refused(scans, motions, start, arguments, error, line: str) -> None:
    with pytest.raises(error, match=line):
        localize_by_particles(Position((0.0, 0.0)), scans, motions, start, **arguments)


def test_a_likelihood_of_nan_is_named() -> None:
    broken = Answer((0.0, 0.0), function=lambda poses: np.full(len(poses), np.nan))
    with pytest.raises(MapError, match="Answer: log-likelihood NaN"):
        localize_by_particles(broken, [fan()], np.zeros((0, 3)), np.zeros(3))


def test_settings_out_of_range_are_refused() -> None:
    for wrong in ({"estimate": "median"}, {"start_position": 0}, {"map_position": -1}, {"particles": 5}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            MonteCarloSettings(**wrong)
