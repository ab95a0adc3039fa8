"""Pole plots: a map of poles, over the surroundings and with what was detected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.poles import Poles
from factorloc.trajectory import Trajectory
from factorloc.viewer.map_canvas import Limits, MapImage, map_canvas
from factorloc.viewer.style import INK, OKABE_ITO, legend_above

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["plot_pole_map"]

_SMALLEST = 14.0  # area of a marker, pt^2


def plot_pole_map(
    pole_map: PoleMap,
    image: npt.ArrayLike | None = None,
    extent: Limits | None = None,
    *,
    trajectory: Trajectory | None = None,
    detections: Poles | None = None,
    scale_bar: bool = False,
) -> Figure:
    """Draw a map of poles from above.

    Poles are as large as they are wide, to be seen at least, and filled the more, the more reliably they were found.

    Parameters
    ----------
    pole_map : PoleMap
        The map.
    image : array_like, shape (X, Y), optional
        What is drawn beneath, such as a top view; see :func:`~factorloc.viewer.map_plots.plot_map_and_trajectories`.
    extent : (float, float, float, float), optional
        ``x_min, x_max, y_min, y_max`` of the image, m.
    trajectory : Trajectory, optional
        A drive in the same frame.
    detections : Poles, optional
        What was found on it, in the same frame.
    scale_bar : bool
        Whether a scale bar takes the place of ticks and labels.

    Raises
    ------
    GeometryError
        If there is nothing to draw, or one of image and extent is missing.
    """
    if (image is None) != (extent is None):
        raise GeometryError("image and extent: one of them is missing; give both or none")
    background = None if image is None or extent is None else MapImage(np.asarray(image, np.float64), extent)
    drawn = [pole_map.positions] if len(pole_map) else []
    if trajectory is not None and len(trajectory):
        drawn.append(trajectory.positions[:, :2])
    if detections is not None and len(detections):
        drawn.append(detections.positions)
    if background is None and not drawn:
        raise GeometryError("pole map: holds no poles, and there is no image; nothing can be drawn")
    figure, axes, _ = map_canvas(background, drawn, scale_bar=scale_bar)
    if trajectory is not None and len(trajectory):
        axes.plot(*trajectory.positions[:, :2].T, color=INK, linewidth=1.2, label="drive", zorder=2)
    if detections is not None and len(detections):
        x, y = detections.positions.T
        axes.scatter(x, y, s=24, marker="x", color=OKABE_ITO[1], linewidths=0.9, label="detections", zorder=4)
    if len(pole_map):
        x, y = pole_map.positions.T
        sizes = _SMALLEST * np.maximum(pole_map.poles.widths / 0.1, 1.0)
        reliable = np.nan_to_num(pole_map.detection_rates)
        colours = [(*_rgb(OKABE_ITO[0]), 0.15 + 0.85 * rate) for rate in reliable.tolist()]
        axes.scatter(
            x, y, s=sizes.tolist(), c=colours, edgecolors=OKABE_ITO[0], linewidths=0.8, label="poles", zorder=3
        )
    legend_above(axes)
    return figure


def _rgb(colour: str) -> tuple[float, float, float]:
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return red, green, blue
