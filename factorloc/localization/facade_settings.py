"""Facade settings: everything a localization among facades may be told."""

from __future__ import annotations

import math

from pydantic import Field

from factorloc.config import Block
from factorloc.localization.bounded_motion import OdometryBounds
from factorloc.localization.correspondences import CorrespondenceSettings
from factorloc.localization.facade_hypotheses import HypothesisSettings
from factorloc.localization.facade_places import PlaceSettings
from factorloc.localization.feasible_settings import FeasibleSettings
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.mapping.facade_points import ReductionSettings, ScanErrors

__all__ = ["FacadeDriveSettings", "FacadeSettings"]


class FacadeSettings(Block):
    """Everything a localization among facades may be told; the defaults run.

    Parameters
    ----------
    correspondences : CorrespondenceSettings
        Which lines are believed.
    feasible : FeasibleSettings
        How they are intersected.
    least_squares : LeastSquaresSettings
        What is likely within the bounds.
    odometry : OdometryBounds
        Greatest errors of motions.
    hypotheses : HypothesisSettings
        Which beliefs of a drive are kept.
    places : PlaceSettings
        How other places are looked for.
    margin_position, margin_heading : float
        A tracked set is widened by so much before facades are associated (m, rad): lines at its border are to be seen
        whole. The result is intersected with the set itself.
    forgetting_position, forgetting_heading : float
        A tracked set is widened by so much before every scan (m, rad): bounds of a scan that broke the assumptions
        unnoticed wear off. Zero trusts every scan for good.
    piece_position, piece_heading : float
        A tracked set with greater half sides is asked piece by piece (m, rad): in a wide one no line is unambiguous.
    most_pieces : int
        One of more pieces is only carried along.
    recovery_position, recovery_heading : float
        After a scan that violates the assumptions it is widened by so much (m, rad): what violates them may be the set.
    motion_sigma : float
        Standard deviations of motions, as part of their greatest errors.
    remembered : float
        Errors of walls and buildings are carried along while they are so near, m.
    """

    correspondences: CorrespondenceSettings = CorrespondenceSettings()
    feasible: FeasibleSettings = FeasibleSettings()
    least_squares: LeastSquaresSettings = LeastSquaresSettings()
    odometry: OdometryBounds = OdometryBounds()
    hypotheses: HypothesisSettings = HypothesisSettings()
    places: PlaceSettings = PlaceSettings()
    margin_position: float = Field(0.5, ge=0)
    margin_heading: float = Field(math.radians(0.5), ge=0)
    forgetting_position: float = Field(0.05, ge=0)
    forgetting_heading: float = Field(math.radians(0.05), ge=0)
    piece_position: float = Field(5.0, gt=0)
    piece_heading: float = Field(math.radians(5.0), gt=0)
    most_pieces: int = Field(60, gt=0)
    recovery_position: float = Field(2.0, ge=0)
    recovery_heading: float = Field(math.radians(1.0), ge=0)
    motion_sigma: float = Field(0.5, gt=0)
    remembered: float = Field(60.0, gt=0)


class FacadeDriveSettings(Block):
    """From raw scans to poses among facades.

    Parameters
    ----------
    errors : ScanErrors
        Bounds of the points.
    reduction : ReductionSettings
        What of a scan is taken for a facade.
    localization : FacadeSettings
        Everything else.
    """

    errors: ScanErrors = ScanErrors()
    reduction: ReductionSettings = ReductionSettings()
    localization: FacadeSettings = FacadeSettings()
