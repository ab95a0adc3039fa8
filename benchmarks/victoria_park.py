"""Victoria Park: real tree trunks, mapped from half of the observations and recognized in the other half.

The file that comes with gtsam has the drive of a truck with a laser through a park of Sydney: odometry, and tree trunks
with recorded association, at most two a pose. Every second observation makes a map, poses and trunks in one graph; from
the others, without their association, the drive is localized in it, from starts that are off. Judged is the
association: how many of the trunks that were named are the recorded ones, and how many of those that could be named
were. Positions are compared with those of the graph that made the map: both are estimates on the same odometry, no
truth.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
import numpy.typing as npt
from pydantic import Field

from benchmarks.bare_poles import bare_poles
from benchmarks.harness import Arguments, Benchmark, arguments, one_line_errors
from benchmarks.victoria_park_picture import park_picture
from factorloc.config import Block, read_config
from factorloc.errors import DataError
from factorloc.factors import OdometryNoise, PoleDetections, PoleLandmarks, PosePrior
from factorloc.geometry import wrap
from factorloc.localization.landmark_smoother import LandmarkSolution, smooth_landmarks
from factorloc.localization.pole_smoother import PoleSmootherSettings, smooth_poles

SETTINGS = Path(__file__).with_name("victoria_park.json")

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_QUICK = 2500  # poses of a quick run


class ObservationNoise(Block):
    """Noise of a trunk's bearing (rad) and range (m)."""

    bearing_sigma: float = Field(gt=0)
    range_sigma: float = Field(gt=0)


class ParkSettings(Block):
    """What ``victoria_park.json`` holds.

    Parameters
    ----------
    every : int
        One of so many observations makes the map; all others localize.
    mapping : ObservationNoise
    odometry : OdometryNoise
    least_sightings : int
        Trunks seen less often, while mapping, are not in the map.
    start : (float, float)
        How far starts are off, m and deg, in directions all around.
    starts : int
        How many.
    smoother : PoleSmootherSettings
    goals : dict of str to float
        Least shares.
    """

    every: int = Field(ge=2)
    mapping: ObservationNoise
    odometry: OdometryNoise
    least_sightings: int = Field(gt=0)
    start: tuple[float, float]
    starts: int = Field(gt=0)
    smoother: PoleSmootherSettings
    goals: dict[str, float]


