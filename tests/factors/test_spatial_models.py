"""Posteriors and end-point models in space: costs, gradients and Hessians against a slow reference, ray by ray."""

import math

import numpy as np
import pytest
from loose_spatial_rays import agree, draw_spatial_rays, interpolated, numerical_gradient
from naive import Ray, lengths_by_cell

from factorloc.errors import MapError
from factorloc.factors import EndPointLevels, SpatialEndPointTerm, SpatialScanTerm
from factorloc.factors.level_tables import LevelTables
from factorloc.geometry import se3
from factorloc.mapping import Grid, RayStatistics
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.distance_table import DistanceTable
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.prior import GammaPrior
from factorloc.mapping.spatial_posterior_pyramid import SpatialPosteriorLevel, SpatialPosteriorPyramid
from factorloc.rays import Rays

BLURS = (0.5, 0.25, 0.0)
STEPS = (4e-7, 1e-7)
PRIOR = GammaPrior(0.3, 0.4)
MAXIMUM = 6.0


def counts() -> RayStatistics:
    """A hall of several bricks with a wall, a floor, clutter, and a part nobody has seen."""
    grid = Grid((-1.0, 2.0, -0.5), 0.2, (21, 18, 17))
    rng = np.random.default_rng(5)
    path = rng.uniform(0, 2, grid.shape)
    hits = np.zeros(grid.shape)
    hits[:, :, 1] = hits[18, 2:12] = 9
    hits[rng.uniform(size=grid.shape) < 0.03] = 2
    path[:9, 12:] = hits[:9, 12:] = 0
    return RayStatistics(
        grid, hits.astype(np.uint32), np.zeros(grid.shape, np.uint32), np.round(path * 2**20).astype(np.int64)
    )


COUNTS = counts()
LOOSE = draw_spatial_rays(COUNTS.grid, 400, seed=3)
PYRAMID = SpatialPosteriorPyramid.from_statistics(COUNTS, BLURS, PRIOR)
MODEL = EndPointModel.from_statistics(COUNTS, 0.2, farthest=1.0)
FIELD = DistanceTable.from_statistics(COUNTS, farthest=1.0)


def make(model: str, rays: Rays, information: float = 1.0) -> SpatialScanTerm:
    if model == "posterior":
        return SpatialScanTerm(LevelTables.of(PYRAMID, [FIELD]), rays, information)
    return SpatialEndPointTerm(EndPointLevels.of(MODEL, BLURS), rays, information, MAXIMUM)


def naive_cost(model: str, level: int, ray: Ray) -> float:
    end = ray.origin + ray.length * ray.direction
    if model == "end-point":
        sigma = math.hypot(MODEL.sigma, BLURS[level])
        r = interpolated(EndPointLevels.of(MODEL, BLURS).table, end) / sigma
        normal = math.exp(-0.5 * r * r) / (math.sqrt(2 * math.pi) * sigma)
        return -math.log(MODEL.hit * normal + MODEL.random / MAXIMUM)
    if level == 0:
        r = interpolated(FIELD.distances, end) / FIELD.sigma
        return 0.5 * r * r if r <= FIELD.huber else FIELD.huber * (r - 0.5 * FIELD.huber)
    tables: SpatialPosteriorLevel = PYRAMID.levels[level - 1]
    passing = 0.0
    for cell, length in lengths_by_cell(ray, tables.shapes.layout.grid).items():
        a, b = (PRIOR.shape, PRIOR.path) if cell is None else (tables.shapes.at(cell), tables.paths.at(cell))
        passing += float(a * np.log1p(length / b))
    return passing - interpolated(tables.log_rates, end)


CASES = [("posterior", k) for k in range(4)] + [("end-point", k) for k in range(3)]
cases = pytest.mark.parametrize(("model", "level"), CASES)


@pytest.fixture(scope="module")
def situations() -> dict[str, np.ndarray]:
    grid, rays = COUNTS.grid, LOOSE.in_map()
    starts = grid.contains([ray.origin for ray in rays])
    ends = grid.contains([ray.origin + ray.length * ray.direction for ray in rays])
    return {"within": starts & ends, "leaving": starts & ~ends, "entering": ~starts & ends, "beyond": ~starts & ~ends}


@cases
def test_costs_are_those_of_the_definition(situations, model, level) -> None:
    assert min(keep.sum() for keep in situations.values()) >= 30, "every situation is tried"
    term = make(model, LOOSE.rays)
    expected = np.array([naive_cost(model, level, ray) for ray in LOOSE.in_map()])
    assert term.cost(LOOSE.poses, level) == pytest.approx(expected, rel=2e-6, abs=2e-6)
    assert term.batch(LOOSE.poses, level).cost == pytest.approx(term.cost(LOOSE.poses, level), rel=1e-12, abs=1e-12)
    assert (expected >= term.least_cost(level) - 1e-9).all()


@cases
def test_gradients_are_those_of_the_cost(situations, model, level) -> None:
    term = make(model, LOOSE.rays)
    wide, narrow = (numerical_gradient(lambda p: term.cost(p, level), LOOSE.poses, step) for step in STEPS)
    smooth = agree(wide, narrow, 1e-5)  # elsewhere a kink lies between
    right = agree(term.batch(LOOSE.poses, level).gradient, narrow, 1e-4)
    assert smooth.mean() > 0.97
    for name, keep in situations.items():
        assert right[keep & smooth].all(), name
    moving = np.abs(narrow).max(1) > 1e-3
    assert moving[situations["within"]].mean() > 0.3, "there is something to compare"


