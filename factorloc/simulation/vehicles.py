"""Vehicle and Pedestrian: what stands or moves in a street, in a few convex parts."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely
import shapely.affinity

from factorloc.errors import SimulationError
from factorloc.simulation.primitives import box, convex, cylinder, joined, mesh_of, placed, sphere
from factorloc.simulation.solid import Solid
from factorloc.simulation.world import Surface

__all__ = ["VEHICLE_MODELS", "Pedestrian", "Vehicle"]

Array = npt.NDArray[np.float64]

# Side views as (x, z) over length and height: body, then cabin. x = 0 is the rear bumper, 1 the front; z = 0 the road.
_BODIES = {
    "saloon": (
        ((0.00, 0.25), (0.02, 0.58), (0.30, 0.66), (0.70, 0.64), (0.98, 0.50), (1.00, 0.25), (0.97, 0.14), (0.0, 0.14)),
        ((0.14, 0.62), (0.30, 0.97), (0.36, 1.00), (0.54, 1.00), (0.74, 0.62)),
    ),
    "estate": (
        ((0.00, 0.22), (0.01, 0.58), (0.30, 0.64), (0.72, 0.62), (0.98, 0.50), (1.00, 0.22), (0.97, 0.13), (0.0, 0.13)),
        ((0.02, 0.56), (0.08, 0.97), (0.16, 1.00), (0.52, 1.00), (0.74, 0.58)),
    ),
    "van": (
        ((0.00, 0.16), (0.00, 0.55), (0.80, 0.55), (0.98, 0.46), (1.00, 0.20), (0.98, 0.11), (0.01, 0.11)),
        ((0.00, 0.50), (0.01, 0.98), (0.04, 1.00), (0.72, 1.00), (0.78, 0.97), (0.92, 0.50)),
    ),
}  # fmt: skip
# Length, width, height of each model, m; single cars differ from it by a few percent.
VEHICLE_MODELS = {"saloon": (4.5, 1.80, 1.45), "estate": (4.3, 1.78, 1.52), "van": (5.2, 1.95, 2.15)}
"""Length, width and height of the models of vehicles, m."""

_WHEEL = (0.64, 0.22)  # diameter, width, m


@dataclass(frozen=True)
class Vehicle:
    """A car, parked or moving.

    Parameters
    ----------
    model : str
        One of ``VEHICLE_MODELS``.
    x, y, z : float
        Centre on the road at time 0, m.
    yaw : float
        Heading, rad.
    scale : float
        Size relative to the model.
    speed : float
        Speed along its heading, m/s; 0 for a parked car.

    Raises
    ------
    SimulationError
        If there is no such model, or the scale is not positive.
    """

    model: str
    x: float
    y: float
    z: float = 0.0
    yaw: float = 0.0
    scale: float = 1.0
    speed: float = 0.0

    def __post_init__(self) -> None:
        if self.model not in VEHICLE_MODELS:
            raise SimulationError(f"vehicle model {self.model!r}: unknown; choose one of {', '.join(VEHICLE_MODELS)}")
        if not 0 < self.scale < np.inf:
            raise SimulationError(f"vehicle scale: {self.scale}; must be positive and finite")

    @classmethod
    def drawn(
        cls, position: tuple[float, float], z: float, yaw: float, rng: np.random.Generator, speed: float = 0.0
    ) -> Vehicle:
        """Return a car of any model at a place."""
        model = str(rng.choice(list(VEHICLE_MODELS), p=[0.4, 0.4, 0.2]))
        return cls(model, *position, z, yaw, float(rng.uniform(0.94, 1.03)), speed)

    @property
    def size(self) -> tuple[float, float, float]:
        """Length, width and height, m."""
        length, width, height = (self.scale * size for size in VEHICLE_MODELS[self.model])
        return length, width, height

    @property
    def footprint(self) -> shapely.Polygon:
        """Rectangle it takes up at time 0, m."""
        length, width, _ = self.size
        outline = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
        turned = shapely.affinity.rotate(outline, self.yaw, origin=(0, 0), use_radians=True)
        footprint: shapely.Polygon = shapely.affinity.translate(turned, self.x, self.y)
        return footprint

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity in the world on level ground, m/s."""
        return self.speed * float(np.cos(self.yaw)), self.speed * float(np.sin(self.yaw)), 0.0

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What it adds to a world."""
        vertices, faces = _model(self.model)
        mesh = mesh_of(vertices * self.scale, faces)
        mesh = placed(mesh, (self.x, self.y, self.z), self.yaw)
        return (Solid(mesh, Surface.VEHICLE, self.model, self.velocity),)


@dataclass(frozen=True)
class Pedestrian:
    """Somebody on foot.

    Parameters
    ----------
    x, y, z : float
        Where they stand at time 0, m.
    yaw : float
        Heading, rad.
    height : float
        Height, m.
    speed : float
        Speed along the heading, m/s.
    """

    x: float
    y: float
    z: float = 0.0
    yaw: float = 0.0
    height: float = 1.75
    speed: float = 0.0

    @property
    def footprint(self) -> shapely.Polygon:
        """Disc they take up at time 0, m."""
        footprint: shapely.Polygon = shapely.Point(self.x, self.y).buffer(0.3 * self.height / 1.75)
        return footprint

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity in the world on level ground, m/s."""
        return self.speed * float(np.cos(self.yaw)), self.speed * float(np.sin(self.yaw)), 0.0

    @property
    def solids(self) -> tuple[Solid, ...]:
        """What they add to a world."""
        stride = 0.18 if self.speed else 0.0
        parts = [
            cylinder(0.15, 0.88, (stride, 0.09, 0), 8),
            cylinder(0.15, 0.88, (-stride, -0.09, 0), 8),
            sphere((0.26, 0.42, 0.72), (0, 0, 1.16), 1),
            cylinder(0.09, 0.6, (-stride / 2, 0.25, 0.82), 6),
            cylinder(0.09, 0.6, (stride / 2, -0.25, 0.82), 6),
            sphere((0.19, 0.16, 0.25), (0, 0, 1.625), 1),
        ]
        body = joined(parts)
        mesh = mesh_of(body.vertices * (self.height / 1.75), body.faces)
        mesh = placed(mesh, (self.x, self.y, self.z), self.yaw)
        return (Solid(mesh, Surface.PEDESTRIAN, "pedestrian", self.velocity),)


