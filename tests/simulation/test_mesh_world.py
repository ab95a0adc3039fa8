import logging

import numpy as np
import pytest
import scipy.stats
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from factorloc.errors import SimulationError
from factorloc.simulation import Canopy, MeshWorld, Solid, Surface, ray_caster
from factorloc.simulation.ray_caster import EmbreeCaster, ForestCaster

UP = np.array([0.0, 0.0, 1.0])


def box(low, high, **features):
    low, high = np.asarray(low, float), np.asarray(high, float)
    mesh = trimesh.creation.box(high - low)
    mesh.apply_translation((low + high) / 2)
    return Solid(mesh, features.pop("surface", Surface.WALL), **features)


def canopy(low, high, rate):
    return Canopy(box(low, high).mesh, rate)


def unit_vectors(count, seed=0):
    vectors = np.random.default_rng(seed).standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def rng(seed=5):
    return np.random.default_rng(seed)


def naive_ranges(triangles, origins, directions):
    """First hit of each ray by solving for barycentric coordinates on every triangle."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    best = np.full(len(origins), np.inf)
    for n, (o, d) in enumerate(zip(origins, directions, strict=True)):
        matrices = np.stack([u, v, np.broadcast_to(-d, u.shape)], -1)
        s, t, r = np.linalg.solve(matrices, (o - a)[:, :, None])[:, :, 0].T
        best[n] = np.where((s >= 0) & (t >= 0) & (s + t <= 1) & (r >= 0), r, np.inf).min()
    return best


@pytest.mark.parametrize("centre", [(0, 0, 0), (5000.0, -3000.0, 200.0)])
def test_ranges_in_a_box_room_are_exact(centre):
    room = box(np.add(centre, (-6, -4, -2)), np.add(centre, (6, 4, 2)))
    directions = unit_vectors(20_000)
    hits = MeshWorld([room]).cast(centre, directions, rng())
    exact = (np.array([6, 4, 2]) / np.abs(directions)).min(axis=1)
    assert np.abs(hits.ranges - exact).max() < 1e-11
    assert (hits.surfaces == Surface.WALL).all()


def test_a_slanted_plane_far_away_is_exact():
    mesh = trimesh.Trimesh([(300, -900, -800), (520, 900, -900), (410, 0, 1000)], [(0, 1, 2)])
    a, b, c = mesh.vertices
    normal = np.cross(b - a, c - a)
    directions = (a * 0.4 + b * 0.3 + c * 0.3) / np.linalg.norm(a * 0.4 + b * 0.3 + c * 0.3) + 0.2 * unit_vectors(5000)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = MeshWorld([Solid(mesh, Surface.GROUND)]).cast(np.zeros(3), directions, rng())
    met = hits.surfaces == Surface.GROUND
    assert met.mean() > 0.9
    assert np.isinf(hits.ranges[~met]).all()
    assert hits.ranges[met] == pytest.approx(normal @ a / (directions[met] @ normal), rel=1e-12)


def test_hits_on_a_pole_lie_between_its_inner_and_outer_circle():
    mesh = trimesh.creation.cylinder(radius=0.2, height=10, sections=48)
    azimuth = np.linspace(-0.03, 0.03, 2001)
    directions = np.column_stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth])
    hits = MeshWorld([Solid(mesh, Surface.POLE)]).cast([-5.0, 0, 0], directions, rng())
    met = hits.surfaces == Surface.POLE
    inner = 0.2 * np.cos(np.pi / 48)
    assert (met == (np.abs(5 * np.sin(azimuth)) < inner)).mean() > 0.99
    radius = np.hypot(*(np.array([-5.0, 0]) + hits.ranges[met, None] * directions[met, :2]).T)
    assert radius.min() > inner - 1e-12
    assert radius.max() < 0.2 + 1e-12


@pytest.mark.parametrize("caster", [EmbreeCaster, ForestCaster])
def test_casters_agree_with_brute_force(caster):
    triangles = rng().uniform(-5, 5, (80, 1, 3)) + rng(6).uniform(-4, 4, (80, 3, 3))
    origins, directions = rng(7).uniform(-8, 8, (1500, 3)), unit_vectors(1500)
    ranges, found = caster(triangles).first_hits(origins, directions)
    expected = naive_ranges(triangles, origins, directions)
    same = np.isfinite(ranges) == np.isfinite(expected)
    assert same.mean() > 0.999  # single precision decides at silhouettes
    assert ((found >= 0) == np.isfinite(ranges)).all()
    met = same & np.isfinite(ranges)
    assert 300 < met.sum() < 1400
    assert (np.abs(ranges[met] - expected[met]) < 1e-11).mean() > 0.998


@pytest.mark.parametrize("caster", [EmbreeCaster, ForestCaster])
def test_closed_meshes_do_not_leak_at_edges_and_corners(caster):
    mesh = trimesh.creation.icosphere(subdivisions=3)
    edges = mesh.vertices[mesh.edges_unique]
    weights = np.linspace(0, 1, 20)[:, None, None]
    targets = np.concatenate([mesh.vertices, ((1 - weights) * edges[:, 0] + weights * edges[:, 1]).reshape(-1, 3)])
    targets /= np.linalg.norm(targets, axis=1, keepdims=True)
    ranges, _ = caster(np.asarray(mesh.triangles)).first_hits(np.zeros_like(targets), targets)
    assert ranges.max() <= 1 + 1e-12
    assert ranges.min() > 0.99


def test_the_nearest_of_several_surfaces_is_reported():
    world = MeshWorld([box((4, -1, -1), (5, 1, 1), surface=Surface.FACADE), box((2, -1, -1), (3, 1, 0), name="car")])
    hits = world.cast([0, 0, 0.5], [1, 0, 0], rng())
    assert (hits.ranges, hits.surfaces) == (4, Surface.FACADE)
    hits = world.cast([0, 0, -0.5], [[1, 0, 0], [-1, 0, 0]], rng())
    assert hits.ranges.tolist() == [2, np.inf]
    assert hits.surfaces.tolist() == [Surface.WALL, Surface.NOTHING]


def test_a_ray_from_within_ends_on_the_back_face():
    assert MeshWorld([box((-1, -1, -1), (1, 1, 2))]).cast([0, 0, 0], UP, None).ranges == 2


def test_moving_solids_are_where_they_are_at_the_time_of_the_ray():
    car = box((0, -1, 0), (4, 1, 1.5), surface=Surface.VEHICLE, velocity=(10.0, 0, 0))
    wall = box((30, -9, 0), (31, 9, 5))
    times = np.array([0.0, 1.0, 2.5, 3.0, -2.0])
    hits = MeshWorld([wall, car]).cast([-5.0, 0, 1], [1, 0, 0], rng(), times)
    assert hits.ranges == pytest.approx([5, 15, 30, 35, 35])
    assert hits.surfaces.tolist() == [Surface.VEHICLE] * 3 + [Surface.WALL] * 2
    # Across its path, it is met only while it passes.
    hits = MeshWorld([car]).cast([12.0, -5, 1], [0, 1, 0], rng(), np.linspace(0, 2, 201))
    passing = np.linspace(0, 2, 201)[np.isfinite(hits.ranges)]
    assert passing.min() == pytest.approx(0.8, abs=0.011)
    assert passing.max() == pytest.approx(1.2, abs=0.011)


def test_a_world_may_hold_only_what_moves():
    world = MeshWorld([box((0, -1, -1), (1, 1, 1), velocity=(0, 0, 2.0), name="lift")])
    assert world.cast([-3, 0, 2.5], [1, 0, 0], rng(), [0, 1]).ranges.tolist() == [np.inf, 3]


def test_free_paths_in_a_canopy_are_exponential():
    world = MeshWorld([box((50, -9, -9), (51, 9, 9))], [canopy((2, -3, -3), (42, 3, 3), 0.7)])
    hits = world.cast(np.zeros((40_000, 3)), [1.0, 0, 0], rng())
    assert (hits.surfaces == Surface.FOLIAGE).all()  # to pass has a chance of exp(-28)
    assert scipy.stats.kstest(hits.ranges - 2, scipy.stats.expon(scale=1 / 0.7).cdf).pvalue > 0.01


def test_a_canopy_is_passed_with_the_exact_probability():
    world = MeshWorld([box((8, -9, -9), (9, 9, 9))], [canopy((2, -3, -3), (5, 3, 3), 0.4)])
    direction = np.array([1, 0.3, -0.2]) / np.linalg.norm([1, 0.3, -0.2])
    hits = world.cast(np.zeros((40_000, 3)), direction, rng())
    passed = hits.surfaces == Surface.WALL
    probability = np.exp(-0.4 * 3 / direction[0])
    assert abs(passed.mean() - probability) < 4 * np.sqrt(probability * (1 - probability) / len(passed))
    assert hits.ranges[passed] == pytest.approx(8 / direction[0])
    inside = hits.ranges[~passed] * direction[0]
    assert inside.min() > 2
    assert inside.max() < 5
    law = scipy.stats.truncexpon(b=0.4 * 3 / direction[0], loc=2 / direction[0], scale=1 / 0.4)
    assert scipy.stats.kstest(hits.ranges[~passed], law.cdf).pvalue > 0.01


def test_rates_add_where_canopies_overlap_and_origins_lie_inside():
    world = MeshWorld([], [canopy((-1, -3, -3), (2, 3, 3), 0.3), canopy((1, -2, -2), (30, 2, 2), 0.5)])
    ranges = world.cast(np.zeros((40_000, 3)), [1.0, 0, 0], rng()).ranges

    def law(x):
        x = np.minimum(x, 30)
        return 1 - np.exp(-(0.3 * np.minimum(x, 2) + 0.5 * np.maximum(x - 1, 0)))

    assert scipy.stats.kstest(ranges, law).pvalue > 0.01


def test_optical_depth_of_an_ellipsoid_is_that_of_its_chord():
    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.apply_scale((2.0, 1.5, 1.0))
    world = MeshWorld([], [Canopy(mesh, 0.6)])
    lost = [np.isinf(world.cast(np.tile([y, 0.2, -9], (20_000, 1)), UP, rng()).ranges).mean() for y in (0.0, 1.0, 1.8)]
    chord = 2 * np.sqrt(1 - np.array([0.0, 1.0, 1.8]) ** 2 / 4 - 0.2**2 / 1.5**2)
    assert lost == pytest.approx(np.exp(-0.6 * chord), abs=0.015)


def test_a_solid_hides_the_canopy_behind_it_and_only_that():
    world = MeshWorld([box((4, -9, -9), (5, 9, 9))], [canopy((6, -3, -3), (60, 3, 3), 50.0)])
    assert (world.cast(np.zeros((100, 3)), [1, 0, 0], rng()).surfaces == Surface.WALL).all()


def test_rays_through_edges_of_a_canopy_are_counted_once():
    """Through corners, edges and along faces, the box is either passed by or has its depth."""
    world = MeshWorld([], [canopy((-1, -1, -1), (1, 1, 1), 40.0)])
    targets = np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 3), -1).reshape(-1, 3)
    directions = targets - [-5.0, 0.5, 0.25]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ranges = world.cast([-5.0, 0.5, 0.25], directions, rng()).ranges
    inner = np.abs(targets).max(1) < 1
    assert np.isfinite(ranges[inner]).all()
    met = np.isfinite(ranges)
    ends = np.array([-5.0, 0.5, 0.25]) + ranges[met, None] * directions[met]
    assert (np.abs(ends).max(1) < 1 + 1e-9).all()


def test_without_a_generator_rays_pass_canopies():
    world = MeshWorld([box((8, -9, -9), (9, 9, 9))], [canopy((2, -3, -3), (5, 3, 3), 9.0)])
    assert world.cast(np.zeros(3), [1, 0, 0], None).ranges == 8


def test_the_seed_decides_and_what_stands_there_does_not():
    foliage = [canopy((2, -3, -3), (30, 3, 3), 0.4)]
    sparse, dense = MeshWorld([], foliage), MeshWorld([box((-9, -9, -9), (-8, 9, 9))], foliage)
    direction = np.tile([1.0, 0, 0], (50, 1))
    first = sparse.cast(np.zeros(3), direction, rng()).ranges
    assert (first == dense.cast(np.zeros(3), direction, rng()).ranges).all()
    assert (first != sparse.cast(np.zeros(3), direction, rng(6)).ranges).any()


def test_shapes_broadcast():
    world = MeshWorld([box((-6, -4, -2), (6, 4, 2))])
    hits = world.cast(np.zeros((5, 3)), np.broadcast_to([1.0, 0, 0], (2, 5, 3)), rng(), np.arange(5))
    assert hits.ranges.shape == hits.surfaces.shape == (2, 5)
    assert (hits.ranges == 6).all()
    assert world.cast(np.zeros((0, 3)), np.zeros((0, 3)), rng()).ranges.shape == (0,)


@given(st.tuples(*[st.floats(-6, 6)] * 3))
def test_clearance_of_a_box_is_exact(point):
    world = MeshWorld([box((-1, -2, -1), (1, 2, 3)), box((-50, -50, -2), (50, 50, -1), surface=Surface.GROUND)])
    gap = np.maximum(np.abs(np.subtract(point, (0, 0, 1))) - (1, 2, 2), 0)
    # Rays that graze a face may count as inside of it; the distance is 0 there either way.
    assert world.clearance(point) == pytest.approx(np.linalg.norm(gap), abs=1e-12)


def test_clearance_of_open_meshes_and_of_nothing():
    sheet = trimesh.Trimesh([(0, 0, 0), (4, 0, 0), (0, 4, 0)], [(0, 1, 2)])
    points = np.array([[1, 1, 2], [-3, 1, 0], [3, 3, 0], [7, -4, 0]])
    expected = [2, 3, np.sqrt(2), 5]
    assert MeshWorld([Solid(sheet, Surface.FENCE)]).clearance(points) == pytest.approx(expected)
    assert np.isinf(MeshWorld([Solid(sheet, Surface.GROUND)]).clearance(points)).all()


def test_moving_solids_count_for_clearance_at_given_times():
    world = MeshWorld([box((0, -1, 0), (4, 1, 2), velocity=(2.0, 0, 0)), box((0, 9, 0), (4, 10, 2))])
    assert world.clearance([-1, 0, 1]) == pytest.approx(np.sqrt(82))
    assert world.clearance([-1, 0, 1], [0.0, 1.0, -1.0]) == pytest.approx([1, 3, 0])


def test_ground_height_is_that_of_the_topmost_ground():
    slope = trimesh.Trimesh([(0, 0, 0), (10, 0, 2), (0, 10, 0), (10, 10, 2)], [(0, 1, 2), (1, 3, 2)])
    below = box((-5, -5, -3), (20, 20, -2), surface=Surface.GROUND)
    world = MeshWorld([Solid(slope, Surface.GROUND), below, box((4, 4, 0), (6, 6, 9))])
    heights = world.ground_height([(5, 5), (1, 9), (-2, 3), (30, 0)])
    assert heights[:3] == pytest.approx([1, 0.2, -2])
    assert np.isnan(heights[3])


def test_without_embree_a_slower_caster_takes_over_and_says_so_once(monkeypatch, caplog):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    ray_caster._has_embree.cache_clear()
    try:
        with caplog.at_level(logging.WARNING):
            slow = [MeshWorld([box((-6, -4, -2), (6, 4, 2))]) for _ in range(2)]
            ranges = [world.cast(np.zeros(3), unit_vectors(100), rng()).ranges for world in slow]
        assert all(isinstance(world._resting, ForestCaster) for world in slow)
        assert [record.message for record in caplog.records if "embreex" in record.message] == [
            caplog.records[0].message
        ]
    finally:
        ray_caster._has_embree.cache_clear()
    monkeypatch.undo()
    fast = MeshWorld([box((-6, -4, -2), (6, 4, 2))])
    assert isinstance(fast._resting, EmbreeCaster)
    assert fast.cast(np.zeros(3), unit_vectors(100), rng()).ranges == pytest.approx(ranges[0], rel=1e-14)


@pytest.mark.parametrize(
    ("origins", "directions", "times", "line"),
    [
        ([0, 0], [1, 0, 0], None, "origins: shape"),
        ([0, 0, 0], [1, 0, 0.1], None, "unit length"),
        ([0, 0, np.nan], [1, 0, 0], None, "origins"),
        (np.zeros((2, 3)), np.tile(UP, (3, 1)), None, "do not fit"),
        (np.zeros((2, 3)), UP, np.zeros(3), "do not fit"),
        ([0, 0, 0], UP, np.inf, "times"),
    ],
)
def test_bad_rays_are_refused(origins, directions, times, line):
    with pytest.raises(SimulationError, match=line):
        MeshWorld([box((-1, -1, -1), (1, 1, 1))]).cast(origins, directions, rng(), times)


def test_an_empty_world_is_refused():
    with pytest.raises(SimulationError, match="holds no solid"):
        MeshWorld([])


def test_bad_solids_and_canopies_are_refused():
    mesh = trimesh.creation.box((1, 1, 1))
    inverted = mesh.copy()
    inverted.invert()
    with pytest.raises(SimulationError, match="0 faces"):
        Solid(trimesh.Trimesh(), Surface.WALL)
    with pytest.raises(SimulationError, match="not opaque"):
        Solid(mesh, Surface.FOLIAGE)
    with pytest.raises(SimulationError, match="velocity"):
        Solid(mesh, Surface.VEHICLE, velocity=(1.0, np.nan, 0.0))
    for open_mesh in (trimesh.Trimesh(mesh.vertices, mesh.faces[:-1]), inverted):
        with pytest.raises(SimulationError, match="not closed or inside out"):
            Canopy(open_mesh, 1.0)
    with pytest.raises(SimulationError, match="rate"):
        Canopy(mesh, 0.0)
