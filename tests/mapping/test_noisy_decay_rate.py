"""Noisy decay rates: equal to naive convolutions, true probabilities, and the exact model where the noise ends."""

import math
from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS, counted, rays_near, scan_of, statistics
from scipy.integrate import quad
from scipy.special import erfcx, ndtr
from spatial_cases import packed_spatial, spatial_rays
from strategies import floats

from factorloc.errors import MapError
from factorloc.mapping import BrickStatistics, DecayRateMap, DecayRatePosterior, GammaPrior, Grid, RayStatistics
from factorloc.mapping._noisy_decay_rate_kernels import scaled_erfc, smooth_loss, smooth_pass
from factorloc.mapping.noisy_decay_rate import NoisyDecayRateMap
from factorloc.mapping.sensor_model import SensorModel
from factorloc.scan import RayStatus, Scan

LIMITS = (0.25, 6.0)
PRIOR = GammaPrior(0.3, 0.7)
ORIGIN = (0, 0, 0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def integral(function, start: float, stop: float, pieces: int) -> float:
    """Gauss and Legendre over many pieces, denser towards the start, where rays are stopped."""
    edges = start + (stop - start) * np.linspace(0, 1, pieces + 1) ** 3
    middles, halves = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    return float((function(middles[:, None] + halves[:, None] * NODES) @ WEIGHTS) @ halves)


def normal(x):
    return np.exp(-0.5 * x * x) / math.sqrt(2 * math.pi)


@given(
    floats(-8, 8),
    st.sampled_from([1e-9, 1e-4, 0.01, 0.2, 1.0, 16.0]),
    st.sampled_from([0, 1e-12, 1e-3, 0.3, 5, 300, 1e5]),
)
def test_passes_and_losses_of_a_cell(alpha: float, width: float, kappa: float) -> None:
    beta = alpha + width
    width = beta - alpha
    # Beyond so much the integrand has vanished.
    last = min(width, 60 / max(kappa, 1e-9))
    expected = integral(lambda way: np.exp(-kappa * way) * normal(alpha + way), 0, last, 60)
    # The difference of two tails keeps fewer digits the larger the cell is against what is left.
    assert smooth_pass(alpha, beta, float(kappa)) == pytest.approx(expected, rel=1e-11, abs=1e-30)
    expected = integral(lambda way: -np.expm1(-kappa * way) * normal(alpha + way), 0, width, 200)
    assert smooth_loss(alpha, beta, float(kappa)) == pytest.approx(expected, rel=1e-8, abs=1e-30)


def test_the_scaled_complement() -> None:
    x = np.concatenate([np.linspace(0, 12, 500), np.geomspace(12, 1e8, 50)])
    assert [scaled_erfc(v) for v in x] == pytest.approx(erfcx(x), rel=2e-14)


def naive_log_likelihood(model: NoisyDecayRateMap, ray: Ray) -> float:
    """The definition: the density of the exact range, convolved with the noise."""
    grid, sigma = model.grid, model.sigma
    far = LIMITS[1] + 10 * sigma
    z = {RayStatus.BELOW_MINIMUM: LIMITS[0], RayStatus.NO_RETURN: LIMITS[1]}.get(RayStatus(ray.status), ray.length)
    total, survival = 0.0, 1.0

    def weight(t):
        if ray.status == RayStatus.RETURN:
            return normal((z - t) / sigma) / sigma
        tail = (z - t) / sigma if ray.status == RayStatus.BELOW_MINIMUM else (t - z) / sigma
        return ndtr(tail)

    for piece in naive.pieces(ray._replace(length=far), grid):
        rate = model.outside if piece.cell is None else model.rates[piece.cell]
        stop = min(piece.stop, piece.start + 50 / max(rate, 1e-9))
        edges = [piece.start, *(t for t in z + sigma * np.arange(-9, 10) if piece.start < t < stop), stop]

        def density(t, start=piece.start, rate=rate, survival=survival):
            return rate * survival * np.exp(-rate * (t - start)) * weight(t)

        total += sum(integral(density, a, b, 4) for a, b in pairwise(edges) if b > a)
        survival *= math.exp(-rate * piece.length)
    if ray.status == RayStatus.NO_RETURN:
        total += survival
    false = model.false_rate / (LIMITS[1] - LIMITS[0]) if ray.status == RayStatus.RETURN else 0.0
    found = (1 - model.false_rate) * total + false
    return math.log(found) if found > 0 else -math.inf


@given(statistics(), st.data(), st.sampled_from([0.02, 0.2]), st.sampled_from([0.0, 0.1]))
def test_equal_to_the_definition(counts: RayStatistics, data, sigma: float, false_rate: float) -> None:
    model = NoisyDecayRateMap.from_map(DecayRateMap(counts, PRIOR), sigma, false_rate)
    rays = [r._replace(length=min(r.length, LIMITS[1])) for r in data.draw(rays_near(counts.grid, 3))]
    found = model.log_likelihood(scan_of(rays, LIMITS), ORIGIN)
    for ray, log_likelihood in zip(rays, found, strict=True):
        expected = naive_log_likelihood(model, ray)
        # Where less than the cut tails is left, the cut shows.
        assert math.exp(log_likelihood) == pytest.approx(math.exp(expected), rel=1e-7, abs=2e-13)


@given(SEEDS, st.sampled_from([0.03, 0.3]), st.sampled_from([0.0, 0.05]))
def test_probability_adds_up_to_one(seed: int, sigma: float, false_rate: float) -> None:
    rng = np.random.default_rng(seed)
    grid = Grid((-1.0, -1.0), 0.5, (5, 6))
    rates = rng.choice([0.0, 0.1, 2.0, 60.0], grid.shape, p=[0.4, 0.3, 0.2, 0.1])
    model = NoisyDecayRateMap(counted(grid, np.zeros(1), 1.0), rates, rng.choice([0.0, 0.2]), sigma, false_rate)
    angle, origin = rng.uniform(-np.pi, np.pi), rng.uniform(-1, 1, 2)
    direction = np.array([np.cos(angle), np.sin(angle)])
    edges = np.linspace(*LIMITS, 400)
    middles, halves = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    nodes, weights = np.polynomial.legendre.leggauss(8)
    lengths = (middles[:, None] + halves[:, None] * nodes).ravel()
    rays = [Ray(origin, direction, length, RayStatus.RETURN) for length in lengths]
    rays += [Ray(origin, direction, 1.0, status) for status in (RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN)]
    p = np.exp(model.log_likelihood(scan_of(rays, LIMITS), ORIGIN))
    density = p[:-2] @ (halves[:, None] * weights).ravel()
    assert density + p[-2:].sum() == pytest.approx(1.0, abs=1e-6)


@given(statistics(), st.data())
def test_without_noise_it_is_the_exact_model(counts: RayStatistics, data) -> None:
    exact = DecayRateMap(counts, PRIOR)
    sigma = 1e-9
    rays = [r._replace(length=min(r.length, LIMITS[1])) for r in data.draw(rays_near(counts.grid))]
    # An end so near a line that the noise takes it across belongs to two cells.
    rays = [
        r for r in rays if min(abs(p.stop - r.length) for p in naive.pieces(r._replace(length=9.0), counts.grid)) > 1e-7
    ]
    if rays:
        scan = scan_of(rays, LIMITS)
        expected = exact.log_likelihood(scan, ORIGIN)
        found = NoisyDecayRateMap.from_map(exact, sigma, 0.0).log_likelihood(scan, ORIGIN)
        assert np.array_equal(np.isfinite(found), np.isfinite(expected))
        some = np.isfinite(expected)
        assert found[some] == pytest.approx(expected[some], rel=1e-5, abs=1e-5)
    posterior = DecayRatePosterior(counts, PRIOR)
    assert np.array_equal(NoisyDecayRateMap.from_posterior(posterior).rates, posterior.mean)


def test_behind_walls_and_between_them() -> None:
    grid = Grid((0, -0.5), 0.1, (60, 10))
    rates = np.zeros(grid.shape)
    rates[30] = 1e6
    model = NoisyDecayRateMap(counted(grid, np.zeros(1), 1.0), rates, 0.5, 0.03, 0.0)
    lengths = [2.9, 3.0, 3.05, 3.2, 3.4, 5.5, 1.0]
    scan = Scan.from_polar(np.zeros(len(lengths)), lengths, LIMITS)
    found = model.log_likelihood(scan, (0, 0, 0))
    # A wall that lets nothing through is a normal distribution around its face.
    expected = [-0.5 * ((z - 3.0) / 0.03) ** 2 - math.log(0.03 * math.sqrt(2 * math.pi)) for z in lengths[:4]]
    assert found[:4] == pytest.approx(expected, rel=1e-3)
    assert np.isneginf(found[4:]).all()
    # Behind it space of any rate: hardly a ray comes there, but their number is known.
    rates[31:] = 0.5
    behind = NoisyDecayRateMap(model.statistics, rates, 0.5, 0.03, 0.0).log_likelihood(scan, (0, 0, 0))
    assert behind[5] == pytest.approx(-1e5 + math.log(0.5) - 0.5 * 2.4 + 0.5 * (0.5 * 0.03) ** 2, rel=1e-11)
    # With false detections every range has a density.
    false = NoisyDecayRateMap(model.statistics, rates, 0.5, 0.03, 0.02).log_likelihood(scan, (0, 0, 0))
    assert false[4:] == pytest.approx(math.log(0.02 / 5.75))
    # A small chance below the minimum keeps its digits: no rate but a tiny one up to where the noise ends.
    rates[:] = 1e-15
    scan = Scan.from_polar(np.zeros(2), [0.1, 9.0], LIMITS)
    below, none = NoisyDecayRateMap(model.statistics, rates, 0.0, 0.03, 0.0).log_likelihood(scan, (0, 0, 0))
    assert math.exp(below) == pytest.approx(1e-15 * LIMITS[0], rel=1e-9)
    assert none == pytest.approx(0.0, abs=1e-12)


@settings(max_examples=20)
@given(st.data(), SEEDS)
def test_in_space_dense_and_in_bricks(data, seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = Grid((-1.0, -2.0, -1.0), 0.25, (18, 20, 17))
    rays = [r._replace(length=min(r.length, LIMITS[1])) for r in data.draw(spatial_rays(grid, 3))]
    block = packed_spatial(rays)
    scan = Scan(block.directions, block.ranges, block.status, LIMITS, origins=block.origins)
    counts = counted(grid, rng.choice([0, 0, 1, 4], grid.shape), rng.choice([0.3, 2.0], grid.shape))
    dense, sparse = (DecayRateMap(c, PRIOR) for c in (counts, BrickStatistics.from_dense(counts)))
    model = NoisyDecayRateMap.from_map(dense, 0.1, 0.05)
    found = model.log_likelihood(scan, np.eye(4))
    assert np.exp(found) == pytest.approx([math.exp(naive_log_likelihood(model, r)) for r in rays], rel=1e-7, abs=2e-13)
    in_bricks = NoisyDecayRateMap.from_map(sparse, 0.1, 0.05)
    assert in_bricks.log_likelihood(scan, np.eye(4)) == pytest.approx(found, rel=1e-4, abs=1e-4)
    poses = np.stack([np.eye(4)] * 2)
    assert model.scan_log_likelihoods(scan, poses) == pytest.approx([found.sum()] * 2)


def test_likelihoods_are_quad_s() -> None:
    # One cell after another by hand, with another integrator.
    grid = Grid((0, 0), 1.0, (3, 1))
    model = NoisyDecayRateMap(counted(grid, np.zeros(1), 1.0), np.array([[0.2], [3.0], [0.5]]), 0.1, 0.25, 0.0)

    def density(t: float) -> float:
        rate, passed = [(0.2, 0.2 * t), (3.0, 0.2 + 3 * (t - 1)), (0.5, 3.2 + 0.5 * (t - 2))][min(int(t), 2)]
        return rate * math.exp(-passed)

    z = 1.1
    expected = quad(lambda t: density(t) * normal((z - t) / 0.25) / 0.25, 0, 3, points=[1, 2], epsabs=1e-13)[0]
    found = model.log_likelihood(Scan.from_polar([0.0], [z], LIMITS), (0, 0.5, 0))
    assert np.exp(found) == pytest.approx([expected], rel=1e-9)


def test_what_does_not_fit_is_refused() -> None:
    counts = counted(Grid((0, 0), 0.5, (3, 3)), np.zeros(1), 1.0)
    rates = np.ones((3, 3))
    model = NoisyDecayRateMap(counts, rates, 0.1)
    assert isinstance(model, SensorModel) and model.normalized and model.grid == counts.grid
    for arguments, message in (
        ((rates[:2], 0.1), "rates: shape"),
        ((-rates, 0.1), "rates: negative"),
        ((rates * math.nan, 0.1), "rates: negative or not finite"),
        ((rates, -0.1), "rates: negative"),
        ((rates, math.inf), "rates: negative or not finite"),
        ((rates, 0.1, 0.0), "sigma"),
        ((rates, 0.1, 0.1, 1.0), "false_rate"),
    ):
        with pytest.raises(MapError, match=message):
            NoisyDecayRateMap(counts, *arguments)
    endless = Scan.from_polar([0.0], [1.0], (0.1, math.inf))
    with pytest.raises(MapError, match="infinite"):
        model.log_likelihood(endless, ORIGIN)
    assert np.isfinite(NoisyDecayRateMap(counts, rates, 0.1, 0.1, 0.0).log_likelihood(endless, ORIGIN)).all()