@functools.cache
def _model(name: str) -> tuple[Array, npt.NDArray[np.int64]]:
    """Vertices and faces of a model about the centre of its length and width, on the road."""
    length, width, height = VEHICLE_MODELS[name]
    parts = []
    for outline, taper in zip(_BODIES[name], (0.03, 0.16 if name != "van" else 0.08), strict=True):
        side = np.array(outline) * (length, height) - (length / 2, 0)
        rise = (side[:, 1] - side[:, 1].min()) / np.ptp(side[:, 1])
        half = width / 2 * (1 - taper * rise) - 0.005
        parts.append(convex(np.concatenate([np.column_stack([side[:, 0], s * half, side[:, 1]]) for s in (-1, 1)])))
    diameter, thickness = _WHEEL
    wheel = cylinder(diameter, thickness, (0, 0, 0), 12)
    lying = np.asarray(wheel.vertices) @ np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
    # The polygon of a wheel touches the road with a side.
    radius = float(-lying[:, 2].min())
    for x in (-0.30 * length, 0.30 * length):
        for y in (-width / 2 + 0.01, width / 2 - 0.01 - thickness):
            shifted = lying - (0, lying[:, 1].min(), 0) + (x, y, radius)
            parts.append(mesh_of(shifted, wheel.faces))
    mirrors = [box((0.1, 0.16, 0.12), (0.18 * length, y, 0.62 * height)) for y in (-width / 2 + 0.08, width / 2 - 0.08)]
    whole = joined([*parts, *mirrors])
    return np.asarray(whole.vertices), np.asarray(whole.faces)
