"""Packed frames of KITTI raw drive 0005 with their reference poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from factorloc.errors import DataError
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["KittiFrames", "read_frames"]

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class KittiFrames:
    """Full frames of the lidar, which is the body.

    The reference is the scan-to-map GICP of the same frames: whoever agrees with it is consistent with it, which is no
    proof of being right.

    Parameters
    ----------
    scans : sequence of Scan
        Stamped.
    poses : ndarray, shape (S, 4, 4)
        Reference ``T_velo0_velo``.
    """

    scans: Sequence[Scan]
    poses: Array

    def __len__(self) -> int:
        return len(self.scans)

    def select(self, rows: slice) -> KittiFrames:
        """Return some of the frames."""
        return KittiFrames(self.scans[rows], self.poses[rows])

    @property
    def reference(self) -> Trajectory:
        """Reference poses with the stamps of the scans."""
        return Trajectory(np.array([scan.stamp for scan in self.scans]), self.poses)


def read_frames(data: Path | None, range_limits: tuple[float, float]) -> KittiFrames:
    """Read every third frame of the drive, unthinned.

    Parameters
    ----------
    data : Path or None
        Folder with ``kitti_raw_0005/frames_every3_full.npz`` and ``reference_poses.npz``.
    range_limits : (float, float)
        Minimum and maximum range to use, m.

    Raises
    ------
    DataError
        If there is no data, or it cannot be read.
    """
    if data is None:
        raise DataError("drive 0005: no real data; set FACTORLOC_DATA or give --data")
    folder = data / "kitti_raw_0005"
    packed = _arrays(folder / "frames_every3_full.npz", "x", "y", "z", "scale", "count", "frame")
    reference = _arrays(folder / "reference_poses.npz", "T_velo0_velo", "oxts_t")
    frames = packed["frame"]
    points = np.stack([packed[axis] * float(packed["scale"]) for axis in "xyz"], -1)
    clouds = np.split(points, np.cumsum(packed["count"])[:-1])
    stamps = reference["oxts_t"][frames]
    scans = tuple(
        Scan.from_points(cloud, range_limits, stamp=float(stamp), frame="velo")
        for cloud, stamp in zip(clouds, stamps, strict=True)
    )
    return KittiFrames(scans, reference["T_velo0_velo"][frames])


def _arrays(path: Path, *names: str) -> dict[str, npt.NDArray[Any]]:
    try:
        with np.load(path) as packed:
            return {name: packed[name] for name in names}
    except (OSError, ValueError, KeyError) as error:
        raise DataError(f"{path}: cannot be read ({error})") from error