@cases
def test_hessians_are_weighted_outer_products_of_the_gradients_of_rays(model, level) -> None:
    term = make(model, LOOSE.rays)
    costs = term.batch(LOOSE.poses, level)
    posterior = model == "posterior" and level > 0
    if posterior:
        weights = 0.5 / np.maximum(costs.cost - PYRAMID.levels[level - 1].least_nll, 0.05)
        expected = weights[:, None, None] * costs.gradient[:, :, None] * costs.gradient[:, None, :]
        assert agree(costs.hessian, expected, 1e-6).all()
    # One row a ray, and no more than the square root of the cost above its bound allows (adaptors.square_root_form).
    assert (costs.hessian == costs.hessian.swapaxes(1, 2)).all()
    values = np.linalg.eigvalsh(costs.hessian)
    assert (values[:, :-1] <= 1e-9 * (1 + values[:, -1:])).all()
    assert (values[:, -1] > 0).mean() > 0.1
    square = np.einsum("ni,nij,nj->n", costs.gradient, np.linalg.pinv(costs.hessian, 1e-9), costs.gradient)
    assert (square <= 2 * (costs.cost - term.least_cost(level)) + 1e-6).all()


@cases
def test_a_scan_is_the_sum_of_its_rays(model, level) -> None:
    pose = se3.exp(np.array([0.3, -0.2, 2.0, 1.0, 3.0, 1.0]))
    rays = LOOSE.bundled(pose)
    together = make(model, rays, 0.3).batch(pose[None], level)
    single = Rays(rays.origins, rays.directions, rays.ranges, rays.status, np.arange(len(LOOSE) + 1))
    each = make(model, single, 0.3).batch(np.tile(pose, (len(LOOSE), 1, 1)), level)
    assert each.cost == pytest.approx(0.3 * make(model, LOOSE.rays).cost(LOOSE.poses, level), rel=1e-9, abs=1e-9)
    assert together.cost[0] == pytest.approx(each.cost.sum(), rel=1e-10)
    assert together.gradient[0] == pytest.approx(each.gradient.sum(0), rel=1e-7, abs=1e-7)
    assert (np.abs(together.hessian[0] - each.hessian.sum(0)) <= 1e-9 * np.abs(each.hessian).sum(0)).all()
    assert np.linalg.eigvalsh(together.hessian[0]).min() > 0


def test_levels_hold_the_posteriors_of_blurred_counts() -> None:
    assert PYRAMID.blurs == BLURS
    fine = PYRAMID.levels[-1]
    cells = np.moveaxis(np.indices(COUNTS.grid.shape), 0, -1)
    assert fine.shapes.at(cells) == pytest.approx(COUNTS.hits + PRIOR.shape, rel=1e-6)
    assert fine.paths.at(cells) == pytest.approx(COUNTS.path_lengths + PRIOR.path, rel=1e-6)
    for level in PYRAMID.levels:
        assert (level.shapes.layout.bricks == level.paths.layout.bricks).all()
        assert (level.shapes.outside, level.paths.outside) == pytest.approx((PRIOR.shape, PRIOR.path))
        assert level.log_rates.pool == pytest.approx(
            np.log(level.shapes.pool / (level.paths.pool + 0.5 * level.shapes.layout.grid.resolution)), abs=1e-6
        )
        assert level.least_nll == pytest.approx(-level.log_rates.pool.max() - 0.5)
    # A level of cells twice the size holds the hits of eight.
    coarse = PYRAMID.levels[0].shapes
    assert coarse.layout.grid.resolution == pytest.approx(0.4)
    every = np.moveaxis(np.indices(coarse.layout.grid.shape), 0, -1)
    kept = (coarse.at(every) - PRIOR.shape).sum()
    assert 0.5 * COUNTS.hits.sum() < kept < COUNTS.hits.sum() * 1.001, "but for what leaves the grid, as off its floor"


def test_sparse_and_dense_counts_make_one_pyramid() -> None:
    sparse = SpatialPosteriorPyramid.from_statistics(BrickStatistics.from_dense(COUNTS), BLURS, PRIOR)
    for one, two in zip(sparse.levels, PYRAMID.levels, strict=True):
        assert (one.shapes.pool == two.shapes.pool).all()
        assert (one.paths.pool == two.paths.pool).all()


def test_hits_without_path_and_path_without_hits_lie_in_the_same_bricks() -> None:
    grid = Grid((0.0, 0.0, 0.0), 0.2, (40, 20, 20))
    hits, path = np.zeros(grid.shape, np.uint32), np.zeros(grid.shape, np.int64)
    hits[2, 2, 2] = 5
    path[35, 10, 10] = 2**21
    alone = RayStatistics(grid, hits, np.zeros_like(hits), path)
    pyramid = SpatialPosteriorPyramid.from_statistics(alone, (0.4, 0.2, 0.0), PRIOR)
    for level in pyramid.levels:
        size = level.shapes.layout.grid.resolution / 0.2
        here, there = ([int(k / size) for k in cell] for cell in ([2, 2, 2], [35, 10, 10]))
        assert level.shapes.at(here) > PRIOR.shape + 0.01
        assert level.paths.at(here) == pytest.approx(PRIOR.path)
        assert level.paths.at(there) > PRIOR.path + 0.005
        assert level.shapes.at(there) == pytest.approx(PRIOR.shape)


def test_what_makes_no_pyramid_is_refused() -> None:
    with pytest.raises(MapError, match="planar"):
        SpatialPosteriorPyramid.from_statistics(RayStatistics.empty(Grid((0, 0), 0.5, (4, 4))))
    with pytest.raises(MapError, match="decreasing"):
        SpatialPosteriorPyramid.from_statistics(COUNTS, (0.1, 0.5))
