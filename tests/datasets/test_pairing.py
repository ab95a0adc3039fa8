from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from carmen_corridor import Corridor
from hypothesis import given
from hypothesis import strategies as st

from factorloc.datasets import Drive, match_scans, open_drive, pair_raw_with_corrected, read_carmen
from factorloc.errors import DataError, FactorlocWarning
from factorloc.geometry import se2
from factorloc.scan import Scan

ANGLES = np.radians(-90.0 + np.arange(5))


def scan(ranges) -> Scan:
    return Scan.from_polar(ANGLES, ranges, (0, 50))


@given(st.integers(0, 999), st.integers(2, 17), st.sampled_from([".1f", ".2f", ".4f", ".3g", ".4g", ".6g"]))
def test_scans_are_found_by_their_printed_ranges_in_file_order(seed: int, written: int, printed: str) -> None:
    """The raw log may have more digits than the corrected one, and ties among them."""
    rng = np.random.default_rng(seed)
    exact = np.array([[float(f"{r:.{written}g}") for r in row] for row in rng.uniform(0.5, 60, (12, 5))])
    rows = np.sort(rng.choice(12, 5, replace=False))
    shown = [[float(f"{r:{printed}}") for r in exact[k]] for k in rows]
    np.testing.assert_array_equal(match_scans([scan(r) for r in exact], [scan(r) for r in shown]), rows)


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    corridor = Corridor.drive(40)
    stamps = corridor.stamps.copy()
    stamps[10:20] = stamps[19:9:-1]  # time runs backwards
    stamps[25:30] = stamps[25]  # and stands still
    corridor = replace(corridor, stamps=stamps)
    paths = tmp_path / "hall.clf", tmp_path / "hall-corrected.log"
    paths[0].write_text(corridor.raw())
    paths[1].write_text(corridor.corrected(every=4))
    return paths


def test_truth_and_true_odometry_come_together(logs: tuple[Path, Path]) -> None:
    corridor = Corridor.drive(40)
    drive = read_carmen(logs[0], truth=logs[1])
    np.testing.assert_allclose(drive.truth.poses, corridor.truth[::4], atol=1e-4)
    driven = se2.between(corridor.odometry[:-4:4], corridor.odometry[4::4])
    np.testing.assert_allclose(drive.odometry, driven, atol=1e-5)
    assert drive.odometry_known.all()
    raw = read_carmen(logs[0])
    np.testing.assert_array_equal(drive.stamps, raw.stamps[::4])
    np.testing.assert_array_equal(drive.keys, raw.keys[::4])
    assert (np.diff(drive.stamps) <= 0).any()
    assert [report.path for report in drive.reports] == list(logs)


def test_times_play_no_part_in_pairing(logs: tuple[Path, Path]) -> None:
    raw, corrected = (read_carmen(path) for path in logs)
    shuffled = replace(corrected, stamps=np.random.default_rng(0).permutation(corrected.stamps))
    pairs = [pair_raw_with_corrected(raw, other) for other in (corrected, shuffled)]
    np.testing.assert_array_equal(pairs[0].odometry, pairs[1].odometry)
    np.testing.assert_array_equal(match_scans(raw.scans, corrected.scans), np.arange(0, 41, 4))


def test_limits_need_not_agree(logs: tuple[Path, Path]) -> None:
    raw = read_carmen(logs[0], range_limits=(0, 6))
    corrected = read_carmen(logs[1])
    np.testing.assert_array_equal(match_scans(raw.scans, corrected.scans), np.arange(0, 41, 4))


def test_a_scan_that_is_missing_is_an_error_or_left_out(logs: tuple[Path, Path]) -> None:
    raw, corrected = (read_carmen(path) for path in logs)
    part = raw.select(np.delete(np.arange(len(raw)), [8, 12]))
    with pytest.raises(
        DataError, match=r"hall: 2 of 11 corrected scans are not among the 39 raw ones \(first: scan 2\)"
    ):
        pair_raw_with_corrected(part, corrected)
    with pytest.warns(FactorlocWarning, match="2 of 11 corrected scans are not in the raw log; left out"):
        drive = pair_raw_with_corrected(part, corrected, allow_missing=2)
    expected = pair_raw_with_corrected(raw, corrected).select([0, 1, *range(4, 11)])
    np.testing.assert_allclose(drive.odometry, expected.odometry, atol=1e-12)
    np.testing.assert_array_equal(drive.truth.poses, expected.truth.poses)


def test_order_resolves_equal_scans_or_says_that_it_cannot() -> None:
    a, b, c = (scan([r] * 5) for r in (1.25, 2.25, 3.25))
    assert match_scans([a, b, a, c], [a, b, a]).tolist() == [0, 1, 2]
    assert match_scans([b, a, c, a], [b, c, a]).tolist() == [0, 2, 3]
    with pytest.raises(DataError, match="corrected scan 0 equals several raw ones"):
        match_scans([a, a, b], [a, b])
    with pytest.raises(DataError, match="another order"):
        match_scans([a, b, c], [b, a])


def test_logs_of_another_kind_are_an_error(logs: tuple[Path, Path]) -> None:
    raw, corrected = (read_carmen(path) for path in logs)
    with pytest.raises(DataError, match="first of the pair must be raw"):
        pair_raw_with_corrected(corrected, corrected)
    with pytest.raises(DataError, match="second of the pair must be corrected"):
        pair_raw_with_corrected(raw, raw)
    with pytest.raises(DataError, match="carries its own truth"):
        read_carmen(logs[1], truth=logs[1])
    other = Drive("other", (Scan.from_polar([0.0], [1.0], (0, 50)),), np.zeros((0, 3)))
    with pytest.raises(DataError, match="beam counts"):
        pair_raw_with_corrected(other, corrected)


@pytest.mark.data
@pytest.mark.parametrize(("name", "scans"), [("aces", 440), ("intel", 910)])
def test_real_logs_pair_completely_and_odometry_between_scans_agrees(
    data_dir: Path, raw_log: Callable[[str], Drive], name: str, scans: int
) -> None:
    raw = raw_log(name)
    corrected = open_drive(data_dir / f"carmen/{name}-corrected.log.gz")
    drive = pair_raw_with_corrected(raw, corrected)
    assert len(drive) == len(corrected) == scans
    assert corrected.odometry_known.all()
    # The corrected log prints six digits of coordinates up to 100 m.
    difference = np.abs(se2.between(corrected.odometry, drive.odometry))
    assert difference.max() < 3e-4
    assert np.median(difference) < 3e-5
    moved = np.abs(se2.between(drive.odometry, se2.between(drive.truth.poses[:-1], drive.truth.poses[1:])))
    assert np.median(moved[:, 0]) > 0.005  # while the truth is far off
