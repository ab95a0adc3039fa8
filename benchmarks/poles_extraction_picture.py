"""Picture of the pole extraction: recall, precision and position errors by lidar, and one stretch from above."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from benchmarks.poles_extraction_scenes import Stretch
from factorloc.geometry import se3
from factorloc.mapping.poles import Poles
from factorloc.viewer.style import FONT_SIZE, INK, OKABE_ITO, WIDTH, dress, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["extraction_picture"]

_HALF = 16.0  # m of the top view to each side


class Scored(Protocol):
    """What the picture needs of a score."""

    offsets: list[float]

    @property
    def recall(self) -> float:
        """Share of the poles that were found."""
        ...

    @property
    def precision(self) -> float:
        """Share of the detections that are poles."""
        ...


def extraction_picture(
    scores: Mapping[str, Mapping[str, Scored]], stretch: Stretch, found: Mapping[str, Poles]
) -> Figure:
    """Draw what was measured.

    Parameters
    ----------
    scores : mapping of str to mapping of str to score
        By lidar, then by set-up.
    stretch : Stretch
        What is shown from above.
    found : mapping of str to Poles
        What was found there, by set-up.
    """
    figure = new_figure(WIDTH * 1.4, 5.4)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.0, 1.1))
    names, lidars = list(next(iter(scores.values()))), list(scores)
    titles: dict[str, Callable[[Scored], float]] = {
        "recall": lambda score: score.recall,
        "precision": lambda score: score.precision,
        "mean position error, m": lambda score: float(np.mean(score.offsets)) if score.offsets else np.nan,
    }
    for row, (title, value) in enumerate(titles.items()):
        axes = figure.add_subplot(grid[row, 0])
        step = 0.8 / len(names)
        for k, name in enumerate(names):
            values = [value(scores[lidar][name]) for lidar in lidars]
            axes.bar(np.arange(len(lidars)) + (k - (len(names) - 1) / 2) * step, values, step, color=OKABE_ITO[k])
        dress(axes, "", title)
        axes.set_xticks(np.arange(len(lidars)), lidars)
    axes = figure.add_subplot(grid[:, 1])
    centre = stretch.centre[:2]
    for scan, pose in zip(stretch.scans, stretch.poses, strict=True):
        points = se3.transform(se3.compose(pose, scan.T_body_sensor), scan.points()[::7])
        points = points[(np.abs(points[:, :2] - centre) < _HALF).all(1) & (points[:, 2] > 0.3)]
        axes.scatter(points[:, 0], points[:, 1], s=0.15, color="#B8B8B8", linewidths=0, rasterized=True)
    x, y = stretch.truth.positions[stretch.returns > 0].T
    axes.scatter(
        x,
        y,
        s=90,
        facecolors="none",
        edgecolors=INK,
        linewidths=0.9,
        label="true poles with returns",
    )
    for k, (name, poles) in enumerate(found.items()):
        x, y = poles.positions.T
        axes.scatter(x, y, s=10 + 14 * (len(names) - k), marker="x", color=OKABE_ITO[k], linewidths=1.1, label=name)
    axes.set_xlim(centre[0] - _HALF, centre[0] + _HALF)
    axes.set_ylim(centre[1] - _HALF, centre[1] + _HALF)
    axes.set_aspect("equal")
    dress(axes, "x (m)", "y (m)", frame=True)
    axes.legend(fontsize=FONT_SIZE - 1, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    return figure
