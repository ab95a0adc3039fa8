import time

import numpy as np
import pytest
import shapely

from factorloc.simulation.poles import PoleKind
from factorloc.simulation.street import StreetSettings, street_route, street_scene, street_world
from factorloc.simulation.trees import leaf_share
from factorloc.simulation.world import Surface


@pytest.fixture(scope="module")
def scene():
    return street_scene(seed=3)


def triangles(world):
    return sum(len(thing.mesh.faces) for thing in (*world.solids, *world.canopies))


def test_it_is_built_at_once_and_of_bounded_size(scene):
    start = time.process_time()
    world = street_world(seed=3)
    assert time.process_time() - start < 2
    assert 20_000 < triangles(world) < 150_000
    for a, b in zip(world.solids, scene.world.solids, strict=True):
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)
        assert np.array_equal(a.mesh.faces, b.mesh.faces)


def test_all_but_the_ground_is_closed(scene):
    assert all(s.mesh.is_watertight for s in scene.world.solids if s.surface is not Surface.GROUND)


def test_no_two_things_stand_in_one_place(scene):
    tree = shapely.STRtree(scene.footprints)
    pairs = tree.query(np.array(scene.footprints), predicate="intersects").T
    assert [tuple(pair) for pair in pairs.tolist() if pair[0] < pair[1]] == []


def test_lanes_and_pavements_are_what_they_should_be(scene):
    grid = StreetSettings().grid
    assert not any(grid.lanes.intersects(footprint) for footprint in scene.footprints)
    pavements = shapely.union_all(grid.ground.pavements)
    assert all(pavements.contains(pole.footprint) for pole in scene.true_poles)
    assert not any(pavements.intersects(car.footprint) for car in scene.vehicles)
    route = street_route()
    assert route.length > 150
    poses = route.poses_at(np.arange(0, route.length, 0.25))
    assert scene.world.clearance(np.pad(poses[:, :2], ((0, 0), (0, 1)), constant_values=0.8)).min() > route.body_radius


def test_it_has_rows_of_facades_with_recesses_and_a_cross_street(scene):
    main = [f for f in scene.facades if abs(f.normal[1]) > 0.9]
    for side in (1, -1):
        offsets = np.array([side * f.start[1] for f in main if f.normal[1] * side < -0.9])
        assert len(np.unique(offsets.round(2))) >= 3
        assert np.ptp(offsets) > 0.5
        length = sum(f.length for f in main if f.normal[1] * side < -0.9)
        assert length > 0.8 * (180 - 18)
    assert sum(abs(f.normal[0]) > 0.9 for f in scene.facades) >= 4


def test_poles_of_many_kinds_have_true_widths_and_identities(scene):
    poles = scene.true_poles
    assert {pole.kind for pole in poles} >= {PoleKind.LAMP, PoleKind.SIGN, PoleKind.BOLLARD, PoleKind.TRUNK}
    assert len({pole.id for pole in poles}) == len(poles) > 40
    assert all(0.06 <= pole.width <= 0.40 for pole in poles)
    assert all(pole.bottom == pytest.approx(0.12) for pole in poles)
    assert 10 < len(scene.vehicles) < 60


def test_seeds_differ_and_nouns_do_not_depend_on_one_another(scene):
    other = street_scene(seed=4)
    assert {p.id: p for p in other.poles} != {p.id: p for p in scene.poles}
    settings = StreetSettings()
    fewer = street_scene(settings.replaced(furniture=settings.furniture.replaced(parked_share=0.3)), seed=3)
    assert fewer.poles == scene.poles
    assert fewer.trees == scene.trees
    assert set(fewer.vehicles) < set(scene.vehicles)
    for a, b in zip(fewer.buildings, scene.buildings, strict=True):
        assert np.array_equal(a.mesh.vertices, b.mesh.vertices)


def test_a_winter_street_has_the_same_trees_without_leaves(scene):
    winter = street_scene(StreetSettings(month=1), seed=3)
    assert [tree.trunk for tree in winter.trees] == [tree.trunk for tree in scene.trees]
    assert {tree.leaves for tree in winter.trees} == {leaf_share(1)}
    assert max(c.rate for c in winter.canopies) < 0.2 * max(c.rate for c in scene.canopies)


def test_a_sloping_street_carries_everything_along():
    level, sloping = street_scene(seed=5), street_scene(StreetSettings(slope=0.04), seed=5)
    for a, b in zip(level.poles, sloping.poles, strict=True):
        assert b.bottom - a.bottom == pytest.approx(0.04 * a.x)
    for a, b in zip(level.vehicles, sloping.vehicles, strict=True):
        assert b.z - a.z == pytest.approx(0.04 * a.x)
    solids = sloping.world.solids
    assert all(solid.mesh.is_watertight for solid in solids if solid.surface is not Surface.GROUND)
    meshes = [solid.mesh for solid in solids if solid.surface is Surface.VEHICLE]
    for car, mesh in zip(sloping.vehicles, meshes, strict=True):
        lifts = np.asarray(mesh.vertices)[:, 2] - 0.04 * np.asarray(mesh.vertices)[:, 0]
        assert lifts.min() == pytest.approx(0, abs=1e-9)
        assert lifts.max() == pytest.approx(car.size[2])
