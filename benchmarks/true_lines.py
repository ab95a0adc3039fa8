"""True lines: correspondences without those that are false, as the truth tells. What no association can do better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from factorloc.localization import CorrespondenceSettings, find_correspondences
from factorloc.localization.correspondence import Correspondence, Correspondences
from factorloc.localization.facade_strips import Frame, Strips
from factorloc.localization.facade_tracker import Finder
from factorloc.localization.line_groups import core_of
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import FacadePoints
from factorloc.result import Bounds

__all__ = ["are_true", "true_lines"]

Array = npt.NDArray[np.float64]

_SURE = 1e-6
_TURN = 1e-9  # rad; half width of the slice of headings about the true one


def are_true(found: tuple[Correspondence, ...], walls: WallLines, pose: Array) -> npt.NDArray[np.bool_]:
    """Whether lines hold at the true pose, heading, strip and along the wall, shape (K,)."""
    frame = Frame(pose[:2], np.array([1.0, 0.0]))
    edges = np.array([pose[2] - _TURN, pose[2] + _TURN])
    strips = Strips(found, walls, frame, edges, 1e-6)
    low, high = strips.along_walls(walls, by_chain=True)[0, :, 2:].T
    across = (strips.low[0] <= strips.shift) & (strips.high[0] >= -strips.shift)
    return np.asarray(strips.possible[0] & across & (low <= 0.0) & (high >= 0.0))


def true_lines(scans: list[FacadePoints], poses: Array, settings: CorrespondenceSettings) -> Finder:
    """Find correspondences as usual, leave false ones and false cores out and be sure of the others.

    Parameters
    ----------
    scans : list of FacadePoints
        Of a drive.
    poses : ndarray, shape (N, 3)
        Their true poses.
    settings : CorrespondenceSettings
        As usual.
    """
    number = {id(scan): k for k, scan in enumerate(scans)}

    def find(points: FacadePoints, walls: WallLines, start: Bounds) -> Correspondences:
        usual = find_correspondences(points, walls, start, settings)
        if not usual.found:
            return usual
        pose = poses[number[id(points)]]
        true = are_true(usual.found, walls, pose)
        cores = are_true(tuple(core_of(one) for one in usual.found), walls, pose)
        sure = (
            replace(one, doubt=_SURE, core=one.core if inside else None, core_doubt=_SURE)
            for one, kept, inside in zip(usual.found, true, cores, strict=True) if kept
        )  # fmt: skip
        return replace(usual, found=tuple(sure))

    return find
