"""Sensor models with likelihoods known in closed form, to judge filters by."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from factorloc.mapping import Grid
from factorloc.scan import Scan

PLANE = Grid((-20.0, -20.0), 0.5, (80, 80))
SPACE = Grid((-20.0, -20.0, -5.0), 0.5, (80, 80, 20))


@dataclass(frozen=True)
class Position:
    """Every scan measures the position it was taken at, with Gaussian noise, whatever its rays."""

    where: tuple[float, ...]
    sigma: float = 0.5
    grid: Grid = PLANE
    asked: list[Scan] = field(default_factory=list)

    @property
    def normalized(self) -> bool:
        return False

    def log_likelihood(self, scan: Scan, T_map_body: np.ndarray) -> np.ndarray:
        return np.append(self.scan_log_likelihoods(scan, np.asarray(T_map_body)[None]), np.zeros(len(scan) - 1))

    def scan_log_likelihoods(self, scan: Scan, poses: np.ndarray) -> np.ndarray:
        self.asked.append(scan)
        at = poses[:, :2] if poses.ndim == 2 else poses[:, :3, 3]
        return -0.5 * ((at - self.where) ** 2).sum(1) / self.sigma**2


@dataclass(frozen=True)
class Answer(Position):
    """Answers what a function of the poses says."""

    function: Callable[[np.ndarray], np.ndarray] = lambda poses: np.zeros(len(poses))

    def scan_log_likelihoods(self, scan: Scan, poses: np.ndarray) -> np.ndarray:
        return self.function(poses)


def fan(rays: int = 5, far: float = 10.0, reach: float = 3.0, dimension: int = 2) -> Scan:
    """A scan of rays around, all of one length; beyond ``far`` they have no return."""
    angles = np.linspace(-np.pi, np.pi, rays, endpoint=False)
    if dimension == 2:
        return Scan.from_polar(angles, np.full(rays, reach), (0.1, far))
    return Scan.from_points(reach * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(rays)]), (0.1, far))
