"""Map plots: where the vehicle drove, and where it was how far off."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.trajectory import Trajectory
from factorloc.viewer.map_canvas import Limits, MapImage, map_canvas
from factorloc.viewer.style import INK, dress, legend_above, line_style

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

__all__ = ["plot_error_coloured_path", "plot_map_and_trajectories"]

_MAX_BROADENED = 3  # paths beneath paths are no broader than this many steps


def plot_map_and_trajectories(
    image: npt.ArrayLike | None,
    extent: Limits | None,
    trajectories: Mapping[str, Trajectory],
    *,
    reference: str | None = None,
    crop: bool = True,
    scale_bar: bool = False,
    colormap: str | None = None,
    image_label: str | None = None,
) -> Figure:
    """Draw paths over the map.

    Parameters
    ----------
    image : array_like, shape (X, Y), or None
        One value a cell, first axis along x; for instance the probability of reflection. NaN is unknown.
    extent : (float, float, float, float) or None
        ``x_min, x_max, y_min, y_max`` of the image, m.
    trajectories : mapping of str to Trajectory
        Paths by name, all in the same world frame; spatial ones are seen from above.
    reference : str, optional
        Name of the path that the others are compared with: broad and dark, beneath them.
    crop : bool
        Whether to frame only the content of the map and the paths.
    scale_bar : bool
        Whether a scale bar takes the place of ticks and labels.
    colormap : str, optional
        Colour map of the image, such as ``"viridis"``; light greys by default.
    image_label : str, optional
        Name and unit of the image's values; adds a colour bar.

    Raises
    ------
    GeometryError
        If the image or extent has a wrong shape, a trajectory is empty, frames are mixed, there is nothing to draw, or
        the reference is not among the trajectories.
    ConfigError
        If the colour map is unknown.
    """
    from matplotlib.patheffects import withStroke

    if reference is not None and reference not in trajectories:
        raise GeometryError(f"reference: no trajectory is called '{reference}'; known: {', '.join(trajectories)}")
    background = _map_image(image, extent)
    paths = {name: _ground_path(trajectory, name) for name, trajectory in trajectories.items()}
    if background is None and not paths:
        raise GeometryError("trajectories: none given, and no image; nothing can be drawn")
    if len(worlds := sorted({trajectory.world for trajectory in trajectories.values()})) > 1:
        raise GeometryError(f"trajectories: mixed world frames {', '.join(worlds)}; transform them into one")
    figure, axes, drawn = map_canvas(
        background, list(paths.values()), crop=crop, scale_bar=scale_bar, colormap=colormap
    )
    estimates = [name for name in paths if name != reference]
    # The first is the narrowest and on top: where paths agree, the others still show at its sides.
    widths = 1.2 + 0.6 * np.minimum(np.arange(len(estimates) + 1), _MAX_BROADENED)
    styles = {name: {**line_style(k), "linewidth": widths[k]} for k, name in enumerate(estimates)}
    if reference is not None:
        styles = {reference: {"color": INK, "linewidth": widths[-1] + 0.4}, **styles}
    for depth, (name, style) in enumerate(styles.items()):
        zorder = 2.0 if name == reference else 3 - depth / len(paths)
        # Lines on coloured ground need a white edge.
        edge = [] if colormap is None else [withStroke(linewidth=style["linewidth"] + 1.5, foreground="white")]
        axes.plot(*paths[name].T, **style, zorder=zorder, label=name, path_effects=edge)
    if paths:
        x, y = np.array([path[0] for path in paths.values()]).T
        axes.scatter(x, y, s=26, facecolor="white", edgecolor=INK, linewidth=1.0, label="start", zorder=4)
    legend_above(axes)
    if drawn is not None and image_label is not None:
        _colour_bar(figure, drawn, image_label)
    return figure


def plot_error_coloured_path(
    trajectory: Trajectory,
    errors: npt.ArrayLike,
    image: npt.ArrayLike | None = None,
    extent: Limits | None = None,
    *,
    label: str = "translation error (m)",
    limit: float | None = None,
    crop: bool = True,
    scale_bar: bool = False,
) -> Figure:
    """Draw a path in the colours of its errors, over the map if there is one.

    Parameters
    ----------
    trajectory : Trajectory
        The path.
    errors : array_like, shape (N,)
        Magnitude of the error of each pose.
    image, extent
        The map, as for :func:`plot_map_and_trajectories`.
    label : str
        Name and unit of the errors, for the colour bar.
    limit : float, optional
        Error at the end of the colour bar, larger ones are clipped; their 99th percentile by default, so that one
        outlier does not take all colours.
    crop, scale_bar
        As for :func:`plot_map_and_trajectories`.

    Raises
    ------
    GeometryError
        If the image, extent or errors have a wrong shape, an error is negative or not finite, or there are no poses.
    """
    from matplotlib.collections import LineCollection

    path = _ground_path(trajectory, "trajectory")
    values = np.asarray(errors, np.float64)
    if values.shape != (len(path),):
        raise GeometryError(f"errors: shape {values.shape}; expected {(len(path),)}, one a pose")
    if not (np.isfinite(values) & (values >= 0)).all():
        raise GeometryError("errors: negative or not finite; give magnitudes")
    top = float(np.percentile(values, 99)) if limit is None else float(limit)
    figure, axes, _ = map_canvas(_map_image(image, extent), [path], crop=crop, scale_bar=scale_bar)
    # A dark edge carries the light end of the colours over white ground.
    axes.plot(*path.T, color=INK, linewidth=4.0, solid_capstyle="round", zorder=2)
    segments = LineCollection(
        [path[[k, k + 1]] for k in range(len(path) - 1)],
        array=np.maximum(values[:-1], values[1:]),
        cmap="viridis",
        linewidth=2.8,
        capstyle="round",
        zorder=3,
    )
    segments.set_clim(0, top if top > 0 else 1.0)
    axes.add_collection(segments, autolim=False)
    _colour_bar(figure, segments, label, clipped=bool(values.max() > top))
    return figure


def _colour_bar(figure: Figure, drawn: ScalarMappable, label: str, *, clipped: bool = False) -> None:
    extend: Literal["max", "neither"] = "max" if clipped else "neither"
    bar = figure.colorbar(drawn, ax=figure.axes[0], shrink=0.7, aspect=30, pad=0.02, extend=extend, extendfrac=0.03)
    dress(bar.ax, ylabel=label)
    bar.ax.grid(False)
    bar.outline.set_visible(False)


def _map_image(image: npt.ArrayLike | None, extent: Limits | None) -> MapImage | None:
    if (image is None) != (extent is None):
        raise GeometryError("image and extent: one of them is missing; give both or none")
    return None if image is None or extent is None else MapImage(np.asarray(image, np.float64), extent)


def _ground_path(trajectory: Trajectory, name: str) -> npt.NDArray[np.float64]:
    if len(trajectory) == 0:
        raise GeometryError(f"{name}: the trajectory is empty")
    return trajectory.positions[:, :2]
