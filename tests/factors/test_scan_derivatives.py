"""Costs, gradients and Hessians of scan terms equal those of a slow reference, ray by ray."""

import numpy as np
import pytest
from loose_rays import BLURS, MODELS, LooseRays, naive_cost, weight

from factorloc.factors import DecayRateTerm
from factorloc.factors._scan_kernels import DISTANCE_FIELD
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.geometry import se2
from factorloc.mapping import BlurPyramid, Grid
from factorloc.mapping.pyramid import PyramidLevel
from factorloc.rays import Rays

STEPS = (4e-7, 1e-7)

levels = pytest.mark.parametrize("level", range(len(BLURS)))
models = pytest.mark.parametrize("model", MODELS)


def numerical_gradient(cost, poses: np.ndarray, step: float) -> np.ndarray:
    """Central differences of costs (N,) by the tangent vectors of poses (N, 3)."""
    columns = []
    for axis in np.eye(3):
        ahead, behind = (cost(se2.compose(poses, se2.exp(sign * step * axis))) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, -1)


def agree(a: np.ndarray, b: np.ndarray, tolerance: float) -> np.ndarray:
    """Which rows (N, ...) are equal, relative to their length."""
    a, b = a.reshape(len(a), -1), b.reshape(len(b), -1)
    return np.linalg.norm(a - b, axis=1) < tolerance * (1 + np.linalg.norm(b, axis=1))


