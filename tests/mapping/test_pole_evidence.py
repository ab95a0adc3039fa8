"""Evidence for poles: kernels against obvious twins."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import betabinom

from factorloc.errors import ConfigError
from factorloc.mapping._pole_evidence_kernels import best_runs, choose_boxes, fill_evidence, hull_evidence
from factorloc.mapping.pole_evidence import evidence_tables
from factorloc.mapping.pole_settings import EvidenceSettings


def test_tables_are_ratios_of_beta_binomial_probabilities() -> None:
    settings = EvidenceSettings(most_rays=6)
    shaft, clutter = evidence_tables(settings)
    for h, m in [(0, 0), (3, 1), (0, 6), (2, 4), (6, 0)]:
        probabilities = [
            betabinom.logpmf(h, h + m, *beta) for beta in (settings.shaft, settings.clutter, settings.free)
        ]
        assert shaft[h, m] == pytest.approx(probabilities[0] - probabilities[2], abs=1e-9)
        assert clutter[h, m] == pytest.approx(probabilities[1] - probabilities[2], abs=1e-9)
    assert shaft[0, 0] == 0.0
    assert shaft[3, 1] > 0 > shaft[0, 6]


def naive_run(evidence: np.ndarray, height: int) -> float:
    """Greatest sum of a run, where runs begin anew whenever a sum falls to zero."""
    best, begin, total = 0.0, 0, 0.0
    for z, value in enumerate(evidence):
        total += value
        if total <= 0:
            begin, total = z + 1, 0.0
        elif total > best and z + 1 - begin >= height:
            best = total
    return best


@pytest.mark.parametrize(("a", "f"), [(1, 1), (2, 1), (3, 2)])
def test_runs_hulls_and_sums_are_those_of_the_definition(a: int, f: int) -> None:
    rng = np.random.default_rng(a)
    shape = (7, 13, 12)
    hits = np.zeros((9, 15, 14), np.uint32)
    misses = np.zeros_like(hits)
    hits[1:-1, 1:-1, 1:-1] = rng.integers(0, 4, shape) * (rng.random(shape) < 0.3)
    misses[1:-1, 1:-1, 1:-1] = rng.integers(0, 12, shape)
    hits[2:8, 6 : 6 + a, 5 : 5 + a] = 7
    settings = EvidenceSettings(most_rays=8)
    tables = evidence_tables(settings)
    shaft, clutter = np.empty((7, 14, 13)), np.empty((7, 14, 13))
    fill_evidence(hits, misses, *tables, 0, 7, shaft, clutter)

    h, m = (counts[1:-1, 1:-1, 1:-1].astype(np.int64) for counts in (hits, misses))
    n = np.maximum(h + m, 8)
    scaled = np.where(h + m > 8, np.floor(h * 8 / n + 0.5).astype(np.int64), h)
    rest = np.where(h + m > 8, 8 - scaled, m)
    of_shaft, of_clutter = tables[0][scaled, rest], tables[1][scaled, rest]

    best, current = np.empty((13, 12)), np.empty((13, 12))
    starts, bottoms, tops = (np.empty((13, 12), np.int64) for _ in range(3))
    best_runs(shaft, clutter, a, f, 3, current, starts, best, bottoms, tops)
    for x in range(f, 13 - a - f + 1):
        for y in range(f, 12 - a - f + 1):
            inside = of_shaft[:, x : x + a, y : y + a].sum((1, 2))
            around = of_clutter[:, x - f : x + a + f, y - f : y + a + f].sum((1, 2))
            assert best[x, y] == pytest.approx(naive_run(inside - np.maximum(around, 0), 3), abs=1e-9)
    assert best.max() > 0

    boxes, most = np.array([[6, 5, a]]), np.empty(1)
    hull_evidence(shaft, boxes, np.array([1]), np.array([6]), f, most)
    columns = of_shaft[1:6, 6 - f : 6 + a + f, 5 - f : 5 + a + f].sum(0)
    columns[f:-f, f:-f] = -np.inf
    assert most[0] == pytest.approx(columns.max())


def test_of_boxes_that_meet_the_first_is_chosen() -> None:
    boxes = np.array([[5, 5, 2], [6, 6, 1], [8, 5, 1], [12, 5, 2], [5, 8, 1]])
    chosen, taken = np.zeros(5, np.bool_), np.zeros((20, 20), np.bool_)
    choose_boxes(boxes, np.array([0, 1, 2, 3, 4]), 2, taken, chosen)
    assert chosen.tolist() == [True, False, False, True, False]
    taken[:] = False
    choose_boxes(boxes, np.array([1, 0, 2, 3, 4]), 2, taken, chosen)
    assert chosen.tolist() == [False, True, False, True, False]


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(ConfigError, match="most_rays"):
        EvidenceSettings(most_rays=0)
    with pytest.raises(ConfigError, match="shaft"):
        EvidenceSettings(shaft=(0.0, 1.0))
