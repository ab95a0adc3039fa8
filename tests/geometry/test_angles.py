"""Angles stay in (-pi, pi] and keep their direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import angles, floats

from factorloc.geometry import circular_mean, unwrap, wrap


@given(floats(-1e4, 1e4))
def test_wrapped_angles_lie_in_the_half_open_turn_and_point_the_same_way(angle: float) -> None:
    turned = float(wrap(angle))
    assert -np.pi < turned <= np.pi
    np.testing.assert_allclose([np.cos(turned), np.sin(turned)], [np.cos(angle), np.sin(angle)], atol=1e-11)


@given(angles())
def test_wrapping_keeps_angles_in_range_to_the_last_bit(angle: float) -> None:
    assert float(wrap(angle)) == (angle if angle != -np.pi else np.pi)


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (np.pi, np.pi),
        (-np.pi, np.pi),
        (3 * np.pi, np.pi),
        (-3 * np.pi, np.pi),
        (2 * np.pi, 0.0),
        (np.nextafter(-np.pi, -4), np.nextafter(np.pi, 0)),
        (np.nextafter(np.pi, 4), np.nextafter(-np.pi, 0)),
        (1e-300, 1e-300),
    ],
)
def test_wrap_at_the_seam(angle: float, expected: float) -> None:
    turned = float(wrap(angle))
    assert -np.pi < turned <= np.pi
    # Either side of the seam is the right answer for an angle one rounding away from it.
    assert abs(np.exp(1j * turned) - np.exp(1j * expected)) < 1e-15
    if abs(angle) <= np.pi:
        assert turned == expected


def test_wrap_keeps_the_shape() -> None:
    assert wrap(4.0).shape == ()
    assert wrap(np.full((2, 0, 3), 7.0)).shape == (2, 0, 3)


@given(st.lists(angles(3.0), min_size=1, max_size=20))
def test_unwrap_undoes_wrap(steps: list[float]) -> None:
    continuous = np.cumsum(steps)
    offset = continuous[0] - float(wrap(continuous[0]))
    np.testing.assert_allclose(unwrap(wrap(continuous)) + offset, continuous, atol=1e-12)


def test_unwrap_follows_the_axis() -> None:
    turns = wrap(np.linspace(0, 9, 19))[:, None] * [1, -1]
    np.testing.assert_allclose(unwrap(turns, axis=0), np.linspace(0, 9, 19)[:, None] * [1, -1], atol=1e-12)


@given(angles(), angles(1.5))
def test_circular_mean_is_the_middle_of_a_symmetric_pair(middle: float, spread: float) -> None:
    mean = float(circular_mean([middle - spread, middle + spread]))
    assert -np.pi < mean <= np.pi
    assert abs(float(wrap(mean - middle))) < 1e-12


def test_circular_mean_across_the_seam_is_not_the_arithmetic_one() -> None:
    np.testing.assert_allclose(np.abs(circular_mean([np.pi - 0.1, -np.pi + 0.1])), np.pi)
    assert float(circular_mean([-np.pi])) == np.pi
    assert circular_mean(np.zeros((4, 3)), axis=0).shape == (3,)
