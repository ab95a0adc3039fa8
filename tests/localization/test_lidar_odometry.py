"""Motions between spatial scans, and how far they may be trusted."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from factorloc.datasets import Drive
from factorloc.errors import ConfigError, FactorlocWarning, GeometryError
from factorloc.geometry import se3
from factorloc.localization.lidar_odometry import LidarOdometrySettings, lidar_odometry, with_lidar_odometry
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

LIMITS = (0.5, 60.0)
MOUNT = se3.exp([0.1, -0.2, 1.8, 1.2, -0.3, 1.5])
NO_FLOOR = LidarOdometrySettings(least_rotation=1e-9, least_translation=1e-9)


def street(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points on a ground with two facades, house corners and poles, m."""
    span = rng.uniform(-1, 1, (count, 2))
    ground = np.column_stack([span * [40, 8], np.zeros(count)])
    left = np.column_stack([span[:, 0] * 40, 8 + 1.5 * (np.floor(span[:, 0] * 5) % 2), 3 + 3 * span[:, 1]])
    right = np.column_stack([span[:, 0] * 40, -8 - 2.0 * (np.floor(span[:, 0] * 3) % 2), 3 + 3 * span[:, 1]])
    gables = np.column_stack([np.rint(span[:, 0] * 5) * 8, 10 + 2 * span[:, 1], rng.uniform(0, 6, count)])
    angle = rng.uniform(0, 2 * np.pi, count)
    poles = np.column_stack([np.rint(span[:, 0] * 4) * 9, np.full(count, -6.0), rng.uniform(0, 5, count)])
    poles[:, :2] += 0.15 * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([ground, left, right, gables, poles])


def scan(T_world_sensor: np.ndarray, rng: np.random.Generator, mount: np.ndarray | None = None) -> Scan:
    """What a lidar of 2 cm noise sees of the street, samples of its own each time."""
    points = street(rng, 2500)
    points += rng.normal(0, 0.02, points.shape)
    return Scan.from_points(se3.transform(se3.inverse(T_world_sensor), points), LIMITS, T_body_sensor=mount)


@dataclass(frozen=True)
class Passage:
    poses: np.ndarray
    scans: tuple[Scan, ...]

    @property
    def motions(self) -> np.ndarray:
        return se3.between(self.poses[:-1], self.poses[1:])


@pytest.fixture(scope="module")
def passage() -> Passage:
    """Eleven poses of a body that turns while it drives, its lidar turned and tilted."""
    rng = np.random.default_rng(5)
    steps = np.array([[0.002, 0.004, 0.03, 0.9 + 0.02 * k, 0.02, 0.0] for k in range(10)])
    poses = [se3.exp([0.02, -0.01, 0.4, -8, -3, 0.3])]
    for step in steps:
        poses.append(poses[-1] @ se3.exp(step))
    return Passage(np.array(poses), tuple(scan(pose @ MOUNT, rng, MOUNT) for pose in poses))


def remounted(scans: tuple[Scan, ...], mount: np.ndarray) -> list[Scan]:
    return [Scan.from_points(one.points(), LIMITS, T_body_sensor=mount) for one in scans]


def errors(found: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """Errors in the tangent space of the body after the motion."""
    return se3.log(se3.between(motions, found))


def nees(error: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    return np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariances), error)


def test_motions_are_found_and_their_covariances_are_of_the_right_order(passage: Passage) -> None:
    calls: list[int] = []
    found = lidar_odometry(passage.scans, progress=calls.append)
    assert found.failed == 0
    assert found.inliers.min() > 0.9
    error = errors(found.motions, passage.motions)
    assert np.abs(error[:, 3:]).max() < 0.03
    assert np.abs(error[:, :3]).max() < np.radians(0.1)
    assert 0.02 < nees(error, found.covariances).mean() / 6 < 2
    assert np.sqrt(found.covariances[:, 3:, 3:].max()) < 0.03
    assert calls == [k + 1 for k in range(11)]


