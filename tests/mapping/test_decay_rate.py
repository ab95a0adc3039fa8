"""Sensor models: equal to naive ones, true probabilities, most likely where they are fitted, averages of each other."""

import math
from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive import Ray
from ray_cases import counted, exact_grids, exact_rays, rays_near, scan_of, statistics, sweep
from strategies import angles, floats, poses_2d

from factorloc.errors import MapError
from factorloc.mapping import DecayRateMap, DecayRatePosterior, GammaPrior, Grid, RayStatistics
from factorloc.mapping.beam_model import rimmed
from factorloc.scan import RayStatus, Scan

LIMITS = (0.25, 12.0)
PRIORS = st.tuples(floats(0.02, 2), floats(0.1, 3)).map(lambda numbers: GammaPrior(*numbers))
ORIGIN = (0, 0, 0)


def with_rates(model: DecayRateMap, rates: np.ndarray) -> DecayRateMap:
    """A map of other rates."""
    changed = DecayRateMap(model.statistics, model.prior)
    vars(changed)["rates"] = rates
    return changed


def assert_naive(counts: RayStatistics, prior: GammaPrior, rays: list[Ray]) -> None:
    rays = [ray._replace(length=min(ray.length, LIMITS[1])) for ray in rays]
    scan = scan_of(rays, LIMITS)
    likely, posterior = DecayRateMap(counts, prior), DecayRatePosterior(counts, prior)
    by_rate, by_belief = likely.log_likelihood(scan, ORIGIN), posterior.log_likelihood(scan, ORIGIN)
    for k, ray in enumerate(rays):
        expected = naive.decay_log_likelihood(ray, LIMITS, counts.grid, likely.rates, prior.mean)
        assert by_rate[k] == pytest.approx(expected, rel=1e-8, abs=1e-8)
        belief = (posterior.shapes, posterior.paths, (prior.shape, prior.path))
        expected = naive.posterior_log_likelihood(ray, LIMITS, counts.grid, *belief)
        assert by_belief[k] == pytest.approx(expected, rel=1e-8, abs=1e-8)


@given(statistics(), PRIORS, st.data())
def test_equal_to_the_naive_models(counts: RayStatistics, prior: GammaPrior, data: st.DataObject) -> None:
    rays = data.draw(rays_near(counts.grid))
    cut = [r._replace(length=length) for r in rays for length in (min(r.length, LIMITS[1]), *LIMITS)]
    assume(not any(naive.is_ambiguous(ray, counts.grid) for ray in cut))
    assert_naive(counts, prior, rays)


@given(statistics(exact_grids()), PRIORS, st.lists(exact_rays(), min_size=1, max_size=4))
def test_along_an_axis_and_on_the_lines(counts: RayStatistics, prior: GammaPrior, rays: list[Ray]) -> None:
    assert_naive(counts, prior, rays)


def test_a_return_on_the_border_belongs_to_the_cell_above() -> None:
    counts = counted(Grid((0, 0), 0.5, (4, 4)), np.arange(16).reshape(4, 4), 1.25)
    axes = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]], float)
    rays = [
        Ray(start, axis, length, RayStatus.RETURN)
        for start in np.array([[-0.75, 0.75], [0.75, 0.75], [0.75, 2.75], [2.0, 2.0], [0.0, 0.0]])
        for axis in axes
        for length in (0.0, 0.75, 1.25)
    ]
    assert_naive(counts, GammaPrior(0.7, 0.9), rays)


@given(statistics(exact_grids()), PRIORS, st.integers(-8, 8), st.integers(-8, 8), st.integers(0, 3), floats(0.3, 11))
def test_from_corner_to_corner(counts, prior, x: int, y: int, quarter: int, length: float) -> None:
    angle = (2 * quarter + 1) * np.pi / 4
    ray = Ray(np.array([x, y]) / 2, np.array([np.cos(angle), np.sin(angle)]), length, RayStatus.RETURN)
    near = [ray._replace(origin=ray.origin + shift * ray.direction[::-1] * [1, -1]) for shift in (-1e-7, 1e-7)]
    assume(not any(naive.is_ambiguous(each, counts.grid) for each in near))
    for model in (DecayRateMap(counts, prior), DecayRatePosterior(counts, prior)):
        found, *beside = model.log_likelihood(scan_of([ray, *near], LIMITS), ORIGIN)
        # What lies in corners has no size: the ray is as likely as one of its neighbours.
        assert min(beside) - 1e-4 <= found <= max(beside) + 1e-4


