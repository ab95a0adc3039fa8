"""Pole: posts, street lamps, signs, traffic lights and bollards, with their exact truth."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from factorloc.errors import SimulationError
from factorloc.simulation.primitives import box, cone, cylinder, joined, placed, sphere
from factorloc.simulation.solid import Solid
from factorloc.simulation.world import Surface

if TYPE_CHECKING:
    import trimesh

__all__ = ["Pole", "PoleKind"]

_EMBED = 0.3  # m; a pole reaches into the ground, so that it may slope

# Least and greatest width, then least and greatest height of each kind, m.
_SIZES = {
    "post": (0.06, 0.12, 2.2, 3.2),
    "sign": (0.06, 0.10, 2.4, 3.2),
    "lamp": (0.12, 0.24, 5.0, 8.0),
    "traffic light": (0.14, 0.20, 3.2, 3.8),
    "column": (0.28, 0.40, 2.6, 3.4),
    "bollard": (0.10, 0.20, 0.8, 1.0),
}


class PoleKind(enum.StrEnum):
    """What a pole is."""

    POST = "post"
    """A bare shaft."""
    SIGN = "sign"
    """A shaft with a plate at its top."""
    LAMP = "lamp"
    """A shaft with an arm and a lamp."""
    TRAFFIC_LIGHT = "traffic light"
    """A shaft with a box of lights."""
    COLUMN = "column"
    """A thick shaft, such as one for posters."""
    BOLLARD = "bollard"
    """A low shaft with a round head."""
    TRUNK = "trunk"
    """Stem of a tree: a pole to whoever sees it."""
    BARREL = "barrel"
    """Construction barrel: a pole to whoever sees it."""


@dataclass(frozen=True)
class Pole:
    """An upright shaft: exactly what a pole detector should find, and the mesh it finds it in.

    Parameters
    ----------
    id : int
        Identity, the same in all sessions of a town.
    kind : PoleKind
        What it is.
    x, y : float
        Its axis in the world, m.
    width : float
        Mean diameter of the shaft, m: that of a section, over all directions.
    bottom, top : float
        Heights in the world between which the shaft is free and has that width, m.
    yaw : float
        Where an arm or plate points, rad.

    Raises
    ------
    SimulationError
        If the width is not positive or the top not above the bottom.
    """

    id: int
    kind: PoleKind
    x: float
    y: float
    width: float
    bottom: float
    top: float
    yaw: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.width < np.inf or not self.bottom < self.top:
            raise SimulationError(
                f"pole {self.id}: width {self.width} m from {self.bottom} to {self.top} m; need a positive width, top "
                "above bottom"
            )

    @classmethod
    def drawn(
        cls, id: int, kind: PoleKind, position: tuple[float, float], bottom: float, yaw: float, rng: np.random.Generator
    ) -> Pole:
        """Return a pole of usual size.

        Raises
        ------
        SimulationError
            If the kind is a trunk or barrel, which are not poles by trade.
        """
        if kind not in _SIZES:
            raise SimulationError(f"pole {id}: a {kind} belongs to its tree or row; choose another kind")
        thin, thick, low, high = _SIZES[kind]
        width, height = float(rng.uniform(thin, thick)), float(rng.uniform(low, high))
        return cls(id, kind, *position, width, bottom, bottom + height, yaw)

    @property
    def footprint(self) -> shapely.Polygon:
        """Where the shaft stands, m."""
        footprint: shapely.Polygon = shapely.Point(self.x, self.y).buffer(self.width / 2)
        return footprint

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it adds to a world; nothing for a trunk or barrel, which their tree and row add."""
        if self.kind in (PoleKind.TRUNK, PoleKind.BARREL):
            return ()
        return (Solid(self._mesh(), Surface.POLE, f"{self.kind} {self.id}"),)

    def _mesh(self) -> trimesh.Trimesh:
        height, w = self.top - self.bottom, self.width
        parts = [cylinder(w, height + _EMBED, (0, 0, -_EMBED))]
        # Whatever is mounted is above the shaft, so that its truth holds all along.
        match self.kind:
            case PoleKind.SIGN:
                parts.append(box((0.03, 0.6, 0.6), (0, 0, height)))
            case PoleKind.LAMP:
                parts += [box((1.6, 0.08, 0.08), (0.72, 0, height)), box((0.6, 0.25, 0.12), (1.4, 0, height))]
            case PoleKind.TRAFFIC_LIGHT:
                parts += [box((0.3, 0.3, 0.9), (0, 0, height)), cylinder(w * 0.6, 0.1, (0, 0, height + 0.88))]
            case PoleKind.COLUMN:
                parts.append(cone(w * 1.15, w * 0.4, 0.25, (0, 0, height)))
            case PoleKind.BOLLARD:
                parts.append(sphere((w, w, w * 0.6), (0, 0, height), subdivisions=1))
        return placed(joined(parts), (self.x, self.y, self.bottom), self.yaw)
