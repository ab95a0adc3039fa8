"""Local maps: the poles beside each short stretch of a drive, as a vehicle finds them on its way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from factorloc.errors import MapError
from factorloc.geometry import se2, se3
from factorloc.mapping.pole_extractor import PoleExtractor
from factorloc.mapping.pole_settings import PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["LocalMap", "local_maps", "segments"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_MOST_SCANS = 64  # of a segment; a vehicle at rest adds scans and no distance


@dataclass(frozen=True, eq=False)
class LocalMap:
    """Poles found from the scans of one stretch.

    Parameters
    ----------
    scans : ndarray of int64
        Which scans of the drive it was made from, increasing.
    stamp : float
        Time of the newest of them, s.
    T_world_reference : (3,) ndarray
        Pose of the reference frame, m and rad: the body at the newest scan, levelled. Only motions between the scans
        of the stretch and that pose have entered the poles, whatever the drift before.
    poles : Poles
        In the reference frame; heights in the frame of the trajectory.
    corners : (2, 2) ndarray
        Lowest and highest corner of what the local map covers, m, in the frame of its axes.
    T_reference_axes : (3,) ndarray
        Pose of that frame in the reference frame: identity for a local map along the vehicle.
    """

    scans: Index
    stamp: float
    T_world_reference: Array
    poles: Poles
    corners: Array
    T_reference_axes: Array

    @property
    def in_world(self) -> Poles:
        """The poles in the frame of the trajectory."""
        return self.poles.transformed(self.T_world_reference)

    def covers(self, positions: npt.ArrayLike, margin: float = 0.0) -> npt.NDArray[np.bool_]:
        """Whether positions in the frame of the trajectory, m, (N, 2), lie in the local map, a margin off its rim."""
        T_world_axes = se2.compose(self.T_world_reference, self.T_reference_axes)
        inside = se2.transform(se2.inverse(T_world_axes), np.asarray(positions, np.float64).reshape(-1, 2))
        return np.asarray(((inside >= self.corners[0] + margin) & (inside <= self.corners[1] - margin)).all(1))


def segments(trajectory: Trajectory, length: float, spacing: float) -> list[Index]:
    """Cut a drive into stretches of equal length, one beginning every so far.

    Parameters
    ----------
    trajectory : Trajectory
        One pose a scan.
    length, spacing : float
        m along the way.

    Returns
    -------
    list of ndarray of int64
        Rows of the trajectory in each stretch, at most 64, evenly spread; the last stretch ends with the drive.
    """
    if len(trajectory) == 0:
        return []
    steps = np.linalg.norm(np.diff(trajectory.positions[:, :2], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = int(max(np.ceil((along[-1] - length) / spacing - 1e-9), 0)) + 1
    begins = np.minimum(spacing * np.arange(count), max(along[-1] - length, 0.0))
    first = np.searchsorted(along, begins - 1e-9, side="left")
    last = np.searchsorted(along, begins + length + 1e-9, side="right")
    rows = [np.arange(i, j, dtype=np.int64) for i, j in zip(first, last, strict=True) if j > i]
    return [r[np.unique(np.linspace(0, len(r) - 1, min(len(r), _MOST_SCANS)).round().astype(np.int64))] for r in rows]


def local_maps(
    scans: Sequence[Scan],
    trajectory: Trajectory,
    settings: PoleSettings | None = None,
    *,
    axes: Literal["reference", "world"] = "reference",
) -> Iterator[LocalMap]:
    """Find the poles along a drive, stretch by stretch.

    Parameters
    ----------
    scans : sequence of Scan
        Spatial scans; only those of one stretch are held at a time.
    trajectory : Trajectory
        Pose of the body at each: odometry, to localize with the poles, or the truth, to map them.
    settings : PoleSettings, optional
        Of the local maps.
    axes : {"reference", "world"}
        Along which axes local maps are laid: those of the newest pose, or those of the trajectory, on one raster.

    Yields
    ------
    LocalMap
        One a stretch, as soon as it is complete.

    Raises
    ------
    MapError
        If there is not one pose a scan, or scans are planar.
    """
    if len(scans) != len(trajectory):
        raise MapError(f"local maps: {len(scans)} scans, but {len(trajectory)} poses; give one pose a scan")
    chosen = settings or PoleSettings()
    extractor, poses = PoleExtractor(chosen), trajectory.to_3d().poses
    held: dict[int, Scan] = {}
    for rows in segments(trajectory, chosen.segment_length, chosen.segment_spacing):
        held = {int(row): held[int(row)] if int(row) in held else scans[int(row)] for row in rows}
        reference = se3.to_se2(poses[rows[-1]])
        T_reference_axes = se2.identity() if axes == "reference" else se2.inverse(reference)
        T_axes_world = se3.from_se2(se2.inverse(se2.compose(reference, T_reference_axes)))
        bodies = se3.compose(T_axes_world, poses[rows])
        members = list(held.values())
        mount = se3.compose(bodies, np.stack([scan.T_body_sensor for scan in members]))[:, :3, 3]
        window = extractor.window((mount.min(0) + mount.max(0)) / 2)
        poles = extractor.extract(members, bodies, (mount.min(0) + mount.max(0)) / 2)
        corners = np.array([window.origin[:2], window.upper[:2]])
        found = poles.transformed(T_reference_axes)
        yield LocalMap(rows, float(trajectory.stamps[rows[-1]]), reference, found, corners, T_reference_axes)
