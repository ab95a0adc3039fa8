import dataclasses
import itertools

import numpy as np
import pytest
import shapely

from factorloc.errors import SimulationError
from factorloc.geometry import se2
from factorloc.scan import RayStatus, Scan
from factorloc.simulation import FloorPlan, PlanarLidar, Route, integrate_odometry, simulate_drive, write_carmen

PLAN = FloorPlan((shapely.LinearRing([(-0.4, -2), (50, -2), (50, 3), (-0.4, 3)]),))
ROUTE = Route(((0, 0), (4, 0), (4, 1.2)))
MOUNT = (0.1, 0.0, 0.0)


def drive(**settings):
    return simulate_drive(PLAN, ROUTE, PlanarLidar(**settings), seed=1)


def read(path):
    """Messages in order: (kind, numbers, stamp, logger time)."""
    messages = []
    for line in path.read_text().splitlines():
        if line.startswith("#"):
            continue
        kind, *words = line.split()
        assert words[-2] == "simulation"
        numbers = [float(word) for word in words[kind == "PARAM" : -3]]
        messages.append((kind, np.array(numbers), float(words[-3]), float(words[-1])))
    return messages


@pytest.mark.parametrize("beams", [180, 181, 360, 361])
@pytest.mark.parametrize("corrected", [False, True])
def test_a_log_holds_the_drive(tmp_path, beams, corrected):
    degrees = (beams - 1) * (1 if beams < 200 else 0.5)
    recorded = drive(beams=beams, field_of_view=np.deg2rad(degrees), range_limits=(2.05, 20.0), dropout=0.05)
    if beams % 2 == 0:
        recorded = from_minus_90(recorded, degrees)
    write_carmen(tmp_path / "drive.log", recorded, corrected=corrected)
    messages = read(tmp_path / "drive.log")
    lasers = [message for message in messages if message[0] == "FLASER"]
    truth = recorded.truth.poses
    assert set(np.concatenate([scan.status for scan in recorded.scans])) == set(RayStatus)
    body = truth if corrected else integrate_odometry(truth[0], recorded.odometry)
    assert len(lasers) == len(recorded)
    for (_, numbers, stamp, logged), scan, pose in zip(lasers, recorded.scans, body, strict=True):
        assert numbers[0] == beams == len(numbers) - 7
        again = Scan.from_polar(np.zeros(beams), numbers[1 : beams + 1], scan.range_limits)
        assert (again.status == scan.status).all()
        assert again.ranges == pytest.approx(scan.ranges, abs=1e-3)
        assert numbers[-3:] == pytest.approx(pose, abs=1e-6)
        assert numbers[-6:-3] == pytest.approx(se2.compose(pose, np.array(MOUNT)), abs=1e-6)
        assert stamp == logged == pytest.approx(scan.stamp)
    assert messages[0][0] == "PARAM" and messages[0][1] == pytest.approx([0.1])


def from_minus_90(recorded, degrees):
    """The same drive with its beams turned so that the first looks to the right, as scanners of even count do."""
    turn = np.deg2rad(degrees / 2 - 90)
    scans = tuple(dataclasses.replace(s, directions=se2.rotate(turn, s.directions)) for s in recorded.scans)
    return dataclasses.replace(recorded, scans=scans)


def test_odometry_between_scans_survives_in_both_logs(tmp_path):
    recorded = drive()
    for corrected in (False, True):
        write_carmen(tmp_path / "drive.log", recorded, corrected=corrected)
        poses = [m[1][:3] for m in read(tmp_path / "drive.log") if m[0] == "ODOM"]
        ends = list(zip(poses[::2], poses[1::2], strict=True)) if corrected else list(itertools.pairwise(poses))
        measured = np.array([se2.between(a, b) for a, b in ends])
        assert measured == pytest.approx(recorded.odometry, abs=1e-5)


def test_a_return_just_short_of_a_limit_stays_a_return(tmp_path):
    recorded = drive(range_limits=(1.0, 20.0))
    ranges = np.tile([19.9999, 1.0], 91)[:181]
    edge = dataclasses.replace(recorded.scans[0], ranges=ranges, status=np.zeros(181, np.uint8))
    write_carmen(tmp_path / "drive.log", dataclasses.replace(recorded, scans=(edge, *recorded.scans[1:])))
    printed = next(m for m in read(tmp_path / "drive.log") if m[0] == "FLASER")[1][1:182]
    assert ((printed >= 1.0) & (printed < 20.0)).all()
    assert printed == pytest.approx(ranges, abs=1e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"beams": 100}, "100 beams"),
        ({"field_of_view": 3.0}, "beams are not those"),
        ({"T_body_sensor": (0.1, 0.05, 0.0)}, "straight ahead"),
    ],
)
def test_what_the_format_cannot_hold_is_refused_and_nothing_is_written(tmp_path, settings, message):
    with pytest.raises(SimulationError, match=message):
        write_carmen(tmp_path / "drive.log", drive(**settings))
    assert not list(tmp_path.iterdir())


def test_a_drive_without_scans_is_refused(tmp_path):
    recorded = drive()
    empty = dataclasses.replace(recorded, scans=(), odometry=np.zeros((0, 3)), truth=recorded.truth.select(slice(0)))
    with pytest.raises(SimulationError, match="no scans"):
        write_carmen(tmp_path / "drive.log", empty)
