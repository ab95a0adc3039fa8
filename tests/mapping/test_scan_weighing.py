"""Weighing of scans: every sensor model, dense and in bricks, sums up its rays at every pose, in threads or not."""

import math
from collections.abc import Callable

import naive
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS, sweep
from strategies import poses_3d, scans

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se3
from factorloc.mapping import BrickStatistics, GammaPrior, Grid, RayStatistics, beam_model
from factorloc.mapping.beta_prior import BetaPrior
from factorloc.mapping.sensor_model import SensorModel
from factorloc.mapping.sensor_models import SENSOR_MODELS, make_sensor_model
from factorloc.scan import Scan

Statistics = RayStatistics | BrickStatistics

PRIORS = {"decay-rate": GammaPrior(0.3, 0.7), "reflection": BetaPrior(0.3, 2.0)}
BEAM_MODELS = ["decay-rate", "decay-rate-posterior", "reflection", "reflection-posterior"]


def counts(*shape: int, seed: int = 0) -> RayStatistics:
    """A map around the origin, with cells never hit and cells never seen."""
    rng = np.random.default_rng(seed)
    grid = Grid(tuple(-0.25 * n for n in shape), 0.5, shape)
    hits, misses = rng.choice([0, 0, 1, 5], shape), rng.choice([0, 1, 20], shape)
    path = np.round((hits + misses) * rng.uniform(0.2, 0.7, shape) * 2**20).astype(np.int64)
    return RayStatistics(grid, hits.astype(np.uint32), misses.astype(np.uint32), path)


def planar() -> RayStatistics:
    return counts(20, 20)


def dense() -> RayStatistics:
    return counts(20, 20, 10)


def unfolded() -> BrickStatistics:
    """Small enough to be laid out in full."""
    return BrickStatistics.from_dense(dense())


def bricks() -> BrickStatistics:
    """In a grid too large for that."""
    whole = Grid((-255.0, -255.0, -102.5), 0.5, (1020, 1020, 410))
    found = unfolded().crop(whole)
    assert whole.cells * 4 > beam_model._MOST_IN_FULL
    assert len(found.cells) == len(unfolded().cells)
    return found


MAPS = [planar, dense, unfolded, bricks]


def spatial_sweep(seed: int, rays: int) -> Scan:
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((rays, 3)) * [1, 1, 0.3]
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    status = rng.choice([0, 0, 0, 1, 2], rays).astype(np.uint8)
    mount = se3.exp(rng.uniform(-0.3, 0.3, 6))
    return Scan(directions, rng.uniform(0.3, 6, rays), status, (0.3, 6.0), T_body_sensor=mount)


def drive(statistics: Statistics, seed: int, rays: int, poses: int) -> tuple[Scan, np.ndarray]:
    """A scan with rays of every status, and poses in the map and beyond its border."""
    rng = np.random.default_rng(seed + 1)
    if statistics.grid.dimension == 2:
        return sweep(seed, rays), rng.uniform(-6, 6, (poses, 3))
    return spatial_sweep(seed, rays), se3.exp(rng.uniform(-1, 1, (poses, 6)) * [1, 1, 3, 6, 6, 3])


def made(statistics: Statistics, name: str) -> SensorModel:
    kind = name.removesuffix("-posterior")
    return make_sensor_model(statistics, name, prior=PRIORS[kind])


@pytest.mark.parametrize("name", SENSOR_MODELS)
@pytest.mark.parametrize("make", MAPS)
def test_every_model_answers_what_is_asked_of_a_sensor_model(make: Callable[[], Statistics], name: str) -> None:
    statistics = make()
    model = make_sensor_model(statistics, name)
    assert isinstance(model, SensorModel)
    assert model.grid == statistics.grid
    assert isinstance(model.normalized, bool)
    scan, poses = drive(statistics, 3, 40, 6)
    each = np.array([model.log_likelihood(scan, pose) for pose in poses])
    sums = model.scan_log_likelihoods(scan, poses)
    assert each.shape == (6, 40)
    assert sums.shape == (6,)
    assert not np.isnan(each).any()
    with np.errstate(invalid="ignore"):
        precision = 40 * 1e-6 if name == "end-point" else 1e-9  # which looks its scores up in single precision
        assert sums == pytest.approx(each.sum(1), rel=1e-9, abs=precision)
    assert model.scan_log_likelihoods(scan, poses[:0]).shape == (0,)
    other = sweep(1, 3) if statistics.grid.dimension == 3 else spatial_sweep(1, 3)
    with pytest.raises(MapError, match="dimension"):
        model.scan_log_likelihoods(other, poses)
    with pytest.raises(MapError, match="dimension"):
        model.log_likelihood(other, poses[0])


