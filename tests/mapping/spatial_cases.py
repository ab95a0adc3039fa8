"""Hypothesis strategies for spatial maps: grids, and rays in them of every ugly kind."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st
from naive import Ray
from ray_cases import SEEDS, STATUSES
from strategies import floats

from factorloc.mapping import Grid
from factorloc.rays import Rays
from factorloc.scan import RayStatus

HERE = np.eye(4)[None]
"""The pose of one scan at the origin of the map."""


@st.composite
def spatial_grids(draw: st.DrawFn, most: int = 40) -> Grid:
    """Spatial grids of a few cells, often of more than one brick."""
    origin = draw(st.tuples(*[floats(-20, 20)] * 3))
    shape = draw(st.tuples(*[st.integers(1, most)] * 3))
    return Grid(origin, draw(floats(0.05, 1.0)), shape)


@st.composite
def spatial_rays(
    draw: st.DrawFn, grid: Grid, count: int = 4, statuses: Sequence[RayStatus] = tuple(RayStatus)
) -> list[Ray]:
    """Rays in general position that start in a grid or around it, and may miss it; many are nearly level."""
    rng = np.random.default_rng(draw(SEEDS))
    size = np.multiply(grid.shape, grid.resolution)
    rays = []
    for _ in range(count):
        direction = rng.standard_normal(3) * rng.choice([1.0, 1e-2], 3)
        length = 1.5 * np.linalg.norm(size) * rng.uniform() ** rng.choice([1, 3])
        origin = grid.origin + size * rng.uniform(-0.5, 1.5, 3)
        rays.append(Ray(origin, direction / np.linalg.norm(direction), float(length), rng.choice(statuses)))
    return rays


@st.composite
def exact_spatial_grids(draw: st.DrawFn) -> Grid:
    """Grids whose planes are whole binary fractions."""
    origin = draw(st.tuples(*[st.integers(-6, 6)] * 3))
    shape = draw(st.tuples(*[st.integers(1, 20)] * 3))
    return Grid(origin, draw(st.sampled_from([0.25, 0.5, 1.0])), shape)


@st.composite
def exact_spatial_rays(draw: st.DrawFn) -> Ray:
    """Rays along an axis, often on a plane or an edge of cells, that start and end there or outside."""
    origin = np.array(draw(st.tuples(*[st.integers(-40, 40).map(lambda n: n / 8)] * 3)))
    direction = np.zeros(3)
    direction[draw(st.integers(0, 2))] = draw(st.sampled_from([-1.0, 1.0]))
    return Ray(origin, direction, draw(st.integers(0, 80)) / 8, draw(STATUSES))


def packed_spatial(rays: Sequence[Ray]) -> Rays:
    """Rays as the block of one scan, taken at the origin of the map."""
    return Rays(
        np.array([ray.origin for ray in rays]).reshape(-1, 3),
        np.array([ray.direction for ray in rays]).reshape(-1, 3),
        np.array([ray.length for ray in rays], np.float64),
        np.array([ray.status for ray in rays], np.uint8),
        np.array([0, len(rays)]),
    )
