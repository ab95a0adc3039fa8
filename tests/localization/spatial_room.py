"""A furnished room, a map of it and a drive through it over a floor that sways, once for all tests that want one."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from factorloc.factors import PosePrior
from factorloc.factors.spatial_scan_term import SpatialScanTerm
from factorloc.geometry import se3
from factorloc.localization import PreparedMap
from factorloc.mapping import BrickStatistics
from factorloc.scan import Scan
from factorloc.simulation import MeshWorld, Solid, SpatialOdometryNoise, Surface, vlp_16
from factorloc.simulation.primitives import box, boxes, cylinder


@dataclass(frozen=True)
class Room:
    """A map, a drive in it, and a start that is wrong by 0.4 m and 5 degrees."""

    statistics: BrickStatistics
    prepared: PreparedMap
    scans: list[Scan]
    truth: np.ndarray
    odometry: np.ndarray
    covariances: np.ndarray
    term: SpatialScanTerm
    prior: PosePrior

    def errors(self, poses: np.ndarray, of: slice = slice(None)) -> np.ndarray:
        """Tangent vectors from the truth to poses, (N, 6)."""
        return se3.log(se3.between(self.truth[of], poses))


def distances(tangents: np.ndarray) -> np.ndarray:
    """Lengths of translations, m."""
    return np.linalg.norm(tangents[..., 3:], axis=-1)


def turns(tangents: np.ndarray) -> np.ndarray:
    """Angles of rotations, rad."""
    return np.linalg.norm(tangents[..., :3], axis=-1)


def world() -> MeshWorld:
    walls = boxes(
        [
            [[-7.2, -5.2, 0], [7.2, -5, 4]],
            [[-7.2, 5, 0], [7.2, 5.2, 4]],
            [[-7.2, -5.2, 0], [-7, 5.2, 4]],
            [[7, -5.2, 0], [7.2, 5.2, 4]],
            [[-7.2, -5.2, -0.2], [7.2, 5.2, 0]],
        ]
    )
    shelves = [box((1.2, 0.6, 1.5), (-3.0, 3.5, 0), 0.3), box((0.8, 2.0, 0.9), (4.5, -2.5, 0), -0.2)]
    furniture = [*shelves, cylinder(0.5, 4.0, (1.0, 2.6, 0)), cylinder(0.4, 1.2, (-4.0, -3.0, 0))]
    return MeshWorld([Solid(mesh, Surface.FACADE) for mesh in (walls, *furniture)])


def arc(n: int, radius: float, begin: float, rng: np.random.Generator) -> np.ndarray:
    """Poses along an ellipse, rolling and pitching by a degree or two."""
    angle = begin + np.linspace(0, 1.6 * np.pi, n)
    level = np.column_stack([1.6 * radius * np.cos(angle), radius * np.sin(angle), angle + np.pi / 2])
    sway = np.column_stack([rng.normal(0, np.radians(1.5), (n, 2)), np.zeros((n, 3)), rng.normal(0, 0.03, n)])
    return se3.compose(se3.from_se2(level), se3.exp(sway))


@cache
def room() -> Room:
    rng = np.random.default_rng(6)
    mount = se3.exp(np.array([0.0, 0.02, 0.3, 0.0, 0.0, 0.0]))
    mount[:3, 3] = [0.2, 0.0, 1.1]
    lidar = vlp_16(columns=120, T_body_sensor=mount, range_sigma=0.02)
    here, mapped, truth = world(), arc(30, 2.2, 0.0, rng), arc(14, 1.7, 0.5, rng)
    statistics = BrickStatistics.from_scans(lidar.cast_many(here, mapped, rng), mapped, resolution=0.2)
    scans = lidar.cast_many(here, truth, rng, 0.5 * np.arange(len(truth)))
    odometry, covariances = SpatialOdometryNoise().sample(truth, rng)
    prepared = PreparedMap.of(statistics)
    wrong = se3.compose(truth[0], se3.exp(np.array([0.0, 0.0, np.radians(5), 0.3, -0.25, 0.05])))
    prior = PosePrior.from_sigmas(wrong, 0.5, np.radians(5))
    return Room(statistics, prepared, scans, truth, odometry, covariances, prepared.term(scans), prior)
