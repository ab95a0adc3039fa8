"""Picture of the long-term sessions: errors by session, and the session of the moved barrels from above."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["longterm_picture"]

Array = npt.NDArray[np.float64]

_COLOURS = {"filter": "C1", "smoother": "C0"}


def longterm_picture(
    errors: Mapping[int, Mapping[str, float]],
    landmarks: Array,
    distrusted: npt.NDArray[np.int64],
    truth: Array,
    paths: Mapping[str, tuple[Array, Array]],
    number: int,
) -> Figure:
    """Draw mean position errors by session, and one session: paths over the map, and errors along the way.

    Parameters
    ----------
    errors : mapping
        Mean position error by session and method, m.
    landmarks : ndarray, shape (L, 2)
    distrusted : ndarray of int64
        Landmarks the smoother names.
    truth : ndarray, shape (N, 3)
    paths : mapping
        Path (N, 3) and position errors (N,) by method.
    number : int
        Which session that is.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.5, 11), layout="constrained")
    over, town, along = figure.subplots(3, 1, height_ratios=[2, 5, 2])
    numbers = list(errors)
    for who, colour in _COLOURS.items():
        over.plot(numbers, [errors[n][who] for n in numbers], "o-", color=colour, ms=4, label=who)
    over.axhline(0.1, color="0.7", lw=0.8)
    over.set_yscale("log")
    over.set_xlabel("session")
    over.set_ylabel("mean position error (m)")
    over.legend(fontsize=8)
    town.scatter(*landmarks.T, s=4, color="0.6", label="landmarks")
    town.scatter(*landmarks[distrusted].T, s=14, color="C3", label="landmarks the smoother distrusts", zorder=3)
    town.plot(*truth[:, :2].T, color="0.2", lw=2.2, label="truth")
    for who, (path, _) in paths.items():
        town.plot(*path[:, :2].T, color=_COLOURS[who], lw=1, label=who)
    town.set_aspect("equal")
    town.set_xlabel("x (m)")
    town.set_ylabel("y (m)")
    town.set_title(f"session {number}", fontsize=10)
    town.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    for who, (_, error) in paths.items():
        along.plot(error, color=_COLOURS[who], lw=1, label=who)
    along.set_xlabel(f"way in session {number} (m)")
    along.set_ylabel("position error (m)")
    along.set_ylim(bottom=0)
    return figure
