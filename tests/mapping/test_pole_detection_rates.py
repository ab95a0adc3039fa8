"""Rates of a simulated second drive: those it was made with come back, and the epsilon of the filter with them."""

import numpy as np
import pytest

from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping.local_maps import LocalMap
from factorloc.mapping.pole_detection_rates import PoleDetectionRates
from factorloc.mapping.pole_likelihood import clutter_density
from factorloc.mapping.poles import Poles

HALF = 15.0
CORNERS = np.array([[-HALF, -HALF], [HALF, HALF]])


def poles_at(positions: np.ndarray) -> Poles:
    n = len(positions)
    return Poles(positions, np.full(n, 0.2), np.tile([0.0, 3.0], (n, 1)), np.ones(n))


def second_drive(mapped: np.ndarray, found: float, clutter: float, seed: int, count: int = 300) -> list[LocalMap]:
    """Local maps that find so many of the poles, and so many other things a square metre."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        pose = np.array([*rng.uniform(0, 200, 2), rng.uniform(-np.pi, np.pi)])
        seen = se2.transform(se2.inverse(pose), mapped)
        seen = seen[(np.abs(seen) <= HALF).all(1) & (rng.random(len(seen)) < found)]
        other = rng.uniform(-HALF, HALF, (rng.poisson(clutter * 4 * HALF**2), 2))
        poles = poles_at(np.concatenate([seen + rng.normal(0, 0.08, seen.shape), other]))
        out.append(LocalMap(np.array([k]), float(k), pose, poles, CORNERS, se2.identity()))
    return out


@pytest.mark.parametrize(("spacing", "found", "clutter"), [(9.0, 0.9, 0.001), (7.0, 0.6, 0.004), (12.0, 0.4, 0.0)])
def test_known_rates_come_back(spacing: float, found: float, clutter: float) -> None:
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(*[np.arange(-20.0, 220.0, spacing)] * 2), -1).reshape(-1, 2)
    mapped = grid + rng.uniform(-2, 2, grid.shape)
    rates = PoleDetectionRates.of(mapped, second_drive(mapped, found, clutter, seed=1))
    assert rates.found_rate == pytest.approx(found, abs=0.03)
    assert rates.clutter == pytest.approx(clutter, rel=0.12, abs=1e-5)
    true_others = clutter * 4 * HALF**2 * 300
    total = rates.matched + rates.unmatched
    assert rates.epsilon == pytest.approx(clutter_density(total - true_others, true_others, 2.7), rel=0.15, abs=1e-3)
    assert f"{rates.found_rate:.0%} of" in str(rates)


def test_chance_is_the_area_near_poles() -> None:
    # One pole in the middle of one local map: a disc of the gate.
    one = LocalMap(np.array([0]), 0.0, np.array([5.0, -3.0, 0.7]), Poles.none(), CORNERS, se2.identity())
    rates = PoleDetectionRates.of([[5.0, -3.0]], [one], gate=3.0)
    assert rates.chance == pytest.approx(np.pi * 9 / 900, rel=0.1)
    assert (rates.found, rates.in_view, rates.matched, rates.unmatched) == (0, 1, 0, 0)
    assert rates.area == 900.0
    assert rates.epsilon == pytest.approx(1 / 3)  # nothing was seen of either kind: one of each is added


def test_a_map_full_of_poles_leaves_the_worst_case() -> None:
    grid = np.stack(np.meshgrid(np.arange(-20.0, 21.0), np.arange(-20.0, 21.0)), -1).reshape(-1, 2)
    one = LocalMap(np.array([0]), 0.0, np.zeros(3), poles_at(grid[:40]), CORNERS, se2.identity())
    rates = PoleDetectionRates.of(grid, [one])
    assert rates.chance == 1.0
    assert rates.others == 40
    assert np.isfinite(rates.epsilon)


def test_what_cannot_be_compared_is_refused() -> None:
    one = LocalMap(np.array([0]), 0.0, np.zeros(3), Poles.none(), CORNERS, se2.identity())
    with pytest.raises(MapError, match="no pole of the map was in view"):
        PoleDetectionRates.of([[500.0, 0.0]], [one])
    with pytest.raises(MapError, match="0 poles"):
        PoleDetectionRates.of(np.empty((0, 2)), [one])
    with pytest.raises(MapError, match="gate -1"):
        PoleDetectionRates.of([[0.0, 0.0]], [one], gate=-1.0)
