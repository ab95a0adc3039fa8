"""Windows of hits and misses: those of the exact walk, whatever the threads."""

from __future__ import annotations

import numpy as np
import pytest

from factorloc import set_threads
from factorloc.errors import MapError
from factorloc.geometry import se3
from factorloc.mapping.brick_statistics import BrickStatistics
from factorloc.mapping.grid import Grid
from factorloc.mapping.reflection_window import ReflectionWindow
from factorloc.scan import RayStatus, Scan

GRID = Grid((-3.0, -2.0, -1.0), 0.2, (30, 25, 10))


def scans(seed: int, count: int = 3, rays: int = 200) -> tuple[list[Scan], np.ndarray]:
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        directions = rng.normal(size=(rays, 3)) * [1, 1, 0.3]
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        status = rng.choice([RayStatus.RETURN, RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN], rays, p=[0.8, 0.1, 0.1])
        mount = se3.exp(0.2 * rng.normal(size=6))
        origins = 0.1 * rng.normal(size=(rays, 3))
        made.append(
            Scan(directions, rng.uniform(0.5, 8, rays), status, (0.4, 9.0), origins=origins, T_body_sensor=mount)
        )
    return made, se3.exp(rng.normal(size=(count, 6)) * [0.1, 0.1, 0.5, 1.5, 1.5, 0.2])


@pytest.mark.parametrize("seed", range(4))
def test_counts_are_those_of_the_exact_walk(seed: int) -> None:
    made, poses = scans(seed)
    window = ReflectionWindow.from_scans(made, poses, GRID)
    exact = BrickStatistics.from_scans(made, poses, resolution=0.2, grid=GRID).to_dense()
    assert np.array_equal(window.hits, exact.hits)
    # The exact walk does not count pieces shorter than 2^-20 m, of which a random ray has next to none.
    assert np.abs(window.misses.astype(int) - exact.misses).sum() <= 2
    assert exact.misses.sum() > 5000


def test_threads_leave_no_trace() -> None:
    made, poses = scans(7, rays=2000)
    before = set_threads(1)
    one = ReflectionWindow.from_scans(made, poses, GRID)
    set_threads(2)
    two = ReflectionWindow.from_scans(made, poses, GRID)
    set_threads(before)
    assert np.array_equal(one.rimmed_hits, two.rimmed_hits)
    assert np.array_equal(one.rimmed_misses, two.rimmed_misses)


def test_the_rim_of_a_window_stays_empty() -> None:
    made, poses = scans(3)
    window = ReflectionWindow.from_scans(made, poses, GRID)
    assert window.rimmed_hits.sum() == window.hits.sum()
    assert window.rimmed_misses.sum() == window.misses.sum()


def test_planar_poses_are_laid_on_the_ground() -> None:
    made, _ = scans(1)
    planar = np.array([[0.1, 0.2, 0.3], [1.0, 0.0, -0.5], [0.0, 0.0, 0.0]])
    one = ReflectionWindow.from_scans(made, planar, GRID)
    assert np.array_equal(one.hits, ReflectionWindow.from_scans(made, se3.from_se2(planar), GRID).hits)


def test_what_does_not_fit_is_refused() -> None:
    made, poses = scans(1)
    with pytest.raises(MapError, match="planar grid"):
        ReflectionWindow.from_scans(made, poses, Grid((0.0, 0.0), 0.2, (3, 3)))
    with pytest.raises(MapError, match="one pose for each of the 3"):
        ReflectionWindow.from_scans(made, poses[:2], GRID)
    flat = Scan.from_polar([0.0], [1.0], (0.1, 5.0))
    with pytest.raises(MapError, match="planar ones"):
        ReflectionWindow.from_scans([flat], np.zeros((1, 3)), GRID)
    with pytest.raises(MapError, match="GiB"):
        ReflectionWindow.from_scans(made, poses, Grid((0.0, 0.0, 0.0), 0.001, (40000, 40000, 3000)))
