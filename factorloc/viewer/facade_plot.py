"""Facade maps: buildings, the walls that are used, and whom the map is owed to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.trajectory import Trajectory
from factorloc.viewer.map_canvas import draw_scale_bar
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, legend_above, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from factorloc.mapping import FacadeMap

__all__ = ["credit", "draw_facade_map", "plot_facade_map"]

_MARGIN = 5.0  # m around all that is shown
_MAX_HEIGHT = 8.0  # inch
_BUILDING = "#E4E4E4"
_FACADE = OKABE_ITO[0]


def credit(axes: Axes, attribution: str) -> None:
    """Name whom a map is owed to, in the lower right corner; nothing if nobody."""
    if attribution:
        behind = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
        note = axes.text(1.0, 0.0, attribution, fontsize=FONT_SIZE - 2.5, color=INK, bbox=behind, zorder=10)
        note.set(transform=axes.transAxes, horizontalalignment="right", verticalalignment="bottom")


def draw_facade_map(axes: Axes, facade_map: FacadeMap, *, label: str = "facades") -> None:
    """Draw buildings and their facades into axes in metres, and name whom the map is owed to.

    Parameters
    ----------
    axes : Axes
        Where.
    facade_map : FacadeMap
        What.
    label : str
        Of the facades in the legend.
    """
    import shapely
    from matplotlib.collections import LineCollection, PathCollection
    from matplotlib.path import Path as Outline

    outlines = []
    for polygon in map(shapely.orient_polygons, facade_map.outlines):  # courtyards turn the other way, and stay empty
        rings = [np.asarray(ring.coords) for ring in (polygon.exterior, *polygon.interiors)]
        outlines.append(Outline.make_compound_path(*(Outline(ring[:, :2], closed=True) for ring in rings)))
    axes.add_collection(PathCollection(outlines, facecolor=_BUILDING, edgecolor="none", zorder=1))
    walls = LineCollection(list(facade_map.facades.segments), colors=_FACADE, linewidths=0.8, zorder=2, label=label)
    axes.add_collection(walls)
    credit(axes, facade_map.attribution)


def plot_facade_map(
    facade_map: FacadeMap,
    trajectories: Mapping[str, Trajectory | npt.ArrayLike] | None = None,
    *,
    limits: tuple[float, float, float, float] | None = None,
) -> Figure:
    """Draw a facade map from above, and ways through it.

    Parameters
    ----------
    facade_map : FacadeMap
        The map.
    trajectories : mapping of str to Trajectory or (N, 2) array_like, optional
        By name, in the frame of the map, m.
    limits : (float, float, float, float), optional
        Lowest and highest x, lowest and highest y shown, m; all by default.

    Returns
    -------
    Figure
        With the attribution of the map in its corner.
    """
    ways = {
        name: way.positions[:, :2] if isinstance(way, Trajectory) else np.asarray(way, np.float64)[:, :2]
        for name, way in (trajectories or {}).items()
    }
    x0, x1, y0, y1 = facade_map.extent if limits is None else limits
    if limits is None:
        points = np.concatenate([[(x0, y0), (x1, y1)], *ways.values()])
        (x0, y0), (x1, y1) = points.min(0) - _MARGIN, points.max(0) + _MARGIN
    height = min(max(WIDTH * (y1 - y0) / (x1 - x0), 2.0), _MAX_HEIGHT)
    figure = new_figure(WIDTH, float(height) + 0.5, equal_aspect=True)
    axes = figure.subplots()
    axes.set(aspect="equal", xlim=(x0, x1), ylim=(y0, y1))
    dress(axes, frame=True)
    axes.grid(False)
    axes.set(xticks=[], yticks=[])
    draw_facade_map(axes, facade_map)
    for number, (name, way) in enumerate(ways.items()):
        axes.plot(*way.T, **line_style(number + 1), linewidth=1.3, label=name, zorder=3)
    draw_scale_bar(axes)
    legend_above(axes)
    return figure
