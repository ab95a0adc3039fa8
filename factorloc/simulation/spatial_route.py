"""SpatialRoute: a planar route driven on the ground of a spatial world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.errors import SimulationError
from factorloc.geometry import se2, se3
from factorloc.simulation.mesh_world import MeshWorld
from factorloc.simulation.route import Route
from factorloc.trajectory import Trajectory

__all__ = ["SpatialRoute"]

Array = npt.NDArray[np.float64]

_STEP = 0.01  # s between the poses of a motion; between them it follows the geodesic
_CHECK_STEP = 0.1  # m between the places that are checked


@dataclass(frozen=True)
class SpatialRoute:
    """A route on four wheels: height, roll and pitch follow from the ground under them.

    The body's origin is in the middle of the wheels, on the ground; x looks ahead, z away from the ground.

    Parameters
    ----------
    route : Route
        The path seen from above, with speed and radius of the body.
    wheelbase, track : float
        Distance of the wheels along and across, m.
    height : float
        The body reaches so far above the ground, m; checked against collisions.
    flat : bool
        Drive in the plane z = 0, whatever the ground.

    Raises
    ------
    SimulationError
        If a size is not positive.
    """

    route: Route
    wheelbase: float = 2.7
    track: float = 1.6
    height: float = 1.6
    flat: bool = False

    def __post_init__(self) -> None:
        for name in ("wheelbase", "track", "height"):
            if not 0 < getattr(self, name) < np.inf:
                raise SimulationError(f"route {name}: {getattr(self, name)} m; must be positive and finite")

    def lift(self, world: MeshWorld, poses: npt.ArrayLike) -> Array:
        """Lay planar poses onto the ground.

        Parameters
        ----------
        world : MeshWorld
            Its ground, the topmost where one lies over another.
        poses : array_like, shape (..., 3)
            ``T_world_body`` seen from above.

        Returns
        -------
        ndarray, shape (..., 4, 4)
            ``T_world_body`` in the plane that fits the ground under the four wheels best.

        Raises
        ------
        SimulationError
            If a wheel has no ground under it.
        """
        planar = se2.as_poses(poses)
        lifted = se3.from_se2(planar)
        if self.flat:
            return lifted
        half_x, half_y = self.wheelbase / 2, self.track / 2
        wheels = np.array([(half_x, half_y), (half_x, -half_y), (-half_x, half_y), (-half_x, -half_y)])
        heights = world.ground_height(se2.transform(planar[..., None, :], wheels))
        if np.isnan(heights).any():
            x, y, _ = planar[np.isnan(heights).any(-1)][0]
            raise SimulationError(f"route: no ground under a wheel at ({x:.2f}, {y:.2f}); lay some or drive flat")
        along = (heights[..., :2].mean(-1) - heights[..., 2:].mean(-1)) / self.wheelbase
        across = (heights[..., ::2].mean(-1) - heights[..., 1::2].mean(-1)) / self.track
        one, zero = np.ones_like(along), np.zeros_like(along)
        ahead = _normalized(np.stack([one, zero, along], -1))
        normal = _normalized(np.stack([-along, -across, one], -1))
        tilt = np.stack([ahead, np.cross(normal, ahead), normal], -1)
        lifted[..., :3, :3] = lifted[..., :3, :3] @ tilt
        lifted[..., 2, 3] = heights.mean(-1)
        return lifted

    def motion(self, world: MeshWorld, start: float, end: float) -> Trajectory:
        """Pose of the body every 10 ms from start to end, s; the vehicle stands before time 0 and after the route."""
        stamps = np.linspace(start, end, int(np.ceil((end - start) / _STEP - 1e-9)) + 1)
        distances = np.clip(stamps * self.route.speed, 0, self.route.length)
        return Trajectory(stamps, self.lift(world, self.route.poses_at(distances)))

    def check(self, world: MeshWorld) -> None:
        """Make sure that the body touches nothing but ground, moving solids included.

        The body is a column of spheres of the radius of the route, up to the height of the vehicle; canopies can be
        driven through.

        Parameters
        ----------
        world : MeshWorld
            The surroundings.

        Raises
        ------
        SimulationError
            If the body touches something, or a wheel has no ground; names the first place.
        """
        radius = self.route.body_radius
        distances = np.linspace(0, self.route.length, int(self.route.length / min(_CHECK_STEP, radius)) + 2)
        poses = self.lift(world, self.route.poses_at(distances))
        top = max(self.height - radius, radius)
        centres = np.zeros((int(np.ceil((top - radius) / radius)) + 1, 3))
        centres[:, 2] = np.linspace(radius, top, len(centres))
        spheres = se3.transform(poses[:, None], centres)
        touching = (world.clearance(spheres, (distances / self.route.speed)[:, None]) <= radius).any(-1)
        if touching.any():
            first = int(touching.argmax())
            x, y, z = poses[first, :3, 3]
            raise SimulationError(
                f"route: a body of radius {radius:.2f} m touches something at ({x:.2f}, {y:.2f}, {z:.2f}), "
                f"{distances[first]:.1f} m along; move the waypoints"
            )


def _normalized(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
