"""Consistency: whether an estimator is as accurate as its covariances say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import EvaluationError

__all__ = ["Consistency", "covariance_factor", "nees"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Consistency:
    """Normalized estimation errors squared (NEES).

    Parameters
    ----------
    values : ndarray, shape (N,)
        ``e^T P^-1 e`` of each pose; chi-square distributed with ``freedom`` degrees if the estimator is consistent.
    per_coordinate : ndarray, shape (D,)
        Mean of ``e_k^2 / P_kk``: which coordinate is trusted too much (above 1) or too little (below 1).
    freedom : int
        Degrees of freedom D of a pose, 3 or 6.
    probability : float
        Probability of the bounds.
    """

    values: Array
    per_coordinate: Array
    freedom: int
    probability: float

    @property
    def mean(self) -> float:
        """Mean NEES per degree of freedom: 1 if consistent, above 1 if over-confident."""
        return float(self.values.mean() / self.freedom)

    @property
    def bounds(self) -> tuple[float, float]:
        """Chi-square interval that :attr:`mean` of a consistent estimator falls into with ``probability``.

        It takes the poses for independent. Errors along one smoothed trajectory are not, which widens it.
        """
        tail = (1 - self.probability) / 2
        total = self.freedom * self.values.size
        low, high = (_chi_square_quantile(p, total) / total for p in (tail, 1 - tail))
        return low, high

    @property
    def consistent(self) -> bool:
        """Whether the mean lies within the bounds."""
        low, high = self.bounds
        return low <= self.mean <= high

    @property
    def share_inside(self) -> float:
        """Share of poses inside their own confidence ellipsoid of ``probability``, which it should come near."""
        return float(np.mean(self.values <= _chi_square_quantile(self.probability, self.freedom)))

    @property
    def covariance_factor(self) -> float:
        """The number s for which ``s * covariances`` have a mean NEES per degree of freedom of 1."""
        return self.mean


def nees(errors: npt.ArrayLike, covariances: npt.ArrayLike, probability: float = 0.95) -> Consistency:
    """Weigh errors by their covariances (Bar-Shalom et al., 2001, section 5.4.2).

    Parameters
    ----------
    errors : array_like, shape (N, D)
        Errors ``log(T_estimate_truth)`` in the tangent space of the estimated body:
        :attr:`factorloc.evaluation.pose_errors.PoseErrors.tangent`.
    covariances : array_like, shape (N, D, D)
        What the estimator thinks they are, in the same space.
    probability : float
        Probability of the bounds, between 0 and 1.

    Raises
    ------
    EvaluationError
        If shapes disagree, there are no errors, a value is not finite, or a covariance is not symmetric and positive
        definite.
    """
    e, P = np.asarray(errors, np.float64), np.asarray(covariances, np.float64)
    if e.ndim != 2 or e.size == 0:
        raise EvaluationError(f"errors: shape {e.shape}; expected one tangent vector a row, at least one")
    n, freedom = e.shape
    if P.shape != (n, freedom, freedom):
        raise EvaluationError(f"covariances: shape {P.shape}; expected {(n, freedom, freedom)}, one an error")
    if not 0 < probability < 1:
        raise EvaluationError(f"probability: {probability}; expected a number between 0 and 1")
    if not (np.isfinite(e).all() and np.isfinite(P).all()):
        raise EvaluationError("errors or covariances: hold NaN or infinity")
    # Unit diagonals first, so that the test does not depend on the units of the coordinates.
    variance = np.diagonal(P, axis1=1, axis2=2)
    sigma = np.sqrt(np.where(variance > 0, variance, 1.0))
    correlation = P / (sigma[:, :, None] * sigma[:, None, :])
    asymmetry = np.abs(correlation - correlation.swapaxes(1, 2)).max((1, 2))
    bad = (variance <= 0).any(1) | (asymmetry > 1e-6) | (np.linalg.eigvalsh(correlation)[:, 0] <= freedom * 2e-16)
    if bad.any():
        raise EvaluationError(
            f"covariances: {np.count_nonzero(bad)} of {n} are not symmetric positive definite, "
            f"the first in row {int(bad.argmax())}"
        )
    z = e / sigma
    values = np.einsum("ni,ni->n", z, np.linalg.solve(correlation, z[..., None])[..., 0])
    return Consistency(values=values, per_coordinate=(z**2).mean(0), freedom=freedom, probability=probability)


def covariance_factor(errors: npt.ArrayLike, covariances: npt.ArrayLike) -> float:
    """Return the number s for which ``s * covariances`` fit the errors: mean NEES per degree of freedom of 1.

    Parameters
    ----------
    errors, covariances : array_like
        As for :func:`nees`, which says what is raised.
    """
    return nees(errors, covariances).covariance_factor


def _chi_square_quantile(probability: float, freedom: int) -> float:
    # The incomplete gamma function directly: scipy.stats takes half a second to import.
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(freedom / 2, probability))
