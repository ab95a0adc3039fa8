"""Districts to localize in: true worlds to cast rays in, maps with committed errors, poses and drives with their scans.

Two kinds: the extract of OpenStreetMap beside drive 0005 of KITTI, and towns of generated footprints, turned by any
angle. Both are extruded with windows, doors and balconies; cars are parked and trees stand along the streets; some
buildings are not on the map, and some of the map do not stand. Outlines as read are the truth; the map is drawn from
them with a shift of each building and an error of each corner, cut where the declared uncertainty ends.

>>> settings = read_config(SETTINGS, DistrictSettings)
>>> for district in districts(settings, "reported", data):
...     facade_map = district.facade_map("osm-like")       # FacadeMap, in the frame of the district
...     shots = district.shots(cache)                      # single poses; shots.poses (N, 3) and shots.scans[k]
...     for drive in district.drives(cache):               # drive.poses, .odometry, .odometry_bounds, .scans[k]
...         ...

Scans are taken standing still, as perfect de-skewing would leave them; the body is tilted and lifted a little. They are
cast once and kept under a digest of all settings they follow from. As a program, this casts them all and shows them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import platformdirs
import shapely

from benchmarks.district_settings import SETTINGS, DistrictSettings
from benchmarks.district_shots import DistrictDrive, Shots
from benchmarks.district_streets import PATH_STEP, Streets, read_streets
from benchmarks.district_towns import turned_town
from benchmarks.district_world import Built, build
from benchmarks.harness import Benchmark, arguments, one_line_errors
from benchmarks.stored_scans import StoredScans
from factorloc.cli.console import progress_bar
from factorloc.config import read_config
from factorloc.datasets import read_buildings
from factorloc.errors import DataError
from factorloc.mapping import BuildingOutlines, FacadeMap
from factorloc.simulation.streams import stream
from factorloc.viewer import plot_facade_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SETTINGS", "District", "DistrictDrive", "DistrictSettings", "Shots", "districts", "scan_cache"]

Array = npt.NDArray[np.float64]

EXTRACT = "kitti_raw_0005/2011_09_26_drive_0005_sync.osm"
"""Where the extract lies in the data folder."""

_RIM = 15.0  # m of street beyond the outermost buildings


@dataclass(frozen=True)
class District:
    """A place of one split.

    Parameters
    ----------
    name : str
        ``extract`` or ``town 1``.
    settings : DistrictSettings
        All of them.
    split : str
        Which poses.
    buildings : BuildingOutlines
        True outlines.
    streets : Streets
        Where cars drive.
    seed : int
        Of the world and its map; the same in all splits.
    shot_count, drive_count : int
        How many.
    """

    name: str
    settings: DistrictSettings
    split: str
    buildings: BuildingOutlines
    streets: Streets
    seed: int
    shot_count: int
    drive_count: int

    @cached_property
    def built(self) -> Built:
        """World and true outlines of what is mapped."""
        return build(self.buildings, self.streets, self.settings.world, self.seed)

    def facade_map(self, kind: str) -> FacadeMap:
        """The map of a kind (``osm-like``, ``lod2-like``), with its errors; the same whenever asked.

        Raises
        ------
        DataError
            If there is no such kind.
        """
        if kind not in self.settings.maps:
            raise DataError(f"maps: no '{kind}'; there are {', '.join(self.settings.maps)}")
        return self.settings.maps[kind].drawn(self.built.mapped, self.seed)

    def shots(self, cache: Path, on_scan: Callable[[int], None] | None = None) -> Shots:
        """Single poses on streets, with their scans from the cache, or cast now.

        Parameters
        ----------
        cache : Path
            Folder of scans.
        on_scan : callable, optional
            Called with the number of scans that are there.
        """
        rng = self._stream("shots")
        chosen = self.settings.shots
        blocked = self.built.obstacles.buffer(chosen.clearance)
        near = shapely.union_all([o.polygon for o in self.built.mapped.outlines]).buffer(chosen.within)
        shapely.prepare(blocked)
        shapely.prepare(near)
        poses: list[Array] = []
        while len(poses) < self.shot_count:
            x, y, yaw = self.streets.spot(rng)
            off = rng.uniform(-chosen.lateral, chosen.lateral)
            x, y = x - off * np.sin(yaw), y + off * np.cos(yaw)
            yaw += np.pi * rng.integers(2) + np.deg2rad(chosen.heading_sigma) * rng.standard_normal()
            if shapely.intersects_xy(near, x, y) and not shapely.intersects_xy(blocked, x, y):
                poses.append(np.array([x, y, yaw]))
        T_world_body = self._standing(np.reshape(poses, (-1, 3)), rng)
        return Shots(T_world_body, self._scans(T_world_body, cache, "shots", on_scan))

    def drives(self, cache: Path, on_scan: Callable[[int], None] | None = None) -> Iterator[DistrictDrive]:
        """All drives; see :meth:`drive`."""
        return (self.drive(number, cache, on_scan) for number in range(self.drive_count))

    def drive(self, number: int, cache: Path, on_scan: Callable[[int], None] | None = None) -> DistrictDrive:
        """A drive through the streets, with its scans from the cache, or cast now; see :meth:`shots`."""
        chosen = self.settings.drives
        rng = self._stream("drive", number)
        blocked = self.built.obstacles.buffer(chosen.clearance)
        path = self.streets.tour(chosen.length, chosen.lane, blocked, rng)
        poses = path[:: round(chosen.spacing / PATH_STEP)]
        T_world_body = self._standing(poses, rng)
        odometry = self.settings.odometry.measured(poses, self._stream("odometry", number))
        bounds = self.settings.odometry.bounds(odometry)
        scans = self._scans(T_world_body, cache, f"drive {number}", on_scan)
        return DistrictDrive(T_world_body, scans, odometry, bounds)

    def _standing(self, poses: Array, rng: np.random.Generator) -> Array:
        """Planar poses (N, 3) as homogeneous ones of a body that is tilted and lifted a little."""
        body = self.settings.body
        roll, pitch = np.deg2rad(body.tilt) * rng.uniform(-1, 1, (2, len(poses)))
        T_world_body = np.tile(np.eye(4), (len(poses), 1, 1))
        T_world_body[:, 0, 3], T_world_body[:, 1, 3] = poses[:, 0], poses[:, 1]
        T_world_body[:, 2, 3] = body.height * rng.uniform(-1, 1, len(poses))
        turns = (_turn(poses[:, 2], (0, 1)), _turn(pitch, (2, 0)), _turn(roll, (1, 2)))
        T_world_body[:, :3, :3] = turns[0] @ turns[1] @ turns[2]
        return T_world_body

    def _scans(self, T_world_body: Array, cache: Path, what: str, on_scan: Callable[[int], None] | None) -> StoredScans:
        lidar = self.settings.lidar
        follows_from = (
            self.settings.model_dump_json(exclude={"maps", "splits", "odometry"}),
            self.name,
            self.split,
            what,
        )
        return StoredScans.of(
            cache, follows_from, lambda: self.built.scene.world, lidar.lidar, T_world_body, lidar.unit, on_scan
        )

    def _stream(self, *what: str | int) -> np.random.Generator:
        return stream(self.seed, self.split, *what)


def _turn(angles: Array, axes: tuple[int, int]) -> Array:
    """Rotations (N, 3, 3) from one axis to another."""
    R = np.tile(np.eye(3), (len(angles), 1, 1))
    a, b = axes
    R[:, a, a] = R[:, b, b] = np.cos(angles)
    R[:, b, a] = np.sin(angles)
    R[:, a, b] = -np.sin(angles)
    return R


def districts(settings: DistrictSettings, split: str, data: Path | None) -> Iterator[District]:
    """Districts of a split: the extract, if there is data, and the towns.

    Parameters
    ----------
    settings : DistrictSettings
        What they are like.
    split : str
        ``tuning`` or ``reported``.
    data : Path or None
        Folder of real data; without it, the extract is left out.

    Raises
    ------
    DataError
        If there is no such split, or the extract cannot be read.
    """
    if split not in settings.splits:
        raise DataError(f"splits: no '{split}'; there are {', '.join(settings.splits)}")
    chosen = settings.splits[split]
    if data is not None and (path := data / EXTRACT).is_file():
        buildings = read_buildings(path)
        assert buildings.frame is not None
        x0, y0, x1, y1 = shapely.total_bounds([outline.polygon for outline in buildings.outlines])
        area = shapely.box(x0, y0, x1, y1).buffer(_RIM)
        streets = Streets.within(read_streets(path, buildings.frame), area)
        yield District(
            "extract", settings, split, buildings, streets, settings.seed, chosen.extract_shots, chosen.extract_drives
        )
    for seed in chosen.towns:
        buildings, streets = turned_town(settings.towns, seed)
        yield District(f"town {seed}", settings, split, buildings, streets, seed, chosen.town_shots, chosen.town_drives)


@one_line_errors
def main(argv: list[str] | None = None) -> int:
    """Cast all scans of the splits asked for, and show the districts."""
    given = arguments("facades_districts", __doc__ or "", argv, split=("tuning", "reported"), cache="")
    settings = read_config(SETTINGS, DistrictSettings)
    cache = Path(given.options["cache"]) if given.options["cache"] else scan_cache()
    bench = Benchmark("facades_districts", settings.model_dump())
    picture = None
    for split in given.options["split"]:
        for district in districts(settings, split, given.data):
            chosen = replace(district, shot_count=25, drive_count=1) if given.quick else district
            picture = _cast(chosen, cache, bench) or picture
    return bench.finish(given, picture)


def scan_cache() -> Path:
    """Folder in which scans are kept."""
    return Path(platformdirs.user_cache_dir("factorloc")) / "facades_districts"


def _cast(district: District, cache: Path, bench: Benchmark) -> Figure | None:
    name = f"{district.split} {district.name}"
    with progress_bar(f"{name}: poses", district.shot_count) as progress:
        shots = district.shots(cache, progress)
    ways = {}
    for number in range(district.drive_count):
        with progress_bar(f"{name}: drive {number + 1}", 0) as progress:
            drive = district.drive(number, cache, progress)
        ways[f"drive {number + 1}"] = drive.poses[:, :2]
    bench.figure(f"{name}: buildings", len(district.built.scene.buildings), "1")
    bench.figure(f"{name}: mapped buildings that do not stand", int((~district.built.standing).sum()), "1")
    bench.figure(f"{name}: streets", district.streets.length, "m")
    bench.figure(f"{name}: poses", len(shots), "1")
    bench.figure(f"{name}: drives", len(ways), "1")
    for kind in district.settings.maps:
        bench.figure(f"{name}: facades {kind}", len(district.facade_map(kind)), "1")
    return plot_facade_map(district.facade_map("osm-like"), dict(list(ways.items())[:3]))


if __name__ == "__main__":
    sys.exit(main())
