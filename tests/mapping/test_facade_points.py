"""Reduction of scans to the plane: boxes hold the truth, columns are what stands upright."""

import numpy as np
import pytest

from factorloc.geometry import se2, se3
from factorloc.mapping.facade_points import FacadePoints, ReductionSettings, ScanErrors, facade_points
from factorloc.scan import Scan


def wall_and_car(rng):
    """A wall 8 m tall, a car beside it, the ground, and a pole, seen from 1.73 m above ground."""
    wall = np.stack([rng.uniform(-10, 10, 4000), np.full(4000, 9.03), rng.uniform(-1.7, 6.0, 4000)], -1)
    car = np.stack([rng.uniform(0, 4, 500), np.full(500, 5.03), rng.uniform(-1.7, -0.2, 500)], -1)
    ground = np.stack([rng.uniform(-10, 10, 2000), rng.uniform(-8, 8, 2000), np.full(2000, -1.73)], -1)
    return np.concatenate([wall, car, ground])


def test_walls_are_taken_and_cars_and_ground_are_not():
    points = wall_and_car(np.random.default_rng(0))
    found = facade_points(Scan.from_points(points, (0.5, 80.0)))
    assert isinstance(found, FacadePoints)
    assert (np.abs(found.points[:, 1] - 9.03) < 0.01).all()
    # One point every 0.2 m along 20 m of wall.
    assert 90 <= len(found) <= 102
    assert sum(found.left_out.values()) + len(found) == len(points)


def test_a_lone_band_of_heights_is_no_wall_and_a_planar_scan_keeps_all_returns():
    angles = np.radians(np.arange(-90, 91, 0.5))
    planar = Scan.from_polar(angles, np.full(len(angles), 10.0), (0.1, 30.0))
    found = facade_points(planar, settings=ReductionSettings(spacing=0.01))
    assert len(found) == len(angles)
    ring = np.stack([10 * np.cos(angles), 10 * np.sin(angles), np.zeros(len(angles))], -1)
    assert len(facade_points(Scan.from_points(ring, (0.1, 30.0)))) == 0


@pytest.mark.parametrize("stamped", [True, False])
def test_boxes_hold_the_truth_whatever_the_errors(stamped):
    """True points, measured from a tilted, moving body with all errors drawn within their bounds: none is outside."""
    rng = np.random.default_rng(1)
    errors = ScanErrors(
        range=0.1, angle=0.004, roll=0.03, pitch=0.02, speed=3.0, sideways_speed=0.5, turn_rate=0.4,
        duration=0.1,
    )  # fmt: skip
    settings = ReductionSettings(span=0.01, ground=-50.0, spacing=0.02, cell=0.5)
    mount = se3.exp(np.array([0.02, -0.01, 0.5, 0.3, -0.2, 1.5]))
    violations = samples = 0
    for _ in range(60):
        count = 3000
        columns = rng.uniform(-30, 30, (300, 2))[rng.integers(0, 300, count)]
        truth = np.column_stack([columns + rng.uniform(-0.2, 0.2, (count, 2)), rng.uniform(-2, 8, count)])
        roll, pitch = rng.uniform(-1, 1, 2) * (errors.roll, errors.pitch)
        v, w = rng.uniform(-1, 1, 2) * (errors.speed, errors.sideways_speed), rng.uniform(-1, 1) * errors.turn_rate
        time = rng.uniform(-0.05, 0.05, count)
        # Pose of the level body at each ray's time in its frame at the scan's time; exact for constant rates.
        moves = se2.exp(np.stack([v[0] * time, v[1] * time, w * time], -1))
        level = truth.copy()
        level[:, :2] = se2.transform(se2.inverse(moves), truth[:, :2])
        c, s = np.cos([roll, pitch]), np.sin([roll, pitch])
        R_x = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
        R_y = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
        sensed = se3.transform(se3.inverse(mount), level @ (R_y @ R_x))
        r = np.linalg.norm(sensed, axis=1) + rng.uniform(-1, 1, count) * errors.range
        bearing = np.arctan2(sensed[:, 1], sensed[:, 0]) + rng.uniform(-1, 1, count) * errors.angle
        elevation = np.arctan2(sensed[:, 2], np.hypot(sensed[:, 0], sensed[:, 1]))
        elevation += rng.uniform(-1, 1, count) * errors.angle
        measured = r[:, None] * np.stack(
            [np.cos(elevation) * np.cos(bearing), np.cos(elevation) * np.sin(bearing), np.sin(elevation)], -1
        )
        scan = Scan.from_points(
            measured, (0.01, 100.0), stamp=0.0, stamps=time if stamped else None, T_body_sensor=mount
        )
        found = facade_points(scan, errors, settings)
        inside = found.boxes.contains(truth[found.rows, :2].T)
        violations += int((~inside).sum())
        samples += len(found)
    assert samples > 100_000
    assert violations == 0
