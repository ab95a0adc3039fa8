"""Scans say what each ray knows, refuse what cannot be, and are packed into body frames."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import LIMITS, floats, scans, units

from factorloc.errors import GeometryError
from factorloc.geometry import se2, se3
from factorloc.rays import pack
from factorloc.scan import RayStatus, Scan

few = settings(max_examples=25)


def planar(**changes: Any) -> Scan:
    """Three rays, one of each status."""
    fields: dict[str, Any] = {
        "directions": [[1, 0], [0, 1], [-1, 0]],
        "ranges": [2.0, 0.1, np.inf],
        "status": [RayStatus.RETURN, RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN],
        "range_limits": (0.5, 30.0),
    }
    return Scan(**{**fields, **changes})


def test_rays_without_a_range_are_as_long_as_what_they_say() -> None:
    scan = planar()
    np.testing.assert_array_equal(scan.ranges, [2.0, 0.5, 30.0])
    np.testing.assert_array_equal(scan.is_return, [True, False, False])
    np.testing.assert_array_equal(scan.points(), [[2, 0]])
    assert scan.dimension == 2
    assert len(scan) == 3


def test_status_follows_from_ranges_and_limits() -> None:
    scan = Scan.from_polar(np.radians([-90, 0, 45, 90, 180]), [0.5, 0.49, 29.9, 30.0, np.inf], (0.5, 30.0), stamp=7.5)
    r, low, high = RayStatus.RETURN, RayStatus.BELOW_MINIMUM, RayStatus.NO_RETURN
    np.testing.assert_array_equal(scan.status, [r, low, r, high, high])
    np.testing.assert_array_equal(scan.ranges, [0.5, 0.5, 29.9, 30.0, 30.0])
    np.testing.assert_allclose(scan.directions[[0, 1, 4]], [[0, -1], [1, 0], [-1, 0]], atol=1e-15)
    assert scan.stamp == 7.5


def test_points_start_at_the_ray_origins() -> None:
    scan = planar(origins=[[0.1, 0.2], [0, 0], [0, 0]])
    np.testing.assert_allclose(scan.points(), [[2.1, 0.2]])


def test_the_caller_keeps_his_array() -> None:
    ranges = np.array([2.0, 0.1, np.inf])
    planar(ranges=ranges)
    np.testing.assert_array_equal(ranges, [2.0, 0.1, np.inf])


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"directions": [1, 0, 0]}, "directions"),
        ({"directions": np.ones((3, 4)) / 2}, "directions"),
        ({"directions": [[1, 0], [0, 1], [-1, 1]]}, "directions"),
        ({"directions": [[1, 0], [0, 1], [np.nan, 0]]}, "directions"),
        ({"ranges": [1.0, 2.0]}, "ranges"),
        ({"ranges": [-1.0, 2.0, 3.0]}, "ranges"),
        ({"ranges": [np.nan, 2.0, 3.0]}, "ranges"),
        ({"ranges": [np.inf, 2.0, 3.0]}, "ranges"),
        ({"status": [0, 0]}, "status"),
        ({"status": [0, 1, 3]}, "status"),
        ({"status": [0, 1, 256]}, "status"),
        ({"status": [0, 1, -1]}, "status"),
        ({"origins": np.zeros((2, 2))}, "origins"),
        ({"origins": np.full((3, 2), np.inf)}, "origins"),
        ({"range_limits": (5.0, 5.0)}, "range_limits"),
        ({"range_limits": (-1.0, 5.0)}, "range_limits"),
        ({"range_limits": (0.5, np.nan)}, "range_limits"),
        ({"range_limits": (0.5, np.inf)}, "range_limits"),
        ({"stamps": [0.0]}, "stamps"),
        ({"stamps": [0.0, 1.0, np.nan]}, "stamps"),
        ({"shape": (2, 2)}, "shape"),
        ({"T_body_sensor": np.eye(4)}, "T_body_sensor"),
        ({"T_body_sensor": np.zeros((2, 3))}, "T_body_sensor"),
        ({"T_body_sensor": [0, 0, np.nan]}, "T_body_sensor"),
    ],
)
def test_what_cannot_be_is_refused_by_name(changes: dict[str, Any], field: str) -> None:
    with pytest.raises(GeometryError, match=f"^{field}: ") as caught:
        planar(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ranges", [[np.nan, 1.0], [-0.1, 1.0], [1.0]])
def test_polar_ranges_are_checked(ranges: list[float]) -> None:
    with pytest.raises(GeometryError, match=r"^ranges: "):
        Scan.from_polar([0.0, 1.0], ranges, (0.5, 30.0))


def test_points_become_rays_from_the_sensor() -> None:
    ends = np.array([[3, 0, 4], [0, 0.3, 0.4], [0, -30, 0], [0, 0, 29.9]])
    mount = se3.exp([0.1, 0.2, 0.3, 1, 2, 3])
    scan = Scan.from_points(
        ends, LIMITS, stamp=2.5, stamps=[0, 1, 2, 3], shape=(2, 2), frame="top", T_body_sensor=mount
    )
    r, high = RayStatus.RETURN, RayStatus.NO_RETURN
    np.testing.assert_array_equal(scan.status, [r, r, high, r])
    np.testing.assert_allclose(scan.ranges, [5, 0.5, 30, 29.9])
    np.testing.assert_allclose(scan.directions, [[0.6, 0, 0.8], [0, 0.6, 0.8], [0, -1, 0], [0, 0, 1]])
    assert not scan.origins.any()
    np.testing.assert_allclose(scan.points(), ends[[0, 1, 3]])
    assert (scan.stamp, scan.shape, scan.frame, scan.dimension) == (2.5, (2, 2), "top", 3)
    np.testing.assert_array_equal(scan.stamps, [0, 1, 2, 3])
    np.testing.assert_array_equal(scan.T_body_sensor, mount)


@few
@given(st.integers(2, 3).flatmap(lambda size: st.lists(units(size), min_size=1, max_size=5)), st.data())
def test_points_of_any_dimension_keep_their_place(directions: list[np.ndarray], data: st.DataObject) -> None:
    ranges = np.array([data.draw(floats(0.01, 60.0).filter(lambda r: r > 0)) for _ in directions])
    scan = Scan.from_points(np.array(directions) * ranges[:, None], LIMITS)
    np.testing.assert_allclose(scan.directions, directions, atol=1e-12)
    near, far = ranges < LIMITS[0] - 1e-9, ranges > LIMITS[1] + 1e-9
    assert (scan.status[near] == RayStatus.BELOW_MINIMUM).all()
    assert (scan.status[far] == RayStatus.NO_RETURN).all()
    np.testing.assert_allclose(scan.ranges, ranges.clip(*LIMITS))


@pytest.mark.parametrize(
    ("points", "reason"),
    [
        ([[1, 2, 3], [0, 0, 0]], "1 at the sensor's origin"),
        ([[1, 2, 3], [np.nan, 0, 0]], "NaN"),
        ([[1, 2], [np.inf, 0]], "infinity"),
        ([[1, 2, 3, 4]], "shape"),
        ([1, 2, 3], "shape"),
    ],
)
def test_points_that_are_no_rays_are_refused(points: list, reason: str) -> None:
    with pytest.raises(GeometryError, match=rf"^points: .*{reason}"):
        Scan.from_points(points, LIMITS)


def test_a_cloud_may_be_empty() -> None:
    assert len(Scan.from_points(np.zeros((0, 3)), LIMITS)) == 0


def test_an_unlimited_sensor_may_report_returns_only() -> None:
    scan = planar(ranges=[1, 2, 1e5], status=[0, 0, 0], range_limits=(0.0, np.inf))
    assert scan.range_limits == (0.0, np.inf)


@few
@given(scans(most=8), st.data())
def test_selection_by_mask_and_by_index_agree(scan: Scan, data: st.DataObject) -> None:
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=len(scan), max_size=len(scan))), bool)
    kept, same = scan.select(mask), scan.select(np.flatnonzero(mask))
    assert len(kept) == mask.sum()
    for name in ("directions", "ranges", "status", "origins", "stamps"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(scan, name)[mask])
        np.testing.assert_array_equal(getattr(kept, name), getattr(same, name))


def test_an_organized_shape_is_lost_by_selection() -> None:
    scan = planar(shape=(3, 1), stamps=[0, 1, 2])
    assert scan.shape == (3, 1)
    assert scan.select([True, False, True]).shape is None
    np.testing.assert_array_equal(scan.select([2, 0]).stamps, [2, 0])


@few
@given(st.lists(scans(2, 6), min_size=1, max_size=4))
def test_packed_planar_rays_end_where_the_body_sees_the_points(batch: list[Scan]) -> None:
    rays = pack(batch).returns()
    for k, scan in enumerate(batch):
        mine = slice(*rays.offsets[k : k + 2])
        ends = rays.origins[mine] + rays.directions[mine] * rays.ranges[mine, None]
        np.testing.assert_allclose(ends, se2.transform(scan.T_body_sensor, scan.points()), atol=1e-11)


@few
@given(st.lists(scans(3, 6), min_size=1, max_size=3))
def test_packed_spatial_rays_end_where_the_body_sees_the_points(batch: list[Scan]) -> None:
    rays = pack(batch).returns()
    for k, scan in enumerate(batch):
        mine = slice(*rays.offsets[k : k + 2])
        ends = rays.origins[mine] + rays.directions[mine] * rays.ranges[mine, None]
        np.testing.assert_allclose(ends, se3.transform(scan.T_body_sensor, scan.points()), atol=1e-11)


@few
@given(st.lists(scans(most=5), min_size=1, max_size=5), st.data())
def test_packing_keeps_order_and_selection_keeps_every_scan_in_its_place(
    batch: list[Scan], data: st.DataObject
) -> None:
    rays = pack(batch)
    assert len(rays) == len(batch)
    assert rays.dimension == 2
    np.testing.assert_array_equal(np.diff(rays.offsets), [len(scan) for scan in batch])
    np.testing.assert_array_equal(rays.ranges, np.concatenate([scan.ranges for scan in batch]))
    for array in (rays.origins, rays.directions, rays.ranges):
        assert array.flags.c_contiguous
        assert array.dtype == np.float64
    total = len(rays.ranges)
    mask = np.array(data.draw(st.lists(st.booleans(), min_size=total, max_size=total)), bool)
    some = rays.select(mask)
    assert len(some) == len(batch)
    owner = np.repeat(np.arange(len(batch)), np.diff(rays.offsets))
    np.testing.assert_array_equal(np.repeat(np.arange(len(batch)), np.diff(some.offsets)), owner[mask])
    np.testing.assert_array_equal(some.ranges, rays.ranges[mask])


def test_scans_that_cannot_share_a_block_are_refused() -> None:
    spatial = Scan(np.eye(3), np.ones(3), np.zeros(3), LIMITS)
    assert len(pack([spatial])) == 1
    with pytest.raises(GeometryError, match=r"^scans: none"):
        pack([])
    with pytest.raises(GeometryError, match=r"^scans: planar and spatial"):
        pack([planar(), spatial])
