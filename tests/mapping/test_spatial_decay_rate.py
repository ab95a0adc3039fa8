"""Decay-rate maps in space: likelihoods equal to naive ones, dense and in bricks, and densities that add up to one."""

from itertools import pairwise

import naive
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS
from spatial_cases import packed_spatial, spatial_grids, spatial_rays

from factorloc.mapping import (
    BrickStatistics,
    DecayRateMap,
    DecayRatePosterior,
    GammaPrior,
    Grid,
    RayStatistics,
    beam_model,
)
from factorloc.scan import RayStatus, Scan

HERE = np.eye(4)
LIMITS = (0.4, 3.0)
PRIOR = GammaPrior(0.3, 0.7)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(14)


def counted(grid: Grid, seed: int, seen: float = 0.5) -> RayStatistics:
    rng = np.random.default_rng(seed)
    path = np.where(rng.random(grid.shape) < seen, rng.choice([0.25, 1.0, 9.0], grid.shape), 0.0)
    hits = np.where(path > 0, rng.choice([0, 1, 2, 7], grid.shape), 0)
    fixed = np.round(path * 2**20).astype(np.int64)
    return RayStatistics(grid, hits.astype(np.uint32), np.zeros(grid.shape, np.uint32), fixed)


def scan_of(rays: list[Ray]) -> Scan:
    block = packed_spatial(rays)
    return Scan(block.directions, block.ranges, block.status, LIMITS, origins=block.origins)


@given(st.data(), SEEDS)
def test_likelihoods_are_the_naive_ones(data: st.DataObject, seed: int) -> None:
    grid = data.draw(spatial_grids(20))
    rays = data.draw(spatial_rays(grid, 5))
    cut = [naive._up_to_its_limit(ray, LIMITS) for ray in rays]
    assume(not any(naive.is_ambiguous(ray, grid) for ray in cut))
    statistics = counted(grid, seed)
    sparse = BrickStatistics.from_dense(statistics)
    rates = DecayRateMap(statistics, PRIOR)
    with np.errstate(divide="ignore"):
        expected = [naive.decay_log_likelihood(ray, LIMITS, grid, rates.rates, PRIOR.mean) for ray in rays]
    assert rates.log_likelihood(scan_of(rays), HERE) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    for most in (0, 2**28):  # in bricks, and laid out in full
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(beam_model, "_MOST_IN_FULL", most)
            found = DecayRateMap(sparse, PRIOR).log_likelihood(scan_of(rays), HERE)
        assert found == pytest.approx(expected, rel=1e-5, abs=1e-4)
    posterior = DecayRatePosterior(statistics, PRIOR)
    expected = [
        naive.posterior_log_likelihood(ray, LIMITS, grid, posterior.shapes, posterior.paths, (PRIOR.shape, PRIOR.path))
        for ray in rays
    ]
    assert posterior.log_likelihood(scan_of(rays), HERE) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    for most in (0, 2**28):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(beam_model, "_MOST_IN_FULL", most)
            found = DecayRatePosterior(sparse, PRIOR).log_likelihood(scan_of(rays), HERE)
        assert found == pytest.approx(expected, rel=1e-5, abs=1e-4)


@given(SEEDS)
def test_probability_adds_up_to_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = Grid((-1.0, -1.0, -1.0), 0.5, (5, 6, 4))
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    origin = rng.uniform(-1, 1, 3)
    statistics = counted(grid, seed, 1.0)
    crossings = [piece.stop for piece in naive.pieces(Ray(origin, direction, LIMITS[1], 0), grid)]
    edges = [LIMITS[0], *(t for t in crossings if LIMITS[0] < t < LIMITS[1]), LIMITS[1]]
    # Parts that grow with the distance from where a piece begins, as a prior's density falls steeply there.
    edges = np.unique([a + (b - a) * step for a, b in pairwise(edges) for step in (0, 0.01, 0.06, 0.2, 0.5, 1)])
    halves = np.diff(edges)[:, None] / 2
    ranges = ((edges[:-1] + edges[1:])[:, None] / 2 + halves * NODES).ravel()
    rays = [Ray(origin, direction, r, RayStatus.RETURN) for r in ranges]
    rays += [Ray(origin, direction, 1.0, status) for status in (RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN)]
    for counts in (statistics, BrickStatistics.from_dense(statistics)):
        for model in (DecayRateMap(counts, PRIOR), DecayRatePosterior(counts, PRIOR)):
            *density, sub, sup = np.exp(model.log_likelihood(scan_of(rays), HERE))
            assert sub + sup + (halves * WEIGHTS).ravel() @ density == pytest.approx(1.0, abs=1e-6)


def test_a_prior_is_learned_from_sparse_maps_as_from_dense_ones() -> None:
    statistics = counted(Grid((0, 0, 0), 0.5, (20, 30, 10)), 4)
    dense, sparse = (DecayRateMap.from_statistics(s) for s in (statistics, BrickStatistics.from_dense(statistics)))
    assert sparse.prior.shape == pytest.approx(dense.prior.shape, rel=1e-4)
    assert sparse.prior.path == pytest.approx(dense.prior.path, rel=1e-4)
