"""Errors of building maps as they are committed, and those of odometry; nothing exceeds what is declared."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely
from pydantic import Field

from factorloc.config import Block
from factorloc.errors import SimulationError
from factorloc.geometry import se2
from factorloc.mapping import BuildingOutlines, FacadeMap, MapUncertainty, Outline
from factorloc.simulation.streams import stream

__all__ = ["MapErrors", "OdometryErrors"]

Array = npt.NDArray[np.float64]

_ATTEMPTS = 200


class MapErrors(Block):
    """How wrong a map is.

    Parameters
    ----------
    shift_sigma : float
        Standard deviation of the shift of each building along each axis, m.
    shift : float
        Where that is cut, m; what is beyond is drawn again.
    vertex : float
        Greatest error of each corner along each axis, m; uniform.
    gap : float
        Walls of buildings mapped nearer than that are taken for shared, m.
    """

    shift_sigma: float = Field(gt=0)
    shift: float = Field(gt=0)
    vertex: float = Field(ge=0)
    gap: float = Field(gt=0)

    def drawn(self, truth: BuildingOutlines, seed: int) -> FacadeMap:
        """Map outlines with errors, and declare exactly their limits."""
        outlines = tuple(
            Outline(self._moved(outline.polygon, stream(seed, "map error", n)), outline.height, outline.name)
            for n, outline in enumerate(truth.outlines)
        )
        wrong = BuildingOutlines(outlines, truth.frame, truth.attribution, truth.source)
        return FacadeMap.from_outlines(wrong, MapUncertainty(self.shift, self.vertex), gap=self.gap)

    def _moved(self, polygon: shapely.Polygon, rng: np.random.Generator) -> shapely.Polygon:
        shift = np.full(2, np.inf)
        while (far := np.abs(shift) > self.shift).any():
            shift[far] = rng.normal(0.0, self.shift_sigma, int(far.sum()))
        for _ in range(_ATTEMPTS):
            # The ends of a ring are one corner.
            rings = [
                np.concatenate([moved, moved[:1]])
                for ring in shapely.get_rings(polygon)
                for corners in [shapely.get_coordinates(ring)[:-1]]
                for moved in [corners + shift + rng.uniform(-self.vertex, self.vertex, corners.shape)]
            ]
            wrong = shapely.Polygon(rings[0], rings[1:])
            if wrong.is_valid:
                return wrong
        raise SimulationError("map errors: an outline crosses itself with any of them; it has edges that are too short")


class OdometryErrors(Block):
    """Greatest errors of a measured motion between two scans, along and across the body and of its turn.

    Parameters
    ----------
    along_per_metre, across_per_metre : float
        Parts of the way.
    turn_per_metre, turn_per_turn : float
        rad/m and rad/rad.
    least_length, least_turn : float
        What is added to each, m and rad.
    """

    along_per_metre: float = Field(ge=0)
    across_per_metre: float = Field(ge=0)
    turn_per_metre: float = Field(ge=0)
    turn_per_turn: float = Field(ge=0)
    least_length: float = Field(ge=0)
    least_turn: float = Field(ge=0)

    def bounds(self, motions: Array) -> Array:
        """Greatest errors of measured motions (N, 3), shape (N, 3), m and rad."""
        way = np.hypot(motions[:, 0], motions[:, 1])
        along = self.along_per_metre * way + self.least_length
        across = self.across_per_metre * way + self.least_length
        turn = self.turn_per_metre * way + self.turn_per_turn * np.abs(motions[:, 2]) + self.least_turn
        return np.column_stack([along, across, turn])

    def measured(self, poses: Array, rng: np.random.Generator) -> Array:
        """Motions between poses (N, 3), each off by a uniform part of its own bounds."""
        true = se2.between(poses[:-1], poses[1:])
        parts = rng.uniform(-1, 1, true.shape)
        motions = true
        for _ in range(60):  # bounds depend on what is measured; a contraction
            motions = true + parts * self.bounds(motions)
        return motions
