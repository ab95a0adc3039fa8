"""Pole localization: a drive localized among poles, and what became of the landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from factorloc.localization.moved_poles import MovedGroup
from factorloc.localization.odometry_calibration import OdometryCalibration
from factorloc.localization.pole_consensus import Conflict
from factorloc.result import Result

__all__ = ["PoleLocalization"]

Index = npt.NDArray[np.int64]


@dataclass(frozen=True)
class PoleLocalization:
    """A localized drive, and what became of the landmarks.

    Parameters
    ----------
    result : Result
        Poses with covariances; ``rejected`` counts what was left out.
    matches : ndarray of int64, shape (K,)
        Landmark of each detection, by its row in the map; -1 for none.
    distrusted : ndarray of int64
        Landmarks that contradicted odometry, by their rows: they took no part in the result.
    conflicts : tuple of Conflict
        Where they did, and by how much.
    missed : ndarray of int64
        Landmarks that were in view and not found.
    moved : tuple of MovedGroup
        Landmarks that were found again, all of them beside their places.
    calibration : OdometryCalibration
        What was wrong with odometry all along.
    odometry : str
        Where the noise of odometry is from, against which landmarks were held.
    """

    result: Result
    matches: Index
    distrusted: Index
    conflicts: tuple[Conflict, ...]
    missed: Index
    moved: tuple[MovedGroup, ...]
    calibration: OdometryCalibration
    odometry: str

    def account(self, names: Sequence[str] | None = None) -> str:
        """Say in some lines which landmarks are not trusted, by their rows or names, and what odometry was taken for.

        Nothing, if covariances came with odometry and all landmarks are trusted.
        """

        def call(rows: Index) -> str:
            return ", ".join(str(row) if names is None else names[row] for row in rows)

        lines = [self.odometry] if "without covariances" in self.odometry else []
        if len(self.distrusted):
            lines.append(f"{len(self.distrusted)} landmarks contradict odometry: {call(self.distrusted)}")
        for group in self.moved:
            x, y = group.shift
            lines.append(
                f"{len(group.landmarks)} of {group.missed} landmarks that were missed stand ({x:+.2f}, {y:+.2f}) m "
                f"beside their places: {call(group.landmarks)}"
            )
        return "\n".join(lines)
