"""Pole mapping: local maps of one or more sessions become one map of poles (thesis, 12.4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from factorloc.config import Block
from factorloc.errors import MapError
from factorloc.mapping.georeference import Georeference
from factorloc.mapping.local_maps import LocalMap, local_maps, segments
from factorloc.mapping.pole_map import PoleMap
from factorloc.mapping.pole_settings import PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.scan import Scan
from factorloc.trajectory import Trajectory

__all__ = ["PoleMapper", "PoleMappingSettings", "confirmed", "merged", "overlaps"]

Array = npt.NDArray[np.float64]
Pairs = npt.NDArray[np.int64]


class PoleMappingSettings(Block):
    """How local maps become a map.

    Parameters
    ----------
    poles : PoleSettings
        Of the local maps.
    confirmations, window : int
        A pole counts if it was seen in at least ``confirmations`` of the ``window`` latest local maps (c and w).
    slack : float
        By how much the square of every pole is enlarged before overlaps are sought, m; none in the thesis.
    growth_distance : float
        Later sessions add poles only from scans this far from all poses of earlier ones, m.
    """

    poles: PoleSettings = PoleSettings()
    confirmations: int = Field(1, ge=1)
    window: int = Field(1, ge=1)
    slack: float = Field(0.0, ge=0)
    growth_distance: float = Field(10.0, ge=0)


def overlaps(one: Poles, other: Poles, slack: float = 0.0) -> Pairs:
    """Pairs of poles, (P, 2), whose squares on the ground overlap: as wide as the poles, along the axes of the frame.

    Parameters
    ----------
    one, other : Poles
        In one frame.
    slack : float
        Width added to each, m.
    """
    if len(one) == 0 or len(other) == 0:
        return np.empty((0, 2), np.int64)
    reach = (one.widths.max() + other.widths.max()) / 2 + slack
    near = cKDTree(one.positions).query_ball_tree(cKDTree(other.positions), reach, p=np.inf)
    rows = np.repeat(np.arange(len(one)), [len(found) for found in near])
    columns = np.array([k for found in near for k in found], np.int64)
    apart = np.abs(one.positions[rows] - other.positions[columns]).max(1, initial=0)
    meet = apart < (one.widths[rows] + other.widths[columns]) / 2 + slack
    return np.stack([rows[meet], columns[meet]], 1)


def confirmed(found: Sequence[Poles], confirmations: int, window: int, slack: float = 0.0) -> list[Poles]:
    """Keep the poles of each local map that overlap with some in enough of the latest local maps, its own included.

    Parameters
    ----------
    found : sequence of Poles
        Poles of local maps in their order, in one frame.
    confirmations, window : int
        How many of how many.
    slack : float
        As in :func:`overlaps`.

    Raises
    ------
    MapError
        If more confirmations are asked for than there are maps in the window.
    """
    if not 1 <= confirmations <= window:
        raise MapError(f"confirmations {confirmations} of {window} local maps; ask for at least 1 and at most all")
    kept = []
    for k, poles in enumerate(found):
        counts = np.zeros(len(poles), np.int64)
        for other in found[max(0, k - window + 1) : k + 1]:
            counts[np.unique(overlaps(poles, other, slack)[:, 0])] += 1
        kept.append(poles.select(counts >= confirmations))
    return kept


def merged(poles: Poles, slack: float = 0.0) -> Poles:
    """Make one pole of those whose squares overlap: means weighted with their scores, and all heights seen.

    Parameters
    ----------
    poles : Poles
        In one frame.
    slack : float
        As in :func:`overlaps`.

    Returns
    -------
    Poles
        One for each group that hangs together.
    """
    n = len(poles)
    if n == 0:
        return poles
    pairs = overlaps(poles, poles, slack)
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    count, group = connected_components(graph, directed=False)
    weight = np.bincount(group, poles.scores, count)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(group, poles.scores * values, count) / weight)

    bottom, top = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(bottom, group, poles.spans[:, 0])
    np.maximum.at(top, group, poles.spans[:, 1])
    positions = np.stack([mean(poles.positions[:, 0]), mean(poles.positions[:, 1])], 1)
    return Poles(positions, mean(poles.widths), np.stack([bottom, top], 1), mean(poles.scores))


@dataclass(frozen=True, eq=False)
class _Session:
    name: str
    trajectory: Trajectory
    maps: list[LocalMap]
    contributes: npt.NDArray[np.bool_]
    map_fraction: float


class PoleMapper:
    """Collects local maps of sessions, and makes one map of them.

    Poles of the first session are all taken; later ones add what lies off all earlier ways. How often every pole of
    the map was seen, and how often it could have been, is counted in all local maps of all sessions.

    Parameters
    ----------
    settings : PoleMappingSettings, optional
        How.
    """

    def __init__(self, settings: PoleMappingSettings | None = None) -> None:
        self.settings = settings or PoleMappingSettings()
        self._sessions: list[_Session] = []

    @property
    def map_fractions(self) -> dict[str, float]:
        """Fraction of the scans of each session that the map was made from (f_map, table 12.1)."""
        return {session.name: session.map_fraction for session in self._sessions}

    def count(self, trajectory: Trajectory) -> int:
        """Number of local maps that a session takes."""
        poles = self.settings.poles
        return len(segments(trajectory, poles.segment_length, poles.segment_spacing))

    def add(
        self,
        name: str,
        scans: Sequence[Scan],
        trajectory: Trajectory,
        progress: Callable[[int], None] | None = None,
    ) -> None:
        """Add a session.

        Parameters
        ----------
        name : str
            Its name.
        scans : sequence of Scan
            Spatial scans.
        trajectory : Trajectory
            True pose ``T_map_body`` of each.
        progress : callable, optional
            Called with the number of local maps done.

        Raises
        ------
        MapError
            If it holds no scan, there is not one pose a scan, or scans are planar.
        """
        if len(scans) == 0:
            raise MapError(f"session {name}: holds no scans; there is nothing to map")
        maps = []
        for found in local_maps(scans, trajectory, self.settings.poles, axes="world"):
            maps.append(found)
            if progress:
                progress(len(maps))
        places = trajectory.positions[:, :2]
        new = np.ones(len(places), np.bool_)
        for earlier in self._sessions:
            distances = np.asarray(cKDTree(earlier.trajectory.positions[:, :2]).query(places)[0])
            new &= distances >= self.settings.growth_distance
        contributes = np.array([new[found.scans].all() for found in maps], np.bool_)
        used = [found.scans for found, counts in zip(maps, contributes, strict=True) if counts]
        fraction = len(np.unique(np.concatenate(used))) / len(places) if used else 0.0
        self._sessions.append(_Session(name, trajectory, maps, contributes, fraction))

    def finish(
        self,
        frame: str = "map",
        provenance: dict[str, str] | None = None,
        georeference: Georeference | None = None,
    ) -> PoleMap:
        """Make the map.

        Parameters
        ----------
        frame : str
            Name of its frame.
        provenance : dict of str to str, optional
            Where it comes from.
        georeference : Georeference, optional
            Where on Earth the frame lies.

        Raises
        ------
        MapError
            If there was no session, or no pole was found.
        """
        if not self._sessions:
            raise MapError("pole map: no session was added")
        s, parts, found_at_all = self.settings, [], 0
        for session in self._sessions:
            found = [each.in_world for each in session.maps]
            found_at_all += sum(map(len, found))
            kept = confirmed(found, s.confirmations, s.window, s.slack)
            parts += [poles for poles, counts in zip(kept, session.contributes, strict=True) if counts]
        poles = merged(Poles.joined(parts), s.slack)
        if len(poles) == 0:
            raise MapError(
                f"pole map: of {found_at_all} detections in {sum(len(x.maps) for x in self._sessions)} local maps, "
                "none became a pole; coarsen the resolution, or lower least_score, least_height or confirmations"
            )
        in_view, seen = (np.zeros((len(poles), len(self._sessions)), np.int64) for _ in range(2))
        margin = s.poles.resolution * (s.poles.hull_cells + s.poles.most_width)
        for column, session in enumerate(self._sessions):
            for each in session.maps:
                hit = np.zeros(len(poles), np.bool_)
                hit[overlaps(poles, each.in_world, s.slack)[:, 0]] = True
                seen[:, column] += hit
                in_view[:, column] += hit | each.covers(poles.positions, margin)
        names = tuple(session.name for session in self._sessions)
        return PoleMap(poles, seen, in_view, names, frame, georeference, provenance or {})