@pytest.mark.parametrize("name", BEAM_MODELS)
@pytest.mark.parametrize("make", MAPS)
def test_threads_leave_no_trace(make: Callable[[], Statistics], name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    statistics = make()
    model, (scan, poses) = made(statistics, name), drive(statistics, 5, 50, 9)
    dealt = []
    in_threads = _jit.in_threads
    monkeypatch.setattr(_jit, "in_threads", lambda work, count: (dealt.append(count), in_threads(work, count))[0])
    alone = model.scan_log_likelihoods(scan, poses), model.log_likelihood(scan, poses[0])
    assert dealt == []
    monkeypatch.setattr(beam_model, "_PARALLEL_CELLS", 0)
    monkeypatch.setattr(_jit, "threads", lambda: 2)
    together = model.scan_log_likelihoods(scan, poses), model.log_likelihood(scan, poses[0])
    assert dealt == [9, 50]
    assert alone[0].tolist() == together[0].tolist()
    assert alone[1].tolist() == together[1].tolist()


@pytest.mark.parametrize("name", BEAM_MODELS)
@pytest.mark.parametrize("make", MAPS)
def test_close_poses_are_weighed_side_by_side_and_alike(
    make: Callable[[], Statistics], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    statistics = make()
    model, (scan, poses) = made(statistics, name), drive(statistics, 5, 50, 23)
    alone = model.scan_log_likelihoods(scan, poses)
    groups = []
    kernel = model._kernel  # type: ignore[attr-defined]

    def watched(poses: np.ndarray, group: int, *rays: np.ndarray) -> None:
        groups.append(group)
        kernel(poses, group, *rays)

    monkeypatch.setitem(model.__dict__, "_kernel", watched)
    monkeypatch.setattr(beam_model, "_SIDE_BY_SIDE", 7)
    assert model.scan_log_likelihoods(scan, poses).tolist() == alone.tolist()
    monkeypatch.setattr(beam_model, "_CLOSE", 1000.0)
    assert model.scan_log_likelihoods(scan, poses).tolist() == alone.tolist()
    assert groups == [1, 7]


def test_poses_are_close_if_a_ray_ends_at_much_the_same_place_from_all() -> None:
    rng = np.random.default_rng(1)
    near = rng.normal(size=(500, 3)) * [0.5, 0.5, 0.1] + [100.0, -50.0, np.pi]
    turned, far = near + np.outer(rng.normal(size=500), [0, 0, 2]), near + np.outer(rng.normal(size=500), [0, 20, 0])
    for poses, close in ((near, True), (turned, False), (far, False), (far[:1], False)):
        assert beam_model._are_close(poses) == close
        assert beam_model._are_close(se3.from_se2(poses)) == close


@given(SEEDS, st.integers(0, 200), st.booleans())
def test_poses_far_apart_are_taken_in_turns_through_the_map(seed: int, count: int, spatial: bool) -> None:
    poses = np.random.default_rng(seed).uniform(-40, 40, (count, 3))
    order = beam_model._through_the_map(se3.from_se2(poses) if spatial else poses)
    assert sorted(order) == list(range(count))
    stripes = np.floor(poses[order, 0] / beam_model._STRIPE)
    assert (np.diff(stripes) >= 0).all()
    for stripe in np.unique(stripes):
        steps = np.diff(np.floor(poses[order][stripes == stripe, 1] / beam_model._STRIPE))
        assert (steps >= 0).all() if stripe % 2 == 0 else (steps <= 0).all()


@pytest.mark.parametrize("name", BEAM_MODELS)
@pytest.mark.parametrize("make", MAPS)
def test_a_map_is_laid_out_once(make: Callable[[], Statistics], name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    statistics = make()
    model, (scan, poses) = made(statistics, name), drive(statistics, 5, 5, 2)
    asked = []
    bound = type(model)._bound_kernel
    monkeypatch.setattr(type(model), "_bound_kernel", lambda self: (asked.append(1), bound(self))[1])
    for _ in range(3):
        model.log_likelihood(scan, poses[0])
        model.scan_log_likelihoods(scan, poses)
    assert asked == [1]


@settings(max_examples=20)
@given(scans(3, 5), poses_3d(), SEEDS)
def test_spatial_scans_are_moved_by_pose_and_mount(scan: Scan, pose: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = pose @ scan.T_body_sensor
    grid = Grid(tuple(T[:3, 3] - rng.uniform(2, 4, 3)), 0.777, (9, 8, 7))
    statistics = counts(9, 8, 7, seed=seed % 1000)
    statistics = RayStatistics(grid, statistics.hits, statistics.misses, statistics.path_fixed)
    rays = [
        Ray(T[:3, :3] @ o + T[:3, 3], T[:3, :3] @ d, float(r), int(s))
        for o, d, r, s in zip(scan.origins, scan.directions, scan.ranges, scan.status, strict=True)
    ]
    assume(not any(naive.is_ambiguous(ray, naive.around(ray, grid)[0]) for ray in rays))
    decay, reflection = made(statistics, "decay-rate-posterior"), made(statistics, "reflection")
    gamma = PRIORS["decay-rate"]
    expected = [
        naive.posterior_log_likelihood(
            ray, scan.range_limits, grid, decay.shapes, decay.paths, (gamma.shape, gamma.path)
        )
        for ray in rays
    ]
    assert decay.log_likelihood(scan, pose) == pytest.approx(expected, rel=1e-7, abs=1e-7)
    expected = [
        naive.reflection_log_likelihood(
            ray, scan.range_limits, grid, reflection.probabilities, PRIORS["reflection"].mean
        )
        for ray in rays
    ]
    assert reflection.log_likelihood(scan, pose) == pytest.approx(expected, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("name", ["decay-rate", "reflection"])
@pytest.mark.parametrize("make", MAPS)
def test_one_ray_that_is_excluded_excludes_the_scan_unless_there_is_a_floor(make, name: str) -> None:
    statistics = make()
    scan, poses = drive(statistics, 7, 200, 4)
    prior = PRIORS[name]
    assert (
        make_sensor_model(statistics, name, prior=prior).scan_log_likelihoods(scan, poses).tolist() == [-math.inf] * 4
    )
    found = make_sensor_model(statistics, name, prior=prior, floor=1e-3).scan_log_likelihoods(scan, poses)
    assert np.isfinite(found).all()


def test_poses_of_another_dimension_or_shape_are_refused() -> None:
    model, scan = made(planar(), "decay-rate"), sweep(0, 4)
    for poses in (np.eye(4)[None], np.zeros(3), np.zeros((2, 4)), np.zeros((2, 1, 3))):
        with pytest.raises(MapError, match="this map of 2 dimensions wants"):
            model.scan_log_likelihoods(scan, poses)
    with pytest.raises(MapError, match="this map of 3 dimensions wants"):
        made(dense(), "decay-rate").log_likelihood(spatial_sweep(0, 4), np.zeros(3))


def test_an_unknown_model_is_answered_by_those_there_are() -> None:
    with pytest.raises(
        MapError, match="none is named 'likelihood'; choose one of decay-rate, decay-rate-posterior, re"
    ):
        make_sensor_model(planar(), "likelihood")


@settings(max_examples=30)
@given(st.sampled_from(BEAM_MODELS), SEEDS)
def test_weights_are_what_one_pose_at_a_time_gives(name: str, seed: int) -> None:
    model = made(counts(12, 9, seed=seed % 1000), name)
    scan, poses = drive(planar(), seed % 1000, 30, 5)
    each = [model.log_likelihood(scan, pose).sum() for pose in poses]
    assert model.scan_log_likelihoods(scan, poses) == pytest.approx(each, rel=1e-9, abs=1e-9)
