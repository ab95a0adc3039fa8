"""Refinement by likelihoods alone: closed forms, a small room by several models, and what is refused."""

import numpy as np
import pytest
import shapely
from analytic_models import PLANE, SPACE, Answer, Position, fan

from factorloc.errors import ConfigError, GeometryError, MapError, OptimizationError
from factorloc.factors import PosePrior
from factorloc.geometry import se2, se3
from factorloc.localization.derivative_free import RefinementSettings, refine
from factorloc.mapping import RayStatistics
from factorloc.mapping.decay_rate import DecayRatePosterior
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.reflection import ReflectionPosterior
from factorloc.result import StopReason
from factorloc.scan import Scan
from factorloc.simulation import FloorPlan, PlanarLidar

RESOLUTION = 0.1


def test_a_gaussian_likelihood_has_the_moments_of_its_product_with_the_prior() -> None:
    settings = RefinementSettings(samples=4000, information=0.5)
    prior = PosePrior.from_sigmas([0.3, -0.2, 0.4], 0.4, 0.1)
    model = Position((0.5, 0.1), sigma=0.3)
    result = refine(model, fan(), prior, settings=settings)
    assert result.converged
    variance = 1 / (0.5 / 0.3**2 + 1 / 0.4**2)
    mean = variance * (0.5 / 0.3**2 * np.array([0.5, 0.1]) + np.array([0.3, -0.2]) / 0.4**2)
    pose, (covariance,) = result.trajectory.poses[0], result.trajectory.covariances
    assert pose == pytest.approx([*mean, 0.4], abs=0.015)
    assert np.diag(covariance) == pytest.approx([variance, variance, 0.01], rel=0.1)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 0.1 * variance
    assert result.cost == pytest.approx(0.5 * 0.5 * ((pose[:2] - [0.5, 0.1]) ** 2).sum() / 0.3**2)
    assert result.residuals["scan"] == pytest.approx([result.cost])


def test_in_space_as_well() -> None:
    turn = se3.exp(np.array([0.1, -0.2, 0.5, 1.0, 2.0, 0.3]))
    prior = PosePrior.from_sigmas(turn, 0.5, 0.05)
    where = turn[:3, 3] + [0.3, -0.4, 0.1]
    model = Position(tuple(where), sigma=0.02, grid=SPACE)
    result = refine(model, fan(dimension=3), prior, settings=RefinementSettings(samples=3000))
    assert result.converged
    (pose,), (covariance,) = result.trajectory.poses, result.trajectory.covariances
    assert pose[:3, 3] == pytest.approx(where, abs=0.01)
    assert np.diag(covariance)[3:] == pytest.approx(np.full(3, 0.02**2 / 0.5), rel=0.3)
    assert np.diag(covariance)[:3] == pytest.approx(np.full(3, 0.05**2), rel=0.3)


def test_a_mean_between_two_peaks_is_no_pose() -> None:
    model = Answer((0.0, 0.0), function=lambda poses: -0.5 * ((np.abs(poses[:, 0]) - 0.5) / 0.03) ** 2)
    settings = RefinementSettings(samples=2000, information=1.0)
    result = refine(model, fan(), PosePrior.from_sigmas([0.0, 0, 0], 0.5, 0.1), settings=settings)
    (pose,), (covariance,) = result.trajectory.poses, result.trajectory.covariances
    assert abs(pose[0]) == pytest.approx(0.5, abs=0.1)
    assert covariance[0, 0] > 0.2, "the other peak counts"


def test_parts_the_model_excludes_are_counted_and_avoided() -> None:
    model = Answer((0.0, 0.0), function=lambda poses: np.where(poses[:, 0] > 0.2, 0.0, -np.inf))
    result = refine(model, fan(), [0.0, 0.0, 0.0])
    assert result.rejected["poses the model excludes"] > 100
    assert result.trajectory.poses[0, 0] > 0.2
    nowhere = Answer((0.0, 0.0), function=lambda poses: np.full(len(poses), -np.inf))
    with pytest.raises(OptimizationError, match="excludes it everywhere"):
        refine(nowhere, fan(), [0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def room() -> tuple[RayStatistics, list[Scan], np.ndarray]:
    walls = shapely.affinity.rotate(shapely.box(0, 0, 6, 4), 10, origin=(0, 0)).exterior
    plan = FloorPlan((walls, shapely.Point(3.6, 2.9).buffer(0.3), shapely.box(0.4, 2.2, 1.0, 3.2)))
    rng = np.random.default_rng(7)
    poses = np.column_stack([rng.uniform(1.4, 4.8, 44), rng.uniform(1.3, 2.2, 44), rng.uniform(-np.pi, np.pi, 44)])
    lidar = PlanarLidar(beams=91, range_limits=(0.1, 8.0), range_sigma=0.02, T_body_sensor=(0.1, 0.05, 0.3))
    scans = lidar.cast_many(plan, poses, rng)
    return RayStatistics.from_scans(scans[:40], poses[:40], resolution=RESOLUTION), scans[40:], poses[40:]


@pytest.mark.parametrize("model", [ReflectionPosterior, DecayRatePosterior, EndPointModel])
def test_a_scan_finds_its_place_within_a_cell(room, model) -> None:
    statistics, scans, truth = room
    built = model.from_statistics(statistics)
    for k, (scan, pose) in enumerate(zip(scans, truth, strict=True)):
        guess = se2.compose(pose, [0.25 * (-1) ** k, 0.2, np.radians(5.0)])
        result = refine(built, scan, guess, seed=k)
        found = result.trajectory.poses[0]
        assert result.converged, result.summary()
        assert np.hypot(*(found - pose)[:2]) < RESOLUTION
        assert abs(se2.between(pose, found)[2]) < np.radians(1.5)
        likely = built.scan_log_likelihoods(scan, np.stack([found, pose, guess]))
        assert likely[0] > likely[2]
        sigma = np.sqrt(np.diag(result.trajectory.covariances[0]))
        assert (sigma > 5e-4).all()
        assert (sigma < [RESOLUTION, RESOLUTION, 0.05]).all()
        assert result.trajectory.stamps[0] == scan.stamp


def test_the_same_seed_gives_the_same_pose(room) -> None:
    statistics, scans, truth = room
    model = EndPointModel.from_statistics(statistics)
    one, two, other = (refine(model, scans[0], truth[0] + 0.1, seed=seed).trajectory.poses for seed in (3, 3, 4))
    assert (one == two).all()
    assert not (one == other).all()


def test_too_few_rounds_are_told() -> None:
    model = Position((0.5, 0.1), sigma=0.001)
    result = refine(model, fan(), [0.0, 0, 0], settings=RefinementSettings(max_rounds=2))
    assert result.stop is StopReason.MAX_ITERATIONS
    assert result.iterations == 2


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(MapError, match="the map has 2"):
        refine(Position((0, 0), grid=PLANE), fan(dimension=3), [0.0, 0, 0])
    with pytest.raises(MapError, match="guess of 3"):
        refine(Position((0, 0), grid=PLANE), fan(), np.eye(4))
    with pytest.raises(GeometryError, match="no rays"):
        refine(Position((0, 0)), fan().select(np.zeros(5, bool)), [0.0, 0, 0])
    with pytest.raises(ConfigError, match="samples"):
        RefinementSettings(samples=2)
