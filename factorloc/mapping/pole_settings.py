"""Pole settings: how local maps are cut out of a drive, and what in them counts as a pole."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from factorloc.config import Block

__all__ = ["BY_EVIDENCE", "KITTI_LIKE", "NCLT_LIKE", "EvidenceSettings", "PoleSettings"]

Positive = Annotated[float, Field(gt=0)]
Beta = tuple[Positive, Positive]


class EvidenceSettings(Block):
    """How likely hits and misses are in each kind of cell, and how much evidence makes a pole.

    Parameters
    ----------
    shaft, free, clutter : (float, float)
        Alpha and beta of the reflection probability of cells of a shaft, of free cells, and of cells of anything else.
    most_rays : int
        Rays of one cell that count: those that follow say the same again.
    least : float
        Evidence of the weakest pole, nats.
    """

    shaft: Beta = (1.0, 1.5)
    free: Beta = (0.03, 3.0)
    clutter: Beta = (0.5, 1.0)
    most_rays: int = Field(10, ge=1, le=1000)
    least: float = Field(4.0, gt=0)


class PoleSettings(Block):
    """Settings of the pole extractor and of the local maps it works on (thesis, 12.4.1 and 12.5).

    Parameters
    ----------
    resolution : float
        Edge length of a cell, m.
    size : (float, float, float)
        Local map along x, y and z, m.
    depth : float
        How far it reaches below the lidar, m.
    most_width : int
        Widest pole, cells; the narrowest is one.
    hull : float
        Thickness of the free space around a pole, m (f).
    occupied_above : float
        Reflection probability above which a cell counts as occupied (mu_o).
    least_score : float
        Score that the cells of a pole surpass (q_min).
    evidence : EvidenceSettings, optional
        Score boxes by likelihood ratios instead, which count only where rays have been; None scores as published.
    fit : bool
        Fit axes and widths to the returns, instead of reading them off the cells as published.
    least_height : float
        Height of the lowest pole, m (h_min).
    bandwidth : float
        Standard deviation of the kernel of mean shift, m. The thesis does not tell it.
    segment_length : float
        How far a drive goes during the scans of one local map, m.
    segment_spacing : float
        How far it goes from one local map to the next, m.
    """

    resolution: float = Field(0.2, gt=0)
    size: tuple[float, float, float] = (30.0, 30.0, 5.0)
    depth: float = Field(2.0, ge=0)
    most_width: int = Field(5, ge=1)
    hull: float = Field(0.2, gt=0)
    occupied_above: float = Field(0.2, gt=0, lt=1)
    least_score: float = Field(0.6, ge=0, lt=1)
    evidence: EvidenceSettings | None = None
    fit: bool = False
    least_height: float = Field(1.0, gt=0)
    bandwidth: float = Field(0.2, gt=0)
    segment_length: float = Field(1.5, gt=0)
    segment_spacing: float = Field(1.5, gt=0)

    @model_validator(mode="after")
    def _cells_fit(self) -> Self:
        if min(self.shape[:2]) < self.most_width + 2 * self.hull_cells:
            raise ValueError(f"size {self.size} m leaves no room for a pole; enlarge it or refine the resolution")
        if self.height_cells > self.shape[2]:
            raise ValueError(f"least_height {self.least_height} m is more than the {self.size[2]} m of a local map")
        return self

    @property
    def shape(self) -> tuple[int, int, int]:
        """Cells of a local map along x, y and z."""
        x, y, z = (max(1, round(length / self.resolution)) for length in self.size)
        return x, y, z

    @property
    def hull_cells(self) -> int:
        """Thickness of the free space around a pole, cells."""
        return max(1, round(self.hull / self.resolution))

    @property
    def height_cells(self) -> int:
        """Cells of the lowest pole."""
        return max(1, round(self.least_height / self.resolution))


NCLT_LIKE = PoleSettings()
"""Coarse cells and short segments, for poses good to some decimetres (thesis, 12.5.1)."""

KITTI_LIKE = PoleSettings(
    resolution=0.1, size=(30.0, 30.0, 3.0), most_width=10, segment_length=5.0, segment_spacing=3.0, bandwidth=0.1
)
"""Fine cells and longer segments, for poses good to some centimetres (thesis, 12.5.2)."""

BY_EVIDENCE = PoleSettings(
    size=(30.0, 30.0, 4.0), segment_length=5.0, segment_spacing=3.0, evidence=EvidenceSettings(), fit=True
)
"""Likelihood ratios in coarse cells, axes fitted to the returns: for lidars whose beams leave gaps in local maps."""
