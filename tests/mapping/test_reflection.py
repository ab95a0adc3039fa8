"""Reflection maps: equal to naive ones, true probabilities, the visits of the statistics, averages of their belief."""

import math

import naive
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS, exact_grids, exact_rays, grids, rays_near, scan_of, sweep
from scipy.special import expit
from scipy.stats import beta
from spatial_cases import packed_spatial, spatial_grids, spatial_rays
from strategies import angles, floats, poses_2d

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, Grid, RayStatistics, beam_model
from factorloc.mapping.beta_prior import BetaPrior
from factorloc.mapping.reflection import ReflectionMap, ReflectionPosterior
from factorloc.scan import RayStatus, Scan

LIMITS = (0.25, 12.0)
PRIOR = BetaPrior(0.4, 1.7)
PRIORS = st.tuples(floats(0.02, 3), floats(0.05, 9)).map(lambda numbers: BetaPrior(*numbers))
ORIGIN = (0, 0, 0)
MODELS = (ReflectionMap, ReflectionPosterior)


def visited(grid: Grid, hits: np.ndarray, misses: np.ndarray) -> RayStatistics:
    """Statistics of given hits and misses, in which every visit left half an edge of path."""
    H, M = (np.broadcast_to(counts, grid.shape).astype(np.uint32) for counts in (hits, misses))
    path = (H.astype(np.int64) + M) * int(grid.resolution * 2**19)
    return RayStatistics(grid, H, M, path)


def drawn(grid: Grid, seed: int) -> RayStatistics:
    """Statistics of seen and unseen cells, never hit or always."""
    rng = np.random.default_rng(seed)
    return visited(grid, rng.choice([0, 0, 1, 2, 40], grid.shape), rng.choice([0, 0, 1, 3, 90], grid.shape))


def spatial_scan(rays: list[Ray], limits: tuple[float, float] = LIMITS) -> Scan:
    block = packed_spatial(rays)
    return Scan(block.directions, block.ranges, block.status, limits, origins=block.origins)


def assert_naive(counts: RayStatistics, prior: BetaPrior, rays: list[Ray]) -> None:
    rays = [ray._replace(length=min(ray.length, LIMITS[1])) for ray in rays]
    for kind in MODELS:
        model = kind(counts, prior)
        found = model.log_likelihood(scan_of(rays, LIMITS), ORIGIN)
        for k, ray in enumerate(rays):
            expected = naive.reflection_log_likelihood(ray, LIMITS, counts.grid, model.probabilities, prior.mean)
            assert found[k] == pytest.approx(expected, rel=1e-8, abs=1e-8)


@settings(max_examples=20)
@given(grids(), SEEDS, PRIORS, st.data())
def test_equal_to_the_naive_model(grid: Grid, seed: int, prior: BetaPrior, data: st.DataObject) -> None:
    rays = data.draw(rays_near(grid))
    rays = [ray._replace(length=min(ray.length, LIMITS[1])) for ray in rays]
    cut = [naive._up_to_its_limit(ray, LIMITS) for ray in rays]
    assume(not any(naive.is_ambiguous(ray, naive.around(ray, grid)[0]) for ray in cut))
    assert_naive(drawn(grid, seed), prior, rays)


@given(exact_grids(), SEEDS, PRIORS, st.lists(exact_rays(), min_size=1, max_size=4))
def test_along_an_axis_and_on_the_lines(grid: Grid, seed: int, prior: BetaPrior, rays: list[Ray]) -> None:
    assert_naive(drawn(grid, seed), prior, rays)


@settings(max_examples=30)
@given(poses_2d(), SEEDS)
def test_scans_are_moved_by_pose_and_mount(pose: np.ndarray, seed: int) -> None:
    scan = sweep(seed, 6)
    model = ReflectionPosterior(drawn(Grid(pose[:2] - 3.1234, 0.5678, (11, 11)), seed), PRIOR)
    rays = naive.rays(scan, pose)
    assume(not any(naive.is_ambiguous(ray, naive.around(ray, model.grid)[0]) for ray in rays))
    expected = [
        naive.reflection_log_likelihood(ray, scan.range_limits, model.grid, model.probabilities, PRIOR.mean)
        for ray in rays
    ]
    assert model.log_likelihood(scan, pose) == pytest.approx(expected, rel=1e-7, abs=1e-7)


