"""Hypothesis strategies for this room: grids, and rays in them of every ugly kind."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st
from naive import Ray
from strategies import floats

from factorloc.mapping import Grid, RayStatistics
from factorloc.rays import Rays
from factorloc.scan import RayStatus, Scan

SEEDS = st.integers(0, 2**32 - 1)
STATUSES = st.sampled_from(list(RayStatus))
EIGHTHS = st.integers(-40, 40).map(lambda n: n / 8)
AXES = st.sampled_from([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)]).map(np.array)
DIAGONALS = st.sampled_from([(1, 1), (1, -1), (-1, 1), (-1, -1)]).map(lambda signs: np.array(signs) * np.sqrt(0.5))
IDENTITY = np.zeros((1, 3))


@st.composite
def grids(draw: st.DrawFn, most: int = 9) -> Grid:
    """Planar grids of a few cells anywhere."""
    origin = draw(st.tuples(floats(-20, 20), floats(-20, 20)))
    shape = draw(st.tuples(st.integers(1, most), st.integers(1, most)))
    return Grid(origin, draw(floats(0.02, 1.5)), shape)


@st.composite
def rays_near(
    draw: st.DrawFn, grid: Grid, count: int = 4, statuses: tuple[RayStatus, ...] = tuple(RayStatus)
) -> list[Ray]:
    """Rays in general position that start in a grid or around it, and may miss it."""
    rng = np.random.default_rng(draw(SEEDS))
    size = np.multiply(grid.shape, grid.resolution)
    rays = []
    for _ in range(count):
        angle = rng.uniform(-np.pi, np.pi)
        length = 2 * size.sum() * rng.uniform() ** rng.choice([1, 4])
        origin = grid.origin + size * rng.uniform(-0.7, 1.7, 2)
        rays.append(Ray(origin, np.array([np.cos(angle), np.sin(angle)]), float(length), rng.choice(statuses)))
    return rays


@st.composite
def exact_grids(draw: st.DrawFn) -> Grid:
    """Grids whose lines are whole binary fractions: arithmetic with eighths is exact in them."""
    origin = draw(st.tuples(st.integers(-6, 6), st.integers(-6, 6)))
    shape = draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    return Grid(origin, draw(st.sampled_from([0.25, 0.5, 1.0])), shape)


@st.composite
def exact_rays(draw: st.DrawFn) -> Ray:
    """Rays along an axis, often on a grid line, that start and end on lines, in corners and outside."""
    origin = np.array(draw(st.tuples(EIGHTHS, EIGHTHS)))
    return Ray(origin, draw(AXES), draw(st.integers(0, 80)) / 8, draw(STATUSES))


@st.composite
def statistics(draw: st.DrawFn, grid: st.SearchStrategy[Grid] | None = None) -> RayStatistics:
    """Counts of a map: seen and unseen cells, hit and never hit; no hit without some path."""
    where = draw(grids() if grid is None else grid)
    rng = np.random.default_rng(draw(SEEDS))
    hits = rng.choice([0, 0, 1, 2, 7], where.shape)
    path = np.where(hits > 0, rng.choice([0.25, 1.0, 9.0], where.shape), rng.choice([0.0, 0.3, 9.0], where.shape))
    return counted(where, hits, path)


def counted(grid: Grid, hits: np.ndarray, path: np.ndarray) -> RayStatistics:
    """Statistics of given hits and path lengths (m)."""
    return RayStatistics(
        grid,
        np.broadcast_to(hits, grid.shape).astype(np.uint32),
        np.zeros(grid.shape, np.uint32),
        np.round(np.broadcast_to(path, grid.shape) * 2**20).astype(np.int64),
    )


def packed(rays: Sequence[Ray]) -> Rays:
    """Rays as the block of one scan, taken at the origin of the map."""
    return Rays(
        np.array([ray.origin for ray in rays]).reshape(-1, 2),
        np.array([ray.direction for ray in rays]).reshape(-1, 2),
        np.array([ray.length for ray in rays], np.float64),
        np.array([ray.status for ray in rays], np.uint8),
        np.array([0, len(rays)]),
    )


def scan_of(rays: Sequence[Ray], limits: tuple[float, float]) -> Scan:
    """Rays as a scan, taken at the origin of the map."""
    block = packed(rays)
    return Scan(block.directions, block.ranges, block.status, limits, origins=block.origins)


def sweep(seed: int, rays: int, limits: tuple[float, float] = (0.3, 6.0)) -> Scan:
    """A scan all around of random ranges, some of them out of limits."""
    rng = np.random.default_rng(seed)
    ranges = rng.uniform(0, 1.1 * limits[1], rays)
    return Scan.from_polar(rng.uniform(-np.pi, np.pi, rays), ranges, limits, T_body_sensor=rng.uniform(-0.5, 0.5, 3))
