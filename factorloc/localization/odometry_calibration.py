"""Odometry calibration: the scale and drift of a whole drive, against a path that is known about."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.geometry import se2, wrap

__all__ = ["OdometryCalibration"]

Array = npt.NDArray[np.float64]

_STRETCH = 40.0  # m; short enough to stay clear of most errors of the path, long enough for the noise to average
_LEAST = 8  # stretches; from fewer nothing is concluded


@dataclass(frozen=True)
class OdometryCalibration:
    """What is wrong with odometry all along a drive, as tyre pressure and an offset of the gyro are.

    Parameters
    ----------
    scale : float
        True length of a measured metre, m.
    drift : float
        True turn in excess of the measured one, rad/m.
    """

    scale: float = 1.0
    drift: float = 0.0

    @classmethod
    def of(cls, poses: npt.ArrayLike, motions: npt.ArrayLike, known: npt.NDArray[np.bool_]) -> OdometryCalibration:
        """Compare stretches of some 40 m, and take medians: a path that is wrong in places does no harm.

        Parameters
        ----------
        poses : array_like, shape (N, 3)
            The path.
        motions : array_like, shape (N - 1, 3)
            Odometry.
        known : ndarray of bool, shape (N - 1,)
            Which motions were measured.
        """
        path, steps = np.asarray(poses, np.float64), np.asarray(motions, np.float64)
        way = se2.way(steps)
        scales, drifts = [], []
        for start in np.arange(0.0, way[-1] - _STRETCH, _STRETCH / 2):
            a, b = np.searchsorted(way, [start, start + _STRETCH])
            if not known[a:b].all():
                continue
            free = np.zeros(3)
            for step in steps[a:b]:
                free = se2.compose(free, step)
            driven = se2.between(path[a], path[b])
            length = float(np.hypot(free[0], free[1]))
            if length > _STRETCH / 2:
                scales.append(float(np.hypot(driven[0], driven[1])) / length)
                drifts.append(float(wrap(driven[2] - free[2])) / (way[b] - way[a]))
        if len(scales) < _LEAST:
            return cls()
        return cls(float(np.median(scales)), float(np.median(drifts)))

    def applied(self, motions: npt.ArrayLike) -> Array:
        """Motions (N, 3) as they should have been measured."""
        out = np.array(motions, np.float64)
        length = np.hypot(out[:, 0], out[:, 1])
        out[:, :2] *= self.scale
        out[:, 2] = wrap(out[:, 2] + self.drift * length)
        return out

    def then(self, other: OdometryCalibration) -> OdometryCalibration:
        """Return both, first this one and then the other, as one."""
        return OdometryCalibration(self.scale * other.scale, self.drift + self.scale * other.drift)