@settings(max_examples=20)
@given(st.data(), SEEDS)
def test_in_space_dense_and_in_bricks(data: st.DataObject, seed: int) -> None:
    grid = data.draw(spatial_grids(20))
    rays = [ray._replace(length=min(ray.length, LIMITS[1])) for ray in data.draw(spatial_rays(grid, 3))]
    cut = [naive._up_to_its_limit(ray, LIMITS) for ray in rays]
    assume(not any(naive.is_ambiguous(ray, naive.around(ray, grid)[0]) for ray in cut))
    counts = drawn(grid, seed)
    sparse = BrickStatistics.from_dense(counts)
    for kind in MODELS:
        model = kind(counts, PRIOR)
        expected = [naive.reflection_log_likelihood(ray, LIMITS, grid, model.probabilities, PRIOR.mean) for ray in rays]
        assert model.log_likelihood(spatial_scan(rays), np.eye(4)) == pytest.approx(expected, rel=1e-8, abs=1e-8)
        for most in (0, 2**28):  # in bricks, and laid out in full
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(beam_model, "_MOST_IN_FULL", most)
                found = kind(sparse, PRIOR).log_likelihood(spatial_scan(rays), np.eye(4))
            assert found == pytest.approx(expected, rel=1e-5, abs=1e-4)


def total_probability(model, start: np.ndarray, direction: np.ndarray, limits: tuple[float, float]) -> float:
    """All that can happen to a ray: too near, too far, or a return in one of the cells, where the density is one."""
    low, high = limits
    whole = Ray(start, direction, high, RayStatus.NO_RETURN)
    cut = [(max(p.start, low), p.stop) for p in naive.pieces(whole, naive.around(whole, model.grid)[0]) if p.stop > low]
    rays = [Ray(start, direction, (a + b) / 2, RayStatus.RETURN) for a, b in cut]
    rays += [whole, Ray(start, direction, low, RayStatus.BELOW_MINIMUM)]
    scan, pose = (scan_of(rays, limits), ORIGIN) if len(start) == 2 else (spatial_scan(rays, limits), np.eye(4))
    *density, sup, sub = np.exp(model.log_likelihood(scan, pose))
    return float(sub + sup + np.diff(cut, axis=1)[:, 0] @ density)


@given(grids(), SEEDS, PRIORS, st.tuples(floats(-0.3, 1.3), floats(-0.3, 1.3)), angles(), floats(0, 2), floats(0.01, 9))
def test_probabilities_add_up_to_one(grid, seed, prior, part, angle: float, low: float, width: float) -> None:
    start = np.array(grid.origin) + np.multiply(grid.shape, grid.resolution) * part
    direction = np.array([np.cos(angle), np.sin(angle)])
    whole = Ray(start, direction, low + width, 2)
    assume(not any(0 < p.length < 3 * naive.UNIT for p in naive.pieces(whole, naive.around(whole, grid)[0])))
    for kind in MODELS:
        assert total_probability(kind(drawn(grid, seed), prior), start, direction, (low, low + width)) == pytest.approx(
            1, abs=1e-6
        )


@given(SEEDS)
def test_probabilities_in_space_add_up_to_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    counts = drawn(Grid((-1.0, -1.0, -1.0), 0.5, (5, 6, 4)), seed)
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    start, limits = rng.uniform(-2, 2, 3), (float(rng.uniform(0, 1)), float(rng.uniform(1.01, 4)))
    for statistics in (counts, BrickStatistics.from_dense(counts)):
        for kind in MODELS:
            model = kind(statistics, PRIOR)
            assert total_probability(model, start, direction, limits) == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("hits", [0, 1, 10**9])
@pytest.mark.parametrize("misses", [0, 1, 10**9])
def test_any_number_of_visits_is_one_probability(hits: int, misses: int) -> None:
    counts = visited(Grid((0, 0), 0.5, (4, 4)), hits, misses)
    start, direction = np.array([0.1, 0.2]), np.array([0.8, 0.6])
    for model in (ReflectionPosterior(counts, BetaPrior(1e-6, 1e6)), ReflectionMap(counts, PRIOR, floor=1e-12)):
        assert total_probability(model, start, direction, (0.3, 1.5)) == pytest.approx(1, abs=1e-9)
        rays = [Ray(start, direction, 1.0, status) for status in RayStatus]
        assert np.isfinite(model.log_likelihood(scan_of(rays, (0.3, 1.5)), ORIGIN)).all()


