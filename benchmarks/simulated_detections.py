"""Simulated detections: poles of a published map, seen from a true path with rates that were measured elsewhere."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.bare_poles import bare_poles
from factorloc.errors import DataError
from factorloc.geometry import se2
from factorloc.mapping.poles import Poles

__all__ = ["Rates", "Sequence"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Rates:
    """Detection rates as they were frozen: shares, 1/m^2, m, m."""

    miss: float
    false: float
    sigma: float
    side: float

    @classmethod
    def read(cls, path: Path) -> Rates:
        """Read the file.

        Raises
        ------
        DataError
            If it is missing or lacks a rate.
        """
        try:
            rates = json.loads(path.read_text(encoding="utf-8"))
            side = rates["local_map"]["side_m"]
            return cls(rates["miss_rate"], rates["false_rate"], rates["position_sigma"], side)
        except (OSError, KeyError, ValueError) as error:
            raise DataError(f"{path}: no detection rates ({error}); run the benchmark poles_kitti first") from error

    def detect(self, poles: Array, pose: Array, rng: np.random.Generator) -> Poles:
        """Draw the poles of a local map at a pose, in the frame of the body."""
        half = self.side / 2
        seen = se2.transform(se2.inverse(pose), poles)
        seen = seen[(np.abs(seen) <= half).all(1)]
        seen = seen[rng.random(len(seen)) >= self.miss]
        seen = seen + rng.normal(0.0, self.sigma, seen.shape)
        clutter = rng.uniform(-half, half, (rng.poisson(self.false * self.side**2), 2))
        return bare_poles(np.concatenate([seen, clutter]))


@dataclass(frozen=True)
class Sequence:
    """A sequence: true poses (N, 3), about evenly spaced, and its poles (L, 2)."""

    name: str
    truth: Array
    poles: Array

    @classmethod
    def read(cls, data: Path, name: str, spacing: float) -> Sequence:
        """Read the true path and the published map.

        Raises
        ------
        DataError
            If a file is missing.
        """
        try:
            cameras = np.loadtxt(data / "kitti_poses" / f"{name}.txt").reshape(-1, 3, 4)
            with np.load(data / "kitti_poles" / f"{name}.npz", allow_pickle=False) as published:
                poles = np.asarray(published["poleparams"], np.float64)[:, :2]
        except OSError as error:
            raise DataError(f"{data}: sequence {name} is not there ({error}); see datasets/") from error
        # Cameras look along z with x to the right: x ahead and y left of the first of them.
        path = np.column_stack([cameras[:, 2, 3], -cameras[:, 0, 3], np.arctan2(-cameras[:, 0, 2], cameras[:, 2, 2])])
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
        rows = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], spacing)))
        return cls(name, path[rows], poles)
