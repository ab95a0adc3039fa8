"""Costs, gradients and Hessians of spatial scan terms equal those of a slow reference, ray by ray."""

import numpy as np
import pytest
from loose_spatial_rays import agree, draw_spatial_rays, naive_cost, numerical_gradient, weight

from factorloc import _jit
from factorloc.errors import GeometryError, MapError
from factorloc.factors.level_tables import LevelTables
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import se3
from factorloc.mapping import Grid, RayStatistics
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.distance_table import DistanceTable
from factorloc.mapping.spatial_pyramid import SpatialLevel, SpatialPyramid
from factorloc.rays import Rays
from factorloc.scan import RayStatus, Scan

BLURS = (0.5, 0.25, 0.0)
STEPS = (4e-7, 1e-7)


def counts() -> RayStatistics:
    """A hall of several bricks, mostly empty, with a wall, a floor and clutter."""
    grid = Grid((-1.0, 2.0, -0.5), 0.2, (21, 18, 17))
    rng = np.random.default_rng(5)
    path = rng.uniform(0, 2, grid.shape)
    hits = np.zeros(grid.shape)
    hits[:, :, 1] = hits[18, 2:12] = 9
    hits[rng.uniform(size=grid.shape) < 0.03] = 2
    path[:9, 12:] = 0
    hits[:9, 12:] = 0
    return RayStatistics(
        grid, hits.astype(np.uint32), np.zeros(grid.shape, np.uint32), np.round(path * 2**20).astype(np.int64)
    )


COUNTS = counts()
PYRAMID = SpatialPyramid.from_statistics(COUNTS, BLURS)
FIELD = DistanceTable.from_statistics(COUNTS, farthest=1.0)
LEVELS = [FIELD, *PYRAMID.levels]
TABLES = LevelTables.of(PYRAMID, [FIELD])
LOOSE = draw_spatial_rays(COUNTS.grid, 400, seed=3)
TERM = SpatialScanTerm(TABLES, LOOSE.rays)

levels = pytest.mark.parametrize("level", range(len(LEVELS)), ids=["field", "0.5", "0.25", "0"])


