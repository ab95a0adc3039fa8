"""One scan among facades: correspondences, the feasible set they leave, and the most likely pose in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.factors.prior import PosePrior
from factorloc.localization.bounded_least_squares import BoundedEstimate, estimate_in_bounds
from factorloc.localization.correspondence import Correspondences
from factorloc.localization.correspondences import find_correspondences
from factorloc.localization.facade_settings import FacadeSettings
from factorloc.localization.feasible_layers import Layer, as_layers
from factorloc.localization.feasible_set import FeasibleSet, intersect_correspondences
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds

__all__ = ["FacadeStep", "localize_scan", "middle_of"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FacadeStep:
    """What one scan gave.

    Parameters
    ----------
    correspondences : Correspondences
        Lines and their facades.
    feasible : FeasibleSet
        What they leave of the start; empty where assumptions are violated.
    estimate : BoundedEstimate or None
        The most likely pose in it; None if it is empty.
    guess : ndarray, shape (3,), or None
        Where the search for it began; None if the set is empty.
    prior : PosePrior, WallBelief or None
        What else was known.
    """

    correspondences: Correspondences
    feasible: FeasibleSet
    estimate: BoundedEstimate | None
    guess: Array | None = None
    prior: PosePrior | WallBelief | None = None


def localize_scan(
    points: FacadePoints,
    walls: WallLines,
    start: Bounds,
    guess: npt.ArrayLike | None = None,
    *,
    within: Bounds | Sequence[Bounds] | Sequence[Layer] | None = None,
    prior: PosePrior | WallBelief | None = None,
    settings: FacadeSettings | None = None,
) -> FacadeStep:
    """Localize one scan among facades: feasible set, and the most likely pose in it.

    Parameters
    ----------
    points : FacadePoints
        The scan.
    walls : WallLines
        The map.
    start : Bounds
        Where the body may be when facades are associated.
    guess : array_like, shape (3,), optional
        Where the search for the most likely pose begins; the middle of the feasible set by default.
    within : Bounds, or sequence of Bounds or Layer, optional
        Where the body may be, as a set, as slices of one or as layers; the start by default.
    prior : PosePrior or WallBelief, optional
        What else is known.
    settings : FacadeSettings, optional
        All settings.
    """
    settings = settings or FacadeSettings()
    correspondences = find_correspondences(points, walls, start, settings.correspondences)
    layers = as_layers(start if within is None else within)
    feasible = intersect_correspondences(correspondences.found, walls, layers, settings.feasible)
    if feasible.violated:
        return FacadeStep(correspondences, feasible, None, None, prior)
    begin = middle_of(feasible.bounds) if guess is None else np.asarray(guess, np.float64)
    estimate = estimate_in_bounds(
        points, correspondences, walls, begin, feasible.bounds,
        conflicts=feasible.conflicts, prior=prior, settings=settings.least_squares,
    )  # fmt: skip
    return FacadeStep(correspondences, feasible, estimate, begin, prior)


def middle_of(bounds: Bounds) -> Array:
    """Pose in the middle of a feasible set: of its largest polygon, and of the headings."""
    polygon = max(bounds.polygons, key=lambda corners: float(np.ptp(corners, axis=0).prod()))
    return np.array([*polygon.mean(0), 0.5 * (bounds.orientation[0] + bounds.orientation[1])])
