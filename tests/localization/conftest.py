"""One map of the simulated office and one drive through it, localized once for all tests of the room."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from factorloc.factors import DecayRateTerm, PosePrior
from factorloc.geometry import se2
from factorloc.localization import smooth, track
from factorloc.mapping import BlurPyramid, RayStatistics
from factorloc.result import Result
from factorloc.simulation import PlanarLidar, SimulatedDrive, office_plan, office_routes, simulate_drive


@dataclass(frozen=True)
class Office:
    """A map, a drive in it, and a start that is wrong by 0.8 m and 8 degrees."""

    statistics: RayStatistics
    pyramid: BlurPyramid
    drive: SimulatedDrive
    term: DecayRateTerm
    prior: PosePrior

    @property
    def truth(self) -> np.ndarray:
        return self.drive.truth.poses

    def errors(self, poses: np.ndarray) -> np.ndarray:
        """Distances between poses and the truth, m."""
        return np.hypot(*(poses - self.truth)[:, :2].T)

    def turns(self, poses: np.ndarray) -> np.ndarray:
        """Heading errors, rad."""
        return np.abs(se2.between(self.truth, poses)[:, 2])


@pytest.fixture(scope="session")
def office() -> Office:
    plan, (mapping, localization) = office_plan(), office_routes()
    mapped = simulate_drive(plan, mapping, seed=1)
    statistics = RayStatistics.from_scans(mapped.scans, mapped.truth.poses)
    lidar = PlanarLidar(beams=109, field_of_view=1.5 * np.pi)
    drive = simulate_drive(plan, replace(localization, waypoints=localization.waypoints[:13]), lidar, seed=2)
    pyramid = BlurPyramid.from_statistics(statistics)
    prior = PosePrior.from_sigmas(drive.truth.poses[0] + [0.6, -0.5, np.radians(8)], 1.0, np.radians(10))
    return Office(statistics, pyramid, drive, DecayRateTerm(pyramid, drive.scans, 0.2), prior)


@dataclass(frozen=True)
class Gap:
    """The drive without scans 18 and 19: 1.5 m of it are not known."""

    term: DecayRateTerm
    odometry: np.ndarray
    known: np.ndarray
    truth: np.ndarray

    def errors(self, poses: np.ndarray) -> np.ndarray:
        """Distances between poses and the truth, m."""
        return np.hypot(*(poses - self.truth)[:, :2].T)


@pytest.fixture(scope="session")
def gap(office: Office) -> Gap:
    scans, odometry = office.drive.scans, office.drive.odometry
    path = np.concatenate([odometry[:17], np.zeros((1, 3)), odometry[20:]])
    term = DecayRateTerm(office.pyramid, scans[:18] + scans[20:], 0.2)
    return Gap(term, path, np.arange(len(path)) != 17, np.delete(office.truth, [18, 19], 0))


@pytest.fixture(scope="session")
def tracked(office: Office) -> Result:
    return track(office.term, office.drive.odometry, office.prior, stamps=office.drive.stamps)


@pytest.fixture(scope="session")
def smoothed(office: Office, tracked: Result) -> Result:
    poses = tracked.trajectory.poses
    return smooth(office.term, office.drive.odometry, poses, prior=office.prior, stamps=office.drive.stamps)
