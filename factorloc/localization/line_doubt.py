"""Doubt: how probable it is that a line found for a facade is false, told from how it looks.

A line is false if that of the facade is not in its hull, as it is the neighbour's, a balcony's, or a compromise between
two walls with different setbacks. No bound holds against that; but some lines are far more doubtful than others. A
logistic model of eight marks tells them apart. Its numbers were fitted to 60,600 lines of 700 scans in simulated
districts (the tuning split of ``benchmarks.facades_simulated``), with maps like those of OpenStreetMap and like LOD2
models, and starts known to 5 m and 5 degrees, 2 m and 2 degrees, and 1 m and 1 degree.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block

__all__ = ["DoubtSettings", "doubts"]

Array = npt.NDArray[np.float64]


class DoubtSettings(Block):
    """Coefficients of the marks in the log odds of a line to be false.

    Parameters
    ----------
    base : float
        Log odds of a line with 80 votes and no rival, on a facade of 10 m that is covered and seen wholly, by
        supporters along as much, with a strip of 1 m in a window of 10 m.
    rivalry : float
        Of the second peak, relative to the first.
    votes : float
        Of the logarithm of the votes.
    uncovered : float
        Of the part of the facade that is not covered.
    strip : float
        Of the logarithm of the width of the strip of positions that it leaves: hull of distances, and map.
    window : float
        Of the logarithm of the width of distances among which the line was looked for.
    extent : float
        Of the logarithm of the extent of the supporters over the length of the facade.
    length : float
        Of the logarithm of the length.
    unseen : float
        Of the part that is not seen on the map, from nine places in the box of possible positions.
    least : float
        No line is less doubtful.
    """

    base: float = -4.71
    rivalry: float = 4.2
    votes: float = -0.39
    uncovered: float = 2.63
    strip: float = -1.08
    window: float = 0.83
    extent: float = 0.25
    length: float = -1.16
    unseen: float = 2.83
    least: float = Field(0.002, gt=0, lt=0.5)

    @property
    def coefficients(self) -> Array:
        """In the order of :func:`marks`, shape (9,)."""
        return np.array([
            self.base, self.rivalry, self.votes, self.uncovered, self.strip, self.window, self.extent, self.length,
            self.unseen,
        ])  # fmt: skip


def marks(peaks: Array, lengths: Array, seen: Array, errors: Array, windows: Array) -> Array:
    """What tells how doubtful lines are, shape (K, 9).

    Parameters
    ----------
    peaks : ndarray, shape (K, PEAK)
        As ``extract_lines`` writes them; NaN first where there is none.
    lengths : ndarray, shape (K,)
        Of the facades, m.
    seen : ndarray, shape (K,)
        Parts of them that are seen on the map.
    errors : ndarray, shape (K,)
        How far the map may be off across them, m.
    windows : ndarray, shape (K,)
        Widths of distances among which lines were looked for, m.
    """
    peaks = np.where(np.isnan(peaks[:, :1]), np.nan, peaks)  # what was passed over is not written
    votes = np.maximum(peaks[:, 0], 1.0)
    return np.stack([
        np.ones(len(peaks)),
        peaks[:, 1] / votes,
        np.log(votes / 80.0),
        1.0 - peaks[:, 6],
        np.log(peaks[:, 5] - peaks[:, 4] + 2.0 * errors),
        np.log(windows / 10.0),
        np.log(np.maximum(peaks[:, 11] - peaks[:, 7], 0.3) / lengths),
        np.log(lengths / 10.0),
        1.0 - seen,
    ], -1)  # fmt: skip


def doubts(marks: Array, settings: DoubtSettings) -> Array:
    """Probabilities of lines with some marks (K, 9) to be false, shape (K,); NaN without a peak."""
    return np.asarray(np.maximum(1.0 / (1.0 + np.exp(-(marks @ settings.coefficients))), settings.least))
