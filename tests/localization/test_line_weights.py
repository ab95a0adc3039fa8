"""Weights of doubtful lines: against enumeration, and what doubt grows with."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.localization._facade_kernels import weigh_satisfied
from factorloc.localization._line_kernels import PEAK
from factorloc.localization.line_doubt import DoubtSettings, doubts, marks
from factorloc.localization.line_weights import likely_depth, surprising_weight, weights_of

some_doubts = st.lists(st.floats(0.002, 0.45), min_size=1, max_size=8).map(np.array)


@given(some_doubts)
def test_weights_are_log_odds_in_eighths(doubt: np.ndarray) -> None:
    weights = weights_of(doubt)
    assert (weights >= 1).all()
    odds = 8 * np.log((1 - doubt) / doubt)
    assert (np.abs(weights - odds) <= np.where(odds < 1, 1.0, 0.5) + 1e-9).all()
    assert (np.diff(weights[np.argsort(doubt)]) <= 0).all()


@given(some_doubts, st.sampled_from([0.3, 0.05, 1e-3, 1e-6]))
def test_surprising_weight_is_that_of_all_subsets(doubt: np.ndarray, surprise: float) -> None:
    weights = weights_of(doubt)
    chances: dict[int, float] = {}
    for false in itertools.product([False, True], repeat=len(doubt)):
        mask = np.array(false)
        chance = float(np.where(mask, doubt, 1 - doubt).prod())
        weight = int(weights[mask].sum())
        chances[weight] = chances.get(weight, 0.0) + chance
    limit = surprising_weight(weights, doubt, surprise)
    assert sum(c for w, c in chances.items() if w > limit) <= surprise + 1e-9
    if limit > 0:
        assert sum(c for w, c in chances.items() if w > limit - 1) > surprise - 1e-9


@given(
    st.lists(st.integers(-1, 60), min_size=1, max_size=200).filter(lambda sums: max(sums) >= 0),
    st.sampled_from([0.5, 0.9, 0.999]),
)
def test_poses_left_out_hold_no_more_than_the_rest_of_the_odds(sums: list[int], confidence: float) -> None:
    cells = np.array(sums)
    below = int(cells.max()) - cells[cells >= 0]
    # Of two parts whose cells have one volume; the same in one.
    parts = [np.bincount(below[0::2], minlength=1), np.bincount(below[1::2], minlength=1)]
    depth = likely_depth([0.3 * part for part in parts], confidence)
    assert depth == likely_depth([0.3 * np.bincount(below)], confidence)
    odds = np.exp(-below / 8.0)
    assert odds[below > depth].sum() <= (1 - confidence) * odds.sum() + 1e-9
    # One level less would leave out too much.
    assert odds[below >= depth].sum() >= (1 - confidence) * odds.sum() - 1e-9
    assert depth >= 0


def peak(**changes: float) -> np.ndarray:
    """A line with 80 votes, no rival, 0.4 m wide, supporters over 10 m."""
    columns = {"votes": 0, "second": 1, "low": 4, "high": 5, "coverage": 6, "begin": 7, "end": 11}
    row = np.zeros((1, PEAK))
    plain = {"votes": 80.0, "second": 0.0, "low": 0.0, "high": 0.4, "coverage": 1.0, "begin": -5.0, "end": 5.0}
    values = plain | changes
    for name, value in values.items():
        row[0, columns[name]] = value
    return row


def doubt_of(
    row: np.ndarray, length: float = 10.0, seen: float = 1.0, error: float = 0.3, window: float = 10.0
) -> float:
    found = doubts(marks(row, *(np.array([v]) for v in (length, seen, error, window))), DoubtSettings())
    return float(found[0])


def test_doubt_grows_with_rivals_and_shrinks_with_votes() -> None:
    plain = doubt_of(peak())
    assert plain == pytest.approx(1 / (1 + np.exp(4.71)))
    assert doubt_of(peak(second=40.0)) > 5 * plain
    assert doubt_of(peak(votes=30.0)) > plain
    assert doubt_of(peak(coverage=0.5)) > plain
    assert doubt_of(peak(), seen=0.2) > plain
    assert doubt_of(peak(), error=0.05) > plain
    assert doubt_of(peak(), window=3.0) < plain
    assert doubt_of(peak(), length=20.0, window=1.0, error=3.0) == DoubtSettings().least


def test_without_a_peak_there_is_no_doubt_to_tell() -> None:
    assert np.isnan(doubt_of(peak(votes=np.nan, low=5.0, high=-5.0)))


@given(st.integers(0, 2**31))
def test_no_cell_weighs_less_than_any_of_its_poses(seed: int) -> None:
    """Random strips, along and across, of facades with one line or more, and pairs that leave boxes; random points."""
    rng = np.random.default_rng(seed)
    slices, count, rows, cells, step = 2, 8, 4, 6, 0.5

    def strips(*shape: int) -> np.ndarray:
        turns = rng.choice([0.0, np.pi / 2, np.nan], shape)
        turns = np.where(np.isnan(turns), rng.uniform(-np.pi, np.pi, shape), turns)
        middle, half = rng.uniform(-1.5, 1.5, shape), rng.uniform(-0.1, 1.0, shape)
        return np.stack([np.cos(turns), np.sin(turns), middle - half, middle + half], -1)

    normal, across, boxes = strips(slices, count), strips(slices, count), strips(slices, 2, 2)
    groups = np.array([0, 1, 2, 3, 4, 5, 8])  # the last facade has three lines
    pairs = np.array([[0, 1, 0, 1], [2, 4, 2, 4]])
    weights = rng.integers(1, 50, len(groups) - 1).astype(np.int32)
    sums = np.empty((slices, rows, cells), np.int32)
    room = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(cells + 1, np.int32)
    weigh_satisfied(normal, across, boxes, pairs, groups, weights, -1.5, -1.0, step, *room, sums)

    def holds(limits: np.ndarray, point: np.ndarray) -> np.ndarray:
        value = limits[..., :2] @ point
        return (limits[..., 2] <= value) & (value <= limits[..., 3])

    for j, y, x in itertools.product(range(slices), range(rows), range(cells)):
        for point in np.array([-1.5 + step * x, -1.0 + step * y]) + step * rng.random((5, 2)):
            lines = holds(normal[j], point) & holds(across[j], point)
            satisfied = np.logical_or.reduceat(lines, groups[:-1])
            weight = int(weights[satisfied].sum())
            for pair, box in zip(pairs[:, 2:], boxes[j], strict=True):
                if satisfied[pair].all() and not holds(box, point).all():
                    weight -= int(weights[pair].min())
            assert weight <= sums[j, y, x] <= weights.sum()
