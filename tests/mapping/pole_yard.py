"""A yard of poles and a wall, seen by a lidar whose rays are cut with cylinders exactly."""

from __future__ import annotations

import os

import numpy as np
import numpy.typing as npt
import pytest

from factorloc.geometry import se3
from factorloc.scan import RayStatus, Scan

Array = npt.NDArray[np.float64]

full_size = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="local maps of full size want compiled kernels"
)

POLES = np.array([[4.03, 3.11, 0.15], [-3.0, 4.5, 0.30], [5.2, -4.07, 0.10], [-4.4, -2.9, 0.40]])
"""x, y and width, m; from the ground up to 4 m."""

WALL = 8.0  # y of a wall without end, m


def scan_at(x: float, y: float, yaw: float, rng: np.random.Generator, beams: int = 64, sigma: float = 0.01) -> Scan:
    """Scan of a lidar 1.8 m above the ground z = 0."""
    azimuth = np.linspace(-np.pi, np.pi, 1200, endpoint=False)
    elevation = np.radians(np.linspace(-24, 6, beams))
    a, e = (values.ravel() for values in np.meshgrid(azimuth, elevation))
    local = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], 1)
    d = local @ se3.from_se2([0, 0, yaw])[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = np.where(d[:, 2] < 0, -1.8 / d[:, 2], np.inf)
        wall = np.where(d[:, 1] > 0, (WALL - y) / d[:, 1], np.inf)
    wall[1.8 + d[:, 2] * np.where(np.isfinite(wall), wall, 0) > 6] = np.inf
    ranges = np.minimum(ground, wall)
    flat = d[:, 0] ** 2 + d[:, 1] ** 2
    for px, py, width in POLES:
        b = d[:, 0] * (px - x) + d[:, 1] * (py - y)
        c = (px - x) ** 2 + (py - y) ** 2 - width**2 / 4
        root = b**2 - flat * c
        near = np.where((root > 0) & (b > 0), (b - np.sqrt(np.maximum(root, 0))) / flat, np.inf)
        near[1.8 + d[:, 2] * np.where(np.isfinite(near), near, 0) > 4] = np.inf
        ranges = np.minimum(ranges, near)
    status = np.where(ranges < 50, RayStatus.RETURN, RayStatus.NO_RETURN)
    ranges = np.minimum(ranges, 50) + sigma * rng.standard_normal(len(ranges))
    mount = np.eye(4)
    mount[2, 3] = 1.8
    return Scan(local, ranges, status, (0.5, 50.0), T_body_sensor=mount)


def drive(beams: int = 64, count: int = 5, seed: int = 0) -> tuple[list[Scan], Array]:
    """Scans and planar poses of a drive of 4 m along x."""
    rng = np.random.default_rng(seed)
    poses = np.stack([np.linspace(-2, 2, count), 0.1 * rng.normal(size=count), 0.1 * rng.normal(size=count)], 1)
    return [scan_at(*pose, rng, beams=beams) for pose in poses.tolist()], poses
