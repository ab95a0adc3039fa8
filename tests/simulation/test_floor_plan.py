import numpy as np
import pytest
import scipy.stats
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from naive_casting import cast_one

from factorloc.errors import SimulationError
from factorloc.simulation import FloorPlan, Foliage, Pane, Surface, _ray_kernels

RAYS = 40_000


def unit(angles):
    return np.stack([np.cos(angles), np.sin(angles)], -1)


def random_plan(rng: np.random.Generator) -> FloorPlan:
    def block():
        x, y, w, h = rng.uniform([-8, -8, 0.2, 0.2], [8, 8, 4, 4])
        return shapely.affinity.rotate(shapely.box(x, y, x + w, y + h), rng.uniform(0, 180))

    ring = shapely.Point(*rng.uniform(-3, 3, 2)).buffer(rng.uniform(2, 4), quad_segs=3)
    ring = ring.difference(ring.centroid.buffer(1, quad_segs=2))
    foliage = [Foliage(polygon, rng.uniform(0.05, 1)) for polygon in (ring, *(block() for _ in range(3)))]
    panes = [Pane(shapely.LineString(rng.uniform(-9, 9, (3, 2))), rng.uniform(0, 0.6)) for _ in range(3)]
    walls = [block() for _ in range(rng.integers(0, 4))] + [shapely.LineString(rng.uniform(-9, 9, (2, 2)))]
    if rng.random() < 0.5:
        walls.append(shapely.union_all([block(), block()]))
    return FloorPlan(tuple(walls), tuple(foliage), tuple(panes))


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_rays_end_where_shapely_says(seed):
    rng = np.random.default_rng(seed)
    plan = random_plan(rng)
    angles = np.concatenate([rng.uniform(-np.pi, np.pi, 16), np.arange(4) * np.pi / 2])
    directions = np.concatenate([unit(angles), [[1, 0], [0, 1], [-1, 0], [0, -1]]])
    origins = rng.uniform(-12, 12, (len(directions), 2))
    hits = plan.cast(origins, directions, np.random.default_rng(seed))
    draws = np.random.default_rng(seed).standard_exponential(len(directions))
    walls_only = plan.opaque_ranges(origins, directions)
    for n, (origin, direction) in enumerate(zip(origins, directions, strict=True)):
        expected, surface = cast_one(plan, origin, direction, draws[n])
        assert hits.ranges[n] == pytest.approx(expected, abs=1e-9)
        assert hits.surfaces[n] == surface
        assert walls_only[n] == pytest.approx(cast_one(plan, origin, direction, np.inf)[0], abs=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_decay_rates_add_up_where_regions_overlap(seed):
    rng = np.random.default_rng(seed)
    plan = random_plan(rng)
    points = rng.uniform(-10, 10, (50, 2))
    expected = sum(f.decay_rate * shapely.contains_xy(f.polygon, points) for f in plan.foliage)
    assert plan.decay_rate_at(points) == pytest.approx(expected)


@given(st.integers(3, 200), st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(0, 7))
def test_no_ray_leaks_through_a_corner(corners, x, y, turn):
    corner = np.array([3.7, -1.9]) + 2 * unit(turn + np.linspace(0, 2 * np.pi, corners, endpoint=False))
    # Each side is a wall of its own, drawn in alternating directions: they share nothing but coordinates.
    sides = zip(corner, np.roll(corner, -1, axis=0), range(corners), strict=True)
    plan = FloorPlan(tuple(shapely.LineString((a, b) if k % 2 else (b, a)) for a, b, k in sides))
    origin = np.array([3.7 + x, -1.9 + y])
    distances = np.linalg.norm(corner - origin, axis=1)
    ranges = plan.opaque_ranges(origin, (corner - origin) / distances[:, None])
    assert ranges == pytest.approx(distances, abs=1e-9)


def test_free_paths_in_a_uniform_region_are_exponential():
    rate = 0.7
    plan = FloorPlan((), (Foliage(shapely.box(-100, -100, 100, 100), rate),))
    rng = np.random.default_rng(3)
    hits = plan.cast([0.0, 0.0], unit(rng.uniform(-np.pi, np.pi, RAYS)), rng)
    assert (hits.surfaces == Surface.FOLIAGE).all()
    assert abs(hits.ranges.mean() - 1 / rate) < 4 / rate / np.sqrt(RAYS)
    assert scipy.stats.kstest(hits.ranges, "expon", args=(0, 1 / rate)).pvalue > 1e-3


def within_4_sigma(count: int, probability: float) -> bool:
    return abs(count - RAYS * probability) < 4 * np.sqrt(RAYS * probability * (1 - probability))


@pytest.mark.parametrize("origin", [-2.0, 0.5])
def test_a_region_transmits_by_its_optical_depth(origin):
    """Two slabs, 0 to 2 m with 0.4 per m and 1 to 3 m with 0.3 per m, before a wall at 4 m."""
    slabs = (Foliage(shapely.box(0, -5, 2, 5), 0.4), Foliage(shapely.box(1, -5, 3, 5), 0.3))
    plan = FloorPlan((shapely.LineString([(4, -5), (4, 5)]),), slabs)
    hits = plan.cast([[origin, 0.0]], np.tile([1.0, 0.0], (RAYS, 1)), np.random.default_rng(4))
    through = hits.surfaces == Surface.WALL
    first = 0.4 * (2 - max(origin, 0))
    assert within_4_sigma(through.sum(), np.exp(-first - 0.3 * 2))
    assert hits.ranges[through] == pytest.approx(4 - origin)
    assert within_4_sigma((hits.ranges + origin < 1).sum(), 1 - np.exp(-0.4 * (1 - max(origin, 0))))


def test_glass_reflects_its_share():
    panes = tuple(Pane(shapely.LineString([(x, -5), (x, 5)]), p) for x, p in ((1, 0.2), (2, 0.35)))
    plan = FloorPlan((shapely.box(3, -5, 4, 5),), panes=panes)
    hits = plan.cast([0.0, 0.0], np.tile([1.0, 0.0], (RAYS, 1)), np.random.default_rng(5))
    assert set(np.unique(hits.ranges.round(9))) == {1.0, 2.0, 3.0}
    for distance, surface, share in (
        (1, Surface.GLASS, 0.2),
        (2, Surface.GLASS, 0.8 * 0.35),
        (3, Surface.WALL, 0.8 * 0.65),
    ):
        here = np.isclose(hits.ranges, distance)
        assert (hits.surfaces[here] == surface).all()
        assert within_4_sigma(here.sum(), share)


def test_whatever_coincides_counts_each():
    """Two panes in one place, on the edge that two regions share."""
    line = shapely.LineString([(2, -5), (2, 5)])
    slabs = (Foliage(shapely.box(1, -5, 2, 5), 0.3), Foliage(shapely.box(2, -5, 3, 5), 0.5))
    plan = FloorPlan((shapely.box(4, -5, 5, 5),), slabs, (Pane(line, 0.2), Pane(line, 0.3)))
    hits = plan.cast([0.0, 0.0], np.tile([1.0, 0.0], (RAYS, 1)), np.random.default_rng(10))
    assert within_4_sigma((hits.surfaces == Surface.GLASS).sum(), np.exp(-0.3) * (1 - 0.8 * 0.7))
    assert within_4_sigma((hits.surfaces == Surface.WALL).sum(), np.exp(-0.3) * 0.8 * 0.7 * np.exp(-0.5))


def test_a_seed_decides_everything():
    plan = random_plan(np.random.default_rng(6))
    directions = unit(np.linspace(-3, 3, 500))
    first, again, other = (plan.cast([0.3, 0.2], directions, np.random.default_rng(s)).ranges for s in (7, 7, 8))
    assert (first == again).all()
    assert (first != other).any()


def test_origins_broadcast_against_directions():
    plan = random_plan(np.random.default_rng(9))
    origins, directions = np.random.default_rng(1).uniform(-9, 9, (6, 1, 2)), unit(np.linspace(-3, 3, 11))
    block = plan.opaque_ranges(origins, directions)
    assert block.shape == (6, 11)
    assert (block[4] == plan.opaque_ranges(origins[4], directions)).all()


def test_clearance_is_zero_inside_and_a_distance_outside():
    hedge = Foliage(shapely.box(5, 0, 6, 1), 1.0)
    plan = FloorPlan((shapely.box(0, 0, 1, 1),), (hedge,), (Pane(shapely.LineString([(10, 0), (10, 1)]), 0.1),))
    assert plan.clearance([[0.5, 0.5], [3.0, 0.5], [4.5, 0.5], [9.0, 0.5]]) == pytest.approx([0, 2, 0.5, 1])
    assert plan.bounds == (0, 0, 10, 1)


def test_kernel_codes_are_those_of_the_enumeration():
    planar = ("NOTHING", "WALL", "GLASS", "FOLIAGE")
    assert {name: getattr(_ray_kernels, name) for name in planar} == {name: int(Surface[name]) for name in planar}


BOW_TIE = shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: FloorPlan(()), "holds no wall"),
        (lambda: FloorPlan((BOW_TIE,)), "wall: Self-intersection"),
        (lambda: FloorPlan((shapely.Point(0, 0),)), "wall: Point"),
        (lambda: Foliage(shapely.box(0, 0, 1, 1), 0.0), "decay_rate"),
        (lambda: Foliage(BOW_TIE, 1.0), "foliage: Self-intersection"),
        (lambda: Pane(shapely.LineString([(0, 0), (1, 0)]), 1.0), "reflection"),
        (lambda: Pane(shapely.LineString(), 0.1), "pane: LineString"),
        (lambda: FloorPlan((shapely.box(0, 0, 1, 1),)).opaque_ranges([0, 0, 0], [1, 0]), "origins"),
        (lambda: FloorPlan((shapely.box(0, 0, 1, 1),)).opaque_ranges([0, 0], [np.nan, 0]), "directions"),
        (
            lambda: FloorPlan((shapely.box(0, 0, 1, 1),)).opaque_ranges(np.zeros((2, 2)), np.ones((3, 2))),
            "does not fit",
        ),
    ],
)
def test_what_is_not_consistent_is_refused(build, message):
    with pytest.raises(SimulationError, match=message):
        build()
