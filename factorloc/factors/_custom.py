"""The only place that makes custom gtsam factors, behind a check of everything gtsam itself does not check."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import gtsam
import numpy as np
import numpy.typing as npt

from factorloc.errors import GeometryError

__all__ = ["custom_factor"]

Array = npt.NDArray[np.float64]


def custom_factor(
    noise: gtsam.noiseModel.Base,
    keys: Sequence[int],
    dimensions: Sequence[int],
    rows: int,
    residual: Callable[[gtsam.Values, bool], tuple[Array, Sequence[Array]]],
) -> gtsam.CustomFactor:
    """Make a custom factor whose residual and Jacobians are checked at every call.

    gtsam takes whatever a Python factor leaves: a Jacobian that is missing or has the wrong number of rows ends the
    process, one with the wrong number of columns silently leaves the initial value as the solution.

    Parameters
    ----------
    noise : gtsam.noiseModel.Base
        Noise of dimension ``rows``. Robust noise weighs all rows as one block.
    keys : sequence of int
        Variables of the factor.
    dimensions : sequence of int
        Tangent dimension of each variable.
    rows : int
        Length of the residual.
    residual : callable
        ``residual(values, want_jacobians) -> (error, jacobians)``; Jacobians by right (body) perturbations, one of
        shape ``(rows, dimension)`` for each key, ignored when not wanted.

    Raises
    ------
    GeometryError
        From within gtsam, if the residual or a Jacobian has the wrong shape or a Jacobian is not finite.
    """
    dimensions = tuple(dimensions)
    if len(dimensions) != len(keys):
        raise GeometryError(f"custom factor: {len(keys)} keys but {len(dimensions)} dimensions")

    def evaluate(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: gtsam.JacobianVector | None) -> Array:
        error, matrices = residual(values, jacobians is not None)
        error = np.asarray(error, np.float64)
        if error.shape != (rows,):
            raise GeometryError(f"custom factor: residual of shape {error.shape}; expected ({rows},)")
        if jacobians is None:
            return error
        if len(matrices) != len(dimensions):
            raise GeometryError(f"custom factor: {len(matrices)} Jacobians for {len(dimensions)} keys")
        for i, (matrix, dimension) in enumerate(zip(matrices, dimensions, strict=True)):
            J = np.asarray(matrix, np.float64)
            if J.shape != (rows, dimension) or not np.isfinite(J).all():
                raise GeometryError(f"custom factor: Jacobian {i} is {J.shape}; expected finite {(rows, dimension)}")
            jacobians[i] = J
        return error

    return gtsam.CustomFactor(noise, list(keys), evaluate)