def test_another_mount_carries_motions_and_covariances_to_another_body(passage: Passage) -> None:
    here = lidar_odometry(passage.scans[:5], NO_FLOOR)
    other = se3.exp([0.7, 0.1, -1.0, 0.5, 2.0, -1.0])
    there = lidar_odometry(remounted(passage.scans[:5], other), NO_FLOOR)
    T_there_here = other @ se3.inverse(MOUNT)
    np.testing.assert_allclose(there.motions, T_there_here @ here.motions @ se3.inverse(T_there_here), atol=1e-7)
    carry = se3.adjoint(T_there_here)
    expected = carry @ here.covariances @ carry.T
    assert np.abs(there.covariances - expected).max() < 1e-4 * np.abs(expected).max()


def test_the_covariance_is_the_inverse_of_the_numerical_hessian(passage: Passage) -> None:
    import small_gicp

    first, second = passage.scans[:2]
    settings = NO_FLOOR.replaced(max_iterations=50)
    found = lidar_odometry([first, second], settings)
    clouds = []
    for one in (first, second):
        cloud = small_gicp.voxelgrid_sampling(one.points(), settings.sampling, 1)
        small_gicp.estimate_covariances(cloud, None, settings.neighbours, 1)
        clouds.append(cloud)
    voxels = small_gicp.GaussianVoxelMap(settings.voxel)
    voxels.insert(clouds[0])
    means, spreads = voxels.voxel_points()[:, :3], np.array(voxels.voxel_covs())[:, :16].reshape(-1, 4, 4)[:, :3, :3]
    places = {tuple(place): k for k, place in enumerate(np.floor(means / settings.voxel).astype(int))}
    points, thick = clouds[1].points()[:, :3], np.array(clouds[1].covs())[:, :3, :3]

    def moved(xi: np.ndarray) -> np.ndarray:
        """Points of the second scan in the frame of the first, the body moved on by a tangent vector."""
        T_first_second = se3.inverse(MOUNT) @ found.motions[0] @ se3.exp(xi) @ MOUNT
        return se3.transform(T_first_second, points)

    ends = moved(np.zeros(6))
    partner = np.array([places.get(tuple(place), -1) for place in np.floor(ends / settings.voxel).astype(int)])
    near = (partner >= 0) & (np.linalg.norm(ends - means[partner], axis=1) <= settings.max_distance)
    assert near.mean() == pytest.approx(found.inliers[0], abs=0.01)
    R = (se3.inverse(MOUNT) @ found.motions[0] @ MOUNT)[:3, :3]
    information = np.linalg.inv(spreads[partner] + R @ thick @ R.T)[near]
    h = 1e-6
    slopes = [(moved(h * unit) - moved(-h * unit))[near] / (2 * h) for unit in np.eye(6)]
    hessian = np.einsum("ani,nij,bnj->ab", slopes, information, slopes)
    size = np.sqrt(np.diag(hessian))
    inverse = np.linalg.inv(found.covariances[0])
    np.testing.assert_allclose(inverse / np.outer(size, size), hessian / np.outer(size, size), atol=0.03)


def test_the_first_motion_may_be_large() -> None:
    rng = np.random.default_rng(1)
    motion = se3.exp([0, 0, 0.05, 2.5, 0, 0])
    start = se3.exp([0, 0, 0.1, -5, 1, 1.7])
    found = lidar_odometry([scan(start, rng), scan(start @ motion, rng)])
    assert np.linalg.norm(errors(found.motions, motion[None])[0, 3:]) < 0.05


def test_a_velocity_that_misleads_is_searched_anew() -> None:
    rng = np.random.default_rng(3)
    steps = [[0, 0, 0, 0.5, 0, 0], [0, 0, 0, 0.5, 0, 0], [0, 0, -0.15, 2.0, 0.2, 0], [0, 0, 0.1, 0.2, 0, 0]]
    poses = [se3.exp([0, 0, 0, -5, 1, 1.7])]
    for step in steps:
        poses.append(poses[-1] @ se3.exp(step))
    found = lidar_odometry([scan(pose, rng) for pose in poses])
    assert found.known.all()
    assert np.abs(errors(found.motions, se3.exp(steps))).max() < 0.05


