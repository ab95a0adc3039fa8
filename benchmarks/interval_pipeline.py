"""A full scan in a district of 500 facades: what the whole localization by intervals costs, beside one plain pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely

from benchmarks._plain_interval_kernels import plain_pass
from benchmarks.facades_districts import SETTINGS as DISTRICTS
from benchmarks.facades_districts import DistrictSettings, districts
from factorloc.config import read_config
from factorloc.errors import MapError
from factorloc.localization.correspondences import find_correspondences
from factorloc.localization.facade_scan import localize_scan
from factorloc.localization.feasible_set import intersect_correspondences
from factorloc.localization.wall_lines import WallLines
from factorloc.mapping.facade_points import ReductionSettings, ScanErrors, facade_points
from factorloc.result import Bounds
from factorloc.scan import Scan
from factorloc.simulation import hdl_64e

__all__ = ["FIT", "FULL", "INTERSECT", "LINES", "PASS", "REDUCE", "Pipeline"]

REDUCE, LINES, INTERSECT = "scan: reduction to the plane", "scan: visibility, association, lines", "scan: feasible set"
FIT = "scan: feasible set and most likely pose, without reduction"
FULL, PASS = "scan: all of it, reduction and visibility included", "scan: one plain pass over the points"

_REDUCTION = ReductionSettings(ground=0.0)
_ERRORS = ScanErrors()


@dataclass(frozen=True)
class Pipeline:
    """One scan and its surroundings.

    Parameters
    ----------
    scan : Scan
        With as many returns as asked for.
    walls : WallLines
        The facades nearest to it.
    start : Bounds
        5 m and 5 degrees around a pose off the truth.
    """

    scan: Scan
    walls: WallLines
    start: Bounds

    @classmethod
    def of(cls, points: int, facades: int) -> Pipeline:
        """Cast a scan in a generated town, whose map is as OpenStreetMap's.

        Raises
        ------
        MapError
            If the town has fewer facades, or the scan fewer returns.
        """
        settings = read_config(DISTRICTS, DistrictSettings)
        district = next(districts(settings, "tuning", None))
        rng = np.random.default_rng(3)
        blocked = district.built.obstacles.buffer(2.0)
        while True:
            pose = district.streets.spot(rng)
            if not shapely.intersects_xy(blocked, pose[0], pose[1]):
                break
        T = np.eye(4)
        T[:2, :2] = [[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]]
        T[:2, 3] = pose[:2]
        scan = hdl_64e(columns=4000).cast(district.built.scene.world, T, rng)
        returned = np.flatnonzero(scan.is_return)
        mapped = district.facade_map("osm-like").facades
        if len(returned) < points or len(mapped) < facades:
            raise MapError(f"town: {len(returned)} returns and {len(mapped)} facades; ask for fewer")
        near = np.argsort(np.hypot(*(mapped.segments.mean(1) - pose[:2]).T))[:facades]
        kept = np.sort(rng.choice(returned, points, replace=False))
        start = Bounds.around(pose + np.array([3.0, -2.0, 0.05]), 5.0, np.radians(5.0))
        return cls(scan.select(kept), WallLines(mapped.select(np.sort(near))), start)

    def runs(self) -> dict[str, Callable[[], object]]:
        """Everything that is timed.

        Raises
        ------
        MapError
            If the feasible set is empty: nothing worth timing.
        """
        reduced = facade_points(self.scan, _ERRORS, _REDUCTION)
        found = find_correspondences(reduced, self.walls, self.start)
        step = localize_scan(reduced, self.walls, self.start)
        if step.estimate is None or not found.found:
            raise MapError("town: no pose is feasible, or no facade was found; nothing was timed")
        cloud, out = np.ascontiguousarray(self.scan.points()), np.empty(len(self.scan))
        return {
            PASS: lambda: plain_pass(cloud, 0.8, 0.6, 1.0, 2.0, out),
            REDUCE: lambda: facade_points(self.scan, _ERRORS, _REDUCTION),
            LINES: lambda: find_correspondences(reduced, self.walls, self.start),
            INTERSECT: lambda: intersect_correspondences(found.found, self.walls, self.start),
            FIT: lambda: localize_scan(reduced, self.walls, self.start),
            FULL: lambda: localize_scan(facade_points(self.scan, _ERRORS, _REDUCTION), self.walls, self.start),
        }
