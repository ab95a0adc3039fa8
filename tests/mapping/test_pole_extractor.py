"""The pole extractor: kernels against obvious twins, and poles that are found where they stand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pole_yard import POLES, drive, full_size
from scipy.special import betaincc, betaln

from factorloc.errors import ConfigError, MapError
from factorloc.geometry import se2
from factorloc.mapping._pole_kernels import (
    fill_tail_table,
    find_seeds,
    score_slice,
    shift_to_modes,
    stack_columns,
    width_weights,
)
from factorloc.mapping.grid import Grid
from factorloc.mapping.pole_extractor import PoleExtractor, occupancy
from factorloc.mapping.pole_settings import BY_EVIDENCE, KITTI_LIKE, NCLT_LIKE
from factorloc.mapping.reflection_window import ReflectionWindow
from factorloc.scan import Scan


def naive_argument(o: np.ndarray, x: int, y: int, a: int, f: int) -> float:
    around = o[x - f : x + a + f, y - f : y + a + f].copy()
    around[f:-f, f:-f] = 0
    return float(o[x : x + a, y : y + a].astype(float).mean() - around.max())


def naive_scores(o: np.ndarray, widths: list[int], f: int, least: float) -> np.ndarray:
    """Greatest argument of all boxes that cover each cell."""
    scores = np.full(o.shape, -1.0)
    for a in widths:
        for x in range(f, o.shape[0] - a - f + 1):
            for y in range(f, o.shape[1] - a - f + 1):
                if (value := naive_argument(o, x, y, a, f)) > least:
                    scores[x : x + a, y : y + a] = np.maximum(scores[x : x + a, y : y + a], value)
    return scores


@pytest.mark.parametrize(("f", "least"), [(1, 0.1), (2, 0.6), (3, 0.3)])
def test_scores_of_a_slice_are_those_of_the_definition(f: int, least: float) -> None:
    rng = np.random.default_rng(f)
    o = (0.2 * rng.random((22, 19))).astype(np.float32)
    o[8:10, 7:9] = 0.95
    o[15, 13] = 0.9
    o[2:5, 14:17] = 0.85
    widths = np.array([1, 2, 3, 4])
    sums, scores = np.empty((23, 20)), np.empty(o.shape, np.float32)
    score_slice(o, widths, f, least, sums, scores)
    expected = naive_scores(o, [1, 2, 3, 4], f, least)
    assert np.allclose(scores, expected, atol=1e-6)
    assert (expected > least).sum() > 4


def test_stacks_are_the_highest_runs() -> None:
    rng = np.random.default_rng(0)
    scores = np.where(rng.random((12, 6, 5)) < 0.7, rng.uniform(0.61, 1, (12, 6, 5)), -1.0).astype(np.float32)
    stacked, totals = np.empty((6, 5)), np.empty((6, 5))
    bottoms, tops, running = (np.empty((6, 5), np.int64) for _ in range(3))
    stack_columns(scores, 0.6, 3, running, totals, stacked, bottoms, tops)
    for x, y in np.ndindex(6, 5):
        column = scores[:, x, y] > 0.6
        runs = [(i, j) for i in range(12) for j in range(i + 3, 13) if column[i:j].all()]
        if not runs:
            assert stacked[x, y] == 0
            continue
        i, j = max(runs, key=lambda run: (run[1] - run[0], -run[0]))
        assert (bottoms[x, y], tops[x, y]) == (i, j)
        assert stacked[x, y] == pytest.approx(scores[i:j, x, y].astype(float).mean())


@pytest.mark.parametrize(("alpha", "beta", "above"), [(0.01, 0.6, 0.2), (1.0, 1.0, 0.2), (0.3, 2.0, 0.7)])
def test_the_table_of_tails_is_the_beta_distribution(alpha: float, beta: float, above: float) -> None:
    table = np.empty((40, 300))
    term = math.exp(alpha * math.log(above) + beta * math.log1p(-above) - betaln(alpha, beta))
    fill_tail_table(float(betaincc(alpha, beta, above)), term, alpha, beta, above, table)
    h, m = np.indices(table.shape)
    assert np.abs(table - betaincc(h + alpha, m + beta, above)).max() < 1e-12


def test_occupancy_beyond_the_table_is_computed() -> None:
    grid = Grid((0.0, 0.0, 0.0), 0.1, (3, 3, 3))
    hits, misses = (np.zeros((5, 5, 5), np.uint32) for _ in range(2))
    hits[2, 2, 2], misses[2, 2, 2] = 1000, 3000
    hits[1, 1, 1], misses[1, 1, 2] = 1, 5
    o = occupancy(ReflectionWindow(grid, hits, misses), 0.2)
    assert o is not None
    assert o[1, 1, 1] == pytest.approx(1.0, abs=1e-6)  # 0.25 after 4000 rays is surely more than 0.2
    assert o[0, 0, 0] > 0.5 > o[0, 0, 1]
    hits[:] = 0
    assert occupancy(ReflectionWindow(grid, hits, misses), 0.2) is None


def test_mean_shift_climbs_to_the_mode_between_cells() -> None:
    x, y = np.indices((30, 30))
    scores = np.exp(-((x - 11.3) ** 2 + (y - 17.8) ** 2) / 8) + 0.5 * np.exp(-((x - 22) ** 2 + (y - 5) ** 2) / 8)
    scores[scores < 0.05] = 0
    seeds = np.empty((9, 2))
    count = find_seeds(scores, seeds)
    assert count == 2
    modes = seeds[:count].copy()
    shift_to_modes(scores, 1.0, 5, modes)
    assert np.abs(modes - [[11.3, 17.8], [22, 5]]).max() < 0.05


def test_width_weights_are_means_of_the_best_boxes_that_cover_a_column() -> None:
    rng = np.random.default_rng(3)
    o = (0.1 * rng.random((4, 15, 15))).astype(np.float32)
    o[:, 6:8, 7:9] = rng.uniform(0.8, 1, (4, 2, 2))
    cells, widths = np.array([[6, 8]]), np.array([1, 2, 3])
    weights = np.empty((1, 3))
    width_weights(o, cells, np.array([1]), np.array([4]), widths, 1, np.empty((16, 16)), weights)
    for k, a in enumerate(widths.tolist()):
        covering = [(x, y) for x in range(7 - a, 7) for y in range(9 - a, 9)]
        best = [max(0.0, *(naive_argument(o[z], x, y, a, 1) for x, y in covering)) for z in range(1, 4)]
        assert weights[0, k] == pytest.approx(np.mean(best), abs=1e-6)
    assert weights[0, 1] > weights[0, 2] > weights[0, 0]


@pytest.fixture(scope="module")
def yard() -> tuple[list[Scan], np.ndarray]:
    return drive()


@full_size
@pytest.mark.parametrize(
    # In cells of 0.1 m, only the near half of the thick poles is ever seen: their boxes are not full.
    ("settings", "reach", "least"),
    [(KITTI_LIKE, 0.12, 2), (NCLT_LIKE, 0.15, 3), (BY_EVIDENCE, 0.05, 4)],
)
def test_poles_are_found_where_they_stand(
    settings: object, reach: float, least: int, yard: tuple[list[Scan], np.ndarray]
) -> None:
    poles = PoleExtractor(settings).extract(*yard)  # type: ignore[arg-type]
    distances = np.linalg.norm(poles.positions[:, None] - POLES[:, :2], axis=-1)
    assert (distances.min(1) < reach).all()  # the wall, 30 m of it, is no pole
    assert (distances.min(0) < reach).sum() >= least
    assert (np.diff(poles.scores) <= 0).all()
    assert (poles.spans[:, 1] - poles.spans[:, 0] >= settings.least_height - 1e-9).all()  # type: ignore[attr-defined]
    assert poles.spans.min() > -0.3


@full_size
def test_fitted_axes_and_widths_are_finer_than_cells(yard: tuple[list[Scan], np.ndarray]) -> None:
    poles = PoleExtractor(BY_EVIDENCE).extract(*yard)
    distances = np.linalg.norm(poles.positions[:, None] - POLES[:, :2], axis=-1)
    assert distances.min(0).max() < 0.03
    assert np.abs(poles.widths - POLES[distances.argmin(1), 2]).max() < 0.04
    coarse = PoleExtractor(BY_EVIDENCE.replaced(fit=False)).extract(*yard)
    assert np.linalg.norm(coarse.positions[:, None] - POLES[:, :2], axis=-1).min(0).max() > 0.03


@full_size
def test_evidence_bridges_gaps_between_beams_that_break_published_stacks() -> None:
    scans, poses = drive(beams=12, count=2)
    published = PoleExtractor(BY_EVIDENCE.replaced(evidence=None, fit=False)).extract(scans, poses)
    found = PoleExtractor(BY_EVIDENCE).extract(scans, poses)
    near = np.linalg.norm(found.positions[:, None] - POLES[:, :2], axis=-1).min(0) < 0.1
    assert near.sum() >= 3 > len(published)
    assert len(found) == near.sum()


def test_the_raster_of_windows_is_that_of_the_frame() -> None:
    extractor = PoleExtractor(KITTI_LIKE)
    one, other = extractor.window([12.34, -7.7, 1.8]), extractor.window([13.0, -7.0, 2.2])
    assert one.shares_raster(other)
    assert one.shape == (300, 300, 30)
    assert one.origin[2] == pytest.approx(-0.2)
    with pytest.raises(MapError, match="finite coordinates"):
        extractor.window([np.nan, 0, 0])


@full_size
def test_another_frame_moves_the_poles_along(yard: tuple[list[Scan], np.ndarray]) -> None:
    scans, poses = yard
    T = np.array([100.0, -50.0, 0.7])
    moved = PoleExtractor(BY_EVIDENCE).extract(scans, se2.compose(T, poses))
    here = PoleExtractor(BY_EVIDENCE).extract(scans, poses).transformed(T)
    distances = np.linalg.norm(moved.positions[:, None] - here.positions, axis=-1)
    assert distances.min(1).max() < 0.05


@full_size
def test_no_scans_no_returns_and_no_poles_are_none(yard: tuple[list[Scan], np.ndarray]) -> None:
    scans, poses = yard
    extractor = PoleExtractor(BY_EVIDENCE)
    assert len(extractor.extract([], np.empty((0, 3)))) == 0
    for settings in (BY_EVIDENCE, NCLT_LIKE):
        assert len(PoleExtractor(settings).extract([scans[0].select(np.zeros(0, np.int64))], poses[:1])) == 0
        ground = scans[0].select(scans[0].directions[:, 2] < -0.35)
        assert len(PoleExtractor(settings).extract([ground], poses[:1])) == 0
    with pytest.raises(MapError, match="one pose for each"):
        extractor.extract(scans, poses[:2])


def test_settings_that_leave_no_room_are_refused() -> None:
    with pytest.raises(ConfigError, match="leaves no room"):
        NCLT_LIKE.replaced(size=(1.0, 30.0, 5.0))
    with pytest.raises(ConfigError, match="least_height"):
        NCLT_LIKE.replaced(least_height=6.0)