def test_a_failed_registration_is_counted_and_the_next_begins_anew(passage: Passage) -> None:
    scans = list(passage.scans[:8])
    scans[3] = Scan.from_points(scans[3].points() * [0.2, 0.2, 0.2] + [0, 0, 30], LIMITS, T_body_sensor=MOUNT)
    scans[6] = scans[6].select(np.arange(20))
    with pytest.warns(FactorlocWarning, match=r"4 of 7 motions not known \(first: to scan 3\)"):
        found = lidar_odometry(scans)
    assert found.known.tolist() == [True, True, False, False, True, False, False]
    assert found.failed == 4
    np.testing.assert_array_equal(found.motions[~found.known], np.tile(np.eye(4), (4, 1, 1)))
    np.testing.assert_array_equal(found.covariances[~found.known], 0)
    assert np.abs(errors(found.motions, passage.motions[:7])[found.known]).max() < 0.03


def test_a_drive_takes_the_motions_and_keeps_the_rest(passage: Passage) -> None:
    n = 4
    blank = se3.identity((n - 1,))
    truth = Trajectory(np.arange(n), se3.exp(np.ones((n, 6))))  # wrong, and not looked at
    drive = Drive("street", passage.scans[:n], blank, np.zeros(n - 1, bool), truth=truth, keys=[3, 6, 9, 12])
    driven = with_lidar_odometry(drive)
    found = lidar_odometry(passage.scans[:n])
    assert driven.odometry_known.all()
    np.testing.assert_allclose(driven.odometry, found.motions, atol=1e-9)
    np.testing.assert_allclose(driven.odometry_covariances, found.covariances, rtol=1e-6)
    assert driven.truth is truth
    assert driven.keys.tolist() == [3, 6, 9, 12]
    ends = driven.dead_reckoning(passage.poses[0]).positions
    np.testing.assert_allclose(ends, passage.poses[:n, :3, 3], atol=0.05)


def test_a_standstill_stays_put() -> None:
    rng = np.random.default_rng(2)
    found = lidar_odometry([scan(se3.exp([0, 0, 0, 0, 0, 1.7]), rng) for _ in range(6)])
    assert found.failed == 0
    assert np.abs(se3.log(found.motions)[:, 3:]).max() < 0.03


def test_one_scan_has_no_motion_and_planar_scans_are_refused(passage: Passage) -> None:
    alone = lidar_odometry(passage.scans[:1])
    assert alone.motions.shape == (0, 4, 4)
    assert alone.covariances.shape == (0, 6, 6)
    assert alone.failed == 0
    with pytest.raises(GeometryError, match=r"^scans: "):
        lidar_odometry([Scan.from_polar([0.0], [1.0], (0, 5))])
    with pytest.raises(ConfigError, match="sampling"):
        LidarOdometrySettings(sampling=0)


@pytest.mark.data
def test_a_street_is_followed(data_dir: Path) -> None:
    packed = np.load(data_dir / "kitti_raw_0005" / "frames_all_voxel20cm.npz")
    reference = np.load(data_dir / "kitti_raw_0005" / "reference_poses.npz")["T_velo0_velo"][:25]
    axes = [packed[axis] * float(packed["scale"]) for axis in "xyz"]
    stops = np.cumsum(packed["count"])
    scans = [
        Scan.from_points(np.stack([axis[stop - count : stop] for axis in axes], -1), (0.9, 120.0))
        for stop, count in zip(stops[:25], packed["count"][:25], strict=True)
    ]
    found = lidar_odometry(scans)
    error = errors(found.motions, se3.between(reference[:-1], reference[1:]))
    assert found.failed == 0
    assert np.sqrt((error[:, 3:] ** 2).sum(1).mean()) < 0.02
    assert np.sqrt((error[:, :3] ** 2).sum(1).mean()) < np.radians(0.03)
    assert 0.1 < nees(error, found.covariances).mean() / 6 < 2
