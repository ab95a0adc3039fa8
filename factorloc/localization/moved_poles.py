"""Moved poles: groups of landmarks that are gone from their places and stand, all together, somewhere beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from factorloc.config import Block
from factorloc.factors.pole_detections import PoleDetections

__all__ = ["MovedGroup", "MovedPolesSettings", "find_moved_groups", "visibility"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


class MovedPolesSettings(Block):
    """What counts as gone, and as moved together.

    Parameters
    ----------
    reach : float
        A landmark nearer than this was in view, m.
    least_views : int
        Local maps that must have had it in view before it can be missed.
    rate : float
        It is missed if it was found in a smaller share of them.
    neighbours : float
        Missed landmarks at most so far apart belong to one group, m.
    shift : float
        The farthest a group is moved, m.
    agree : float
        Poles moved together agree to this, m.
    share : float
        Least share of a group that must be found at its new place.
    least : int
        Least number of them: three poles and some clutter agree on many a shift.
    least_shift : float
        A group that moved less was not moved, m.
    """

    reach: float = Field(12.0, gt=0)
    least_views: int = Field(3, gt=0)
    rate: float = Field(0.1, ge=0, lt=1)
    neighbours: float = Field(12.0, gt=0)
    shift: float = Field(6.0, gt=0)
    agree: float = Field(0.4, gt=0)
    share: float = Field(0.5, gt=0, le=1)
    least: int = Field(5, ge=3)
    least_shift: float = Field(0.3, ge=0)


@dataclass(frozen=True)
class MovedGroup:
    """Landmarks that were moved together.

    Parameters
    ----------
    landmarks : ndarray of int64, shape (G,)
        Rows of those that were found again.
    shift : (float, float)
        From where the map has them to where they are, m.
    missed : int
        Landmarks of the neighbourhood that were missed, those included.
    """

    landmarks: Index
    shift: tuple[float, float]
    missed: int


def visibility(
    poses: Array, detections: PoleDetections, matches: Index, landmarks: Array, reach: float
) -> tuple[Index, Index]:
    """In how many local maps each landmark was found, and in how many it could have been.

    Parameters
    ----------
    poses : ndarray, shape (N, 3)
        Of the local maps.
    detections : PoleDetections
        Those without a single detection saw nothing: they do not count.
    matches : ndarray of int64, shape (K,)
        Landmark of each detection, or -1.
    landmarks : ndarray, shape (L, 2)
        m.
    reach : float
        How far a local map sees, m.

    Returns
    -------
    seen, in_view : ndarray of int64, shape (L,)
    """
    looked = np.diff(detections.offsets) > 0
    near = cKDTree(landmarks).query_ball_point(poses[looked, :2], reach)
    in_view = np.bincount(
        np.concatenate([np.asarray(rows, np.int64) for rows in [*near, []]]), minlength=len(landmarks)
    )
    close = np.hypot(*(poses[detections.pose_of, :2] - landmarks[np.maximum(matches, 0)]).T) <= reach
    pairs = np.unique(np.column_stack([matches, detections.pose_of])[(matches >= 0) & close], axis=0)
    seen = np.bincount(pairs[:, 0], minlength=len(landmarks))
    return np.minimum(seen, in_view).astype(np.int64), in_view.astype(np.int64)


def find_moved_groups(
    poses: Array,
    detections: PoleDetections,
    matches: Index,
    landmarks: Array,
    settings: MovedPolesSettings | None = None,
) -> tuple[Index, list[MovedGroup]]:
    """Find landmarks that are missed, and where whole groups of them went.

    For each group, the shifts that lead from its landmarks to detections without landmark are counted, each landmark
    once; the most frequent one wins, of several the shortest.

    Parameters
    ----------
    poses, detections, matches, landmarks
        As :func:`visibility`.
    settings : MovedPolesSettings, optional
        What counts.

    Returns
    -------
    missed : ndarray of int64, shape (M,)
        Landmarks that were in view and not found.
    groups : list of MovedGroup
        Those of them that were found again together.
    """
    settings = settings or MovedPolesSettings()
    seen, in_view = visibility(poses, detections, matches, landmarks, settings.reach)
    missed = np.flatnonzero((in_view >= settings.least_views) & (seen < settings.rate * in_view))
    stray = detections.placed(poses)[matches < 0]
    if len(missed) < settings.least or len(stray) == 0:
        return missed, []
    places = cKDTree(landmarks[missed])
    _, labels = connected_components(places.sparse_distance_matrix(places, settings.neighbours), directed=False)
    tree = cKDTree(stray)
    groups = []
    for label in np.unique(labels):
        members = missed[labels == label]
        if len(members) < settings.least:
            continue
        near = tree.query_ball_point(landmarks[members], settings.shift)
        shifts = [stray[rows] - landmarks[member] for rows, member in zip(near, members, strict=True)]
        owner = np.repeat(np.arange(len(members)), [len(s) for s in shifts])
        together = np.concatenate(shifts) if len(owner) else np.zeros((0, 2))
        if len(together) == 0:
            continue
        around = cKDTree(together).query_ball_point(together, settings.agree)
        votes = np.array([len(set(owner[rows].tolist())) for rows in around])
        best = int(np.lexsort((np.hypot(*together.T), -votes))[0])
        if votes[best] < max(settings.least, settings.share * len(members)):
            continue
        shift = np.median(together[around[best]], axis=0)
        if np.hypot(*shift) < settings.least_shift:
            continue
        found = np.unique(owner[around[best]])
        groups.append(MovedGroup(members[found], (float(shift[0]), float(shift[1])), len(members)))
    return missed, groups
