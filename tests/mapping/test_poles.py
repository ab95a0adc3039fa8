"""Poles: what is kept, what is refused, and moving to another frame."""

from __future__ import annotations

import math

import numpy as np
import pytest

from factorloc.errors import MapError
from factorloc.mapping.poles import Poles


def three() -> Poles:
    return Poles([[0, 0], [1, 0], [0, 2]], [0.1, 0.2, 0.3], [[0, 2], [0, 3], [1, 4]], [0.9, 0.8, 0.7])


def test_selection_and_joining_keep_rows_together() -> None:
    poles = three()
    again = Poles.joined([poles.select([2, 0]), Poles.none(), poles.select(np.array([False, True, False]))])
    assert again.positions.tolist() == [[0, 2], [0, 0], [1, 0]]
    assert again.widths.tolist() == [0.3, 0.1, 0.2]
    assert again.spans.tolist() == [[1, 4], [0, 2], [0, 3]]
    assert again.scores.tolist() == [0.7, 0.9, 0.8]


def test_moving_turns_and_shifts_positions_alone() -> None:
    moved = three().transformed([10.0, 20.0, math.pi / 2])
    assert np.allclose(moved.positions, [[10, 20], [10, 21], [8, 20]])
    assert np.array_equal(moved.spans, three().spans)


def test_none_and_joining_nothing_are_empty() -> None:
    assert len(Poles.none()) == len(Poles.joined([])) == len(three().select([])) == len(three().select(slice(0))) == 0
    assert Poles.none().transformed([1.0, 2.0, 3.0]).positions.shape == (0, 2)


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [
        ("positions", [[0, 0, 0]] * 3, "shape"),
        ("positions", [[0, 0], [0, math.nan], [0, 0]], "finite"),
        ("widths", [0.1, 0.0, 0.2], "positive"),
        ("widths", [0.1, 0.2], "counts"),
        ("spans", [[0, 1], [2, 1], [0, 1]], "lowest"),
        ("scores", [[1.0]] * 3, "shape"),
    ],
)
def test_damage_is_refused_by_its_name(field: str, value: object, word: str) -> None:
    poles = three()
    parts = {name: getattr(poles, name) for name in ("positions", "widths", "spans", "scores")}
    with pytest.raises(MapError, match=word):
        Poles(**{**parts, field: value})
