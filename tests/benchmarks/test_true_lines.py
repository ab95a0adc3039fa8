"""True lines: those that hold at the true pose, and only those."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.true_lines import are_true, true_lines
from factorloc.geometry import se2
from factorloc.intervals import Interval
from factorloc.localization import CorrespondenceSettings, WallLines, find_correspondences
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.line_groups import core_of
from factorloc.mapping import Facades
from factorloc.mapping.facade_points import FacadePoints, ScanErrors, facade_points
from factorloc.result import Bounds
from factorloc.scan import Scan


@pytest.fixture(scope="module")
def corner() -> tuple[WallLines, np.ndarray, FacadePoints]:
    """Two walls that meet, mapped 0.3 m off, and points on them."""
    true = np.array([[[10.0, -8.0], [10.0, 8.0]], [[10.0, 8.0], [-10.0, 8.0]]])[:, ::-1]
    walls = WallLines(Facades(true + np.array([0.3, -0.3]), np.array([0, 1]), np.full(2, 0.5), np.full(2, 0.1)))
    pose = np.array([1.0, -0.5, 0.2])
    points = (true[:, :1] + np.linspace(0, 1, 150)[:, None] * (true[:, 1:] - true[:, :1])).reshape(-1, 2)
    scan = Scan.from_points(se2.transform(se2.inverse(pose), points), range_limits=(0.5, 60.0))
    return walls, pose, facade_points(scan, ScanErrors())


def line(walls: WallLines, row: int, pose: np.ndarray) -> Correspondence:
    normal = se2.rotation(-pose[2]) @ walls.normals[row]
    anchor = se2.transform(se2.inverse(pose), walls.centres[row])
    alpha = Interval.around(np.arctan2(normal[1], normal[0]), 0.01)
    return Correspondence(row, anchor, alpha, Interval.around(0.0, 0.05), 50, 0.1, 1.0, (-1.0, 1.0), (-5.0, 5.0), 0.01)


def test_a_line_is_true_if_heading_strip_and_chain_hold(corner: tuple[WallLines, np.ndarray, FacadePoints]) -> None:
    walls, pose, _ = corner
    right = line(walls, 0, pose)
    wrong = [
        replace(right, d=right.d + 2.0),
        replace(right, alpha=right.alpha + 0.3),
        replace(right, middle=(20.0, 22.0)),
    ]
    assert are_true((right, *wrong), walls, pose).tolist() == [True, False, False, False]


def test_what_is_found_is_left_if_it_is_true(corner: tuple[WallLines, np.ndarray, FacadePoints]) -> None:
    walls, pose, points = corner
    settings = CorrespondenceSettings()
    start = Bounds.around(pose + np.array([1.0, 1.0, 0.02]), 3.0, np.radians(4.0))
    usual = find_correspondences(points, walls, start, settings)
    assert len(usual.found) > 0
    found = true_lines([points], pose[None], settings)(points, walls, start)
    assert {one.facade for one in found.found} <= {one.facade for one in usual.found}
    assert all(one.doubt == 1e-6 for one in found.found)
    assert len(found.found) == are_true(usual.found, walls, pose).sum()
    assert any(one.core is not None for one in found.found)
    cored = [one for one in found.found if one.core is not None]
    assert are_true(tuple(core_of(one) for one in cored), walls, pose).all()
    away = true_lines([points], pose[None] + np.array([5.0, 5.0, 0.0]), settings)(points, walls, start)
    assert len(away.found) < len(found.found)
