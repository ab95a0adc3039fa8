"""Rays one by one: what a term says of a pose is then what it says of a ray. And the same by the definition, slowly."""

import math
from dataclasses import dataclass

import numpy as np
from naive import Ray, lengths_by_cell

from factorloc.factors import DecayRateTerm, EndPointTerm, PosteriorTerm
from factorloc.factors.grid_scan_term import GridScanTerm
from factorloc.geometry import se2
from factorloc.mapping import Grid
from factorloc.rays import Rays
from factorloc.scan import RayStatus

BLURS = (0.5, 0.1, 0.0)
MODELS = ("decay-rate", "decay-rate-posterior", "end-point", "distance-field")


@dataclass(frozen=True)
class LooseRays:
    """One ray a scan, each with a pose of its own."""

    rays: Rays
    poses: np.ndarray

    def __len__(self) -> int:
        return len(self.poses)

    def select(self, keep: np.ndarray) -> "LooseRays":
        rays = self.rays.select(keep)
        return LooseRays(
            Rays(rays.origins, rays.directions, rays.ranges, rays.status, np.arange(keep.sum() + 1)), self.poses[keep]
        )

    def bundled(self, pose: np.ndarray) -> Rays:
        """One scan of all rays where they are now, for a body at ``pose``."""
        moved = se2.between(pose, self.poses)
        return Rays(
            se2.transform(moved, self.rays.origins),
            se2.rotate(moved[:, 2], self.rays.directions),
            self.rays.ranges,
            self.rays.status,
            np.array([0, len(self)]),
        )

    def in_map(self) -> list[Ray]:
        origins = se2.transform(self.poses, self.rays.origins)
        directions = se2.rotate(self.poses[:, 2], self.rays.directions)
        return [Ray(*row, RayStatus.RETURN) for row in zip(origins, directions, self.rays.ranges, strict=True)]


def draw_rays(grid: Grid, n: int, seed: int) -> LooseRays:
    """Rays in, out of, across and beyond a grid, whose origins lie off the body by up to 0.7 m."""
    rng = np.random.default_rng(seed)
    low, high = np.array(grid.origin), np.array(grid.upper)
    poses = np.column_stack([rng.uniform(low - 1.5, high + 1.5, (n, 2)), rng.uniform(-np.pi, np.pi, n)])
    angle = rng.uniform(-np.pi, np.pi, n)
    rays = Rays(
        rng.uniform(-0.5, 0.5, (n, 2)),
        np.column_stack([np.cos(angle), np.sin(angle)]),
        rng.uniform(0.05, 6.0, n),
        np.full(n, RayStatus.RETURN, np.uint8),
        np.arange(n + 1),
    )
    return LooseRays(rays, poses)


def interpolated(table: np.ndarray, grid: Grid, point: np.ndarray) -> float:
    """Bilinear interpolation between cell centres of a rimmed table, which goes on for ever as its rim."""
    q = (point - np.array(grid.origin)) / grid.resolution + 0.5
    low = np.floor(q).astype(int)
    total = 0.0
    for i in (low[0], low[0] + 1):
        for j in (low[1], low[1] + 1):
            cell = np.clip([i, j], 0, np.array(table.shape) - 1)
            total += (1 - abs(q[0] - i)) * (1 - abs(q[1] - j)) * table[tuple(cell)]
    return float(total)


def naive_cost(term: GridScanTerm, level: int, ray: Ray) -> float:
    """Cost of one ray by the definition of the model."""
    grid, numbers = term.grid, term.numbers[level]
    shape = (grid.shape[0] + 2, grid.shape[1] + 2)
    end = ray.origin + ray.length * ray.direction
    if isinstance(term, DecayRateTerm):
        rates = term.primary[level].reshape(shape)
        integral = sum(
            length * (numbers[0] if cell is None else rates[cell[0] + 1, cell[1] + 1])
            for cell, length in lengths_by_cell(ray, grid).items()
        )
        return integral - interpolated(term.secondary[level].reshape(shape), grid, end)
    if isinstance(term, PosteriorTerm):
        shapes, paths = term.primary[level].reshape(shape), term.secondary[level].reshape(shape)
        passing = 0.0
        for cell, length in lengths_by_cell(ray, grid).items():
            at = (0, 0) if cell is None else (cell[0] + 1, cell[1] + 1)
            passing += shapes[at] * math.log1p(length / paths[at])
        return passing - interpolated(term.tertiary[level].reshape(shape), grid, end)
    residual = interpolated(term.primary[level].reshape(shape), grid, end) / numbers[1]
    if isinstance(term, EndPointTerm):
        return -math.log(math.exp(numbers[3] - 0.5 * residual**2) + 0.05 / 5.0)
    huber = numbers[2]
    return 0.5 * residual**2 if residual <= huber else huber * (residual - 0.5 * huber)


def weight(term: GridScanTerm, level: int, cost: float) -> float:
    """Weight of a ray's outer product: Gauss-Newton on the square root of twice its cost above the least, robustly."""
    if isinstance(term, DecayRateTerm | PosteriorTerm):
        return 0.5 / max(cost - term.numbers[level, 1], 0.05)
    if isinstance(term, EndPointTerm):
        near = max(math.exp(-cost - term.numbers[level, 3]) - term.numbers[level, 2], 1e-12)
        square = -2 * math.log(min(near, 1.0))
        return (near + term.numbers[level, 2]) / (near * square) if square > 1e-12 else 0.0
    huber = term.numbers[level, 2]
    residual = math.sqrt(2 * cost) if cost <= 0.5 * huber**2 else cost / huber + 0.5 * huber
    return 1 / (min(residual, huber) * residual)
