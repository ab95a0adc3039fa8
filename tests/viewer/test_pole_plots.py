"""Pictures of pole maps."""

from __future__ import annotations

import numpy as np
import pytest

from factorloc.errors import GeometryError
from factorloc.mapping import PoleMap, Poles
from factorloc.viewer import plot_pole_map, save_figure


def a_map() -> PoleMap:
    poles = Poles([[1, 2], [5, 8], [12, 9]], [0.1, 0.4, 0.2], [[0, 3]] * 3, [9.0, 8.0, 7.0])
    return PoleMap(poles, [[4], [1], [0]], [[4], [4], [0]], ("a",))


def test_poles_are_as_large_as_wide_and_as_dark_as_reliable(room, path, tmp_path):
    figure = plot_pole_map(a_map(), *room, trajectory=path(), detections=a_map().poles.select([0]))
    axes = figure.axes[0]
    drawn = {group.get_label(): group for group in axes.collections}
    assert np.allclose(drawn["poles"].get_offsets(), a_map().positions)
    assert np.allclose(drawn["poles"].get_sizes(), [14, 56, 28])
    assert np.allclose(drawn["poles"].get_facecolors()[:, 3], [1.0, 0.3625, 0.15])
    assert np.allclose(drawn["detections"].get_offsets(), [[1, 2]])
    save_figure(figure, tmp_path / "poles.png")


def test_poles_alone_are_framed_and_nothing_is_refused(room):
    axes = plot_pole_map(a_map()).axes[0]
    assert axes.get_xlim()[0] < 1
    assert axes.get_xlim()[1] > 12
    with pytest.raises(GeometryError, match="nothing can be drawn"):
        plot_pole_map(PoleMap.of(Poles.none()))
    with pytest.raises(GeometryError, match="one of them is missing"):
        plot_pole_map(a_map(), room[0])
    assert plot_pole_map(PoleMap.of(Poles.none()), *room).axes
