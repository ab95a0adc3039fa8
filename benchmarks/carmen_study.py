"""What is measured on one CARMEN log: maps, localizations and errors, without a word about goals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from factorloc.datasets import Drive, read_carmen, read_relations
from factorloc.evaluation import ErrorStatistics, absolute_errors, nees
from factorloc.geometry import se2
from factorloc.localization import Localization, LocalizationSettings, PreparedMap, localize, register_many
from factorloc.mapping import RayStatistics
from factorloc.trajectory import Trajectory

__all__ = ["Errors", "Log", "errors_of", "localize_from_around", "open_log", "relation_errors", "truth_floor"]

Array = npt.NDArray[np.float64]

START_OFFSET = 1.0
START_TURN = np.radians(10.0)
DIRECTIONS = 8


@dataclass(frozen=True)
class Log:
    """A log split into the part that makes the map and the part that is localized in it.

    Parameters
    ----------
    name : str
    drive : Drive
        All scans with truth and odometry.
    mapping, localizing : Drive
        Disjoint parts.
    statistics : RayStatistics
        Map of the first.
    """

    name: str
    drive: Drive
    mapping: Drive
    localizing: Drive
    statistics: RayStatistics


def open_log(data: Path, name: str, resolution: float, split: str = "alternate") -> Log:
    """Read a log and its truth, and build the map of one part.

    The odometry is that of the raw log where there is one, else of the ODOM lines between scans of the corrected log.

    Parameters
    ----------
    data : Path
        Folder with ``carmen`` and ``carmen_raw``.
    name : str
        Name of the log.
    resolution : float
        Of the map, m.
    split : {"alternate", "halves"}
        Even scans map and odd ones are localized, or the first half maps and the second is localized.
    """
    corrected, raw = data / "carmen" / f"{name}-corrected.log.gz", data / "carmen_raw" / f"{name}.clf.bz2"
    drive = read_carmen(raw, truth=corrected) if raw.exists() else read_carmen(corrected)
    n = len(drive)
    if split == "halves":
        mapping, localizing = drive.select(slice(0, n // 2)), drive.select(slice(n // 2, None))
    else:
        mapping, localizing = drive.select(slice(0, None, 2)), drive.select(slice(1, None, 2))
    return Log(name, drive, mapping, localizing, map_of(mapping, resolution))


def truth_of(drive: Drive) -> Trajectory:
    """The corrected poses of a drive that has them."""
    assert drive.truth is not None
    return drive.truth


def map_of(drive: Drive, resolution: float) -> RayStatistics:
    """Map of a drive at its corrected poses."""
    return RayStatistics.from_scans(drive.scans, truth_of(drive).poses, resolution=resolution)


def localize_from_around(log: Log, settings: LocalizationSettings, directions: int = DIRECTIONS) -> list[Localization]:
    """Localize from starts 1 m off in evenly spaced directions, turned by 10 degrees to either side in turn."""
    first = truth_of(log.localizing).poses[0]
    runs = []
    for k in range(directions):
        angle = 2 * np.pi * k / directions
        offset = [START_OFFSET * np.cos(angle), START_OFFSET * np.sin(angle), START_TURN * (-1) ** k]
        runs.append(
            localize(
                log.statistics,
                log.localizing.scans,
                log.localizing.odometry,
                first + offset,
                known=log.localizing.odometry_known,
                settings=settings,
            )
        )
    return runs


@dataclass(frozen=True)
class Errors:
    """Errors of many poses against the corrected ones.

    Parameters
    ----------
    position, heading : ErrorStatistics
        m and rad.
    nees : float or None
        Normalized estimation error squared per degree of freedom, before any covariance factor.
    tangent : ndarray, shape (N, 3)
    covariances : ndarray, shape (N, 3, 3), or None
    """

    position: ErrorStatistics
    heading: ErrorStatistics
    nees: float | None
    tangent: Array
    covariances: Array | None


def errors_of(trajectories: list[Trajectory], truth: Trajectory) -> Errors:
    """Pool the errors of several runs over the same scans."""
    found = [absolute_errors(trajectory, truth) for trajectory in trajectories]
    tangent = np.concatenate([errors.tangent for errors in found])
    parts = [trajectory.covariances for trajectory in trajectories]
    covariances = None if any(part is None for part in parts) else np.concatenate([p for p in parts if p is not None])
    return Errors(
        ErrorStatistics.of(np.concatenate([errors.translation for errors in found]), "m", "position"),
        ErrorStatistics.of(np.abs(np.concatenate([errors.heading for errors in found])), "rad", "heading"),
        None if covariances is None else nees(tangent, covariances).mean,
        tangent,
        covariances,
    )


@dataclass(frozen=True)
class Floor:
    """How far two maps from disjoint scans agree, and what both say of the corrected poses.

    Parameters
    ----------
    disagreement : float
        RMS difference of the positions found in the two maps, divided by the root of two: the noise of one, m.
    common : float
        Root of the mean scalar product of the two position errors, m: as the maps share no scan, this is the error of
        the corrected poses themselves (and whatever both maps inherit from them).
    """

    disagreement: float
    common: float


def truth_floor(log: Log, resolution: float, settings: LocalizationSettings) -> Floor:
    """Register the localized scans in two maps of disjoint halves of the mapping scans, from the corrected poses."""
    truth = truth_of(log.localizing).poses
    offsets = []
    for part in (log.mapping.select(slice(0, None, 2)), log.mapping.select(slice(1, None, 2))):
        term = PreparedMap.of(map_of(part, resolution), settings).term(log.localizing.scans)
        found = register_many(term, truth, np.arange(len(truth)), levels=[-1])
        offsets.append(found.poses[:, :2] - truth[:, :2])
    first, second = offsets
    product = float(np.mean((first * second).sum(1)))
    return Floor(
        float(np.sqrt(np.mean(((first - second) ** 2).sum(1)) / 2)), float(np.sign(product) * np.sqrt(abs(product)))
    )


def relation_errors(data: Path, log: Log, settings: LocalizationSettings) -> tuple[Array, Array] | None:
    """Errors of relative poses against measured relations, all scans they name being localized in the map.

    The raw scans between the first and the last relation are tracked from the corrected pose nearest the first of them;
    those named are smoothed.

    Returns
    -------
    (ndarray, ndarray) or None
        Position (m) and heading (rad) error of each relation; None where the log has no relations.
    """
    file = data / "carmen_raw" / f"{log.name}.relations"
    if not file.exists():
        return None
    relations = read_relations(file)
    raw = read_carmen(data / "carmen_raw" / f"{log.name}.clf.bz2")
    rows = relations.rows(raw.keys)
    named = np.unique(rows)
    drive = raw.select(named)
    # The nearest scan with a corrected pose gives the start: carried over by the odometry between the two.
    anchor = int(np.argmin(np.abs(log.drive.keys - raw.keys[named[0]])))
    path = raw.dead_reckoning()
    carried = int(np.argmin(np.abs(raw.keys - log.drive.keys[anchor])))
    motion = se2.between(path.poses[carried], path.poses[named[0]])
    start = se2.compose(truth_of(log.drive).poses[anchor], motion)
    found = localize(
        log.statistics, drive.scans, drive.odometry, start, known=drive.odometry_known, settings=settings
    ).smoothed.trajectory.poses
    index = np.searchsorted(named, rows)
    measured = relations.planar()
    error = se2.between(measured, se2.between(found[index[:, 0]], found[index[:, 1]]))
    return np.hypot(error[:, 0], error[:, 1]), np.abs(error[:, 2])
