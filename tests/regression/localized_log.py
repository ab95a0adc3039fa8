"""A real log, localized in the map of its other half."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from factorloc.datasets import read_carmen
from factorloc.evaluation import absolute_errors
from factorloc.localization import localize
from factorloc.mapping import RayStatistics
from factorloc.trajectory import Trajectory

START = np.array([0.8, -0.6, np.radians(10.0)])
"""How wrong the start is: 1 m and 10 degrees."""


class Figures(NamedTuple):
    """Errors of a smoothed drive: metres, the heading's in degrees."""

    rmse: float
    median: float
    percentile_95: float
    maximum: float
    heading_rmse: float


def localized(data: Path, name: str) -> tuple[Figures, int]:
    """Map the even scans at 0.1 m, localize the odd ones by raw odometry; errors, and how many scans there were."""
    drive = read_carmen(data / f"carmen_raw/{name}.clf.bz2", truth=data / f"carmen/{name}-corrected.log.gz")
    even, odd = drive.select(slice(0, None, 2)), drive.select(slice(1, None, 2))
    statistics = RayStatistics.from_scans(even.scans, even.truth.poses, resolution=0.1)
    start = odd.truth.poses[0] + START
    result = localize(statistics, odd.scans, odd.odometry, start, known=odd.odometry_known).smoothed
    assert result.converged
    # Stamps repeat and run backwards in these logs; the scans are in order.
    truth = Trajectory(result.trajectory.stamps, odd.truth.poses)
    errors = absolute_errors(result.trajectory, truth)
    distance = errors.translation
    return Figures(
        rmse=float(np.sqrt(np.mean(distance**2))),
        median=float(np.median(distance)),
        percentile_95=float(np.quantile(distance, 0.95)),
        maximum=float(distance.max()),
        heading_rmse=float(np.degrees(np.sqrt(np.mean(errors.heading**2)))),
    ), len(odd)
