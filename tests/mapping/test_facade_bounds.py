"""Facade bounds: no truth within the declared errors is lost, and they are as tight as the derivation says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import MapError
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facades import Facades

ORIGIN = np.array([3.25, -1.5])
WALLS = 400
DRAWS = 500


def scene(seed: int) -> Facades:
    rng = np.random.default_rng(seed)
    start, length = rng.uniform(-80, 80, (WALLS, 2)), rng.uniform(0.2, 40, WALLS)
    direction = rng.uniform(-np.pi, np.pi, WALLS)
    direction[:17] = np.arange(-8, 9) * np.pi / 4  # along the axes, where directions have seams
    end = start + length[:, None] * np.column_stack([np.cos(direction), np.sin(direction)])
    shifts, errors = rng.uniform(0, 2, WALLS), rng.uniform(0, 0.3, WALLS)
    shifts[::7], errors[::5] = 0, 0
    return Facades(np.stack([start, end], 1), np.arange(WALLS), shifts, errors)


def truths(facades: Facades, rng: np.random.Generator, extreme: bool):
    """True ends and lines within the errors, in extended precision, about the origin."""
    draws = rng.uniform(-1, 1, (3, len(facades), 2)).astype(np.longdouble)
    draws = np.sign(draws) if extreme else draws
    shift = draws[0] * facades.shifts[:, None]
    a, b = (
        facades.segments[:, end]
        - ORIGIN.astype(np.longdouble)
        + shift
        + draws[1 + end] * facades.vertex_errors[:, None]
        for end in (0, 1)
    )
    alpha = np.arctan2(a[:, 0] - b[:, 0], b[:, 1] - a[:, 1])
    return a, b, alpha, a[:, 0] * np.cos(alpha) + a[:, 1] * np.sin(alpha)


def inside(interval, values) -> np.ndarray:
    return (interval.lo <= values) & (values <= interval.hi)


@pytest.mark.parametrize("extreme", [False, True])
def test_no_truth_is_lost(extreme: bool) -> None:
    facades, rng = scene(1), np.random.default_rng(2)
    bounds = FacadeBounds.of(facades, ORIGIN)
    lost = 0
    for _ in range(DRAWS):
        a, b, alpha, d = truths(facades, rng, extreme)
        turns = np.round((alpha - bounds.alpha.mid) / (2 * np.pi)) * (2 * np.arccos(np.longdouble(-1)))
        good = inside(bounds.alpha, alpha - turns) & inside(bounds.d, d)
        for box, point in ((bounds.first, a), (bounds.second, b), (bounds.hull, (a + b) / 2)):
            good &= inside(box[0], point[:, 0]) & inside(box[1], point[:, 1])
        lost += int((~good).sum())
    assert lost == 0


def test_the_check_finds_bounds_that_are_too_tight() -> None:
    facades, rng = scene(1), np.random.default_rng(2)
    careless = Facades(facades.segments, facades.buildings, facades.shifts, 0.9 * facades.vertex_errors)
    bounds = FacadeBounds.of(careless, ORIGIN)
    lost_angles = lost_distances = 0
    for _ in range(20):
        _, _, alpha, d = truths(facades, rng, True)
        turns = np.round((alpha - bounds.alpha.mid) / (2 * np.pi)) * (2 * np.pi)
        lost_angles += int((~inside(bounds.alpha, alpha - turns)).sum())
        lost_distances += int((~inside(bounds.d, d)).sum())
    assert lost_angles > 100
    assert lost_distances > 100


def turn(ratio: float, error: float, direction: float) -> float:
    """How far a wall of so many vertex errors may turn to either side of its mapped direction."""
    end = ratio * error * np.array([math.cos(direction), math.sin(direction)])
    alpha = FacadeBounds.of(Facades([[[0, 0], end]], [0], [1.0], [error])).alpha
    mapped = direction - math.pi / 2 + 2 * math.pi * round((alpha.mid[0] - direction + math.pi / 2) / (2 * math.pi))
    return float(max(alpha.hi[0] - mapped, mapped - alpha.lo[0]))


def formula(ratio: float) -> float:
    return math.atan(2 * math.sqrt(2) / (ratio - 2))


@given(st.floats(0.001, 0.5), st.floats(3.0, 1000.0), st.floats(-np.pi, np.pi))
def test_directions_keep_to_the_formula(error: float, ratio: float, direction: float) -> None:
    found = turn(ratio, error, direction)
    # A wall along an axis is the best case, a diagonal one the worst.
    assert math.atan(2 / (ratio + 2)) <= found <= formula(ratio) * (1 + 1e-9)


def test_shorter_walls_may_turn_by_more_than_the_formula() -> None:
    """Its limit is three vertex errors, met where the second corner leads."""
    directions = np.linspace(0, math.pi / 2, 201)
    assert max(turn(2.9, 0.5, t) for t in directions) > 1.05 * formula(2.9)
    assert max(turn(3.0, 0.5, t) for t in directions) == pytest.approx(formula(3.0), rel=1e-3)
    assert turn(0.1, 0.5, 0.3) >= math.pi


def test_a_near_origin_makes_tight_distances() -> None:
    wall = Facades([[[95, 100], [105, 100.0]]], [0], [0.5], [0.1])
    near, far = FacadeBounds.of(wall, (100, 95)), FacadeBounds.of(wall)
    # Between the ends, the line is off by the vertex error and the shift, as far as its direction allows.
    assert near.d.width[0] / 2 == pytest.approx(0.6, abs=0.02)
    # From the old origin, the lever is 100 m beyond an end of 10 m.
    assert far.d.width[0] / 2 == pytest.approx(0.5 + 0.1 * 19, abs=0.2)
    # The building is on the left, so its outside is in the south, and it is seen from there.
    assert near.alpha.contains([-math.pi / 2]).all()
    assert near.d.hi[0] < 0


def test_selection_and_origins() -> None:
    bounds = FacadeBounds.of(scene(3))
    assert len(bounds.select([5, 2])) == 2
    assert bounds.select([5, 2]).d.lo.tolist() == bounds.d.lo[[5, 2]].tolist()
    with pytest.raises(MapError, match="origin"):
        FacadeBounds.of(scene(3), (0, math.nan))