@given(poses_2d(), st.integers(0, 9), PRIORS)
def test_scans_are_moved_by_pose_and_mount(pose: np.ndarray, seed: int, prior: GammaPrior) -> None:
    scan = sweep(seed, 6)
    rng = np.random.default_rng(seed)
    grid = Grid(pose[:2] - 3.1234, 0.5678, (11, 11))
    counts = counted(grid, rng.integers(0, 4, (11, 11)), rng.uniform(0.5, 3, (11, 11)))
    model = DecayRatePosterior(counts, prior)
    belief = (model.shapes, model.paths, (prior.shape, prior.path))
    rays = naive.rays(scan, pose)
    assume(not any(naive.is_ambiguous(ray, grid) for ray in rays))
    expected = [naive.posterior_log_likelihood(ray, scan.range_limits, grid, *belief) for ray in rays]
    assert model.log_likelihood(scan, pose) == pytest.approx(expected, rel=1e-8, abs=1e-8)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(14)


def total_probability(model: DecayRateMap | DecayRatePosterior, start, angle: float, limits) -> float:
    """All that can happen to a ray: too near, too far, or a return somewhere between, integrated piece by piece."""
    low, high = limits
    direction = np.array([np.cos(angle), np.sin(angle)])
    whole = Ray(np.array(start), direction, high, RayStatus.NO_RETURN)
    edges = [low, *(p.stop for p in naive.pieces(whole, model.grid) if low < p.stop)]
    # Parts that grow with the distance from where a piece begins, as a prior's density falls steeply there.
    steps = [0, 0.004, 0.02, 0.06, 0.15, 0.3, 0.5, 0.75, 1]
    edges = np.unique([a + (b - a) * step for a, b in pairwise(edges) for step in steps])
    halves = np.diff(edges)[:, None] / 2
    ranges = ((edges[:-1] + edges[1:])[:, None] / 2 + halves * NODES).ravel()
    statuses = [RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN, *[RayStatus.RETURN] * len(ranges)]
    lengths = [low, high, *ranges]
    rays = [Ray(whole.origin, direction, r, status) for r, status in zip(lengths, statuses, strict=True)]
    sub, sup, *density = np.exp(model.log_likelihood(scan_of(rays, limits), ORIGIN))
    return float(sub + sup + (halves * WEIGHTS).ravel() @ density)


@settings(max_examples=40)
@given(statistics(), PRIORS, st.tuples(floats(-0.3, 1.3), floats(-0.3, 1.3)), angles(), floats(0, 2), floats(0.01, 9))
def test_probabilities_add_up_to_one(counts, prior, part, angle: float, low: float, width: float) -> None:
    start = np.array(counts.grid.origin) + np.multiply(counts.grid.shape, counts.grid.resolution) * part
    for model in (DecayRateMap(counts, prior), DecayRatePosterior(counts, prior)):
        assert total_probability(model, start, angle, (low, low + width)) == pytest.approx(1, abs=1e-8)


def test_certainty_makes_the_posterior_the_most_likely_map() -> None:
    # Where rays never leave the grid, the two differ by the order of one over the counts.
    rng = np.random.default_rng(3)
    grid = Grid((-8, -8), 0.5, (32, 32))
    hits, path = rng.integers(1, 9, grid.shape), rng.uniform(2, 40, grid.shape)
    scan = sweep(2, 60)
    errors = []
    for times in (1, 10, 100, 1000):
        counts = counted(grid, times * hits, times * path)
        prior = GammaPrior(1e-9, 1e-9)
        by_rate, by_belief = (
            model(counts, prior).log_likelihood(scan, (0.1, 0.2, 0.3)) for model in (DecayRateMap, DecayRatePosterior)
        )
        errors.append(np.abs(by_rate - by_belief).max())
    assert errors[0] > 0.1
    assert np.array(errors[:-1]) / errors[1:] == pytest.approx(10, rel=0.4)


