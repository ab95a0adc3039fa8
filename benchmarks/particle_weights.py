"""Who weighs particles: the package's sensor models, a k-d tree, and plain loops, bound to a map.

All begin with a scan and poses and end with a sum for each pose, as a particle filter calls them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from benchmarks._plain_particle_kernels import (
    plain_decay,
    plain_field,
    plain_posterior,
    plain_reflection,
    plain_spatial_decay,
)
from benchmarks.particle_weights_scenes import Query, Scene
from factorloc.errors import MapError
from factorloc.geometry import se2
from factorloc.mapping import BrickStatistics
from factorloc.mapping.beam_model import BeamModel
from factorloc.mapping.cell_layout import CellLayout
from factorloc.mapping.cell_table import CellTable
from factorloc.mapping.decay_rate import DecayRateMap, DecayRatePosterior
from factorloc.mapping.distance_transform import end_cells
from factorloc.mapping.end_point import EndPointModel, finite_maximum
from factorloc.mapping.grid import require_memory
from factorloc.mapping.reflection import ReflectionPosterior
from factorloc.rays import pack

__all__ = [
    "BRICKS", "DECAY", "FIELD", "OWN", "PLAIN", "POSTERIOR", "REFLECTION", "TREE", "Weigher", "all_weighers",
    "check_agreement", "own_label",
]  # fmt: skip

Array = npt.NDArray[np.float64]

FIELD, DECAY = "likelihood field", "decay rates"
POSTERIOR, REFLECTION = "decay-rate posterior", "reflection posterior"
OWN, PLAIN, TREE = "factorloc, 1 thread", "plain numba", "cKDTree"
BRICKS = "factorloc, in bricks"
"""As larger maps are kept."""

_SAME = 1e-6  # of a sum or the mean magnitude; a likelihood field has single precision
_TIES = 2e-3  # of the particles: which cell a ray through a corner is in, rounding decides
_NODE_BYTES = 72  # of a k-d tree


@dataclass(frozen=True)
class Weigher:
    """One competitor.

    Parameters
    ----------
    kind, label : str
        What it computes, and who.
    weigh : callable
        Sum for each particle of a query, shape (P,).
    table_bytes : int
        Memory of what it looks up.
    threads : int
        Threads it may use.
    checked : callable, optional
        What is to agree with the others, where that is not :attr:`weigh` itself.
    """

    kind: str
    label: str
    weigh: Callable[[Query], Array]
    table_bytes: int
    threads: int = 1
    checked: Callable[[Query], Array] | None = None

    @property
    def name(self) -> str:
        """Kind and label."""
        return f"{self.kind}: {self.label}"


def own_label(threads: int) -> str:
    """Label of the package."""
    return OWN if threads == 1 else f"factorloc, {threads} threads"


def all_weighers(scene: Scene, floor: float, threads: int) -> list[Weigher]:
    """Every competitor; the package on one thread is the one that the others of a kind must agree with.

    Parameters
    ----------
    scene : Scene
        Whose map is looked at.
    floor : float
        Under the rates of the decay-rate map, 1/m.
    threads : int
        Threads of the parallel ones; with 1 they are left out.

    Raises
    ------
    MapError
        If a dense array of a spatial map does not fit into memory.
    """
    statistics = scene.statistics
    decay = DecayRateMap.from_statistics(statistics, floor=floor)
    if isinstance(statistics, BrickStatistics):
        return [*_own(DECAY, decay, threads), _in_bricks(decay), _plain_spatial(decay, statistics)]
    field = EndPointModel.from_statistics(statistics)
    models = {
        DECAY: (decay, plain_decay),
        POSTERIOR: (DecayRatePosterior.from_statistics(statistics), plain_posterior),
        REFLECTION: (ReflectionPosterior.from_statistics(statistics), plain_reflection),
    }
    weighers = [*_own_field(field, scene, threads), _plain_field(field, scene), _tree(field, scene)]
    for kind, (model, kernel) in models.items():
        weighers += [*_own(kind, model, threads), _plain(kind, model, kernel)]
    return weighers


def check_agreement(weighers: Sequence[Weigher], query: Query) -> None:
    """Compare the sums of all competitors.

    Raises
    ------
    MapError
        If one does not agree with the first of its kind.
    """
    first: dict[str, tuple[Weigher, Array]] = {}
    for weigher in weighers:
        sums = (weigher.checked or weigher.weigh)(query)
        rival, expected = first.setdefault(weigher.kind, (weigher, sums))
        differ = ~(np.abs(sums - expected) <= _SAME * (np.abs(expected) + np.abs(expected).mean()))
        if differ.mean() > _TIES:
            raise MapError(f"{weigher.name}: does not agree with {rival.label}; nothing was timed")


def _labelled(threads: int) -> dict[str, int]:
    return {own_label(count): count for count in sorted({1, threads})}


def _own(kind: str, model: BeamModel, threads: int) -> list[Weigher]:
    size = _table_bytes(model._bound_kernel())
    return [
        Weigher(kind, label, lambda query: model.scan_log_likelihoods(query.scan, query.poses), size, count)
        for label, count in _labelled(threads).items()
    ]


def _own_field(model: EndPointModel, scene: Scene, threads: int) -> list[Weigher]:
    size = model._table(finite_maximum(scene.scans[0])).nbytes
    return [
        Weigher(FIELD, label, lambda query: model.scan_log_likelihoods(query.scan, query.poses), size, count)
        for label, count in _labelled(threads).items()
    ]


def _plain(kind: str, model: BeamModel, kernel: Callable[..., None]) -> Weigher:
    _, *tables = model._bound_kernel()
    low, resolution = np.array(model.grid.origin), model.grid.resolution
    return Weigher(kind, PLAIN, _each_ray(kernel, (*tables, low, resolution)), _table_bytes(tables))


def _each_ray(kernel: Callable[..., None], grid: tuple[Any, ...]) -> Callable[[Query], Array]:
    def weigh(query: Query) -> Array:
        rays, out = pack([query.scan]), np.empty(len(query.poses))
        kernel(*grid, query.poses, rays.origins, rays.directions, rays.ranges, rays.status, out)
        return out

    return weigh


class _InBricks(DecayRateMap):
    def _laid_out(self, values: Array, outside: float) -> CellLayout:
        assert isinstance(self.statistics, BrickStatistics)
        return CellLayout.bricks(CellTable.from_cells(self.statistics, values, outside))


def _in_bricks(model: DecayRateMap) -> Weigher:
    large = _InBricks(model.statistics, model.prior, model.floor)
    size = _table_bytes(large._bound_kernel())
    return Weigher(DECAY, BRICKS, lambda query: large.scan_log_likelihoods(query.scan, query.poses), size)


def _plain_spatial(model: DecayRateMap, statistics: BrickStatistics) -> Weigher:
    shape, mean = statistics.grid.shape, model.prior.mean
    strides = np.array([(shape[1] + 2) * (shape[2] + 2), shape[2] + 2, 1])
    size = (shape[0] + 2) * int(strides[0])
    require_memory(4 * size, f"a dense grid of {size / 1e6:.0f} million cells")
    rates = np.full(size, mean, np.float32)
    rates[(statistics.layout.cells(statistics.keys) + 1) @ strides] = model.rates
    grid = (rates, shape, mean, np.array(statistics.grid.origin), statistics.grid.resolution)
    return Weigher(DECAY, PLAIN, _each_ray(plain_spatial_decay, grid), rates.nbytes)


def _without_return(model: EndPointModel, query: Query) -> float:
    """What rays out of range add, the same at every pose."""
    return float(model.log_shares[query.scan.status[~query.scan.is_return]].sum())


def _plain_field(model: EndPointModel, scene: Scene) -> Weigher:
    maximum = finite_maximum(scene.scans[0])
    table, outside = model.log_score(np.asarray(model.distances.values), maximum), model.distances.farthest
    low, resolution = np.array(model.grid.origin), model.grid.resolution
    beyond = float(model.log_score(outside, maximum))

    def weigh(query: Query) -> Array:
        ends, out = se2.transform(query.scan.T_body_sensor, query.scan.points()), np.empty(len(query.poses))
        plain_field(table, low, resolution, beyond, query.poses, ends, out)
        return out + _without_return(model, query)

    return Weigher(FIELD, PLAIN, weigh, table.nbytes)


def _tree(model: EndPointModel, scene: Scene) -> Weigher:
    """Centres of the occupied cells; a table asks for the centre of an end's cell, the tree for the end itself."""
    grid, farthest = model.grid, model.distances.farthest
    low, resolution = np.array(grid.origin), grid.resolution
    tree = cKDTree(low + resolution * (np.argwhere(end_cells(scene.statistics)) + 0.5))

    def score(query: Query, ends: Array) -> Array:
        nearest, _ = tree.query(ends, distance_upper_bound=farthest, workers=1)
        d = np.minimum(nearest, farthest) / model.sigma
        peak = model.hit / (model.sigma * np.sqrt(2 * np.pi))
        scores = np.log(peak * np.exp(-0.5 * d * d) + model.random / finite_maximum(query.scan))
        return np.asarray(scores.sum(1) + _without_return(model, query))

    def ends(query: Query) -> Array:
        x, y = se2.transform(query.scan.T_body_sensor, query.scan.points()).T
        c, s = np.cos(query.poses[:, 2:]), np.sin(query.poses[:, 2:])
        return np.stack([c * x - s * y + query.poses[:, :1], s * x + c * y + query.poses[:, 1:2]], -1)

    def at_centres(query: Query) -> Array:
        cells = np.floor((ends(query) - low) / resolution)
        inside = ((cells >= 0) & (cells < grid.shape)).all(-1)
        # Outside of the map a field ends, and a tree does not.
        return score(query, np.where(inside[..., None], low + resolution * (cells + 0.5), low - 2 * farthest))

    size = tree.data.nbytes + tree.indices.nbytes + _NODE_BYTES * tree.size
    return Weigher(FIELD, TREE, lambda query: score(query, ends(query)), size, checked=at_centres)


def _table_bytes(values: Sequence[Any]) -> int:
    return sum(value.nbytes for value in values if isinstance(value, np.ndarray))