def smooth_at(term: GridScanTerm, level: int, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Numerical gradients, and where two step lengths agree on them: elsewhere a kink lies between."""
    wide, narrow = (numerical_gradient(lambda p: term.cost(p, level), poses, step) for step in STEPS)
    return narrow, agree(wide, narrow, 1e-5)


@pytest.fixture(scope="module")
def situations(loose: LooseRays, statistics) -> dict[str, np.ndarray]:
    """Where rays begin and end, inside the grid or not."""
    grid = statistics.grid
    starts = grid.contains([ray.origin for ray in loose.in_map()])
    ends = grid.contains([ray.origin + ray.length * ray.direction for ray in loose.in_map()])
    return {"within": starts & ends, "leaving": starts & ~ends, "entering": ~starts & ends, "beyond": ~starts & ~ends}


@models
@levels
def test_costs_are_those_of_the_definition(make_term, loose, situations, model, level) -> None:
    assert min(keep.sum() for keep in situations.values()) >= 60, "every situation is tried"
    term = make_term(model, loose.rays)
    expected = [naive_cost(term, level, ray) for ray in loose.in_map()]
    assert term.cost(loose.poses, level) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-9)
    assert (np.array(expected) >= term.least_cost(level) - 1e-12).all()


@models
@levels
def test_gradients_are_those_of_the_cost(make_term, loose, situations, model, level) -> None:
    term = make_term(model, loose.rays)
    numerical, smooth = smooth_at(term, level, loose.poses)
    gradient = term.batch(loose.poses, level).gradient
    right = agree(gradient, numerical, 1e-4)
    assert smooth.mean() > 0.97
    for name, keep in situations.items():
        assert right[keep & smooth].all(), name
    moving = np.abs(numerical).max(1) > 1e-3
    assert moving[situations["within"]].mean() > 0.3, "there is something to compare"


@models
@levels
def test_hessians_are_weighted_outer_products_of_the_gradients_of_rays(make_term, loose, model, level) -> None:
    alone = make_term(model, loose.rays)
    _, smooth = smooth_at(alone, level, loose.poses)
    kept = loose.select(smooth)
    term = make_term(model, kept.rays, information=0.3)
    numerical, _ = smooth_at(make_term(model, kept.rays), level, kept.poses)
    costs = [naive_cost(term, level, ray) for ray in kept.in_map()]
    # A ray that touches what it should has no weight of its own where its gradient vanishes.
    expected = [
        0.3 * weight(term, level, cost) * np.outer(g, g) if cost != 0 else np.zeros((3, 3))
        for cost, g in zip(costs, numerical, strict=True)
    ]
    hessian = term.batch(kept.poses, level).hessian
    assert agree(hessian, np.array(expected), 1e-3).all()
    assert (hessian == hessian.swapaxes(1, 2)).all()


@models
@levels
def test_a_scan_is_the_sum_of_its_rays(make_term, loose, statistics, model, level) -> None:
    pose = np.array([*np.mean([statistics.grid.origin, statistics.grid.upper], 0), 0.8])
    # All of them held by one body: their own poses are offsets from it.
    together = make_term(model, loose.bundled(pose), information=0.2).batch(pose[None], level)
    single = LooseRays(Rays(*_parts(loose.bundled(pose))), np.tile(pose, (len(loose), 1)))
    each = make_term(model, single.rays, information=0.2).batch(single.poses, level)
    assert together.cost[0] == pytest.approx(each.cost.sum(), rel=1e-10)
    assert together.gradient[0] == pytest.approx(each.gradient.sum(0), rel=1e-7, abs=1e-7)
    scale = np.abs(each.hessian).sum(0)
    assert (np.abs(together.hessian[0] - each.hessian.sum(0)) <= 1e-9 * scale).all()
    assert np.linalg.eigvalsh(together.hessian[0]).min() > 0
    moved = make_term(model, loose.rays).cost(loose.poses, level)
    assert each.cost == pytest.approx(0.2 * moved, rel=1e-9, abs=1e-9)


def _parts(rays: Rays):
    return rays.origins, rays.directions, rays.ranges, rays.status, np.arange(len(rays.ranges) + 1)


# ---- tables whose costs have closed forms ----

GRID = Grid((-1.0, 2.0), 0.1, (40, 30))
OUTSIDE = 0.7


def one_ray(origin, angle: float, length: float) -> Rays:
    direction = [[np.cos(angle), np.sin(angle)]]
    return Rays(np.array([origin]), np.array(direction), np.array([length]), np.zeros(1, np.uint8), np.array([0, 1]))


def tabled(rates: np.ndarray, log_rates: np.ndarray, rays: Rays):
    level = PyramidLevel(0.0, rates.ravel(), log_rates.ravel(), OUTSIDE, -10.0)
    return DecayRateTerm(BlurPyramid(GRID, (level,)), rays)


def rimmed_centres() -> tuple[np.ndarray, np.ndarray]:
    x, y = (GRID.origin[a] + (np.arange(GRID.shape[a] + 2) - 0.5) * GRID.resolution for a in (0, 1))
    return np.meshgrid(x, y, indexing="ij")


@pytest.mark.parametrize("theta", [0.0, 0.4, -2.8])
@pytest.mark.parametrize("angle", [0.05, 0.7, 1.5, 2.9, -0.3, -1.6])
def test_a_slope_of_log_rates_pulls_the_end_of_a_ray(theta, angle) -> None:
    slope = np.array([3.0, -2.0])
    x, y = rimmed_centres()
    rate, lever, length = 0.5, np.array([0.3, -0.2]), 0.9
    term = tabled(np.full(x.shape, rate), 1.0 + slope[0] * x + slope[1] * y, one_ray(lever, angle, length))
    pose = np.array([0.9, 3.4, theta])
    costs = term.batch(pose[None])
    end = lever + length * np.array([np.cos(angle), np.sin(angle)])
    assert costs.cost[0] == pytest.approx(rate * length - (1.0 + slope @ se2.transform(pose, end)), abs=1e-12)
    pull = se2.rotate(-theta, -slope)
    expected = np.array([*pull, end[0] * pull[1] - end[1] * pull[0]])
    assert costs.gradient[0] == pytest.approx(expected, abs=1e-12)
    residual = costs.cost[0] + 10.0
    assert costs.hessian[0] == pytest.approx(np.outer(expected, expected) / (2 * residual), abs=1e-12)


@pytest.mark.parametrize("ahead", [True, False])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("lean", [-0.5, 0.0, 0.2, 0.9])
def test_a_step_between_two_rates_pushes_where_it_is_crossed(ahead, axis, lean) -> None:
    line = GRID.origin[axis] + 10 * GRID.resolution
    rates = np.where(rimmed_centres()[axis] < line, 0.4, 2.5)
    before, after = (0.4, 2.5) if ahead else (2.5, 0.4)
    angle = lean + (np.pi / 2 if axis else 0.0) + (0.0 if ahead else np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    # The ray starts 0.35 m before the line, and ends as far behind it.
    lever, pose = np.array([0.15, 0.1]), np.array([0.3, 2.8, 0.0])
    pose[axis] = line - (0.35 if ahead else -0.35) - lever[axis]
    reach = 0.35 / np.cos(lean)
    costs = tabled(rates, np.zeros(rates.shape), one_ray(lever, angle, 2 * reach)).batch(pose[None])
    assert costs.cost[0] == pytest.approx(before * reach + after * reach, abs=1e-12)
    # Moved by dx along the axis, the origin meets the line dx / direction earlier; a turn moves origin and crossing.
    per_metre = (after - before) / direction[axis]
    crossing = lever + reach * direction
    gradient = np.array([0.0, 0.0, per_metre * (crossing[0] if axis else -crossing[1])])
    gradient[axis] = per_metre
    assert costs.gradient[0] == pytest.approx(gradient, abs=1e-10)


def test_a_ray_beyond_the_grid_sees_the_rate_outside_alone() -> None:
    x, _ = rimmed_centres()
    rates = np.full(x.shape, 3.0)
    rates[[0, -1]] = OUTSIDE
    rates[:, [0, -1]] = OUTSIDE
    term = tabled(rates, np.log(rates), one_ray([0.2, 0.0], 2.0, 1.5))
    costs = term.batch([[20.0, 20.0, 1.0]])
    assert costs.cost[0] == pytest.approx(OUTSIDE * 1.5 - np.log(OUTSIDE), abs=1e-12)
    assert (costs.gradient == 0).all()
    assert (costs.hessian == 0).all()


def test_a_ray_through_the_grid_and_out_again_is_pushed_by_nothing_but_its_chord() -> None:
    x, _ = rimmed_centres()
    rates = np.full(x.shape, 3.0)
    rates[[0, -1]] = OUTSIDE
    rates[:, [0, -1]] = OUTSIDE
    # Corner to corner, it cuts a triangle of legs 1.5 m: the chord is as long as its distance from the corner says.
    start = np.array([GRID.origin[0] - 0.5, GRID.origin[1] + 2.0])
    term = tabled(rates, np.log(rates), one_ray([0.0, 0.0], -np.pi / 4, 5.0))
    costs = term.batch([[*start, 0.0]])
    chord = 1.5 * np.sqrt(2)
    assert costs.cost[0] == pytest.approx((3.0 - OUTSIDE) * chord + OUTSIDE * 5 - np.log(OUTSIDE), abs=1e-9)
    # Moved by (a, b) the legs grow by a + b.
    assert costs.gradient[0, :2] == pytest.approx(np.full(2, (3.0 - OUTSIDE) * np.sqrt(2)), abs=1e-9)


@pytest.mark.parametrize(("distance", "robust"), [(0.06, False), (0.8, True)])
def test_a_plane_of_distances_pulls_with_its_slope_and_no_harder_than_huber_lets_it(distance, robust) -> None:
    x, _ = rimmed_centres()
    sigma, huber = 0.05, 2.0
    lever, length, pose = np.array([0.1, 0.2]), 0.6, np.array([0.5, 3.0, 0.5])
    end = lever + length * np.array([np.cos(0.3), np.sin(0.3)])
    wall = se2.transform(pose, end)[0] - distance
    rays = one_ray(lever, 0.3, length)
    table = (x - wall).ravel()[None]
    term = GridScanTerm(DISTANCE_FIELD, GRID, [0.0], table, table, np.array([[9.0, sigma, huber]]), rays, 1.0)
    costs = term.batch(pose[None])
    r = distance / sigma
    assert (r > huber) == robust
    assert costs.cost[0] == pytest.approx(huber * (r - huber / 2) if robust else r**2 / 2)
    pull = se2.rotate(-pose[2], [1 / sigma, 0.0])
    J = np.array([*pull, end[0] * pull[1] - end[1] * pull[0]])
    slope = min(r, huber)
    assert costs.gradient[0] == pytest.approx(slope * J, abs=1e-9)
    assert costs.hessian[0] == pytest.approx(slope / r * np.outer(J, J), abs=1e-8)


def test_a_return_at_the_sensor_itself_counts_by_its_cell_alone() -> None:
    x, y = rimmed_centres()
    term = tabled(np.full(x.shape, 5.0), 2.0 * x - y, one_ray([0.1, 0.0], 0.0, 0.0))
    costs = term.batch([[0.5, 3.0, 0.0]])
    assert costs.cost[0] == pytest.approx(-(2.0 * 0.6 - 3.0))
    assert costs.gradient[0] == pytest.approx([-2.0, 1.0, 0.1])
