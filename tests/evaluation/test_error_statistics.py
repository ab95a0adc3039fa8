import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import EvaluationError
from factorloc.evaluation import ErrorStatistics


def test_figures_of_known_values():
    s = ErrorStatistics.of([3.0, -4.0, 1.0, 0.0], "m")
    assert s.rmse == pytest.approx(np.sqrt(26 / 4))
    assert (s.mean, s.median, s.min, s.max, s.count, s.unit) == (0.0, 0.5, -4.0, 3.0, 4, "m")
    assert s.std == pytest.approx(s.rmse)
    assert s.percentile_95 == pytest.approx(1 + 0.85 * 2)


@given(st.lists(st.floats(0, 1e6), min_size=1, max_size=50))
def test_figures_of_magnitudes_are_ordered(values):
    s = ErrorStatistics.of(values, "m")
    slack = 1e-9 * (1 + s.max)
    assert s.min <= s.median + slack <= s.percentile_95 + 2 * slack <= s.max + 3 * slack
    assert s.mean <= s.rmse + slack <= s.max + 2 * slack
    assert s.rmse**2 == pytest.approx(s.mean**2 + s.std**2, rel=1e-6, abs=1e-12)


def test_degrees_replace_radians_only():
    turned = ErrorStatistics.of([np.pi, np.pi / 2], "rad").in_degrees()
    assert (turned.max, turned.min, turned.unit, turned.count) == (180, 90, "deg", 2)
    metres = ErrorStatistics.of([1.0], "m")
    assert metres.in_degrees() is metres


def test_dictionary_holds_every_field():
    s = ErrorStatistics.of([1.0, 2.0], "m")
    assert ErrorStatistics(**s.to_dict()) == s
    assert set(s.to_dict()) == {f.name for f in dataclasses.fields(s)}


@pytest.mark.parametrize(
    ("values", "message"),
    [([], "at least one"), ([1.0, np.nan, np.inf], "2 of 3 are not finite"), ([[1.0]], "in a row")],
)
def test_bad_values_are_named(values, message):
    with pytest.raises(EvaluationError, match=f"lateral: .*{message}"):
        ErrorStatistics.of(values, "m", "lateral")
