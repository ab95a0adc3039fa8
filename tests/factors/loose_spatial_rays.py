"""Spatial rays one by one: what a term says of a pose is then what it says of a ray. And the same by the definition."""

from dataclasses import dataclass

import numpy as np
from naive import Ray, lengths_by_cell

from factorloc.factors._scan_kernels import LEAST_MARGIN
from factorloc.geometry import se3
from factorloc.mapping import Grid
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.distance_table import DistanceTable
from factorloc.mapping.spatial_pyramid import SpatialLevel
from factorloc.rays import Rays
from factorloc.scan import RayStatus


@dataclass(frozen=True)
class LooseSpatialRays:
    """One ray a scan, each with a pose of its own."""

    rays: Rays
    poses: np.ndarray

    def __len__(self) -> int:
        return len(self.poses)

    def bundled(self, pose: np.ndarray) -> Rays:
        """One scan of all rays where they are now, for a body at ``pose``."""
        moved = se3.between(pose, self.poses)
        return Rays(
            se3.transform(moved, self.rays.origins),
            np.einsum("nij,nj->ni", moved[:, :3, :3], self.rays.directions),
            self.rays.ranges,
            self.rays.status,
            np.array([0, len(self)]),
        )

    def in_map(self) -> list[Ray]:
        return [
            Ray((T @ [*a, 1])[:3], T[:3, :3] @ b, float(length), RayStatus.RETURN)
            for T, a, b, length in zip(
                self.poses, self.rays.origins, self.rays.directions, self.rays.ranges, strict=True
            )
        ]


def draw_spatial_rays(grid: Grid, n: int, seed: int) -> LooseSpatialRays:
    """Rays in, out of, across and beyond a grid, whose origins lie off the body by up to 0.9 m."""
    rng = np.random.default_rng(seed)
    low, high = np.array(grid.origin), np.array(grid.upper)
    poses = se3.exp(np.column_stack([rng.normal(0, 1.5, (n, 3)), np.zeros((n, 3))]))
    poses[:, :3, 3] = rng.uniform(low - 0.8, high + 0.8, (n, 3))
    directions = rng.standard_normal((n, 3))
    rays = Rays(
        rng.uniform(-0.5, 0.5, (n, 3)),
        directions / np.linalg.norm(directions, axis=1)[:, None],
        rng.uniform(0.05, 6.0, n),
        np.full(n, RayStatus.RETURN, np.uint8),
        np.arange(n + 1),
    )
    return LooseSpatialRays(rays, poses)


def interpolated(table: CellTable, point: np.ndarray) -> float:
    """Trilinear interpolation between cell centres of a table, which goes on for ever outside of its grid."""
    grid = table.layout.grid
    q = (point - np.array(grid.origin)) / grid.resolution - 0.5
    low = np.floor(q).astype(int)
    corners = low + np.moveaxis(np.indices((2, 2, 2)), 0, -1).reshape(-1, 3)
    return float(np.prod(1 - np.abs(q - corners), axis=1) @ table.at(corners))


def naive_cost(level: SpatialLevel | DistanceTable, ray: Ray) -> float:
    """Cost of one ray by the definition of the model."""
    end = ray.origin + ray.length * ray.direction
    if isinstance(level, DistanceTable):
        residual, huber = interpolated(level.distances, end) / level.sigma, level.huber
        return 0.5 * residual**2 if residual <= huber else huber * (residual - 0.5 * huber)
    rates = level.rates
    integral = sum(
        length * (rates.outside if cell is None else float(rates.at(cell)))
        for cell, length in lengths_by_cell(ray, rates.layout.grid).items()
    )
    return integral - interpolated(level.log_rates, end)


def weight(level: SpatialLevel | DistanceTable, cost: float) -> float:
    """Weight of a ray's outer product: Gauss-Newton on the square root of twice its cost above the least, robustly."""
    if isinstance(level, SpatialLevel):
        return 0.5 / max(cost - level.least_nll, LEAST_MARGIN)
    residual = np.sqrt(2 * cost) if cost <= 0.5 * level.huber**2 else cost / level.huber + 0.5 * level.huber
    return 1 / (min(residual, level.huber) * residual)


def numerical_gradient(cost, poses: np.ndarray, step: float) -> np.ndarray:
    """Central differences of costs (N,) by the tangent vectors of poses (N, 4, 4)."""
    columns = []
    for axis in np.eye(6):
        ahead, behind = (cost(se3.compose(poses, se3.exp(sign * step * axis))) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, -1)


def agree(a: np.ndarray, b: np.ndarray, tolerance: float) -> np.ndarray:
    """Which rows (N, ...) are equal, relative to their length."""
    a, b = a.reshape(len(a), -1), b.reshape(len(b), -1)
    return np.linalg.norm(a - b, axis=1) < tolerance * (1 + np.linalg.norm(b, axis=1))