@dataclass(frozen=True)
class Park:
    """The drive as recorded.

    Parameters
    ----------
    motions : ndarray, shape (N - 1, 3)
    pose_of, tree_of : ndarray of int64, shape (K,)
    points : ndarray, shape (K, 2)
    """

    motions: Array
    pose_of: Index
    tree_of: Index
    points: Array

    @classmethod
    def read(cls, path: Path | str, poses: int | None = None) -> Park:
        """Read the text file: ``ODOMETRY i j dx dy dtheta ...`` and ``LANDMARK i l x y ...``.

        Raises
        ------
        DataError
            If it is no chain of poses.
        """
        rows = [line.split() for line in Path(path).read_text(encoding="ascii").splitlines()]
        steps = np.array([row[1:6] for row in rows if row[0] == "ODOMETRY"], np.float64)
        trees = np.array([row[1:5] for row in rows if row[0] == "LANDMARK"], np.float64)
        if len(steps) == 0 or (steps[1:, 0] != steps[:-1, 1]).any():
            raise DataError(f"{path}: its ODOMETRY lines are no chain of poses")
        # Some numbers between poses were given to trunks.
        names = np.concatenate([steps[:1, 0], steps[:, 1]])
        pose_of = np.searchsorted(names, trees[:, 0])
        tree_of = np.unique(trees[:, 1], return_inverse=True)[1]
        order = np.argsort(pose_of, kind="stable")
        last = len(names) if poses is None else min(poses, len(names))
        order = order[pose_of[order] < last]
        return cls(steps[: last - 1, 2:], pose_of[order], tree_of[order], trees[order, 2:])

    def part(self, mask: npt.NDArray[np.bool_]) -> Park:
        """Return it with some of the observations."""
        return Park(self.motions, self.pose_of[mask], self.tree_of[mask], self.points[mask])

    @property
    def detections(self) -> PoleDetections:
        """Observations without association; of trunks only the place was recorded."""
        poles = bare_poles(self.points)
        counts = np.bincount(self.pose_of, minlength=len(self.motions) + 1)
        return PoleDetections(poles, np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Run the benchmark; the exit code is 1 if a goal is missed."""
    given = arguments("victoria_park", __doc__ or "", argv, settings=str(SETTINGS))
    settings = read_config(given.options["settings"], ParkSettings)
    file: str = gtsam.findExampleDataFile("victoria_park.txt")  # type: ignore[no-untyped-call]
    park = Park.read(file, _QUICK if given.quick else None)
    for_map = np.arange(len(park.points)) % settings.every == 0
    mapped = make_map(park.part(for_map), settings)
    bench = Benchmark("victoria_park", {"quick": given.quick, **settings.model_dump(mode="json")})
    bench.figure("drive", np.hypot(park.motions[:, 0], park.motions[:, 1]).sum(), "m")
    bench.figure("observations for the map", for_map.sum(), "1")
    bench.figure("observations to localize by", (~for_map).sum(), "1")
    return localize(bench, given, park.part(~for_map), mapped, settings)


def make_map(park: Park, settings: ParkSettings) -> LandmarkSolution:
    """Estimate poses and trunks by the observations of one half."""
    noise = settings.mapping
    start = PosePrior.from_sigmas(np.zeros(3), 0.01, 0.001)
    return smooth_landmarks(
        park.motions, park.pose_of, park.tree_of, park.points, start,
        sigma=(noise.bearing_sigma, noise.range_sigma), noise=settings.odometry,
    )  # fmt: skip


def localize(bench: Benchmark, given: Arguments, park: Park, mapped: LandmarkSolution, settings: ParkSettings) -> int:
    """Localize by the other half from several starts; judge and draw."""
    names = np.flatnonzero(mapped.counts >= settings.least_sightings)
    positions = mapped.landmarks[names]
    n = len(names)
    trunks = bare_poles(positions)
    in_map = np.isin(park.tree_of, names)
    bench.figure("trunks in the map", n, "1")
    bench.figure("observations of trunks that are in the map", in_map.sum(), "1")
    correct, near, found, mean, most, seconds, paths = [], [], [], [], [], [], []
    covariances = settings.odometry.covariances(park.motions)
    for k in range(settings.starts):
        angle = 2 * np.pi * k / settings.starts
        off = np.array([np.cos(angle), np.sin(angle)]) * settings.start[0]
        turn = np.radians(settings.start[1]) * (-1) ** k
        start = mapped.poses[0] + [*off, turn]
        done = smooth_poles(
            PoleLandmarks(trunks), park.detections, park.motions, start, covariances=covariances,
            settings=settings.smoother, seed=k,
        )  # fmt: skip
        named = done.matches >= 0
        right = named & (names[np.maximum(done.matches, 0)] == park.tree_of)
        correct.append(right.sum() / max(named.sum(), 1))
        # Some trunks were recorded under two names: the map has them twice, nearer than an observation is sure.
        beside = np.hypot(*(positions[np.maximum(done.matches, 0)] - mapped.landmarks[park.tree_of]).T)
        near.append((named & (beside < settings.mapping.range_sigma)).sum() / max(named.sum(), 1))
        found.append(right[in_map].sum() / in_map.sum())
        apart = done.result.trajectory.poses - mapped.poses
        distance = np.hypot(apart[:, 0], apart[:, 1])
        mean.append(distance.mean())
        most.append(distance.max())
        seconds.append(done.result.seconds)
        paths.append(done.result.trajectory.poses)
        heading = np.degrees(np.abs(wrap(apart[:, 2])).mean())
        bench.figure(f"start {k}: difference of headings from the mapping graph, mean", heading, "deg")
    for name, values, unit in (
        ("named trunks that are the recorded ones", correct, "1"),
        ("named trunks within a standard deviation of a range of the recorded ones", near, "1"),
        ("observations of mapped trunks that were named rightly", found, "1"),
        ("distance from the mapping graph, mean", mean, "m"),
        ("distance from the mapping graph, largest", most, "m"),
        ("localization", seconds, "s"),
    ):
        bench.figure(f"{name}, worst start" if name != "localization" else name, _worst(name, values), unit)
    bench.goal(
        "named trunks that are the recorded ones, worst start", min(correct), "1", least=settings.goals["correct"]
    )
    bench.goal("mapped trunks named rightly, worst start", min(found), "1", least=settings.goals["found"])
    return bench.finish(given, park_picture(mapped.poses, paths[int(np.argmin(correct))], positions))


def _worst(name: str, values: list[float]) -> float:
    if name == "localization":
        return float(np.median(values))
    return min(values) if name.startswith(("named", "observations")) else max(values)


if __name__ == "__main__":
    sys.exit(main())
