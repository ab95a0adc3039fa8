"""ErrorStatistics: what a set of error values amounts to, with its unit."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import EvaluationError

__all__ = ["ErrorStatistics"]


@dataclass(frozen=True)
class ErrorStatistics:
    """Figures of one metric, all in the same unit.

    Parameters
    ----------
    rmse : float
        Root of the mean square.
    mean, median, std, min, max : float
        As named; the standard deviation is the population's (divided by ``count``).
    percentile_95 : float
        The value that 95 % stay below, linearly interpolated.
    count : int
        How many values there were.
    unit : str
        ``"m"``, ``"rad"``, ``"deg"`` or ``"1"``.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    percentile_95: float
    count: int
    unit: str

    @classmethod
    def of(cls, values: npt.ArrayLike, unit: str, name: str = "errors") -> ErrorStatistics:
        """Summarize values.

        Parameters
        ----------
        values : array_like, shape (N,)
            Error values as they are; take magnitudes first where the sign should not count.
        unit : str
            Their unit.
        name : str
            What to call them in an error message.

        Raises
        ------
        EvaluationError
            If there are no values or one is not finite.
        """
        array = np.asarray(values, np.float64)
        if array.ndim != 1 or array.size == 0:
            raise EvaluationError(f"{name}: shape {array.shape}; statistics need at least one value in a row")
        if not np.isfinite(array).all():
            raise EvaluationError(f"{name}: {np.count_nonzero(~np.isfinite(array))} of {array.size} are not finite")
        return cls(
            rmse=float(np.sqrt(np.mean(array**2))),
            mean=float(array.mean()),
            median=float(np.median(array)),
            std=float(array.std()),
            min=float(array.min()),
            max=float(array.max()),
            percentile_95=float(np.percentile(array, 95)),
            count=array.size,
            unit=unit,
        )

    def in_degrees(self) -> ErrorStatistics:
        """Return the same figures in degrees if they are in radians, else themselves; for tables only."""
        if self.unit != "rad":
            return self
        turned = {name: float(np.degrees(value)) for name, value in self.to_dict().items() if isinstance(value, float)}
        return ErrorStatistics(**turned, count=self.count, unit="deg")

    def to_dict(self) -> dict[str, float | int | str]:
        """Return the figures by name, ready for JSON."""
        return asdict(self)