def test_where_nothing_was_ever_hit_the_most_likely_map_excludes_a_return() -> None:
    grid = Grid((0, 0), 1.0, (4, 1))
    counts = counted(grid, np.array([[0], [0], [1], [0]]), np.array([[9.0], [2.0], [4.0], [0.0]]))
    prior = GammaPrior(0.5, 5.0)
    model = DecayRateMap(counts, prior)
    assert model.rates.ravel().tolist() == [0, 0, 0.25, 0.1]
    assert model.grid == grid
    assert model.reflection_probability().ravel() == pytest.approx(1 - np.exp([0, 0, -0.25, -0.1]))
    scan = Scan.from_polar(np.zeros(5), [1.2, 2.2, 3.2, 4.2, 0.0], (0.9, 5.0))
    found = model.log_likelihood(scan, (0.3, 0.5, 0))
    expected = [-math.inf, math.log(0.25) - 0.125, math.log(0.1) - 0.25 - 0.05, math.log(0.1) - 0.25 - 0.15, -math.inf]
    assert found == pytest.approx(expected)
    through = Scan.from_polar([0.0], [np.inf], (0.9, 1.5))
    assert model.log_likelihood(through, (0.3, 0.5, 0)) == pytest.approx(0, abs=1e-15)
    assert np.isfinite(DecayRatePosterior(counts, prior).log_likelihood(scan, (0.3, 0.5, 0))).all()


def test_without_a_minimum_range_nothing_is_below_it() -> None:
    counts = counted(Grid((0, 0), 1.0, (4, 4)), 3, 2.0)
    scan = Scan(np.array([[1.0, 0.0]]), np.zeros(1), np.array([RayStatus.BELOW_MINIMUM]), (0.0, 5.0))
    for model in (DecayRateMap, DecayRatePosterior):
        assert model.from_statistics(counts).log_likelihood(scan, (1.5, 1.5, 0)).tolist() == [-math.inf]


def test_a_hit_where_a_ray_enters_leaves_a_rate_that_is_finite() -> None:
    counts = counted(Grid((0, 0), 1.0, (2, 1)), np.array([[1], [1]]), np.array([[0.0], [2.0]]))
    assert DecayRateMap(counts, GammaPrior(1, 1)).rates.ravel().tolist() == [2.0**20, 0.5]


def test_a_floor_leaves_unlikely_what_was_impossible() -> None:
    counts = counted(Grid((0, 0), 1.0, (4, 1)), np.array([[0], [0], [1], [0]]), np.array([[9.0], [2.0], [4.0], [0.0]]))
    model = DecayRateMap.from_statistics(counts, GammaPrior(0.5, 5.0), floor=0.02)
    assert model.rates.ravel().tolist() == [0.02, 0.02, 0.25, 0.1]
    scan = Scan.from_polar(np.zeros(1), [1.2], (0.9, 5.0))
    assert model.log_likelihood(scan, (0.3, 0.5, 0)) == pytest.approx([math.log(0.02) - 1.2 * 0.02])
    for floor in (-1.0, math.inf, math.nan):
        with pytest.raises(MapError, match="expected a rate, 0 for none"):
            DecayRateMap(counts, GammaPrior(1, 1), floor=floor)


@pytest.mark.parametrize(("hits", "path"), [(10**9, 1e-3), (10**9, 2.0**-20), (10**9, 1e6), (0, 1e6), (1, 2.0**-20)])
def test_counts_of_any_size_are_likelihoods(hits: int, path: float) -> None:
    counts = counted(Grid((0, 0), 1.0, (4, 4)), hits, path)
    scan = Scan.from_polar(np.linspace(-3, 3, 9), [*np.linspace(0.5, 6, 7), 0.1, np.inf], (0.3, 8.0))
    for model in (DecayRatePosterior(counts, GammaPrior(1e-6, 1e6)), DecayRateMap(counts, GammaPrior(1e-6, 1e6))):
        found = model.log_likelihood(scan, (1.6, 1.7, 0.1))
        assert not np.isnan(found).any()
        assert (np.exp(found[-2:]) <= 1).all()
    assert np.isfinite(DecayRatePosterior(counts, GammaPrior(1, 1)).log_likelihood(scan, (1.6, 1.7, 0.1))).all()


