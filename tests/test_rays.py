"""Rays of many scans in one block, and a choice of them spread over the surroundings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import floats, scans

from factorloc.errors import GeometryError
from factorloc.geometry import se2, se3
from factorloc.rays import Rays, pack, spread
from factorloc.scan import RayStatus, Scan


def ends(rays: Rays) -> np.ndarray:
    return rays.origins + rays.directions * rays.ranges[:, None]


def scan_of(rays: Rays) -> np.ndarray:
    """Number of the scan each ray belongs to."""
    return np.repeat(np.arange(len(rays)), np.diff(rays.offsets))


def block(seed: int, dimension: int, counts: tuple[int, ...]) -> Rays:
    """Scans of rays of every status and length, most of them near."""
    rng = np.random.default_rng(seed)
    n = sum(counts)
    directions = rng.standard_normal((n, dimension))
    return Rays(
        rng.uniform(-0.5, 0.5, (n, dimension)),
        directions / np.linalg.norm(directions, axis=1)[:, None],
        rng.uniform(0, 8, n) ** 2,
        rng.choice([RayStatus.RETURN, RayStatus.RETURN, RayStatus.NO_RETURN, RayStatus.BELOW_MINIMUM], n).astype("u1"),
        np.concatenate([[0], np.cumsum(counts)]),
    )


blocks = st.builds(
    block,
    st.integers(0, 2**32 - 1),
    st.sampled_from([2, 3]),
    st.lists(st.integers(0, 120), min_size=1, max_size=4).map(tuple),
)


def rows(rays: Rays) -> list[tuple]:
    return [
        (k, *a, *b, c, d)
        for k, a, b, c, d in zip(scan_of(rays), rays.origins, rays.directions, rays.ranges, rays.status, strict=True)
    ]


@given(blocks, st.integers(1, 80), floats(0.1, 20))
def test_one_ray_a_voxel_and_as_many_as_wanted(rays, count, voxel) -> None:
    chosen = spread(rays, count, voxel)
    assert len(chosen) == len(rays), "scans keep their places"
    assert (chosen.status == RayStatus.RETURN).all()
    returns = rays.returns()
    here, there = np.floor(ends(chosen) / voxel), np.floor(ends(returns) / voxel)
    for k in range(len(rays)):
        own, all_of = here[scan_of(chosen) == k], there[scan_of(returns) == k]
        voxels = len(np.unique(all_of, axis=0)) if len(all_of) else 0
        assert len(own) == min(count, voxels), "every voxel has its ray, up to the count"
        if len(own):
            assert len(np.unique(own, axis=0)) == len(own), "none has two"


@given(blocks, st.integers(1, 80))
def test_chosen_rays_are_rays_of_their_scan_in_order(rays, count) -> None:
    chosen, returns = rows(spread(rays, count)), rows(rays.returns())
    at = [returns.index(row) for row in chosen]
    assert at == sorted(set(at))


@given(blocks, st.integers(1, 80), st.integers(0, 5))
def test_the_same_rays_make_the_same_choice(rays, count, seed) -> None:
    assert rows(spread(rays, count, seed=seed)) == rows(spread(rays, count, seed=seed))


def test_another_draw_chooses_others_and_no_corner_of_space() -> None:
    rays = block(1, 3, (20_000,))
    one, two = spread(rays, 400), spread(rays, 400, seed=1)
    assert len(one.ranges) == len(two.ranges) == 400
    assert len(set(rows(one)) & set(rows(two))) < 100
    # The mean of 400 of the voxels is that of all, within what chance allows.
    everything = ends(spread(rays, 10**6))
    assert len(everything) > 5000
    wide = everything.std(0) / np.sqrt(400)
    assert (np.abs(ends(one).mean(0) - everything.mean(0)) < 4 * wide).all()


def test_dense_rings_nearby_do_not_crowd_out_a_far_wall() -> None:
    angle = np.linspace(-np.pi, np.pi, 3000, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.full(3000, -0.5)])
    wall = np.column_stack([np.full(60, 20.0), np.linspace(-15, 15, 60), np.ones(60)])
    points = np.concatenate([2 * ring, wall])
    lengths = np.linalg.norm(points, axis=1)
    n = len(points)
    rays = Rays(np.zeros((n, 3)), points / lengths[:, None], lengths, np.zeros(n, np.uint8), np.array([0, n]))
    chosen = spread(rays, 100)
    assert (chosen.ranges > 10).sum() >= 55
    assert len(chosen.ranges) <= 100


def test_far_apart_voxels_are_told_apart() -> None:
    points = np.array(
        [[x, y, z] for x in (-300.2, 0.1, 300.3) for y in (-300.2, 0.1, 300.3) for z in (-40.1, 0.2, 90.3)]
    )
    lengths = np.linalg.norm(points, axis=1)
    rays = Rays(np.zeros((27, 3)), points / lengths[:, None], lengths, np.zeros(27, np.uint8), np.array([0, 27]))
    assert len(spread(rays, 100).ranges) == 27


def test_scans_without_returns_stay_empty() -> None:
    rays = block(2, 3, (0, 5, 0))
    silent = Rays(rays.origins, rays.directions, rays.ranges, np.full(5, RayStatus.NO_RETURN, np.uint8), rays.offsets)
    assert spread(silent, 10).offsets.tolist() == [0, 0, 0, 0]


@settings(max_examples=30)
@given(st.lists(scans(3), min_size=1, max_size=3) | st.lists(scans(2), min_size=1, max_size=3))
def test_packed_rays_are_those_of_the_scans_seen_from_the_body(given_scans) -> None:
    rays = pack(given_scans)
    assert len(rays) == len(given_scans)
    assert rays.dimension == given_scans[0].dimension
    group = se2 if rays.dimension == 2 else se3
    for k, scan in enumerate(given_scans):
        own = rays.select(scan_of(rays) == k)
        tips = group.transform(scan.T_body_sensor, scan.origins + scan.directions * scan.ranges[:, None])
        assert ends(own) == pytest.approx(tips, abs=1e-9)
        assert own.origins == pytest.approx(group.transform(scan.T_body_sensor, scan.origins), abs=1e-9)
        assert (np.diff(rays.offsets)[k], own.status.tolist()) == (len(scan), scan.status.tolist())


@given(blocks, st.integers(0, 2**32 - 1))
def test_a_selection_keeps_scans_in_their_places(rays, seed) -> None:
    keep = np.random.default_rng(seed).uniform(size=len(rays.ranges)) < 0.4
    kept = rays.select(keep)
    assert rows(kept) == [row for row, k in zip(rows(rays), keep, strict=True) if k]
    assert len(kept) == len(rays)
    assert rows(rays.returns()) == [row for row in rows(rays) if row[-1] == RayStatus.RETURN]


def test_what_cannot_be_packed_is_refused() -> None:
    with pytest.raises(GeometryError, match="none given"):
        pack([])
    planar, spatial = (Scan(np.eye(d)[:1], np.ones(1), np.zeros(1, np.uint8), (0.1, 9.0)) for d in (2, 3))
    with pytest.raises(GeometryError, match="mixed"):
        pack([planar, spatial])
