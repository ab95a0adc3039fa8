"""Bare poles: only their places are known, or simulated."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from factorloc.mapping.poles import Poles

__all__ = ["bare_poles"]


def bare_poles(positions: npt.NDArray[np.float64]) -> Poles:
    """Poles at positions (N, 2), m, all of the same width, height and score."""
    n = len(positions)
    return Poles(positions, np.full(n, 0.2), np.tile([0.0, 2.0], (n, 1)), np.ones(n))
