"""Pictures of localization among facades: drawn, labelled, and of whom the map is owed to."""

import numpy as np

from factorloc.intervals import Box, HoughAccumulator, Interval
from factorloc.result import Bounds
from factorloc.viewer import plot_accumulator, plot_associated_points, plot_feasible_sets

WALLS = np.array([[[0.0, 5.0], [10.0, 5.0]], [[10.0, -5.0], [0.0, -5.0]]])
BOUNDS = Bounds.around([5.0, 0.0, 0.1], 1.0, 0.1)


def texts(figure):
    found = [text.get_text() for axes in figure.axes for text in axes.texts]
    return found + [text.get_text() for axes in figure.axes if axes.get_legend() for text in axes.get_legend().texts]


def test_accumulator_shows_all_votes_and_frames_the_peak():
    points = Box.around(np.array([[1.0, 2.0, 3.0, 4.0], [5.0, 5.0, 5.0, 5.0]]), 0.05)
    accumulator = HoughAccumulator.from_boxes(points, Interval(1.4, 1.7), Interval(4.0, 6.0))
    peak = accumulator.peak()
    figure = plot_accumulator(accumulator, peak)
    axes = figure.axes[0]
    np.testing.assert_array_equal(axes.images[0].get_array(), accumulator.counts.T)
    frame = axes.patches[0]
    np.testing.assert_allclose(frame.get_xy(), [np.degrees(peak.alpha.lo), peak.d.lo])
    assert any("4 votes" in text for text in texts(figure))


def test_points_have_a_colour_of_their_facade_and_the_map_its_owner():
    points = np.array([[1.0, 5.0], [2.0, 5.1], [3.0, -5.0], [5.0, 0.0]])
    figure = plot_associated_points(WALLS, points, [0, 0, 1, -1], bounds=BOUNDS, attribution="© surveyors")
    assert any("2 facades" in text for text in texts(figure))
    assert "© surveyors" in texts(figure)
    assert len(figure.axes[0].patches) >= 1


def test_feasible_sets_are_drawn_over_the_paths():
    sets = [BOUNDS, Bounds((0.0, 0.1), ()), BOUNDS]
    figure = plot_feasible_sets(WALLS, sets, {"estimate": [[5.0, 0.0], [5.5, 0.1], [6.0, 0.0]]})
    assert "estimate" in texts(figure)
    assert len(figure.axes[0].patches) >= 2
