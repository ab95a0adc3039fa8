"""Angles in radians."""

import numpy as np
import numpy.typing as npt

__all__ = ["circular_mean", "unwrap", "wrap"]


def wrap(angle: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Bring angles into (-pi, pi].

    Parameters
    ----------
    angle : array_like
        Angles, rad.

    Returns
    -------
    ndarray
        The same angles in (-pi, pi], of the same shape; those already there are kept to the last bit.
    """
    angle = np.asarray(angle, np.float64)
    turned = np.pi - np.mod(np.pi - angle, 2 * np.pi)
    # The remainder of a tiny negative number rounds up to the modulus itself.
    turned = np.where(turned <= -np.pi, np.pi, turned)
    return np.where((angle > -np.pi) & (angle <= np.pi), angle, turned)


def unwrap(angle: npt.ArrayLike, axis: int = -1) -> npt.NDArray[np.float64]:
    """Make a sequence of angles continuous by adding whole turns.

    Parameters
    ----------
    angle : array_like
        Angles, rad.
    axis : int
        The axis along which they follow each other.

    Returns
    -------
    ndarray
        Angles whose neighbours differ by at most pi.
    """
    return np.unwrap(np.asarray(angle, np.float64), axis=axis)


def circular_mean(angle: npt.ArrayLike, axis: int = -1) -> npt.NDArray[np.float64]:
    """Mean direction of angles.

    Parameters
    ----------
    angle : array_like
        Angles, rad.
    axis : int
        The axis to average over.

    Returns
    -------
    ndarray
        The angle of the mean unit vector, in (-pi, pi].
    """
    angle = np.asarray(angle, np.float64)
    # arctan2 answers -pi for a sine of -0.
    return wrap(np.arctan2(np.sin(angle).mean(axis), np.cos(angle).mean(axis)))
