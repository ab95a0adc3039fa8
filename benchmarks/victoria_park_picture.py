"""Picture of the park: trunks of the map, the path of the mapping graph and that of the localization."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["park_picture"]

Array = npt.NDArray[np.float64]


def park_picture(mapped: Array, localized: Array, trunks: Array) -> Figure:
    """Draw paths (N, 3) and trunks (L, 2) from above, and how far the paths are apart along the way."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 8.5), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=[4, 1])
    above.plot(*mapped[:, :2].T, color="0.6", lw=3, label="mapping graph (half of the observations)")
    above.plot(*localized[:, :2].T, color="C3", lw=0.8, label="localized (other half, association withheld)")
    above.scatter(*trunks.T, s=14, color="C2", zorder=3, label="trunks of the map")
    above.set_aspect("equal")
    above.set_xlabel("x (m)")
    above.set_ylabel("y (m)")
    above.legend(loc="upper left", fontsize=8)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(mapped[:, :2], axis=0).T))])
    below.plot(way, np.hypot(*(localized[:, :2] - mapped[:, :2]).T), color="C3", lw=0.8)
    below.set_xlabel("way (m)")
    below.set_ylabel("apart (m)")
    below.set_ylim(bottom=0)
    return figure