SCANS = [sweep(seed, 40, (0.0, 4.0)) for seed in range(6)]
POSES = np.random.default_rng(5).uniform(-1.5, 1.5, (6, 3))


def test_no_other_rates_make_the_mapping_rays_as_likely() -> None:
    counts = RayStatistics.from_scans(SCANS, POSES, grid=Grid((-3, -3), 1.0, (6, 6)))
    model = DecayRateMap.from_statistics(counts)

    def log_likelihood(rates: np.ndarray) -> float:
        changed = with_rates(model, rates)
        return sum(changed.log_likelihood(scan, pose).sum() for scan, pose in zip(SCANS, POSES, strict=True))

    best = log_likelihood(model.rates)
    assert np.isfinite(best)
    for cell in np.argwhere(counts.path_fixed > 0):
        for factor in (0.97, 1.03):
            rates = model.rates.copy()
            rates[tuple(cell)] = rates[tuple(cell)] * factor if rates[tuple(cell)] > 0 else 0.01
            assert log_likelihood(rates) < best


def test_the_posterior_is_the_average_over_all_maps() -> None:
    rng = np.random.default_rng(11)
    grid = Grid((-1.5, -1.5), 1.0, (3, 3))
    counts = counted(grid, rng.integers(0, 4, grid.shape), rng.uniform(0.5, 3, grid.shape))
    prior = GammaPrior(0.8, 1.5)
    posterior = DecayRatePosterior(counts, prior)
    statuses = [RayStatus.RETURN] * 4 + [RayStatus.NO_RETURN] * 3 + [RayStatus.BELOW_MINIMUM] * 3
    rays = [
        Ray(np.array([-0.4, 0.3]), np.array([np.cos(t), np.sin(t)]), rng.uniform(0.3, 3), status)
        for t, status in zip(rng.uniform(-np.pi, np.pi, 10), statuses, strict=True)
    ]
    scan = scan_of(rays, (0.7, 4.0))
    draws = 3000
    likelihoods = np.empty((draws, len(rays)))
    for k in range(draws):
        outside = GammaPrior(rng.gamma(prior.shape, 1 / prior.path), 1.0)  # of this mean
        rates = rng.gamma(posterior.shapes, 1 / posterior.paths)
        likelihoods[k] = np.exp(with_rates(DecayRateMap(counts, outside), rates).log_likelihood(scan, ORIGIN))
    sigma = likelihoods.std(0) / np.sqrt(draws)
    assert (sigma < 0.1 * likelihoods.mean(0)).all()
    assert (np.abs(likelihoods.mean(0) - np.exp(posterior.log_likelihood(scan, ORIGIN))) < 5 * sigma).all()


def test_models_estimate_their_own_prior_and_know_their_mean() -> None:
    counts = RayStatistics.from_scans(SCANS, POSES, resolution=0.5)
    for model in (DecayRateMap, DecayRatePosterior):
        assert model.from_statistics(counts).prior == model.from_statistics(counts, "marginal").prior
        assert model.from_statistics(counts, "published").prior != model.from_statistics(counts).prior
        assert model.from_statistics(counts, GammaPrior(1, 2)).prior == GammaPrior(1, 2)
        assert model.from_statistics(counts).grid == counts.grid
    posterior = DecayRatePosterior(counts, GammaPrior(1, 2))
    assert posterior.mean == pytest.approx((counts.hits + 1) / (counts.path_lengths + 2))


def test_a_scan_of_another_dimension_is_refused() -> None:
    spatial = Scan(np.eye(3), np.ones(3), np.zeros(3, np.uint8), (0.1, 5))
    counts = counted(Grid((0, 0), 1.0, (2, 2)), 1, 1.0)
    for model in (DecayRateMap, DecayRatePosterior):
        with pytest.raises(MapError, match="it has 3 dimensions, the map 2"):
            model.from_statistics(counts, GammaPrior(1, 1)).log_likelihood(spatial, ORIGIN)


def test_the_rim_surrounds() -> None:
    assert rimmed([[1, 2]], 7).tolist() == [[7, 7, 7, 7], [7, 1, 2, 7], [7, 7, 7, 7]]
    assert rimmed(np.zeros((2, 3), np.float32), 0).dtype == np.float64