def test_rays_visit_the_cells_they_are_counted_in() -> None:
    # The chords are the same under any probabilities: of two maps' likelihoods only the counts tell the difference.
    scans = [sweep(seed, 60, (0.0, 4.0)) for seed in range(5)]
    scans = [scan.select(scan.is_return) for scan in scans]
    poses = np.random.default_rng(5).uniform(-1, 1, (5, 3))
    counts = RayStatistics.from_scans(scans, poses, grid=Grid((-7, -7), 0.1, (140, 140)))
    one, two = (ReflectionPosterior(counts, prior) for prior in (PRIOR, BetaPrior(2.0, 0.3)))
    found = sum((one.log_likelihood(s, T) - two.log_likelihood(s, T)).sum() for s, T in zip(scans, poses, strict=True))
    H, M = counts.hits, counts.misses
    expected = (H * np.log(one.mean / two.mean) + M * np.log((1 - one.mean) / (1 - two.mean))).sum()
    assert H.sum() == sum(len(scan) for scan in scans)
    assert found == pytest.approx(expected, rel=1e-9)


def test_rays_in_space_visit_the_cells_they_are_counted_in() -> None:
    rng = np.random.default_rng(2)
    directions = rng.standard_normal((300, 3))
    points = directions / np.linalg.norm(directions, axis=1)[:, None] * rng.uniform(0.5, 3, (300, 1))
    scan = Scan.from_points(points, (0.1, 5.0))
    counts = RayStatistics.from_scans([scan], np.eye(4)[None], grid=Grid((-3.2, -3.3, -3.1), 0.2, (32, 33, 34)))
    one, two = (ReflectionPosterior(counts, prior) for prior in (PRIOR, BetaPrior(2.0, 0.3)))
    found = (one.log_likelihood(scan, np.eye(4)) - two.log_likelihood(scan, np.eye(4))).sum()
    expected = counts.hits * np.log(one.mean / two.mean) + counts.misses * np.log((1 - one.mean) / (1 - two.mean))
    assert found == pytest.approx(expected.sum(), rel=1e-9)


def test_the_posterior_is_the_average_over_all_maps() -> None:
    counts = visited(Grid((0, 0), 1.0, (3, 1)), np.array([[0], [2], [5]]), np.array([[4], [1], [3]]))
    logit = np.linspace(-70, 30, 20_001)
    mu = expit(logit)
    seen = zip(counts.hits, counts.misses, strict=True)
    belief = [beta.pdf(mu, H + PRIOR.hits, M + PRIOR.misses) * mu * (1 - mu) for H, M in seen]
    hit = [float(np.trapezoid(p * mu, logit)) for p in belief]
    miss = [float(np.trapezoid(p * (1 - mu), logit)) for p in belief]
    model = ReflectionPosterior(counts, PRIOR)
    rays = [Ray(np.array([0.0, 0.5]), np.array([1.0, 0.0]), r, 0) for r in (1.5, 2.5)]
    expected = [miss[0] * hit[1], miss[0] * miss[1] * hit[2]]
    assert np.exp(model.log_likelihood(scan_of(rays, LIMITS), ORIGIN)) == pytest.approx(expected, rel=1e-6)
    assert model.mean.ravel()[1:] == pytest.approx(hit[1:], rel=1e-6)


def test_certainty_makes_the_posterior_the_most_likely_map() -> None:
    rng = np.random.default_rng(3)
    grid = Grid((-8, -8), 0.5, (32, 32))
    hits, misses = rng.integers(1, 9, grid.shape), rng.integers(1, 9, grid.shape)
    errors = []
    for times in (1, 10, 100, 1000):
        counts = visited(grid, times * hits, times * misses)
        one, two = (kind(counts, PRIOR).log_likelihood(sweep(2, 60), (0.1, 0.2, 0.3)) for kind in MODELS)
        errors.append(np.abs(one - two).max())
    assert errors[0] > 0.05
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx(10, rel=0.5)


