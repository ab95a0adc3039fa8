"""Least squares settings: what is likely among facades, and how it is sought."""

from __future__ import annotations

from pydantic import Field

from factorloc.config import Block

__all__ = ["LeastSquaresSettings"]


class LeastSquaresSettings(Block):
    """What is likely within the bounds, and how it is sought.

    Parameters
    ----------
    point_sigma : float
        Standard deviation of a point's distance from its wall, m.
    cauchy : float
        Threshold of the robust loss, in standard deviations: balconies, parked cars and points of other walls are
        associated too.
    line_cauchy : tuple of float
        The same for the lines that the search begins with, one after the other: from wide, where the start is rough.
    gate : float
        Lines farther from where a belief has them are left out, in standard deviations.
    information : float
        Weight of a point; neighbours share a wall's ornaments.
    most_doubt : float
        More doubtful correspondences are left out, unless all are and nothing else is known.
    shift_sigma, vertex_sigma : float
        Standard deviations of shifts and of vertex errors, as parts of their greatest values.
    surface_sigma : float
        What walls seen by a lidar are off at their ends besides, m: they have windows, doors and balconies.
    max_iterations : int
        Accepted steps.
    tolerance : float
        Ends when a step lowers the cost by less.
    initial_damping, damping_factor, max_damping : float
        Of Levenberg and Marquardt's method, relative to the diagonal.
    """

    point_sigma: float = Field(0.1, gt=0)
    cauchy: float = Field(2.0, gt=0)
    line_cauchy: tuple[float, ...] = (30.0, 10.0, 3.0)
    gate: float = Field(4.0, gt=0)
    information: float = Field(0.2, gt=0, le=1)
    most_doubt: float = Field(0.2, gt=0, le=1)
    shift_sigma: float = Field(0.25, gt=0)
    vertex_sigma: float = Field(0.5, gt=0)
    surface_sigma: float = Field(0.05, ge=0)
    max_iterations: int = Field(40, gt=0)
    tolerance: float = Field(1e-3, gt=0)
    initial_damping: float = Field(1e-4, gt=0)
    damping_factor: float = Field(10.0, gt=1)
    max_damping: float = Field(1e8, gt=0)
