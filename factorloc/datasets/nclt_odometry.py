"""Odometry of the NCLT robot: wheels, fibre-optic gyro and IMU fused by a small extended Kalman filter.

The state is ``[x, y, heading, speed, turn rate, bias of the IMU's turn rate]``, in axes that point forward, left and
up. At each scan the pose part is read off and set back to zero, with its covariance: so what is read off is the motion
since the last scan, and its covariance that of the motion alone.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import DataError

__all__ = ["NcltNoise", "NcltSensors", "fuse_odometry"]

Array = npt.NDArray[np.float64]

_GAP = 1.0  # s without wheels; a motion over more of it is not known
_LEAST = np.diag([1e-4, 1e-4, 1e-5]) ** 2


class NcltNoise(Block):
    """Noise of the sensors and of the motion between them.

    Parameters
    ----------
    wheel : float
        Standard deviation of the speed of a wheel, m/s.
    track : float
        Distance of the wheels, m.
    gyro : float
        Of a heading increment of the fibre-optic gyro, rad.
    imu : float
        Of the turn rate of the IMU, rad/s.
    acceleration, turn : float
        What speed (m/s) and turn rate (rad/s) change in a second.
    slip : float
        What a metre driven is off sideways, m.
    bias : float
        What the bias of the IMU changes in a second, rad/s.
    """

    wheel: float = Field(0.05, gt=0)
    track: float = Field(0.56, gt=0)
    gyro: float = Field(0.001, gt=0)
    imu: float = Field(0.02, gt=0)
    acceleration: float = Field(1.0, gt=0)
    turn: float = Field(1.0, gt=0)
    slip: float = Field(0.01, ge=0)
    bias: float = Field(1e-4, ge=0)


@dataclass(frozen=True)
class NcltSensors:
    """What was measured, each with its times (s), in axes forward, left, up.

    Parameters
    ----------
    wheels : ndarray, shape (W, 3)
        Time, left and right speed, m/s.
    gyro : ndarray, shape (G, 2)
        Time and heading, rad, from any zero.
    imu : ndarray, shape (I, 2)
        Time and turn rate, rad/s.
    """

    wheels: Array
    gyro: Array
    imu: Array


def fuse_odometry(
    sensors: NcltSensors, stamps: npt.ArrayLike, noise: NcltNoise | None = None
) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    """Filter all sensors and read off the motions between scans.

    Parameters
    ----------
    sensors : NcltSensors
        Measurements.
    stamps : array_like, shape (N,)
        Times of the scans, s, increasing.
    noise : NcltNoise, optional
        Noise.

    Returns
    -------
    motions : ndarray, shape (N - 1, 3)
        ``T_body[k]_body[k + 1]``, m and rad.
    covariances : ndarray, shape (N - 1, 3, 3)
        In the tangent space of the body after each.
    known : ndarray of bool, shape (N - 1,)
        False where no wheel was read within a second.

    Raises
    ------
    DataError
        If there are no wheels, or times of scans do not increase.
    """
    times = np.asarray(stamps, np.float64)
    if len(sensors.wheels) == 0:
        raise DataError("wheels: no measurement; odometry needs them")
    if (np.diff(times) <= 0).any():
        raise DataError("scans: times do not increase; sort them")
    ekf = _Filter(noise or NcltNoise(), float(times[0]))
    kinds = [(sensors.wheels, 0), (sensors.gyro, 1), (sensors.imu, 2), (times[:, None], 3)]
    events = np.concatenate([np.column_stack([rows[:, 0], np.full(len(rows), kind)]) for rows, kind in kinds])
    which = np.concatenate([np.arange(len(rows)) for rows, _ in kinds])
    order = np.lexsort((events[:, 1], events[:, 0]))
    motions, covariances = np.zeros((len(times) - 1, 3)), np.zeros((len(times) - 1, 3, 3))
    for time, kind, row in zip(events[order, 0], events[order, 1].astype(int), which[order], strict=True):
        ekf.predict(float(time))
        if kind == 0:
            ekf.wheels(*sensors.wheels[row, 1:])
        elif kind == 1:
            ekf.gyro(float(time), float(sensors.gyro[row, 1]))
        elif kind == 2:
            ekf.imu(float(sensors.imu[row, 1]))
        else:
            pose, covariance = ekf.read_off()
            if row > 0:
                motions[row - 1], covariances[row - 1] = pose, covariance
    return motions, covariances, _known(sensors.wheels[:, 0], times)


def _known(wheels: Array, times: Array) -> npt.NDArray[np.bool_]:
    """Whether wheels were read at least once a second between scans."""
    known = np.ones(len(times) - 1, np.bool_)
    for k, (a, b) in enumerate(itertools.pairwise(times.tolist())):
        inside = wheels[np.searchsorted(wheels, a - _GAP) : np.searchsorted(wheels, b + _GAP, side="right")]
        ends = np.concatenate([[min(a, b)], inside[(inside > a) & (inside < b)], [b]])
        near = len(inside) > 0
        known[k] = near and float(np.diff(ends).max()) <= _GAP
    return known


class _Filter:
    """The state and its covariance."""

    def __init__(self, noise: NcltNoise, start: float) -> None:
        self.noise, self.time = noise, start
        self.x = np.zeros(6)
        self.P = np.diag([0.0, 0.0, 0.0, 1.0, 0.5, 0.05]) ** 2
        self.last_gyro: tuple[float, float] | None = None
        self._started = False

    def predict(self, time: float) -> None:
        """Move on, with constant speed and turn rate but for noise."""
        dt = time - self.time
        if dt <= 0:
            return
        if not self._started and dt > _GAP:  # nothing was measured before the first scan
            self.time = time
            return
        n, (_, _, heading, v, w, _) = self.noise, self.x
        middle = heading + 0.5 * w * dt
        c, s = np.cos(middle), np.sin(middle)
        F = np.eye(6)
        F[0, 2:5] = -v * dt * s, dt * c, -0.5 * v * dt * dt * s
        F[1, 2:5] = v * dt * c, dt * s, 0.5 * v * dt * dt * c
        F[2, 4] = dt
        self.x[:3] += v * dt * c, v * dt * s, w * dt
        self.P = F @ self.P @ F.T
        self.P[3, 3] += n.acceleration**2 * dt
        self.P[4, 4] += n.turn**2 * dt
        self.P[5, 5] += n.bias**2 * dt
        side = np.array([-s, c]) * n.slip
        self.P[:2, :2] += np.outer(side, side) * abs(v) * dt
        self.time = time

    def wheels(self, left: float, right: float) -> None:
        """Take the speeds of both wheels."""
        half = self.noise.track / 2
        H = np.zeros((2, 6))
        H[:, 3], H[:, 4] = 1.0, (-half, half)
        self._update(np.array([left, right]), H, np.full(2, self.noise.wheel**2))

    def gyro(self, time: float, heading: float) -> None:
        """Take a heading of the fibre-optic gyro: what it turned since the last, over the time."""
        if self.last_gyro is not None and 0 < time - self.last_gyro[0] <= _GAP:
            dt = time - self.last_gyro[0]
            turned = (heading - self.last_gyro[1] + np.pi) % (2 * np.pi) - np.pi
            H = np.zeros((1, 6))
            H[0, 4] = 1.0
            self._update(np.array([turned / dt]), H, np.array([(self.noise.gyro / dt) ** 2]))
        self.last_gyro = time, heading

    def imu(self, rate: float) -> None:
        """Take the turn rate of the IMU, which has a bias."""
        H = np.zeros((1, 6))
        H[0, 4] = H[0, 5] = 1.0
        self._update(np.array([rate]), H, np.array([self.noise.imu**2]))

    def read_off(self) -> tuple[Array, Array]:
        """Motion since the last call, its covariance in the frame of the body now; the pose begins at zero again."""
        self._started = True
        pose, covariance = self.x[:3].copy(), self.P[:3, :3].copy()
        c, s = np.cos(pose[2]), np.sin(pose[2])
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        self.x[:3] = 0.0
        self.P[:3, :] = self.P[:, :3] = 0.0
        covariance = turn @ covariance @ turn.T + _LEAST
        return pose, (covariance + covariance.T) / 2

    def _update(self, z: Array, H: Array, variances: Array) -> None:
        S = H @ self.P @ H.T + np.diag(variances)
        K = np.linalg.solve(S, H @ self.P).T
        self.x += K @ (z - H @ self.x)
        A = np.eye(6) - K @ H
        self.P = A @ self.P @ A.T + (K * variances) @ K.T
