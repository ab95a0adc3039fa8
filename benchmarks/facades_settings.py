"""What ``facades_simulated.json`` holds."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from factorloc.config import Block
from factorloc.localization import FacadeSettings, MonteCarloSettings
from factorloc.mapping.facade_points import ReductionSettings, ScanErrors

__all__ = ["SETTINGS", "KindSettings", "SimulatedSettings"]

SETTINGS = Path(__file__).with_name("facades_simulated.json")
"""Everything that was chosen."""


class KindSettings(Block):
    """What belongs to one kind of map.

    Parameters
    ----------
    likelihood_sigma : float
        Standard deviation of the facade likelihood of the particle filter, m.
    confidence : float
        Of the feasible sets of drives. On a better map fewer lines are false without looking so.
    shots, tracking : dict of str to (float or None, float or None)
        Least and most of figures.
    """

    likelihood_sigma: float = Field(gt=0)
    confidence: float = Field(gt=0, lt=1)
    shots: dict[str, tuple[float | None, float | None]]
    tracking: dict[str, tuple[float | None, float | None]]


class SimulatedSettings(Block):
    """All of it.

    Parameters
    ----------
    seed : int
        Of starts and particles.
    start_position, start_heading : float
        Half sides of the box a pose is known to be in, m and deg.
    errors : ScanErrors
        Bounds of the points.
    reduction : ReductionSettings
        Of scans.
    shots, tracking : FacadeSettings
        Of single scans, and of drives.
    particles : MonteCarloSettings
        Of the particle filter.
    one_direction : float
        A pose sees one direction only if all correspondences are within this of parallel, deg.
    well_conditioned : float
        Largest smaller and larger radius of a well-conditioned pose, m.
    kinds : dict of str to KindSettings
        By kind of map.
    """

    seed: int = Field(ge=0)
    start_position: float = Field(gt=0)
    start_heading: float = Field(gt=0)
    errors: ScanErrors
    reduction: ReductionSettings
    shots: FacadeSettings
    tracking: FacadeSettings
    particles: MonteCarloSettings
    one_direction: float = Field(gt=0)
    well_conditioned: float = Field(gt=0)
    kinds: dict[str, KindSettings]

    def of_drives(self, kind: str) -> FacadeSettings:
        """Of drives with a kind of map."""
        feasible = self.tracking.feasible.replaced(confidence=self.kinds[kind].confidence)
        return self.tracking.replaced(feasible=feasible)
