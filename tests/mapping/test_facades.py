"""Facades: what is kept and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from factorloc.errors import MapError
from factorloc.mapping.facade_bounds import FacadeBounds
from factorloc.mapping.facades import Facades

SEGMENTS = [[[0, 0], [3, 4]], [[3, 4], [3, 0]]]


def test_lengths_and_selection() -> None:
    facades = Facades(SEGMENTS, [7, 7], [1.5, 1.5], [0.2, 0.3])
    assert facades.lengths.tolist() == [5, 4]
    last = facades.select([1])
    assert len(last) == 1
    assert last.segments.tolist() == SEGMENTS[1:]
    assert (last.buildings[0], last.shifts[0], last.vertex_errors[0]) == (7, 1.5, 0.3)


def test_no_walls_are_a_map_too() -> None:
    assert len(Facades(np.empty((0, 2, 2)), [], [], [])) == 0
    facades = Facades(SEGMENTS, [7, 7], [1.5, 1.5], [0.2, 0.3])
    for nothing in ([], np.zeros(2, np.bool_), np.empty(0)):
        assert len(facades.select(nothing)) == 0
        assert len(FacadeBounds.of(facades).select(nothing)) == 0


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("segments", [[0, 0, 3, 4]], "shape"),
        ("segments", [[[0, 0], [0, 0]], SEGMENTS[1]], "begins where it ends"),
        ("segments", [[[0, 0], [math.inf, 0]], SEGMENTS[1]], "finite"),
        ("buildings", [1], "one value"),
        ("shifts", [-1.0, 0.0], "negative"),
        ("vertex_errors", [math.nan, 0.0], "finite"),
    ],
)
def test_damage_is_refused_by_its_name(field: str, value: object, word: str) -> None:
    parts: dict[str, object] = {"segments": SEGMENTS, "buildings": [0, 0], "shifts": [1, 1], "vertex_errors": [0, 0]}
    with pytest.raises(MapError, match=word):
        Facades(**{**parts, field: value})  # type: ignore[arg-type]
