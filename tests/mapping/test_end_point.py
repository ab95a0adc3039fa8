"""End-point models: exact distances, sums equal to naive ones, and probabilities that add up to one."""

import math

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_cases import SEEDS, grids, sweep
from scipy.spatial import cKDTree
from spatial_cases import spatial_grids
from strategies import poses_2d

from factorloc import _jit
from factorloc.errors import MapError
from factorloc.geometry import se2, se3
from factorloc.mapping import BrickStatistics, Grid, RayStatistics
from factorloc.mapping.distance_transform import DistanceField, end_cells
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.normalized_end_point import NormalizedEndPointModel
from factorloc.mapping.out_of_range import OutOfRangePrior
from factorloc.mapping.sensor_model import SensorModel
from factorloc.scan import RayStatus, Scan

LIMITS = (0.4, 6.0)
HERE = np.eye(4)


def counted(grid: Grid, seed: int, share: float = 0.1) -> RayStatistics:
    """Counts with some occupied cells, and some that were hit too rarely."""
    rng = np.random.default_rng(seed)
    hits = np.where(rng.random(grid.shape) < share, rng.choice([1, 5], grid.shape), 0)
    hits.flat[rng.integers(hits.size)] = 7
    misses = np.where(hits == 1, 40, rng.choice([0, 3], grid.shape))
    return RayStatistics(grid, hits.astype(np.uint32), misses.astype(np.uint32), np.full(grid.shape, 2**20))


def brute_distances(grid: Grid, occupied: np.ndarray, farthest: float) -> np.ndarray:
    cells = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1)
    apart = np.linalg.norm(cells[..., None, :] - np.argwhere(occupied), axis=-1).min(-1)
    return np.minimum(apart * grid.resolution, farthest)


