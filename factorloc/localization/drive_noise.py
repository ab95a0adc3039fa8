"""Drive noise: how far off the odometry of a drive is, told by the drive itself against a path in a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import nnls

from factorloc.factors.odometry import OdometryNoise
from factorloc.geometry import se2

__all__ = ["UNTOLD", "DriveNoise"]

Array = npt.NDArray[np.float64]

UNTOLD = OdometryNoise(
    turn_per_turn=0.05, turn_per_metre=0.02, length_per_metre=0.05, length_per_turn=0.02, least_turn=0.004,
    least_length=0.02, huber=3.0,
)  # fmt: skip
"""Of odometry nobody said anything about: some 7 cm and 2 degrees after a metre, more than most vehicles are off by. A
path that follows its landmarks shows how good odometry was."""

_LENGTHS = (15.0, 30.0, 60.0, 120.0)  # m; errors of landmarks are alike over less
_LEAST = 8  # stretches of a length; fewer say nothing
_NORMAL = 1.4826  # standard deviations of a normal distribution in its median of absolute deviations
_SPREAD = 2.3  # relative standard error of a squared median deviation, times the root of the count
_REWEIGHTED = 5
_FLOOR = np.array([0.005, 0.0005]) ** 2  # m^2/m and rad^2/m; what an error of the path hides is no perfect odometry
_STANDING = np.array([0.002, 0.0002]) ** 2  # m^2 and rad^2 of any motion, be it none at all


@dataclass(frozen=True)
class DriveNoise:
    """Variances that grow with the way.

    Parameters
    ----------
    length : float
        Of the way driven, and of what is slid sideways, m^2/m.
    turn : float
        rad^2/m.
    """

    length: float
    turn: float

    @classmethod
    def of(cls, poses: npt.ArrayLike, motions: npt.ArrayLike, known: npt.NDArray[np.bool_]) -> DriveNoise | None:
        """Compare odometry with a path over stretches of several lengths.

        What an error of the path adds to the difference is the same for all lengths, what odometry adds grows with
        them: variances are fitted by ``2 sigma^2 + q length``, with neither negative. They are medians of absolute
        deviations, so that a place where the path is wrong does no harm.

        Parameters
        ----------
        poses : array_like, shape (N, 3)
            The path.
        motions : array_like, shape (N - 1, 3)
            Odometry, calibrated.
        known : ndarray of bool, shape (N - 1,)
            Which motions were measured.

        Returns
        -------
        DriveNoise or None
            None of a drive too short to tell.
        """
        path, steps = np.asarray(poses, np.float64), np.asarray(motions, np.float64)
        way = se2.way(steps)
        lengths, variances, levers, counts = [], [], [], []
        for length in _LENGTHS:
            starts = np.arange(0.0, way[-1] - length, length / 2)
            ends = np.searchsorted(way, np.stack([starts, starts + length], 1))
            rows = [_apart(path, steps, a, b) for a, b in ends.tolist() if known[a:b].all()]
            if len(rows) < _LEAST:
                break
            apart = np.array(rows)
            lengths.append(length)
            counts.append(len(apart))
            variances.append((_NORMAL * np.median(np.abs(apart[:, :3]), axis=0)) ** 2)
            levers.append(np.median(apart[:, 3]))
        if len(lengths) < 2:
            return None
        lever, variance = np.array(levers), np.array(variances)
        turn = max(_rate(np.array(lengths), variance[:, 2], np.array(counts), 0 * lever), _FLOOR[1])
        along = _rate(np.array(lengths), variance[:, 0], np.array(counts), turn * lever)
        return cls(float(max(along, _FLOOR[0])), float(turn))

    def covariances(self, motions: npt.ArrayLike) -> Array:
        """Covariances (N, 3, 3) of motions (N, 3) in the tangent space of the body after each."""
        of = np.asarray(motions, np.float64)
        # A turn in place is a way too: some metre a radian is what wheels roll.
        rolled = np.hypot(of[:, 0], of[:, 1]) + np.abs(of[:, 2])
        out = np.zeros((len(of), 3, 3))
        out[:, 0, 0] = out[:, 1, 1] = self.length * rolled + _STANDING[0]
        out[:, 2, 2] = self.turn * rolled + _STANDING[1]
        return out

    def __str__(self) -> str:
        """Return standard deviations after a metre."""
        return f"{100 * np.sqrt(self.length):.1f} cm and {np.degrees(np.sqrt(self.turn)):.2f} deg per square root of m"


def _apart(path: Array, steps: Array, a: int, b: int) -> Array:
    """Compare odometry from pose a to pose b with the path.

    Returns
    -------
    ndarray, shape (4,)
        By how much it misses, in the tangent space of the last pose, m, m, rad; and what a variance of 1 rad^2/m of
        turns adds to that of the way along it, m^2: turns move the end of a bend.
    """
    free = np.zeros((b - a + 1, 3))
    for k, step in enumerate(steps[a:b]):
        free[k + 1] = se2.compose(free[k], step)
    beside = se2.between(free[-1], free[:-1])[:, 1]
    lever = float((np.hypot(steps[a:b, 0], steps[a:b, 1]) * beside**2).sum())
    return np.append(se2.log(se2.between(free[-1], se2.between(path[a], path[b]))), lever)


def _rate(lengths: Array, variances: Array, counts: npt.NDArray[np.int64], others: Array) -> float:
    """Growth of variances with length, and one standard error more: too small a noise distrusts what is right.

    A variance is as sure as it is large: as the fit has it, not as it came out, or small ones would count most.
    What others add to it (L,) is known.
    """
    plain, fitted = np.stack([np.ones(len(lengths)), lengths], 1), np.maximum(variances, 1e-12)
    for _ in range(_REWEIGHTED):
        weight = np.sqrt(counts) / (_SPREAD * fitted)
        design = plain * weight[:, None]
        solution = nnls(design, (variances - others) * weight)[0]
        fitted = np.maximum(plain @ solution + others, 1e-12)
    return float(solution[1] + np.sqrt(np.linalg.inv(design.T @ design)[1, 1]))
