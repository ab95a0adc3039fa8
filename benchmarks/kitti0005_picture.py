"""A localized drive over its map, and its deviations from the reference over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from factorloc.evaluation import absolute_errors
from factorloc.mapping import BrickStatistics
from factorloc.mapping.top_view import top_view
from factorloc.trajectory import Trajectory
from factorloc.viewer.map_canvas import MapImage, draw_scale_bar
from factorloc.viewer.style import INK, WIDTH, dress, legend_above, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["drive_picture"]

_LEAST = 1e-3  # m and deg; lower end of the deviations shown
_AROUND = 25.0  # m of the map around the paths


def drive_picture(statistics: BrickStatistics, paths: Mapping[str, Trajectory], reference: Trajectory) -> Figure:
    """Draw paths over the map from above, and below it how far they are from the reference in position and rotation.

    Parameters
    ----------
    statistics : BrickStatistics
        The map.
    paths : mapping of str to Trajectory
        By name, with the stamps of the reference.
    reference : Trajectory
        What they are compared with.
    """
    positions = reference.positions
    low, high = positions[:, :2].min(0) - _AROUND, positions[:, :2].max(0) + _AROUND
    tall = WIDTH * float((high[1] - low[1]) / (high[0] - low[0]))
    figure = new_figure(WIDTH, tall + 3.6)
    top, position, rotation = figure.subplots(3, 1, height_ratios=[tall, 1.3, 1.3])
    top.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    MapImage(top_view(statistics), statistics.grid.extent).draw(top)
    dress(top, frame=True)
    top.grid(False)
    top.set(xticks=[], yticks=[])
    draw_scale_bar(top)
    top.plot(*positions[:, :2].T, color=INK, linewidth=3.0, label="reference (GICP)", zorder=2)
    for number, (name, path) in enumerate(paths.items()):
        found = absolute_errors(path, reference)
        style = {**line_style(number), "linewidth": 1.2}
        seconds = path.stamps - reference.stamps[0]
        top.plot(*path.positions[:, :2].T, **style, label=name, zorder=4 - number / 10)
        position.plot(seconds, found.translation, **style)
        rotation.plot(seconds, np.degrees(found.rotation), **style)
    dress(position, ylabel="deviation (m)")
    dress(rotation, "time (s)", "deviation (°)")
    for axes in (position, rotation):
        axes.set_yscale("log")
        axes.set_ylim(bottom=_LEAST)  # the odometry begins at the reference
        axes.set_xlim(0, float(reference.stamps[-1] - reference.stamps[0]))
    position.tick_params(labelbottom=False)
    figure.align_ylabels([position, rotation])
    legend_above(top)
    return figure
