from pathlib import Path
from typing import Any

import numpy as np
import pytest
from carmen_corridor import Corridor

from factorloc.datasets import READERS, CarmenReader, Drive, Reader, open_drive
from factorloc.errors import DataError
from factorloc.scan import Scan

SAMPLE = Path(__file__).resolve().parents[2] / "datasets" / "samples" / "corridor.log"


class OneScan:
    """The smallest reader."""

    name = "one scan"

    def matches(self, path: Path) -> bool:
        return False

    def read(self, path: Path, **options: Any) -> Drive:
        return Drive(path.stem, (Scan.from_polar([0.0], [options["range"]], (0, 5)),), np.zeros((0, 3)))


@pytest.mark.parametrize("name", ["a.log", "a.CLF", "a.b.log.gz", "a.clf.bz2", "a.log.XZ"])
def test_carmen_logs_are_told_by_their_names(name: str) -> None:
    assert CarmenReader().matches(Path(name))


@pytest.mark.parametrize("name", ["a.png", "log", "a.gz", "a.log.zip", "a.bz2.gz", ""])
def test_an_unknown_format_names_those_known(name: str) -> None:
    with pytest.raises(DataError, match=r"no known format; known are: CARMEN log \(.log, .clf"):
        open_drive(name)


def test_any_reader_can_be_handed_in() -> None:
    reader: Reader = OneScan()
    assert open_drive("x.png", reader, range=2.5).scans[0].ranges.tolist() == [2.5]
    assert reader not in READERS


def test_the_sample_is_what_the_corridor_makes() -> None:
    assert SAMPLE.stat().st_size < 40_000
    drive, corridor = open_drive(SAMPLE), Corridor.drive()
    np.testing.assert_allclose(drive.truth.poses, corridor.truth[::3], atol=1e-4)
    np.testing.assert_allclose([scan.ranges for scan in drive.scans], corridor.ranges[::3].clip(max=50), atol=0.0051)
    assert drive.odometry_known.all()
    assert 0.01 < np.mean([~scan.is_return for scan in drive.scans]) < 0.3
