"""A mapping trajectory that sways: scans know better, and the poles of the map are where they are."""

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from factorloc import Trajectory
from factorloc.errors import GeometryError
from factorloc.geometry import se3
from factorloc.localization.trajectory_refinement import TrajectoryRefinementSettings, refine_trajectory
from factorloc.mapping import BY_EVIDENCE, PoleMapper, PoleMappingSettings
from factorloc.simulation import SimulatedDrive, StreetSettings, hdl_32e, simulate_drive, street_route, street_scene

full_size = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="local maps of full size want compiled kernels"
)

MAPPING = PoleMappingSettings(poles=BY_EVIDENCE, confirmations=1, window=1, slack=0.1)


@pytest.fixture(scope="module")
def street() -> tuple[SimulatedDrive, np.ndarray]:
    """A drive along a street, a scan every 1.5 m or so, and the poles that stand there."""
    scene = street_scene(StreetSettings(), 3)
    drive = simulate_drive(scene.world, street_route(), hdl_32e(columns=700), seed=3, period=0.2)
    return drive, np.array([[pole.x, pole.y] for pole in scene.poles])


def swaying(truth: Trajectory, seed: int) -> Trajectory:
    """Smooth noise: some decimetres in ten or twenty metres, and turns to match."""
    rng = np.random.default_rng(seed)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth.positions, axis=0), axis=1))])
    off = np.zeros((len(truth), 3))
    for wavelength in (12.0, 17.0, 23.0):
        phases = rng.uniform(0, 2 * np.pi, 3)
        off += np.sin(2 * np.pi * way[:, None] / wavelength + phases) * [0.12, 0.12, 0.01]
    return replace(truth, poses=se3.compose(truth.to_3d().poses, se3.from_se2(off)), covariances=None)


def pole_errors(drive: SimulatedDrive, path: Trajectory, poles: np.ndarray) -> tuple[float, int]:
    """RMS distance of the mapped poles from the true ones within a metre, and how many have one."""
    mapper = PoleMapper(MAPPING)
    mapper.add("street", drive.scans, path)
    distance = cKDTree(poles).query(mapper.finish().positions)[0]
    near = distance < 1.0
    return float(np.sqrt((distance[near] ** 2).mean())), int(near.sum())


@full_size
def test_poles_of_a_map_from_a_swaying_trajectory_get_better(street) -> None:
    drive, poles = street
    given = swaying(drive.truth, 1)
    refined = refine_trajectory(drive.scans, given)
    assert refined.failed == 0
    before, after = (
        np.linalg.norm(path.positions[:, :2] - drive.truth.positions[:, :2], axis=1)
        for path in (given, refined.trajectory)
    )
    assert np.sqrt((after**2).mean()) < 0.6 * np.sqrt((before**2).mean())
    swayed, _ = pole_errors(drive, given, poles)
    mended, found = pole_errors(drive, refined.trajectory, poles)
    assert found >= 10
    assert mended < 0.6 * swayed
    assert "trajectory refined by" in str(refined)
    assert refined.trajectory.world == given.world


def test_the_true_trajectory_stays_where_it_is(street) -> None:
    drive, _ = street
    refined = refine_trajectory(drive.scans[:12], drive.truth.select(np.arange(12)))
    assert refined.moved < 0.03
    assert refined.revisits == 0


def test_places_seen_twice_are_tied(street) -> None:
    drive, _ = street
    order = np.array([*range(10), *range(9, -1, -1)])
    scans = [drive.scans[k] for k in order]
    rng = np.random.default_rng(0)
    there, back = (se3.from_se2([*rng.normal(0, 0.2, 2), 0.0]) for _ in range(2))
    poses = drive.truth.to_3d().poses[order]
    poses = np.concatenate([se3.compose(there, poses[:10]), se3.compose(back, poses[10:])])
    given = Trajectory(np.arange(20.0), poses)
    settings = TrajectoryRefinementSettings(revisit_way=4.0, revisit_distance=1.0)
    refined = refine_trajectory(scans, given, settings)
    assert refined.revisits >= 5
    apart = np.linalg.norm(refined.trajectory.positions[:10] - refined.trajectory.positions[:9:-1], axis=1)
    assert apart.max() < 0.05 < np.linalg.norm(given.positions[:10] - given.positions[:9:-1], axis=1).max()


def test_poses_must_fit_scans(street) -> None:
    drive, _ = street
    with pytest.raises(GeometryError, match="give one pose a scan"):
        refine_trajectory(drive.scans[:3], drive.truth.select(np.arange(2)))