def test_without_data_there_is_the_prior() -> None:
    counts = visited(Grid((0, 0), 1.0, (3, 2)), 0, 0)
    for kind in MODELS:
        model = kind(counts, PRIOR)
        assert model.probabilities == pytest.approx(np.full((3, 2), PRIOR.mean))
        # Then the grid is no more than a part of the raster: cells outside are cells inside.
        inside, outside = (
            model.log_likelihood(scan_of([Ray(np.array([x, 0.3]), np.array([0.6, 0.8]), 1.9, 0)], LIMITS), ORIGIN)
            for x in (0.2, 40.2)
        )
        assert inside == pytest.approx(outside)


CORRIDOR = visited(Grid((0, 0), 1.0, (4, 1)), np.array([[0], [3], [2], [0]]), np.array([[9], [1], [0], [0]]))


def test_the_most_likely_map_takes_its_data_at_their_word_unless_it_has_a_floor() -> None:
    model = ReflectionMap(CORRIDOR, PRIOR)
    assert model.probabilities.ravel() == pytest.approx([0, 0.75, 1, PRIOR.mean])
    scan = Scan.from_polar(np.zeros(5), [0.7, 1.7, 2.7, 3.7, np.inf], (0.2, 5.0))
    expected = [-math.inf, math.log(0.75), math.log(0.25), -math.inf, -math.inf]
    assert model.log_likelihood(scan, (0.0, 0.5, 0.0)) == pytest.approx(expected)
    assert model.scan_log_likelihoods(scan, [(0.0, 0.5, 0.0)]).tolist() == [-math.inf]
    model = ReflectionMap.from_statistics(CORRIDOR, PRIOR, floor=0.01)
    assert model.probabilities.ravel() == pytest.approx([0.01, 0.75, 0.99, PRIOR.mean])
    assert np.isfinite(model.log_likelihood(scan, (0.0, 0.5, 0.0))).all()


def test_a_limit_parts_a_cell_as_it_parts_the_chord() -> None:
    model = ReflectionMap(CORRIDOR, PRIOR)
    statuses = np.array([RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN], np.uint8)
    scan = Scan(np.tile([1.0, 0.0], (2, 1)), np.zeros(2), statuses, (1.2, 1.6))
    sub, sup = np.exp(model.log_likelihood(scan, (0.0, 0.5, 0.0)))
    assert sub == pytest.approx(0.2 * 0.75)
    assert sup == pytest.approx(1 - 0.6 * 0.75)
    # Section 8.4.5 would have all of the cell passed, 0.75 below the minimum and 0.25 beyond the maximum.
    nothing = Scan(np.array([[1.0, 0.0]]), np.zeros(1), statuses[:1], (0.0, 5.0))
    assert model.log_likelihood(nothing, (1.5, 0.5, 0.0)).tolist() == [-math.inf]


def test_models_estimate_their_own_prior() -> None:
    counts = drawn(Grid((0, 0), 0.5, (20, 20)), 4)
    for kind in MODELS:
        assert kind.from_statistics(counts).prior == kind.from_statistics(counts, "marginal").prior
        assert kind.from_statistics(counts, "published").prior != kind.from_statistics(counts).prior
        assert kind.from_statistics(counts, PRIOR).prior == PRIOR
        assert kind.from_statistics(counts).normalized


def test_each_cell_may_have_a_prior_of_its_own() -> None:
    counts = drawn(Grid((0, 0), 0.5, (20, 20)), 4)
    model = ReflectionPosterior.from_statistics(counts, "leave-one-out")
    alphas, betas = model.prior.of_cells
    assert np.ptp(alphas) > 0
    assert model.mean == pytest.approx((counts.hits + alphas) / (counts.hits + alphas + counts.misses + betas))


def test_bad_floors_and_scans_are_refused() -> None:
    for floor in (-0.1, 0.6, math.nan):
        with pytest.raises(MapError, match="expected a probability of at most 1/2"):
            ReflectionMap(CORRIDOR, PRIOR, floor=floor)
    spatial = Scan(np.eye(3), np.ones(3), np.zeros(3, np.uint8), (0.1, 5))
    for kind in MODELS:
        with pytest.raises(MapError, match="it has 3 dimensions, the map 2"):
            kind(CORRIDOR, PRIOR).log_likelihood(spatial, ORIGIN)
