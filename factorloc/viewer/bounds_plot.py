"""Localization among facades: accumulators, associated points, and feasible sets on the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.viewer.map_canvas import draw_scale_bar
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, legend_above, line_style, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from factorloc.intervals.hough import HoughAccumulator, HoughPeak
    from factorloc.result import Bounds

__all__ = ["draw_bounds", "plot_accumulator", "plot_associated_points", "plot_feasible_sets"]

Array = npt.NDArray[np.float64]

_WALL = "#8A8A8A"


def plot_accumulator(accumulator: HoughAccumulator, peak: HoughPeak | None = None) -> Figure:
    """Draw the votes of an interval Hough transform, and the hull of its peak.

    Parameters
    ----------
    accumulator : HoughAccumulator
        Votes.
    peak : HoughPeak, optional
        Whose hull is framed.
    """
    from matplotlib.patches import Rectangle

    figure = new_figure(WIDTH, 3.6)
    axes = figure.subplots()
    rows, columns = accumulator.counts.shape
    alpha = np.degrees(accumulator.alpha_first + accumulator.alpha_step * np.array([0, rows]))
    d = accumulator.d_first + accumulator.d_step * np.array([0, columns])
    image = axes.imshow(
        accumulator.counts.T, origin="lower", aspect="auto", extent=(*alpha, *d), cmap="cividis",
        interpolation="nearest",
    )  # fmt: skip
    dress(axes, "direction of the normal (°)", "distance from the anchor (m)", frame=True)
    axes.grid(False)
    bar = figure.colorbar(image, ax=axes, pad=0.02)
    bar.set_label("boxes", fontsize=FONT_SIZE, color=INK)
    bar.ax.tick_params(labelsize=FONT_SIZE - 1, colors=INK)
    if peak is not None:
        low = np.degrees(float(peak.alpha.lo)), float(peak.d.lo)
        size = np.degrees(float(peak.alpha.width)), float(peak.d.width)
        label = f"hull of the peak: {peak.votes} votes, second peak {peak.rivalry:.2f} of it"
        axes.add_patch(Rectangle(low, *size, fill=False, edgecolor=OKABE_ITO[1], linewidth=1.6, label=label))
        legend_above(axes)
    return figure


def plot_associated_points(
    walls: npt.ArrayLike,
    points: npt.ArrayLike,
    facade_of_point: npt.ArrayLike,
    *,
    bounds: Bounds | None = None,
    attribution: str = "",
    margin: float = 8.0,
) -> Figure:
    """Draw the points of a scan over the facades they were associated with.

    Parameters
    ----------
    walls : array_like, shape (F, 2, 2)
        Segments of all facades, m.
    points : array_like, shape (N, 2)
        In the map, at some pose, m.
    facade_of_point : array_like of int, shape (N,)
        Facade of each; negative for none.
    bounds : Bounds, optional
        Where the sensor may be.
    attribution : str
        Whom the map is owed to.
    margin : float
        Around the points, m.
    """
    ends, of = np.asarray(points, np.float64), np.asarray(facade_of_point)
    figure, axes = _map_axes(np.asarray(walls, np.float64), ends, margin, attribution)
    free = of < 0
    axes.plot(*ends[free].T, ".", color=_WALL, markersize=1.5, label="points of no facade", zorder=2)
    used = np.unique(of[~free])
    for number, facade in enumerate(used):
        color = OKABE_ITO[number % len(OKABE_ITO)]
        axes.plot(*ends[of == facade].T, ".", color=color, markersize=2.5, zorder=4)
        axes.plot(*np.asarray(walls)[facade].T, color=color, linewidth=3.0, alpha=0.5, zorder=3)
    axes.plot([], [], ".", color=OKABE_ITO[0], label=f"points of {len(used)} facades, a colour each")
    if bounds is not None:
        draw_bounds(axes, bounds, label="feasible positions")
    legend_above(axes)
    return figure


def plot_feasible_sets(
    walls: npt.ArrayLike,
    sets: Sequence[Bounds],
    paths: Mapping[str, npt.ArrayLike],
    *,
    every: int = 1,
    attribution: str = "",
    margin: float = 15.0,
) -> Figure:
    """Draw feasible sets of a drive over the map, with paths.

    Parameters
    ----------
    walls : array_like, shape (F, 2, 2)
        Segments of all facades, m.
    sets : sequence of Bounds
        One a scan.
    paths : mapping of str to array_like, shape (N, 2) or (N, 3)
        Positions by name, m.
    every : int
        One of so many sets is drawn.
    attribution : str
        Whom the map is owed to.
    margin : float
        Around the paths, m.
    """
    ways = {name: np.asarray(path, np.float64)[:, :2] for name, path in paths.items()}
    around = np.concatenate([*ways.values(), *(polygon for one in sets for polygon in one.polygons)])
    figure, axes = _map_axes(np.asarray(walls, np.float64), around, margin, attribution)
    for number, one in enumerate(sets[::every]):
        draw_bounds(axes, one, label="feasible positions" if number == 0 else "")
    for number, (name, way) in enumerate(ways.items()):
        axes.plot(*way.T, **line_style(number + 1), linewidth=1.3, label=name, zorder=5)
    legend_above(axes)
    return figure


def draw_bounds(axes: Axes, bounds: Bounds, *, label: str = "") -> None:
    """Draw the polygons of a feasible set."""
    from matplotlib.patches import Polygon

    for number, polygon in enumerate(bounds.polygons):
        named = label if number == 0 and label else None
        axes.add_patch(
            Polygon(
                polygon, closed=True, facecolor=(*_rgb(OKABE_ITO[0]), 0.12), edgecolor=(*_rgb(OKABE_ITO[0]), 0.8),
                linewidth=0.9, label=named, zorder=4,
            )
        )  # fmt: skip


def _rgb(colour: str) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    return to_rgb(colour)


def _map_axes(walls: Array, around: Array, margin: float, attribution: str) -> tuple[Figure, Axes]:
    from matplotlib.collections import LineCollection

    low, high = around.min(0) - margin, around.max(0) + margin
    height = float(np.clip(WIDTH * (high[1] - low[1]) / (high[0] - low[0]), 2.0, 8.0))
    figure = new_figure(WIDTH, height + 0.5, equal_aspect=True)
    axes = figure.subplots()
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    dress(axes, frame=True)
    axes.grid(False)
    axes.set(xticks=[], yticks=[])
    axes.add_collection(LineCollection(list(walls), colors=_WALL, linewidths=1.0, zorder=1, label="facades"))
    if attribution:
        axes.text(
            0.995, 0.005, attribution, transform=axes.transAxes, ha="right", va="bottom", fontsize=FONT_SIZE - 2,
            color=INK, zorder=9,
        )  # fmt: skip
    draw_scale_bar(axes)
    return figure, axes
