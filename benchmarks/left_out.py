"""What a map would be without one of its scans, to the last bit: ray statistics are integer sums."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from factorloc.mapping import BrickStatistics, RayStatistics
from factorloc.mapping.accumulation import rays_in_map
from factorloc.mapping.cell_tiles import CellTiles
from factorloc.mapping.sensor_model import SensorModel
from factorloc.rays import pack
from factorloc.scan import Scan

__all__ = ["leave_one_out", "without"]

Array = npt.NDArray[np.float64]
Statistics = RayStatistics | BrickStatistics
Choice = TypeVar("Choice")

Family = Callable[[Statistics], Iterable[tuple[Choice, SensorModel]]]
"""Models of a map, one for each choice of what has to be chosen."""


def without(statistics: Statistics, scan: Scan, pose: Array, margin: float = 0.0) -> Statistics:
    """Take one scan out of the map it helped to make.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        The map.
    scan : Scan
        One of those that made it.
    pose : ndarray, shape (3,) or (4, 4)
        Where it was taken.
    margin : float
        Of a planar map only the part that the rays of the scan reach is returned, and so much around it, m. What lies
        beyond no ray of this scan meets.

    Returns
    -------
    RayStatistics or BrickStatistics
        On the raster of the map. Walked on the whole of its grid, so that no sum differs by rounding.
    """
    if isinstance(statistics, BrickStatistics):
        return _bricks_without(statistics, BrickStatistics.from_scans([scan], pose[None], grid=statistics.grid))
    own = RayStatistics.from_scans([scan], pose[None], grid=statistics.grid)
    rays = pack([scan])
    origins, directions = rays_in_map(rays, pose[None])
    ends = np.concatenate([origins, origins + directions * rays.ranges[:, None]])
    beyond = margin + statistics.grid.resolution
    part = statistics.grid.crop(ends.min(0) - beyond, ends.max(0) + beyond)
    window = statistics.grid.window(part)
    return RayStatistics(
        part,
        statistics.hits[window] - own.hits[window],
        statistics.misses[window] - own.misses[window],
        statistics.path_fixed[window] - own.path_fixed[window],
        statistics.scans - 1,
        {reason: count - own.left_out.get(reason, 0) for reason, count in statistics.left_out.items()},
    )


def _bricks_without(statistics: BrickStatistics, own: BrickStatistics) -> BrickStatistics:
    keys = statistics.keys
    at = np.searchsorted(keys, own.keys)
    hits, misses, path = statistics.hits, statistics.misses, statistics.path_fixed
    for whole, part in ((hits, own.hits), (misses, own.misses), (path, own.path_fixed)):
        whole[at] -= part
    left = (hits > 0) | (misses > 0) | (path > 0)
    cells = CellTiles.of_keys(keys[left], hits[left], misses[left], path[left])
    counts = {reason: count - own.left_out.get(reason, 0) for reason, count in statistics.left_out.items()}
    return BrickStatistics(statistics.grid, cells, statistics.scans - 1, counts)


def leave_one_out(
    statistics: Statistics,
    scans: Sequence[Scan],
    poses: Array,
    families: Mapping[str, Family[Choice]],
    pool: Executor,
    *,
    margin: float = 0.0,
    weighed: Callable[[Scan], Scan] = lambda scan: scan,
) -> dict[str, dict[Choice, float]]:
    """Log-likelihood of training scans, each in the map of all the others.

    Parameters
    ----------
    statistics : RayStatistics or BrickStatistics
        Map these scans helped to make.
    scans : sequence of Scan
    poses : ndarray, shape (N, 3) or (N, 4, 4)
    families : mapping of str to Family
        Models to compare.
    pool : Executor
        Does one scan a worker.
    margin : float
        See :func:`without`.
    weighed : callable
        Which rays of a scan are weighed, all by default.

    Returns
    -------
    dict of str to dict
        Nats per ray by family and choice.
    """

    def of_scan(scan: Scan, pose: Array) -> tuple[int, dict[str, dict[Choice, float]]]:
        others, some = without(statistics, scan, pose, margin), weighed(scan)
        sums = {
            name: {choice: float(model.log_likelihood(some, pose).sum()) for choice, model in family(others)}
            for name, family in families.items()
        }
        return len(some), sums

    found = list(pool.map(of_scan, scans, poses))
    rays = sum(count for count, _ in found)
    return {
        name: {choice: sum(sums[name][choice] for _, sums in found) / rays for choice in found[0][1][name]}
        for name in families
    }