def cloud(seed: int, rays: int) -> Scan:
    """A spatial scan of random ranges, some out of limits, of a tilted sensor."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((rays, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ranges = rng.uniform(0, 1.1 * LIMITS[1], rays)
    status = np.select([ranges < LIMITS[0], ranges >= LIMITS[1]], [1, 2], 0)
    mount = se3.exp(rng.uniform(-0.5, 0.5, 6))
    return Scan(directions, ranges, status, LIMITS, T_body_sensor=mount)


def spatial_poses(seed: int, count: int, grid: Grid) -> np.ndarray:
    rng = np.random.default_rng(seed)
    poses = se3.exp(rng.normal(size=(count, 6)) * [0.3, 0.3, 2, 0, 0, 0])
    poses[:, :3, 3] = grid.origin + rng.uniform(-0.2, 1.2, (count, 3)) * np.multiply(grid.shape, grid.resolution)
    return poses


@given(grids(), SEEDS, st.sampled_from([0.3, 2.0, 50.0]))
def test_distances_are_those_of_brute_force(grid: Grid, seed: int, farthest: float) -> None:
    statistics = counted(grid, seed)
    field = DistanceField.from_statistics(statistics, farthest)
    expected = brute_distances(grid, end_cells(statistics), farthest)
    assert field.values == pytest.approx(expected, abs=1e-12)
    centres = np.stack(np.meshgrid(grid.centres(0), grid.centres(1), indexing="ij"), -1)
    assert field.at(centres) == pytest.approx(expected, abs=1e-12)
    assert field.at([grid.upper[0] + 1, 0.0]) == farthest


@settings(max_examples=25)
@given(spatial_grids(24), SEEDS, st.sampled_from([0.3, 0.7]))
def test_distances_in_space_dense_and_in_bricks(grid: Grid, seed: int, farthest: float) -> None:
    statistics = counted(grid, seed, 0.003)
    occupied = end_cells(statistics)
    expected = brute_distances(grid, occupied, farthest) if occupied.sum() < 40 and grid.cells < 9000 else None
    dense = DistanceField.from_statistics(statistics, farthest)
    sparse = DistanceField.from_statistics(BrickStatistics.from_dense(statistics), farthest)
    cells = np.stack(np.meshgrid(*map(np.arange, grid.shape), indexing="ij"), -1)
    if expected is not None:
        assert dense.values == pytest.approx(expected, abs=1e-12)
    assert sparse.values.at(cells) == pytest.approx(dense.values, rel=1e-6)
    assert sparse.values.at([-1, 0, 0]) == pytest.approx(farthest)


def test_what_counts_as_occupied() -> None:
    grid = Grid((0, 0), 1.0, (5, 1))
    hits, misses = np.array([[0], [1], [1], [3], [100]]), np.array([[9], [9], [10], [0], [800]])
    statistics = RayStatistics(grid, hits.astype(np.uint32), misses.astype(np.uint32), np.ones((5, 1), np.int64))
    assert np.flatnonzero(end_cells(statistics)).tolist() == [1, 3, 4]
    assert np.flatnonzero(end_cells(statistics, 2)).tolist() == [3, 4]
    assert np.flatnonzero(end_cells(statistics, 1, 0.2)).tolist() == [3]
    assert np.flatnonzero(end_cells(statistics, 0, 0.0)).tolist() == [1, 2, 3, 4]
    with pytest.raises(MapError, match="no cell is occupied; lower least_hits"):
        EndPointModel.from_statistics(statistics, least_hits=101)
    with pytest.raises(MapError, match="occupied: shape"):
        DistanceField.from_occupied(grid, np.ones((2, 2)))
    with pytest.raises(MapError, match="farthest"):
        DistanceField.from_occupied(grid, np.ones((5, 1)), 0.0)


def naive_score(model: EndPointModel, distance: float, maximum: float) -> float:
    normal = math.exp(-0.5 * (distance / model.sigma) ** 2) / (model.sigma * math.sqrt(2 * math.pi))
    return model.hit * normal + model.random / maximum


@given(grids(), poses_2d(), st.integers(0, 9))
def test_each_ray_has_the_naive_score(grid: Grid, pose: np.ndarray, seed: int) -> None:
    statistics = counted(grid, seed)
    prior = OutOfRangePrior(0.02, 0.3)
    model = EndPointModel.from_statistics(statistics, 0.2, farthest=1.0, out_of_range=prior)
    distances = brute_distances(grid, end_cells(statistics), 1.0)
    pose = pose + np.array([*grid.origin, 0])
    scan = sweep(seed, 30)
    for ray, found in zip(naive.rays(scan, pose), model.log_likelihood(scan, pose), strict=True):
        if ray.status != RayStatus.RETURN:
            assert np.exp(found) == pytest.approx(0.02 if ray.status == RayStatus.BELOW_MINIMUM else 0.3)
            continue
        cell = naive.cell_at(ray, ray.length, grid)
        score = naive_score(model, 1.0 if cell is None else distances[cell], scan.range_limits[1])
        assert found == pytest.approx(math.log(score), rel=1e-9, abs=1e-9)


@given(grids(30), SEEDS)
def test_a_scan_is_the_sum_of_its_rays(grid: Grid, seed: int) -> None:
    model = EndPointModel.from_statistics(counted(grid, seed))
    rng = np.random.default_rng(seed)
    size = np.multiply(grid.shape, grid.resolution)
    poses = np.column_stack([grid.origin + rng.uniform(-0.5, 1.5, (7, 2)) * size, rng.uniform(-9, 9, 7)])
    scan = sweep(seed, 77)
    expected = [model.log_likelihood(scan, pose).sum() for pose in poses]
    # What single precision costs: less than 1e-6 a ray.
    assert model.scan_log_likelihoods(scan, poses) == pytest.approx(expected, abs=77e-6, rel=0)
    normalized = NormalizedEndPointModel(model)
    expected = [normalized.log_likelihood(scan, pose).sum() for pose in poses]
    assert normalized.scan_log_likelihoods(scan, poses) == pytest.approx(expected, rel=1e-12)


@settings(max_examples=25)
@given(spatial_grids(20), SEEDS)
def test_a_spatial_scan_is_the_sum_of_its_rays(grid: Grid, seed: int) -> None:
    statistics = counted(grid, seed, 0.01)
    scan, poses = cloud(seed, 40), spatial_poses(seed, 4, grid)
    dense = EndPointModel.from_statistics(statistics, farthest=1.0)
    sparse = EndPointModel.from_statistics(BrickStatistics.from_dense(statistics), farthest=1.0)
    expected = np.array([dense.log_likelihood(scan, pose).sum() for pose in poses])
    assert dense.scan_log_likelihoods(scan, poses) == pytest.approx(expected, rel=1e-12)
    assert sparse.scan_log_likelihoods(scan, poses) == pytest.approx(expected, abs=1e-3)
    each = [sparse.log_likelihood(scan, pose).sum() for pose in poses]
    assert sparse.scan_log_likelihoods(scan, poses) == pytest.approx(each, abs=1e-4)
    normalized = NormalizedEndPointModel(dense).scan_log_likelihoods(scan, poses)
    assert NormalizedEndPointModel(sparse).scan_log_likelihoods(scan, poses) == pytest.approx(normalized, abs=1e-3)


def test_threads_change_nothing() -> None:
    grid = Grid((0, 0), 0.1, (200, 150))
    model = EndPointModel.from_statistics(counted(grid, 1, 0.01))
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(0, 15, (2000, 2)), rng.uniform(-3, 3, 2000)])
    scan = sweep(2, 100)
    before = _jit.threads()
    try:
        found = [model.scan_log_likelihoods(scan, poses) for n in (1, 2) if _jit.set_threads(n)]
    finally:
        _jit.set_threads(before)
    assert np.array_equal(*found)
    # The nearest occupied cell of the whole map, by a tree: each end is at most half a diagonal from its cell's centre.
    some = poses[:50]
    ends = np.stack([se2.transform(se2.compose(pose, scan.T_body_sensor), scan.points()) for pose in some])
    inside = grid.contains(ends)
    centres = (grid.index(ends) + 0.5) * grid.resolution
    tree = cKDTree((np.argwhere(end_cells(counted(grid, 1, 0.01))) + 0.5) * grid.resolution)
    distances = np.where(inside, np.minimum(tree.query(centres)[0], 2.0), 2.0)
    expected = model.log_score(distances, scan.range_limits[1]).sum(1)
    expected += model.log_shares[scan.status[~scan.is_return]].sum()
    assert found[0][:50] == pytest.approx(expected, abs=1e-4)


@given(grids(), SEEDS)
def test_normalized_rays_are_the_naive_ones_and_add_up_to_one(grid: Grid, seed: int) -> None:
    statistics = counted(grid, seed)
    model = NormalizedEndPointModel.from_statistics(statistics, 0.15, farthest=0.7)
    distances = brute_distances(grid, end_cells(statistics), 0.7)
    rng = np.random.default_rng(seed)
    pose = np.array([*(grid.origin + rng.uniform(-0.5, 1.5, 2) * np.multiply(grid.shape, grid.resolution)), 0.3])
    ray = naive.rays(Scan.from_polar([rng.uniform(-3, 3)], [LIMITS[1] * (1 - 1e-12)], LIMITS), pose)[0]
    pieces = [
        (max(piece.start, LIMITS[0]), piece.stop, naive_score(model.scores, 0.7 if c is None else distances[c], 6.0))
        for piece in naive.pieces(ray, grid)
        for c in [piece.cell]
        if piece.stop > LIMITS[0] + 1e-9 and piece.length > 1e-9
    ]
    total = sum((stop - start) * score for start, stop, score in pieces)
    middles = np.array([(start + stop) / 2 for start, stop, _ in pieces])
    angle = math.atan2(ray.direction[1], ray.direction[0]) - pose[2]
    scan = Scan.from_polar(np.full(len(middles) + 2, angle), [*middles, 0.1, 7.0], LIMITS)
    found = np.exp(model.log_likelihood(scan, pose))
    within = model.scores.out_of_range.within
    assert found[:-2] == pytest.approx([within * score / total for _, _, score in pieces], rel=1e-6)
    lengths = np.array([stop - start for start, stop, _ in pieces])
    assert found[:-2] @ lengths + found[-2:].sum() == pytest.approx(1.0, abs=1e-6)


@given(SEEDS)
def test_normalized_rays_in_space_add_up_to_one(seed: int) -> None:
    grid = Grid((-2.0, -1.0, -1.0), 0.3, (20, 18, 7))
    statistics = counted(grid, seed, 0.02)
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    ray = naive.Ray(rng.uniform(-1, 1, 3), direction, LIMITS[1], 0)
    pieces = [p for p in naive.pieces(ray, grid) if p.stop > LIMITS[0] and p.length > 1e-7]
    starts, stops = np.array([max(p.start, LIMITS[0]) for p in pieces]), np.array([p.stop for p in pieces])
    n = len(pieces)
    scan = Scan(
        np.tile(direction, (n, 1)), (starts + stops) / 2, np.zeros(n), LIMITS, origins=np.tile(ray.origin, (n, 1))
    )
    for counts in (statistics, BrickStatistics.from_dense(statistics)):
        model = NormalizedEndPointModel.from_statistics(counts)
        density = np.exp(model.log_likelihood(scan, HERE))
        assert density @ (stops - starts) == pytest.approx(model.scores.out_of_range.within, abs=1e-5)


def test_priors_of_rays_out_of_range() -> None:
    scans = [Scan.from_polar(np.zeros(4), [0.1, 1.0, 2.0, 9.0], LIMITS)] * 10
    prior = OutOfRangePrior.from_scans(scans)
    assert (prior.below, prior.none, prior.within) == pytest.approx((10.5 / 41.5, 10.5 / 41.5, 20.5 / 41.5))
    statistics = RayStatistics.from_scans(scans, np.zeros((10, 3)), resolution=0.2)
    prior = OutOfRangePrior.from_statistics(statistics, none=0.2)
    assert (prior.below, prior.none) == pytest.approx((0.8 * 10.5 / 31.0, 0.2))
    model = EndPointModel.from_statistics(statistics)
    assert model.out_of_range == OutOfRangePrior.from_statistics(statistics)
    for wrong in ((0.0, 0.1), (0.1, 0.0), (0.5, 0.5), (math.nan, 0.1)):
        with pytest.raises(MapError, match="out of range"):
            OutOfRangePrior(*wrong)


def test_what_does_not_fit_is_refused() -> None:
    statistics = counted(Grid((0, 0), 0.5, (6, 6)), 3)
    model = EndPointModel.from_statistics(statistics)
    assert isinstance(model, SensorModel) and not model.normalized
    assert isinstance(NormalizedEndPointModel(model), SensorModel) and NormalizedEndPointModel(model).normalized
    assert NormalizedEndPointModel(model).grid == model.grid == statistics.grid
    endless = Scan.from_polar([0.0], [1.0], (0.1, math.inf))
    for each in (model, NormalizedEndPointModel(model)):
        for call, arguments in (
            (each.log_likelihood, (cloud(1, 3), HERE)),
            (each.scan_log_likelihoods, (cloud(1, 3), HERE[None])),
            (each.scan_log_likelihoods, (sweep(1, 3), HERE[None])),
            (each.log_likelihood, (sweep(1, 3), [0, 0, math.nan])),
            (each.log_likelihood, (endless, [0, 0, 0])),
            (each.scan_log_likelihoods, (endless, [[0, 0, 0]])),
        ):
            with pytest.raises(MapError):
                call(*arguments)
    for name in ("sigma", "hit", "random"):
        with pytest.raises(MapError, match=f"{name}: 0.0"):
            EndPointModel.from_statistics(statistics, **{name: 0.0})
