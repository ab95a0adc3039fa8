"""Pole map: the poles of a place, how reliably each was found, and where on Earth they stand."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping.georeference import Georeference
from factorloc.mapping.poles import Poles

__all__ = ["PoleMap"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PoleMap:
    """Poles of a place, with an account of how often each was found where it could have been.

    Parameters
    ----------
    poles : Poles
        In the frame of the map, m.
    seen : (N, S) array_like of int
        In how many local maps of each session each pole was found.
    in_view : (N, S) array_like of int
        In how many local maps of each session it could have been found: those that cover its place.
    sessions : tuple of str
        Names of the S sessions the map was made from, in their order.
    frame : str
        Name of the frame.
    georeference : Georeference, optional
        Where on Earth the frame lies.
    provenance : dict of str to str
        Where the map comes from.

    Raises
    ------
    MapError
        If counts do not fit the poles and sessions, are negative, or a pole was seen more often than it was in view.
    """

    poles: Poles
    seen: Index
    in_view: Index
    sessions: tuple[str, ...]
    frame: str = "map"
    georeference: Georeference | None = None
    provenance: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        shape = (len(self.poles), len(self.sessions))
        if not self.sessions:
            raise MapError("pole map: no session; name the one it was made from")
        if len(set(self.sessions)) < len(self.sessions):
            raise MapError(f"pole map: sessions {self.sessions} are not told apart by their names")
        for name in ("seen", "in_view"):
            given = np.asarray(getattr(self, name))
            counts = np.ascontiguousarray(given.reshape(shape) if given.size == 0 else given, np.int64)
            if counts.shape != shape:
                raise MapError(f"pole map: {name} has shape {counts.shape}; expected {shape}, poles by sessions")
            if (counts < 0).any():
                raise MapError(f"pole map: {name} must not be negative")
            object.__setattr__(self, name, counts)
        if (self.seen > self.in_view).any():
            raise MapError("pole map: a pole was seen more often than it was in view")

    @classmethod
    def of(cls, poles: Poles, session: str = "map", **options: object) -> PoleMap:
        """Take poles as a map of one session of which nothing else is known: each was in view once, and seen.

        Parameters
        ----------
        poles : Poles
            In the frame of the map.
        session : str
            Name of the session.
        **options
            ``frame``, ``georeference`` and ``provenance``.
        """
        once = np.ones((len(poles), 1), np.int64)
        return cls(poles, once, once.copy(), (session,), **options)  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.poles)

    @property
    def positions(self) -> Array:
        """Axes of the poles, m, (N, 2)."""
        return self.poles.positions

    @property
    def detection_rates(self) -> Array:
        """Fraction of the local maps with each pole in view in which it was found, all sessions together, (N,).

        NaN for a pole that was never in view.
        """
        seen, in_view = self.seen.sum(1), self.in_view.sum(1)
        return np.asarray(np.divide(seen, in_view, out=np.full(len(self), np.nan), where=in_view > 0))

    def select(self, which: npt.ArrayLike) -> PoleMap:
        """Part of the map named by a mask or indices."""
        rows = np.asarray(which) if np.size(which) else np.empty(0, np.int64)
        return replace(self, poles=self.poles.select(rows), seen=self.seen[rows], in_view=self.in_view[rows])

    def near(self, positions: npt.ArrayLike, reach: float) -> PoleMap:
        """Part of the map within a distance of any of some positions, as those of a drive.

        Parameters
        ----------
        positions : (M, 2) array_like
            m, in the frame of the map.
        reach : float
            Distance, m.

        Raises
        ------
        MapError
            If no pole is that near: the map is of another place, or in another frame.
        """
        places = np.asarray(positions, np.float64).reshape(-1, 2)
        if len(self) == 0:
            raise MapError("pole map: holds no poles; map a drive with upright objects beside the road")
        if len(places) == 0 or not np.isfinite(places).all():
            raise MapError("pole map: no finite positions to look near; is the drive empty?")
        distances = np.asarray(cKDTree(places).query(self.positions)[0])
        if distances.min() > reach:
            raise MapError(
                f"pole map: its nearest pole is {distances.min():.0f} m from the drive, farther than {reach:g} m; "
                "is the map of another place, or in another coordinate system?"
            )
        return self.select(distances <= reach)

    def without_duplicates(self, distance: float) -> tuple[PoleMap, int]:
        """Leave out poles nearer to another than that, of which the one seen more often (then scored higher) stays.

        Parameters
        ----------
        distance : float
            Smallest distance between axes, m.

        Returns
        -------
        PoleMap
            The map without them, in the same order.
        int
            How many were left out.
        """
        if len(self) == 0:
            return self, 0
        neighbours = cKDTree(self.positions).query_ball_point(self.positions, distance)
        kept = np.zeros(len(self), np.bool_)
        for row in np.lexsort((-self.poles.scores, -self.seen.sum(1))).tolist():
            kept[row] = not kept[neighbours[row]].any()
        return self.select(kept), int((~kept).sum())

    def transformed(self, T_new_map: npt.ArrayLike, frame: str) -> PoleMap:
        """The same map in another planar frame; a georeference goes along.

        Parameters
        ----------
        T_new_map : (3,) array_like
            Pose (x, y, yaw) of the present frame in the new one, m and rad.
        frame : str
            Name of the new frame.
        """
        moved = self.georeference and Georeference(
            self.georeference.crs, se2.compose(self.georeference.T_crs_map, se2.inverse(T_new_map))
        )
        return replace(self, poles=self.poles.transformed(T_new_map), frame=frame, georeference=moved)

    def referred_to(self, georeference: Georeference) -> PoleMap:
        """The same map in the local frame of another georeference, each pole converted on its own.

        Parameters
        ----------
        georeference : Georeference
            Where the other frame lies.

        Raises
        ------
        MapError
            If this map has no georeference, or lies where the other projection is not defined.
        """
        if self.georeference is None:
            raise MapError("pole map: has no coordinate system, so it cannot be moved into another; name its CRS")
        moved = georeference.from_lonlat(self.georeference.to_lonlat(self.positions))
        return replace(self, poles=replace(self.poles, positions=moved), georeference=georeference)
