"""What Monte Carlo localization is tried in: the office with tours through all of it, and the street."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.tours import Roadmap, TourSettings
from factorloc.config import Block
from factorloc.localization import AroundPose, FreeSpace, Initialization
from factorloc.mapping import BrickStatistics, RayStatistics
from factorloc.scan import Scan
from factorloc.simulation import (
    OdometryNoise,
    PlanarLidar,
    StreetSettings,
    hdl_32e,
    office_plan,
    simulate_drive,
    street_route,
    street_world,
)

__all__ = ["Guess", "LidarSettings", "Office", "Run", "Runs", "Street", "StreetRuns"]

Array = npt.NDArray[np.float64]


class LidarSettings(Block):
    """A planar lidar.

    Parameters
    ----------
    beams : int
        Rays of a scan.
    field_of_view : float
        Angle between the first and the last, deg.
    range_limits : (float, float)
        Minimum and maximum range, m.
    range_sigma : float
        Noise of ranges, m.
    dropout : float
        Share of reflections that are not noticed.
    """

    beams: int = Field(gt=1)
    field_of_view: float = Field(gt=0, lt=360)
    range_limits: tuple[float, float]
    range_sigma: float = Field(ge=0)
    dropout: float = Field(ge=0, lt=1)

    @property
    def lidar(self) -> PlanarLidar:
        """The lidar."""
        values = self.model_dump() | {"field_of_view": np.radians(self.field_of_view)}
        return PlanarLidar(**values)


class Runs(Block):
    """How many drives are localized.

    Parameters
    ----------
    runs : int
        Each with a tour, noise and particles of its own.
    scans : int
        Of a run.
    """

    runs: int = Field(gt=0)
    scans: int = Field(gt=1)


class Guess(Runs):
    """Drives whose first pose is known roughly.

    Parameters
    ----------
    position : float
        Guesses are uniform over the disc of this radius about the truth, and truths are believed uniform over the same
        disc about the guess, m.
    heading : float
        Likewise over plus and minus this, deg.
    """

    position: float = Field(gt=0)
    heading: float = Field(gt=0, le=180)

    def around(
        self, truth: Array, rng: np.random.Generator, height_sigma: float = 0, tilt_sigma: float = 0
    ) -> AroundPose:
        """Draw a guess, and return what is believed."""
        guess = AroundPose(truth, self.position, np.radians(self.heading)).sample(1, rng)[0]
        return AroundPose(guess, self.position, np.radians(self.heading), height_sigma, tilt_sigma)


class StreetRuns(Guess):
    """A simulated street, mapped by an HDL-32E in one lane, and driven along in both.

    Parameters
    ----------
    street : StreetSettings
        The street.
    columns : int
        Firings in one turn of the lidar.
    range_limits : (float, float)
        Its minimum and maximum range, m.
    range_sigma : float
        Noise of its ranges, m.
    resolution : float
        Edge length of a cell, m.
    speed : float
        Of all drives, m/s.
    period, mapping_period : float
        Time between scans that are localized, and that make the map, s.
    height_sigma, tilt_sigma : float
        What is believed of height (m), roll and pitch (rad) of the first pose.
    """

    street: StreetSettings
    columns: int = Field(gt=0)
    range_limits: tuple[float, float]
    range_sigma: float = Field(ge=0)
    resolution: float = Field(gt=0)
    speed: float = Field(gt=0)
    period: float = Field(gt=0)
    mapping_period: float = Field(gt=0)
    height_sigma: float = Field(ge=0)
    tilt_sigma: float = Field(ge=0)


@dataclass(frozen=True)
class Run:
    """A drive to be localized.

    Parameters
    ----------
    scans : sequence of Scan
        Measurements.
    odometry : ndarray, shape (N - 1, 3) or (N - 1, 4, 4)
        Motions.
    covariances : ndarray, optional
        Theirs, in space.
    truth : ndarray, shape (N, 3) or (N, 4, 4)
        True poses.
    start : Initialization
        What is believed of the first.
    seed : int
        Of the particles.
    """

    scans: tuple[Scan, ...]
    odometry: Array
    covariances: Array | None
    truth: Array
    start: Initialization
    seed: int


class Office:
    """The office, and a map of it that a survey made.

    Parameters
    ----------
    tours : TourSettings
        Of the survey and of all drives.
    lidar : PlanarLidar
        Of all drives.
    noise : OdometryNoise
        Of the wheels.
    period : float
        Time between scans, s.
    resolution : float
        Edge length of a cell, m.
    seed : int
        Of everything.
    """

    def __init__(
        self, tours: TourSettings, lidar: PlanarLidar, noise: OdometryNoise, period: float, resolution: float, seed: int
    ) -> None:
        self.plan, self.lidar, self.noise, self.period, self.seed = office_plan(), lidar, noise, period, seed
        self.size = (30.0, 20.0)
        self.roadmap = Roadmap(self.plan, self.size, tours, seed)
        survey = self.roadmap.survey(np.random.default_rng([seed, 1]))
        mapping = simulate_drive(self.plan, survey, lidar, noise, seed=self._seed(2), period=period)
        self.survey_length = survey.length
        self.statistics = RayStatistics.from_scans(mapping.scans, mapping.truth.poses, resolution=resolution)
        everywhere = FreeSpace.of(self.statistics)
        grid, cells = everywhere.grid, everywhere.cells
        centres = np.array(grid.origin) + (cells + 0.5) * grid.resolution
        within = ((centres > 0) & (centres < self.size)).all(1)  # rays pass the windows, the vehicle does not
        self.free_space = FreeSpace(grid, cells[within])

    def run(self, number: int, scans: int, guess: Guess | None) -> Run:
        """Simulate a drive; with a guess of the first pose, or without any."""
        kind = 4 if guess is None else 3
        rng = np.random.default_rng([self.seed, kind, number])
        route = self.roadmap.tour((scans + 1) * self.period, rng)
        drive = simulate_drive(
            self.plan, route, self.lidar, self.noise, seed=int(rng.integers(2**31)), period=self.period
        )
        truth = drive.truth.poses[:scans]
        start = self.free_space if guess is None else guess.around(truth[0], rng)
        return Run(
            tuple(drive.scans[:scans]), drive.odometry[: scans - 1], None, truth, start, int(rng.integers(2**31))
        )

    def _seed(self, of: int) -> int:
        return int(np.random.default_rng([self.seed, of]).integers(2**31))


class Street:
    """The street, and a map of it.

    Parameters
    ----------
    settings : StreetRuns
        What it is like.
    seed : int
        Of everything.
    """

    def __init__(self, settings: StreetRuns, seed: int) -> None:
        s, self.settings, self.seed = settings, settings, seed
        self.world, self.route = street_world(s.street, seed), street_route(s.street, s.speed)
        self.lidar = hdl_32e(columns=s.columns, range_limits=s.range_limits, range_sigma=s.range_sigma)
        mapping = simulate_drive(self.world, self.route, self.lidar, seed=seed, period=s.mapping_period)
        self.statistics = BrickStatistics.from_scans(mapping.scans, mapping.truth.poses, resolution=s.resolution)

    def run(self, number: int) -> Run:
        """Simulate a drive, in turn in the lane that was mapped and in the other one, from anywhere it can begin."""
        s, rng = self.settings, np.random.default_rng([self.seed, 5, number])
        (x, y), (end, _) = self.route.waypoints
        length = s.scans * s.period * s.speed
        first = rng.uniform(x, max(end - length, x))
        corners = ((first, y), (min(first + length, end), y))
        if number % 2:
            corners = (corners[1][0], -y), (corners[0][0], -y)
        route = type(self.route)(corners, self.route.radius, s.speed, self.route.body_radius)
        drive = simulate_drive(self.world, route, self.lidar, seed=int(rng.integers(2**31)), period=s.period)
        scans = min(s.scans, len(drive))
        truth = drive.truth.poses[:scans]
        start = s.around(truth[0], rng, s.height_sigma, s.tilt_sigma)
        covariances = drive.odometry_covariances
        return Run(
            tuple(drive.scans[:scans]),
            drive.odometry[: scans - 1],
            None if covariances is None else covariances[: scans - 1],
            truth,
            start,
            int(rng.integers(2**31)),
        )
