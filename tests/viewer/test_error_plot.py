from types import SimpleNamespace

import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.evaluation import absolute_errors
from factorloc.viewer import plot_errors_over_time


def test_metres_degrees_and_seconds_since_the_first_stamp():
    a = SimpleNamespace(stamps=np.array([100.0, 101.0]), translation=np.array([3.0, 4.0]), heading=np.radians([-2, 2]))
    b = SimpleNamespace(stamps=np.array([103.0, 99.0]), translation=np.array([1.0, 2.0]), heading=np.zeros(2))
    figure = plot_errors_over_time({"a": a, "b": b})
    upper, lower = figure.axes
    np.testing.assert_allclose(upper.lines[0].get_xydata(), [[1, 3], [2, 4]])
    np.testing.assert_allclose(upper.lines[1].get_xydata(), [[0, 2], [4, 1]])
    np.testing.assert_allclose(lower.lines[1].get_ydata(), [-2, 2])
    assert (upper.get_ylabel(), lower.get_ylabel(), lower.get_xlabel()) == (
        "translation error (m)",
        "heading error (°)",
        "time (s)",
    )
    assert upper.get_ylim()[0] == 0
    assert lower.get_ylim()[0] == -lower.get_ylim()[1]
    first, _ = (text.get_text() for text in upper.get_legend().get_texts())
    assert first == "a (RMSE 3.54 m, 2°)"


def test_absolute_errors_fit_as_they_are(path):
    figure = plot_errors_over_time({"shifted": absolute_errors(path(0.5), path())})
    np.testing.assert_allclose(figure.axes[0].lines[0].get_ydata(), 0.5)


def test_a_single_instant_is_drawn():
    one = SimpleNamespace(stamps=np.zeros(1), translation=np.ones(1), heading=np.ones(1))
    assert plot_errors_over_time({"one": one}).axes[0].get_xlim() == (0, 1)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"translation": np.zeros(3)}, "a: .*shapes"),
        ({"heading": np.array([0, np.nan])}, "a: .*finite"),
        ({"stamps": np.zeros(0), "translation": np.zeros(0), "heading": np.zeros(0)}, "a: .*shapes"),
    ],
)
def test_bad_runs_are_named(changes, message):
    good = {"stamps": np.arange(2.0), "translation": np.zeros(2), "heading": np.zeros(2)}
    with pytest.raises(GeometryError, match=message):
        plot_errors_over_time({"a": SimpleNamespace(**{**good, **changes})})


def test_no_runs_are_refused():
    with pytest.raises(GeometryError, match="none given"):
        plot_errors_over_time({})