def smooth_at(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Numerical gradients, and where two step lengths agree on them: elsewhere a kink lies between."""
    wide, narrow = (numerical_gradient(lambda p: TERM.cost(p, level), LOOSE.poses, step) for step in STEPS)
    return narrow, agree(wide, narrow, 1e-5)


@pytest.fixture(scope="module")
def situations() -> dict[str, np.ndarray]:
    """Where rays begin and end, inside the grid or not."""
    grid, rays = COUNTS.grid, LOOSE.in_map()
    starts = grid.contains([ray.origin for ray in rays])
    ends = grid.contains([ray.origin + ray.length * ray.direction for ray in rays])
    return {"within": starts & ends, "leaving": starts & ~ends, "entering": ~starts & ends, "beyond": ~starts & ~ends}


@levels
def test_costs_are_those_of_the_definition(situations, level) -> None:
    assert min(keep.sum() for keep in situations.values()) >= 30, "every situation is tried"
    expected = np.array([naive_cost(LEVELS[level], ray) for ray in LOOSE.in_map()])
    assert TERM.cost(LOOSE.poses, level) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    batch = TERM.batch(LOOSE.poses, level)
    assert batch.cost == pytest.approx(TERM.cost(LOOSE.poses, level), rel=1e-12, abs=1e-12)
    assert (expected >= TERM.least_cost(level)).all()


@levels
def test_gradients_are_those_of_the_cost(situations, level) -> None:
    numerical, smooth = smooth_at(level)
    gradient = TERM.batch(LOOSE.poses, level).gradient
    right = agree(gradient, numerical, 1e-4)
    assert smooth.mean() > 0.97
    for name, keep in situations.items():
        assert right[keep & smooth].all(), name
    moving = np.abs(numerical).max(1) > 1e-3
    assert moving[situations["within"]].mean() > 0.3, "there is something to compare"


@levels
def test_hessians_are_weighted_outer_products_of_the_gradients_of_rays(level) -> None:
    costs = TERM.batch(LOOSE.poses, level)
    expected = [
        weight(LEVELS[level], cost) * np.outer(g, g) if np.abs(g).max() > 0 else np.zeros((6, 6))
        for cost, g in zip(costs.cost, costs.gradient, strict=True)
    ]
    assert agree(costs.hessian, np.array(expected), 1e-6).all()
    assert (costs.hessian == costs.hessian.swapaxes(1, 2)).all()
    assert (np.linalg.eigvalsh(costs.hessian)[:, -1] > 0).mean() > 0.2


@levels
@pytest.mark.parametrize("information", [1.0, 0.2])
def test_a_scan_is_the_sum_of_its_rays(level, information) -> None:
    pose = se3.exp(np.array([0.3, -0.2, 2.0, 1.0, 3.0, 1.0]))
    # All of them held by one body: their own poses are offsets from it.
    rays = LOOSE.bundled(pose)
    together = SpatialScanTerm(TABLES, rays, information).batch(pose[None], level)
    single = Rays(rays.origins, rays.directions, rays.ranges, rays.status, np.arange(len(LOOSE) + 1))
    term = SpatialScanTerm(TABLES, single, information)
    each = term.batch(np.tile(pose, (len(LOOSE), 1, 1)), level)
    assert each.cost == pytest.approx(information * TERM.cost(LOOSE.poses, level), rel=1e-9, abs=1e-9)
    assert together.cost[0] == pytest.approx(each.cost.sum(), rel=1e-10)
    assert together.gradient[0] == pytest.approx(each.gradient.sum(0), rel=1e-7, abs=1e-7)
    scale = np.abs(each.hessian).sum(0)
    assert (np.abs(together.hessian[0] - each.hessian.sum(0)) <= 1e-9 * scale).all()
    assert np.linalg.eigvalsh(together.hessian[0]).min() > 0
    assert term.least_cost(level) == pytest.approx(np.full(len(LOOSE), information * TABLES.least_costs[level]))
    whole = information * len(LOOSE) * TABLES.least_costs[level]
    assert SpatialScanTerm(TABLES, rays, information).least_cost(level) == pytest.approx([whole])


@levels
def test_the_information_scales_gradient_and_hessian(level) -> None:
    full, part = TERM.batch(LOOSE.poses, level), SpatialScanTerm(TABLES, LOOSE.rays, 0.3).batch(LOOSE.poses, level)
    assert part.gradient == pytest.approx(0.3 * full.gradient, rel=1e-12, abs=1e-12)
    assert part.hessian == pytest.approx(0.3 * full.hessian, rel=1e-12, abs=1e-12)


@levels
def test_a_mounted_sensor_sends_its_rays_from_where_it_is(level) -> None:
    mount, pose = (
        se3.exp(np.array([0.1, -0.4, 1.2, 0.3, -0.2, 0.9])),
        se3.exp(np.array([0.1, 0.2, -2.0, 1.0, 3.5, 0.4])),
    )
    rng = np.random.default_rng(8)
    directions = rng.standard_normal((60, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = rng.uniform(-0.1, 0.1, (60, 3))
    status = rng.choice([RayStatus.RETURN, RayStatus.RETURN, RayStatus.NO_RETURN, RayStatus.BELOW_MINIMUM], 60)
    ranges = rng.uniform(0.5, 3, 60)
    scan = Scan(directions, ranges, status, (0.4, 5.0), origins=origins, T_body_sensor=mount)
    term = SpatialScanTerm(TABLES, [scan, scan])
    assert term.scans == 2
    T = pose @ mount
    returns = [
        naive_cost(LEVELS[level], naive_ray)
        for naive_ray in (
            type(LOOSE.in_map()[0])((T @ [*a, 1])[:3], T[:3, :3] @ b, float(r), 0)
            for a, b, r, s in zip(origins, directions, ranges, status, strict=True)
            if s == RayStatus.RETURN
        )
    ]
    assert term.cost(np.stack([pose, pose]), level) == pytest.approx(np.full(2, sum(returns)), rel=1e-6)


def test_threads_change_nothing() -> None:
    rng = np.random.default_rng(2)
    poses = np.tile(LOOSE.poses, (8, 1, 1))
    index = rng.integers(0, len(LOOSE), len(poses))
    most = _jit.set_threads(None)
    try:
        _jit.set_threads(2)
        several = TERM.batch(poses, -1, index)
        _jit.set_threads(1)
        alone = TERM.batch(poses, -1, index)
    finally:
        assert _jit.set_threads(None) == most
    for name in ("cost", "gradient", "hessian"):
        assert np.array_equal(getattr(several, name), getattr(alone, name))
    # Each pose is of the scan it is said to be.
    few = SpatialScanTerm(TABLES, LOOSE.rays.select(np.arange(len(LOOSE)) == index[7]))
    own = few.cost(poses[7:8], -1, [index[7]])
    assert own == several.cost[7:8]


# ---- tables whose costs have closed forms ----

GRID = Grid((-1.0, 2.0, 0.0), 0.1, (40, 30, 20))


def tabled(rates: np.ndarray, log_rates: np.ndarray, rays: Rays) -> SpatialScanTerm:
    tables = [CellTable.from_dense(GRID, values, -100.0) for values in (rates, log_rates)]
    level = SpatialLevel(0.0, *tables, -10.0)
    return SpatialScanTerm(LevelTables.of(SpatialPyramid(GRID, (level,))), rays)


def one_ray(origin, direction, length: float) -> Rays:
    return Rays(np.array([origin]), np.array([direction]), np.array([length]), np.zeros(1, np.uint8), np.array([0, 1]))


def centres() -> list[np.ndarray]:
    axes = [GRID.origin[a] + (np.arange(GRID.shape[a]) + 0.5) * GRID.resolution for a in range(3)]
    return list(np.meshgrid(*axes, indexing="ij"))


@pytest.mark.parametrize("turn", [[0, 0, 0], [0.1, -0.3, 0.4], [-0.2, 0.1, -2.8]])
@pytest.mark.parametrize("direction", [[1.0, 0, 0], [0.6, 0.0, 0.8], [2 / 3, -1 / 3, 2 / 3], [0, -1.0, 0]])
def test_a_slope_of_log_rates_pulls_the_end_of_a_ray(turn, direction) -> None:
    slope = np.array([3.0, -2.0, 1.5])
    x, y, z = centres()
    rate, lever, length = 0.5, np.array([0.3, -0.2, 0.1]), 0.6
    log_rates = 1.0 + slope[0] * x + slope[1] * y + slope[2] * z
    term = tabled(np.full(x.shape, rate), log_rates, one_ray(lever, direction, length))
    pose = se3.exp(np.array([*turn, 0.0, 0.0, 0.0]))
    pose[:3, 3] = [0.9, 3.4, 0.95]
    costs = term.batch(pose[None])
    end = lever + length * np.array(direction)
    assert costs.cost[0] == pytest.approx(rate * length - (1.0 + slope @ se3.transform(pose, end)), abs=1e-5)
    pull = pose[:3, :3].T @ -slope
    expected = np.array([*np.cross(end, pull), *pull])
    assert costs.gradient[0] == pytest.approx(expected, abs=1e-4)
    residual = costs.cost[0] + 10.0
    assert costs.hessian[0] == pytest.approx(np.outer(expected, expected) / (2 * residual), abs=1e-4)


@pytest.mark.parametrize("ahead", [True, False])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.3, -0.2), (1.4, 0.9), (0.5, 1.6)])
def test_a_step_between_two_rates_pushes_where_it_is_crossed(ahead, axis, lean) -> None:
    plane = GRID.origin[axis] + 10 * GRID.resolution
    rates = np.where(centres()[axis] < plane, 0.4, 2.5)
    before, after = (0.4, 2.5) if ahead else (2.5, 0.4)
    sign = 1.0 if ahead else -1.0
    direction = np.roll([sign, *lean], axis)
    direction /= np.linalg.norm(direction)
    # The ray starts 0.35 m before the plane, and ends as far behind it.
    lever, pose = np.array([0.15, 0.1, -0.05]), np.eye(4)
    pose[:3, 3] = [0.6, 3.2, 0.85]
    pose[axis, 3] = plane - sign * 0.35 - lever[axis]
    reach = 0.35 / abs(direction[axis])
    costs = tabled(rates, np.zeros(rates.shape), one_ray(lever, direction, 2 * reach)).batch(pose[None])
    assert costs.cost[0] == pytest.approx((before + after) * reach, abs=1e-6)
    # Moved by dx along the axis, the origin meets the plane dx / direction earlier; a turn moves the crossing.
    push = np.eye(3)[axis] * (after - before) / direction[axis]
    crossing = lever + reach * direction
    assert costs.gradient[0] == pytest.approx([*np.cross(crossing, push), *push], abs=1e-5)


def test_a_ray_beyond_the_grid_sees_the_rate_outside_alone() -> None:
    costs = SpatialScanTerm(TABLES, one_ray([0.2, 0.0, 0.0], [0.0, 0.6, 0.8], 1.5)).batch(
        np.eye(4)[None] + np.array([[0, 0, 0, 50.0]] * 3 + [[0] * 4])
    )
    outside = PYRAMID.levels[-1].rates.outside
    assert costs.cost[0] == pytest.approx(outside * 1.5 - np.log(outside), abs=1e-6)
    assert (costs.gradient == 0).all()
    assert (costs.hessian == 0).all()


def test_a_return_at_the_sensor_itself_counts_by_its_cell_alone() -> None:
    x, y, _ = centres()
    term = tabled(np.full(x.shape, 5.0), 2.0 * x - y, one_ray([0.1, 0.0, 0.0], [1.0, 0.0, 0.0], 0.0))
    pose = np.eye(4)
    pose[:3, 3] = [0.5, 3.0, 1.0]
    costs = term.batch(pose[None])
    assert costs.cost[0] == pytest.approx(-(2.0 * 0.6 - 3.0), abs=1e-5)
    assert costs.gradient[0, 3:] == pytest.approx([-2.0, 1.0, 0.0], abs=1e-4)


# ---- tables and arguments ----


def test_levels_stand_in_their_order() -> None:
    assert TERM.blurs == TABLES.blurs == (1.0, *BLURS)
    assert (TERM.grid, TERM.scans) == (COUNTS.grid, len(LOOSE))
    assert pytest.approx(COUNTS.grid.origin) == TABLES.low
    assert TABLES.least_costs == pytest.approx([0.0, *(level.least_nll for level in PYRAMID.levels)])
    assert TABLES.nbytes == TABLES.directory.nbytes + TABLES.primary.nbytes + TABLES.secondary.nbytes
    alone = SpatialScanTerm(LevelTables.of(PYRAMID), LOOSE.rays)
    for level in range(3):
        assert np.array_equal(alone.cost(LOOSE.poses, level), TERM.cost(LOOSE.poses, level + 1))


def test_a_field_of_another_map_is_refused() -> None:
    moved = Grid((0.0, 2.0, -0.5), 0.2, COUNTS.grid.shape)
    other = RayStatistics(moved, COUNTS.hits, COUNTS.misses, COUNTS.path_fixed)
    with pytest.raises(MapError, match="its lowest corner is not that of the map"):
        LevelTables.of(PYRAMID, [DistanceTable.from_statistics(other)])


def test_what_does_not_fit_is_refused() -> None:
    planar = Scan(np.array([[1.0, 0.0]]), np.array([2.0]), np.zeros(1, np.uint8), (0.1, 9.0))
    with pytest.raises(MapError, match="planar"):
        SpatialScanTerm(TABLES, [planar])
    with pytest.raises(GeometryError, match="none given"):
        SpatialScanTerm(TABLES, [])
    n = len(LOOSE)
    for poses, index, line in [
        (np.eye(4), None, "expected finite 4 x 4"),
        (np.zeros((n, 3)), None, "expected finite 4 x 4"),
        (np.full((n, 4, 4), np.nan), None, "expected finite 4 x 4"),
        (LOOSE.poses[:3], None, "give one each, or scan_of_pose"),
        (LOOSE.poses[:3], [0, 1], "indices below"),
        (LOOSE.poses[:3], [0, 1, n], "indices below"),
        (LOOSE.poses[:3], [0, 1, -1], "indices below"),
    ]:
        for function in (TERM.batch, TERM.cost):
            with pytest.raises(GeometryError, match=line):
                function(poses, -1, index)
