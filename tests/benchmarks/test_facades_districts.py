"""Districts for facades: errors within what is declared, drives and poses that are free, scans from the cache."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from benchmarks.district_errors import MapErrors, OdometryErrors
from benchmarks.district_settings import SETTINGS, DistrictSettings
from benchmarks.district_streets import Streets
from benchmarks.facades_districts import District, districts
from factorloc.config import read_config
from factorloc.errors import DataError, SimulationError
from factorloc.geometry import se2
from factorloc.mapping import BuildingOutlines, Outline
from factorloc.scan import RayStatus

settings = read_config(SETTINGS, DistrictSettings)


@pytest.fixture(scope="module")
def town() -> District:
    small = settings.replaced(
        towns=settings.towns.replaced(blocks=1),
        lidar=settings.lidar.replaced(columns=90),
        drives=settings.drives.replaced(length=120.0, spacing=30.0),
    )
    found = next(districts(small, "tuning", None))
    return replace(found, shot_count=4, drive_count=1)


def test_the_settings_are_those_that_were_agreed() -> None:
    osm, lod2 = settings.maps["osm-like"], settings.maps["lod2-like"]
    assert (osm.shift_sigma, osm.shift, osm.vertex) == (0.5, 2.0, 0.1)
    assert (lod2.shift_sigma, lod2.shift, lod2.vertex) == (0.05, 0.2, 0.05)
    reported = settings.splits["reported"]
    assert reported.extract_shots + len(reported.towns) * reported.town_shots >= 2000
    assert reported.extract_drives + len(reported.towns) * reported.town_drives >= 20
    assert settings.drives.length >= 500
    assert not set(reported.towns) & set(settings.splits["tuning"].towns)


@pytest.mark.parametrize("kind", ["osm-like", "lod2-like"])
def test_map_errors_keep_to_what_is_declared(kind: str) -> None:
    errors = settings.maps[kind]
    houses = [shapely.box(30 * k, 0, 30 * k + 12, 9) for k in range(300)]
    facade_map = errors.drawn(BuildingOutlines(tuple(Outline(house) for house in houses)), seed=3)
    moved = np.array([shapely.get_coordinates(p.exterior)[:-1] for p in facade_map.outlines])
    off = moved - np.array([shapely.get_coordinates(p.exterior)[:-1] for p in houses])
    shifts = off.mean(1)
    assert np.abs(off).max() <= errors.shift + errors.vertex
    # Corners are uniform about the shift, and shifts are as wide as they should be: both are used up.
    assert np.abs(shifts).std() > 0
    assert shifts.std() == pytest.approx(errors.shift_sigma, rel=0.1)
    assert errors.vertex < np.abs(off - shifts[:, None]).max() <= 2 * errors.vertex
    assert set(facade_map.facades.shifts.tolist()) == {errors.shift}
    assert facade_map.facades.vertex_errors.min() == errors.vertex


def test_the_true_walls_are_inside_the_bounds_of_the_map(town: District) -> None:
    """Of every facade whose building was mapped, true ends and line are enclosed; what was cut is not compared."""
    for kind in settings.maps:
        facade_map = town.facade_map(kind)
        truth = {}
        for number, outline in enumerate(town.built.mapped.whole().outlines):
            ring = shapely.get_coordinates(shapely.orient_polygons(outline.polygon).exterior)
            truth[number] = np.stack([ring[:-1], ring[1:]], 1)
        bounds = facade_map.bounds()
        lost = compared = 0
        for k, (segment, building) in enumerate(
            zip(facade_map.facades.segments, facade_map.facades.buildings.tolist(), strict=True)
        ):
            edges = truth[building]
            off = np.abs(edges - segment).max((1, 2))
            nearest = int(off.argmin())
            if off[nearest] > facade_map.facades.shifts[k] + facade_map.uncertainty.vertex:
                continue  # cut, or put together of several
            a, b = edges[nearest]
            direction = np.arctan2(a[0] - b[0], b[1] - a[1])
            turned = direction + 2 * np.pi * np.round((bounds.alpha.mid[k] - direction) / (2 * np.pi))
            distance = a @ [np.cos(direction), np.sin(direction)]
            lost += not (bounds.alpha.lo[k] <= turned <= bounds.alpha.hi[k])
            lost += not (bounds.d.lo[k] <= distance <= bounds.d.hi[k])
            compared += 1
        assert lost == 0
        assert compared > 0.5 * len(facade_map)


def test_outlines_that_fold_are_refused() -> None:
    thin = BuildingOutlines((Outline(shapely.Polygon([(0, 0), (20, 0.0), (20, 0.01), (0, 0.01)])),))
    with pytest.raises(SimulationError, match="too short"):
        MapErrors(shift_sigma=0.1, shift=1.0, vertex=3.0, gap=0.4).drawn(
            BuildingOutlines((replace(thin.outlines[0], polygon=comb()),)), seed=0
        )


def comb() -> shapely.Polygon:
    teeth = [(0.1 * k, 5.0 if k % 2 else 0.0) for k in range(200)]
    return shapely.Polygon([*teeth, (20.0, -3.0), (0.0, -3.0)])


def test_odometry_keeps_to_its_bounds() -> None:
    errors: OdometryErrors = settings.odometry
    rng = np.random.default_rng(1)
    poses = np.cumsum(rng.normal(0, [2.0, 0.3, 0.2], (2000, 3)), axis=0)
    measured = errors.measured(poses, rng)
    parts = (measured - se2.between(poses[:-1], poses[1:])) / errors.bounds(measured)
    assert np.abs(parts).max() <= 1 + 1e-9
    assert np.abs(parts).max(0).min() > 0.98


def test_tours_keep_to_the_streets_and_off_obstacles() -> None:
    cross = [shapely.LineString([(-100, 0), (100, 0)]), shapely.LineString([(0, -80), (0, 80)])]
    streets = Streets.within(cross, shapely.box(-90, -90, 90, 90))
    assert streets.length == pytest.approx(340)
    obstacle = shapely.box(20, 5, 40, 9)
    for seed in range(3):
        path = streets.tour(400, 1.5, obstacle, np.random.default_rng(seed))
        assert np.hypot(*np.diff(path[:, :2], axis=0).T).sum() >= 400
        assert not shapely.intersects_xy(obstacle, path[:, 0], path[:, 1]).any()
        near = shapely.distance(shapely.union_all(list(streets.lines)), shapely.points(path[:, :2]))
        assert near.max() < 2.5
        # Headings follow the path.
        along = np.diff(path[:, :2], axis=0)
        off = np.angle(np.exp(1j * (np.arctan2(along[:, 1], along[:, 0]) - path[:-1, 2])))
        assert np.abs(off).max() < 0.5
    with pytest.raises(SimulationError, match="no free tour"):
        streets.tour(10, 1.5, shapely.box(-200, -200, 200, 200), np.random.default_rng(0))


def test_poses_are_free_and_scans_come_from_the_cache(town: District, tmp_path: Path) -> None:
    shots = town.shots(tmp_path)
    assert (len(shots), len(shots.scans)) == (4, 4)
    clear = shapely.distance(town.built.obstacles, shapely.points(shots.poses[:, :2]))
    assert clear.min() >= settings.shots.clearance
    scan = shots.scans[3]
    assert scan.shape == (32, 90)
    assert (scan.status == RayStatus.RETURN).mean() > 0.5
    files = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    again = town.shots(tmp_path)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == files
    assert (again.scans[3].ranges == scan.ranges).all()
    # A return on a true wall: most points above cars are within their noise of what stands.
    T = shots.T_world_body[3] @ scan.T_body_sensor
    points = (scan.directions * scan.ranges[:, None])[scan.is_return] @ T[:3, :3].T + T[:3, 3]
    walls = shapely.union_all([b.footprint for b in town.built.scene.buildings]).boundary
    high = points[(points[:, 2] > 2.5) & (points[:, 2] < 5.0)]
    assert (shapely.distance(walls, shapely.points(high[:, :2])) < 0.4).mean() > 0.5


def test_drives_have_bounded_odometry(town: District, tmp_path: Path) -> None:
    (drive,) = town.drives(tmp_path)
    assert len(drive) == 5
    true = se2.between(drive.poses[:-1], drive.poses[1:])
    assert (np.abs(drive.odometry - true) <= drive.odometry_bounds + 1e-9).all()


def test_missing_and_extra_buildings_are_there(town: District) -> None:
    built = town.built
    assert (~built.standing).sum() + len(built.scene.buildings) - built.standing.sum() > 0
    assert len(built.mapped) == len(built.standing)


def test_unknown_names_are_refused(town: District) -> None:
    with pytest.raises(DataError, match="osm-like"):
        town.facade_map("perfect")
    with pytest.raises(DataError, match="tuning"):
        next(districts(settings, "secret", None))
