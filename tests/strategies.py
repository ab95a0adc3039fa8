"""Hypothesis strategies for the package's vocabulary: angles, tangent vectors, poses, scans, trajectories."""

import numpy as np
from hypothesis import strategies as st

from factorloc.geometry import se2, se3
from factorloc.scan import RayStatus, Scan
from factorloc.trajectory import Trajectory

LIMITS = (0.5, 30.0)
"""Range limits of all scans drawn here, m."""


def floats(low: float, high: float) -> st.SearchStrategy[float]:
    """Finite numbers; numbers so small that their squares vanish are drawn as zero."""
    return st.floats(low, high, allow_subnormal=False).map(lambda x: 0.0 if abs(x) < 1e-150 else x)


def angles(most: float = np.pi) -> st.SearchStrategy[float]:
    """Angles of any size up to ``most``, often tiny, often near half a turn, where series and logarithms go wrong."""
    tiny = st.sampled_from([0.0, 1e-12, 1e-8, 0.99e-4, 1e-4, 1.01e-4, 1e-3])
    half = st.sampled_from([0.0, 1e-12, 1e-9, 1e-6, 1e-3]).map(lambda short: most - short)
    signed = st.tuples(st.sampled_from([-1.0, 1.0]), tiny | half).map(lambda pair: pair[0] * pair[1])
    return floats(-most, most) | signed


def vectors(size: int, most: float = 50.0) -> st.SearchStrategy[np.ndarray]:
    """Points or displacements, m."""
    return st.lists(floats(-most, most), min_size=size, max_size=size).map(np.array)


def units(size: int) -> st.SearchStrategy[np.ndarray]:
    """Directions of unit length."""
    return vectors(size, 1.0).filter(lambda v: np.linalg.norm(v) > 1e-3).map(lambda v: v / np.linalg.norm(v))


def tangents_2d(most: float = np.pi - 1e-6) -> st.SearchStrategy[np.ndarray]:
    """Tangent vectors ``[v_x, v_y, omega]`` that turn by at most ``most``."""
    return st.tuples(vectors(2), angles(most)).map(lambda parts: np.append(parts[0], parts[1]))


def tangents_3d(most: float = np.pi - 1e-6) -> st.SearchStrategy[np.ndarray]:
    """Tangent vectors ``[omega, v]`` that turn by at most ``most`` about any axis."""
    return st.tuples(units(3), angles(most), vectors(3)).map(lambda parts: np.append(parts[0] * parts[1], parts[2]))


def poses_2d() -> st.SearchStrategy[np.ndarray]:
    """Planar poses ``[x, y, theta]``, shape (3,), with headings in (-pi, pi]."""
    return st.tuples(vectors(2), angles()).map(lambda parts: se2.as_poses(np.append(parts[0], parts[1])))


def poses_3d() -> st.SearchStrategy[np.ndarray]:
    """Spatial poses, shape (4, 4)."""
    return tangents_3d(np.pi).map(se3.exp)


@st.composite
def scans(draw: st.DrawFn, dimension: int = 2, most: int = 12) -> Scan:
    """Scans of up to ``most`` rays with every status, mounted anywhere on the body."""
    n = draw(st.integers(0, most))
    directions = np.array(draw(st.lists(units(dimension), min_size=n, max_size=n))).reshape(n, dimension)
    origins = np.array(draw(st.lists(vectors(dimension, 1.0), min_size=n, max_size=n))).reshape(n, dimension)
    return Scan(
        directions=directions,
        ranges=np.array(draw(st.lists(floats(*LIMITS), min_size=n, max_size=n))),
        status=np.array(draw(st.lists(st.sampled_from(list(RayStatus)), min_size=n, max_size=n)), np.uint8),
        range_limits=LIMITS,
        origins=origins,
        stamps=np.arange(n) * 1e-3,
        T_body_sensor=draw(poses_2d() if dimension == 2 else poses_3d()),
    )


@st.composite
def trajectories(draw: st.DrawFn, dimension: int = 2, least: int = 1, most: int = 8) -> Trajectory:
    """Trajectories with increasing stamps."""
    n = draw(st.integers(least, most))
    steps = draw(st.lists(floats(1e-3, 10.0), min_size=n, max_size=n))
    poses = draw(st.lists(poses_2d() if dimension == 2 else poses_3d(), min_size=n, max_size=n))
    return Trajectory(np.cumsum(steps), np.array(poses))
