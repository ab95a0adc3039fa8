"""The posterior term against the densities it stands for, and against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from strategies import floats

from factorloc.errors import MapError
from factorloc.factors import PosteriorTerm
from factorloc.factors._posterior_kernels import pass_cell
from factorloc.mapping import DecayRatePosterior, Grid, RayStatistics
from factorloc.mapping.posterior_pyramid import PosteriorLevel, PosteriorPyramid
from factorloc.mapping.prior import GammaPrior
from factorloc.rays import Rays
from factorloc.scan import RayStatus

GRID = Grid((-1.0, 2.0), 0.1, (40, 30))
PRIOR = GammaPrior(0.2, 0.5)


@given(floats(1e-6, 1e3), floats(-3, 3), floats(-6, 3))
def test_a_cell_is_passed_by_the_logarithm_at_the_effective_rate(a, log_b, log_ratio) -> None:
    b = 10**log_b
    r = b * 10**log_ratio
    cost, rate = pass_cell(a, b, r)
    assert cost == pytest.approx(a * np.log1p(r / b), rel=2e-13)
    assert rate == pytest.approx(a / (b + r), rel=1e-14)


def test_the_short_series_meets_the_logarithm() -> None:
    for ratio in (0.125 * (1 - 1e-12), 0.125, 0.1, 1e-9, 0.0):
        assert pass_cell(3.0, 2.0, 2.0 * ratio)[0] == pytest.approx(3.0 * np.log1p(ratio), rel=2e-13, abs=0)


def test_passing_has_the_probability_of_the_posterior(statistics, drawn, make_term) -> None:
    scan, pose = drawn[0][44], drawn[1][44]
    posterior = DecayRatePosterior.from_statistics(statistics)
    pyramid = PosteriorPyramid.from_statistics(statistics, [0.0])
    assert posterior.prior == pyramid.prior
    (level,) = pyramid.levels
    bare = replace(pyramid, levels=(replace(level, log_rates=np.zeros_like(level.log_rates)),))
    far = 2.5
    through = replace(scan, status=np.full(len(scan), RayStatus.NO_RETURN, np.uint8), range_limits=(0.1, far))
    ends = replace(through, status=np.zeros(len(scan), np.uint8), ranges=np.full(len(scan), far))
    cost = PosteriorTerm(bare, [ends]).cost(pose[None])[0]
    assert cost == pytest.approx(-posterior.log_likelihood(through, pose).sum(), rel=1e-10)


def tabled(shapes: np.ndarray, paths: np.ndarray, log_rates: np.ndarray, rays: Rays) -> PosteriorTerm:
    level = PosteriorLevel(0.0, shapes.ravel(), paths.ravel(), log_rates.ravel(), -10.0)
    return PosteriorTerm(PosteriorPyramid(GRID, PRIOR, (level,)), rays)


def one_ray(origin, angle: float, length: float) -> Rays:
    direction = [[np.cos(angle), np.sin(angle)]]
    return Rays(np.array([origin]), np.array(direction), np.array([length]), np.zeros(1, np.uint8), np.array([0, 1]))


def filled(shape: float, path: float) -> tuple[np.ndarray, np.ndarray]:
    size = tuple(n + 2 for n in GRID.shape)
    return np.full(size, shape), np.full(size, path)


def test_a_line_between_two_cells_is_pushed_by_their_effective_rates() -> None:
    shapes, paths = filled(1.0, 4.0)
    shapes[12], paths[12] = 30.0, 0.4  # cells 11 along x, beyond the line at x = 0.1
    x, r_before, r_after = 0.1, 0.07, 0.05
    term = tabled(shapes, paths, np.zeros(shapes.shape), one_ray([0.0, 0.0], 0.0, r_before + r_after))
    costs = term.batch([[x - r_before, 3.04, 0.0]])
    assert costs.cost[0] == pytest.approx(np.log1p(r_before / 4.0) + 30 * np.log1p(r_after / 0.4), rel=1e-12)
    slope = 30 / (0.4 + r_after) - 1 / (4.0 + r_before)
    assert costs.gradient[0] == pytest.approx([slope, 0, 0], rel=1e-12)


def test_before_and_behind_the_grid_is_one_cell() -> None:
    shapes, paths = filled(0.0, 1.0)
    term = tabled(shapes, paths, np.zeros(shapes.shape), one_ray([0.0, 0.0], 0.3, 9.0))
    pose = np.array([-2.0, 2.2, 0.0])
    t_in, t_out = 1.0 / np.cos(0.3), min(5.0 / np.cos(0.3), 2.8 / np.sin(0.3))
    outside = 9.0 - (t_out - t_in)
    costs = term.batch(pose[None])
    log_end = np.log(PRIOR.shape / (PRIOR.path + 0.05))
    assert costs.cost[0] == pytest.approx(PRIOR.shape * np.log1p(outside / PRIOR.path) - log_end, rel=1e-12)
    # It enters and leaves across x: moved along x, it passes as much of the outside.
    assert costs.gradient[0, :2] == pytest.approx([0, 0], abs=1e-12)
    per_radian = PRIOR.shape / (PRIOR.path + outside) * (t_in - t_out) * np.tan(0.3)
    assert costs.gradient[0, 2] == pytest.approx(per_radian, rel=1e-9)


@pytest.mark.parametrize("angle", np.arange(8) * np.pi / 4)
def test_rays_along_lines_and_diagonals_pass_as_far_as_they_are_long(angle) -> None:
    shapes, paths = filled(2.0, 1e6)  # so much path that all lengths count alike
    term = tabled(shapes, paths, np.zeros(shapes.shape), one_ray([0.0, 0.0], angle, 0.8))
    for x, y in [(0.5, 3.5), (0.5, 3.55), (0.55, 3.5), (0.5 + 1e-12, 3.5)]:
        costs = term.batch([[x, y, 0.0]])
        assert costs.cost[0] == pytest.approx(2.0 * 0.8e-6, rel=1e-5)
        assert np.isfinite(costs.gradient).all()


def test_what_a_cell_barely_knows_counts_less_than_in_the_most_likely_map() -> None:
    """Two maps of equal mean rates: a ray through cells of little evidence pays less."""
    rays = one_ray([0.0, 0.0], 0.2, 2.0)
    costs = []
    for evidence in (1e6, 1.0, 0.05):
        shapes, paths = filled(3.0 * evidence, evidence)
        costs.append(tabled(shapes, paths, np.zeros(shapes.shape), rays).cost([[0.0, 3.0, 0.0]])[0])
    assert costs[0] == pytest.approx(6.0, rel=1e-6)
    assert costs[0] > costs[1] > costs[2] > 0


def test_pyramids_blur_counts_and_keep_the_prior(statistics) -> None:
    pyramid = PosteriorPyramid.from_statistics(statistics, (0.3, 0.0), PRIOR)
    assert (pyramid.blurs, pyramid.prior) == ((0.3, 0.0), PRIOR)
    size = tuple(n + 2 for n in statistics.grid.shape)
    blurred, fine = pyramid.levels
    assert fine.shapes.reshape(size)[1:-1, 1:-1] == pytest.approx(statistics.hits + PRIOR.shape)
    assert fine.paths.reshape(size)[1:-1, 1:-1] == pytest.approx(statistics.path_lengths + PRIOR.path)
    for level in pyramid.levels:
        a, b = level.shapes.reshape(size), level.paths.reshape(size)
        for edge in (a[0], a[-1], a[:, 0], a[:, -1]):
            assert (edge == PRIOR.shape).all()
        assert (b[0] == PRIOR.path).all()
        assert level.log_rates == pytest.approx(np.log(level.shapes / (level.paths + 0.05)))
        assert level.least_nll == pytest.approx(-level.log_rates.max() - 0.5)
    # What is blurred is spread, not lost, but for what leaves the grid.
    inner = blurred.shapes.reshape(size)[1:-1, 1:-1] - PRIOR.shape
    assert inner.max() < statistics.hits.max()
    assert 0.8 * statistics.hits.sum() < inner.sum() <= statistics.hits.sum() * (1 + 1e-9)


def test_what_makes_no_pyramid_is_refused(statistics) -> None:
    for blurs in [(), (0.1, 0.5), (0.5, 0.5), (0.5, -0.1)]:
        with pytest.raises(MapError, match="decreasing"):
            PosteriorPyramid.from_statistics(statistics, blurs)
    with pytest.raises(MapError, match="no cell was hit"):
        PosteriorPyramid.from_statistics(RayStatistics.empty(GRID))
    with pytest.raises(MapError, match="spatial"):
        PosteriorPyramid.from_statistics(RayStatistics.empty(Grid((0, 0, 0), 0.5, (4, 4, 4))))
