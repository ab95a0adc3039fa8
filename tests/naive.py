"""Slow reference implementations: one ray, one piece, one integral at a time, by the definition and without a trick."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.optimize import minimize
from scipy.stats import gamma

from factorloc.geometry import se2
from factorloc.mapping.grid import Grid
from factorloc.scan import RayStatus, Scan

UNIT = 2.0**-20
"""Shortest path that is a visit, m."""

NEAR = 1e-9
"""A point nearer to a grid line than this many cells may be taken for either side of it."""


class Ray(NamedTuple):
    """A ray in the frame of the map."""

    origin: np.ndarray
    direction: np.ndarray
    length: float
    status: int


class Piece(NamedTuple):
    """The part of a ray between two crossings, and the cell it lies in: None outside the grid."""

    start: float
    stop: float
    cell: tuple[int, ...] | None

    @property
    def length(self) -> float:
        return self.stop - self.start


def rays(scan: Scan, T_map_body) -> list[Ray]:
    """Rays of a planar scan in the frame of the map, moved there by matrices."""
    T = se2.matrix(T_map_body) @ se2.matrix(scan.T_body_sensor)
    return [
        Ray((T @ [*origin, 1])[:2], T[:2, :2] @ direction, float(length), int(status))
        for origin, direction, length, status in zip(
            scan.origins, scan.directions, scan.ranges, scan.status, strict=True
        )
    ]


def cell_at(ray: Ray, t: float, grid: Grid) -> tuple[int, ...] | None:
    """The cell of the point at ray parameter ``t``."""
    index = np.floor((ray.origin - grid.origin) / grid.resolution + ray.direction / grid.resolution * t)
    inside = ((index >= 0) & (index < grid.shape)).all()
    return tuple(int(i) for i in index) if inside else None


def pieces(ray: Ray, grid: Grid) -> list[Piece]:
    """Cut a ray at all lines of a grid, in order, and find the cell of every piece by its midpoint."""
    crossings = [0.0, ray.length]
    for low, cells, origin, direction in zip(grid.origin, grid.shape, ray.origin, ray.direction, strict=True):
        position, velocity = (origin - low) / grid.resolution, direction / grid.resolution
        if velocity != 0:
            with np.errstate(over="ignore"):
                at = (np.arange(cells + 1) - position) / velocity
            crossings += [float(t) for t in at if 0 < t < ray.length]
    crossings.sort()
    return [Piece(a, b, cell_at(ray, (a + b) / 2, grid)) for a, b in pairwise(crossings)]


class Counts(NamedTuple):
    """Hits, misses and path lengths (m) of the cells."""

    hits: np.ndarray
    misses: np.ndarray
    path: np.ndarray


def ray_statistics(walked: list[Ray], grid: Grid) -> Counts:
    """Hits, misses and path lengths of rays; those below the minimum range leave nothing."""
    counts = Counts(*(np.zeros(grid.shape, kind) for kind in (int, int, float)))
    for ray in walked:
        if ray.status == RayStatus.BELOW_MINIMUM:
            continue
        end = cell_at(ray, ray.length, grid) if ray.status == RayStatus.RETURN else None
        if end is not None:
            counts.hits[end] += 1
        for piece in pieces(ray, grid):
            if piece.cell is not None:
                counts.path[piece.cell] += piece.length
                if piece.cell != end and math.floor(piece.stop / UNIT) > math.floor(piece.start / UNIT):
                    counts.misses[piece.cell] += 1
    return counts


def is_ambiguous(ray: Ray, grid: Grid) -> bool:
    """Whether rounding decides which cells a ray visits: it runs along a line, cuts a corner, or ends on a line."""
    cut = pieces(ray, grid)
    points = [ray.length, *((piece.start + piece.stop) / 2 for piece in cut)]
    positions = (ray.origin + np.multiply.outer(points, ray.direction) - grid.origin) / grid.resolution
    on_line = np.abs(positions - np.round(positions)).min() < NEAR
    return bool(on_line or any(0 < piece.length < 2 * UNIT for piece in cut))


def lengths_by_cell(ray: Ray, grid: Grid) -> dict[tuple[int, ...] | None, float]:
    """Path length of a ray in each cell it crosses; None is all that lies outside."""
    lengths: dict[tuple[int, ...] | None, float] = {}
    for piece in pieces(ray, grid):
        lengths[piece.cell] = lengths.get(piece.cell, 0.0) + piece.length
    return lengths


def decay_log_likelihood(ray: Ray, limits: tuple[float, float], grid: Grid, rates: np.ndarray, outside: float) -> float:
    """Log-likelihood of a ray under known decay rates (thesis, eq. 7.13 to 7.16)."""
    ray = _up_to_its_limit(ray, limits)

    def rate(cell):
        return outside if cell is None else rates[cell]

    integral = sum(rate(cell) * length for cell, length in lengths_by_cell(ray, grid).items())
    end = rate(cell_at(ray, ray.length, grid))
    return _log_likelihood(ray, -integral, math.log(end) if end > 0 else -math.inf)


def posterior_log_likelihood(
    ray: Ray, limits: tuple[float, float], grid: Grid, shapes: np.ndarray, paths: np.ndarray, prior: tuple[float, float]
) -> float:
    """Log-likelihood of a ray under Gamma posteriors of the rates (thesis, section 8.4.5)."""
    ray = _up_to_its_limit(ray, limits)
    lengths = lengths_by_cell(ray, grid)

    def posterior(cell):
        return prior if cell is None else (shapes[cell], paths[cell])

    log_pass = 0.0
    for cell, length in lengths.items():
        a, b = posterior(cell)
        log_pass += a * math.log(b / (b + length))
    end = cell_at(ray, ray.length, grid)
    a, b = posterior(end)
    return _log_likelihood(ray, log_pass, math.log(a / (b + lengths.get(end, 0.0))))


def _up_to_its_limit(ray: Ray, limits: tuple[float, float]) -> Ray:
    lengths = {RayStatus.RETURN: ray.length, RayStatus.BELOW_MINIMUM: limits[0], RayStatus.NO_RETURN: limits[1]}
    return ray._replace(length=lengths[RayStatus(ray.status)])


def _log_likelihood(ray: Ray, log_pass: float, log_rate: float) -> float:
    if ray.status == RayStatus.NO_RETURN:
        return log_pass
    if ray.status == RayStatus.BELOW_MINIMUM:
        return math.log(-math.expm1(log_pass)) if log_pass < 0 else -math.inf
    return log_rate + log_pass


def marginal_log_likelihood(shape: float, path: float, H: np.ndarray, R: np.ndarray) -> float:
    """Log of the product over cells of the integral over the rate: prior times ``rate^H exp(-rate R)``."""
    log_rate = np.linspace(-60.0, 15.0, 2001)
    rate = np.exp(log_rate)
    density = gamma.pdf(rate, shape, scale=1 / path) * rate  # in the logarithm of the rate
    seen = np.exp(H[:, None] * log_rate - rate * R[:, None])
    return float(np.log(trapezoid(density * seen, log_rate, axis=1)).sum())


def marginal_prior(H: np.ndarray, R: np.ndarray) -> tuple[float, float]:
    """Shape and path of the Gamma prior that maximizes the marginal likelihood, without its gradient."""
    found = minimize(
        lambda logs: -marginal_log_likelihood(*np.exp(logs), H, R),
        np.zeros(2),
        method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-10, "maxiter": 2000},
    )
    return float(np.exp(found.x[0])), float(np.exp(found.x[1]))


def around(ray: Ray, grid: Grid) -> tuple[Grid, tuple[int, ...]]:
    """The same raster about as far as a ray goes and a few cells more, and where the grid lies in it."""
    reach = [(at - grid.origin) / grid.resolution for at in (ray.origin, ray.origin + ray.length * ray.direction)]
    before = np.maximum(3 - np.floor(np.min(reach, axis=0)), 0).astype(int)
    behind = np.maximum(3 + np.ceil(np.max(reach, axis=0)) - grid.shape, 0).astype(int)
    origin = tuple(float(low) for low in grid.origin - before * grid.resolution)
    shape = tuple(int(n) for n in before + grid.shape + behind)
    return Grid(origin, grid.resolution, shape), tuple(int(n) for n in before)


def reflection_log_likelihood(
    ray: Ray, limits: tuple[float, float], grid: Grid, probabilities: np.ndarray, outside: float
) -> float:
    """Log-likelihood of a ray under reflection probabilities (thesis, eq. 7.16, 7.23, 7.30 to 7.32)."""
    ray = _up_to_its_limit(ray, limits)
    raster, offset = around(ray, grid)

    def mu(cell):
        index = tuple(int(i) for i in np.subtract(cell, offset))
        inside = all(0 <= i < n for i, n in zip(index, grid.shape, strict=True))
        return float(probabilities[index]) if inside else outside

    end = cell_at(ray, ray.length, raster)
    onwards = ray._replace(length=ray.length + 2 * grid.resolution)
    chords = [piece for piece in pieces(onwards, raster) if piece.cell == end]
    chord_start, chord_stop = min(piece.start for piece in chords), max(piece.stop for piece in chords)

    def log_miss(cell, part=1.0):
        return math.log1p(-part * mu(cell)) if part * mu(cell) < 1 else -math.inf

    log_pass = 0.0
    for piece in pieces(ray, raster):
        if piece.cell != end and math.floor(piece.stop / UNIT) > math.floor(piece.start / UNIT):
            log_pass += log_miss(piece.cell)
    if ray.status != RayStatus.RETURN:
        log_pass += log_miss(end, (ray.length - chord_start) / (chord_stop - chord_start))
    density = mu(end) / (chord_stop - chord_start)
    return _log_likelihood(ray, log_pass, math.log(density) if density > 0 else -math.inf)


def beta_log_marginal(alpha: float, beta: float, H: np.ndarray, M: np.ndarray) -> float:
    """Log of the product over cells of the integral over the probability: prior times ``mu^H (1 - mu)^M``."""
    logit = np.linspace(-80.0, 80.0, 8001)
    log_mu, log_rest = -np.logaddexp(0, -logit), -np.logaddexp(0, logit)
    log_prior = alpha * log_mu + beta * log_rest  # in the logit, not yet normalized
    total = trapezoid(np.exp(log_prior), logit)
    seen = np.exp(log_prior + H[:, None] * log_mu + M[:, None] * log_rest)
    return float(np.log(trapezoid(seen, logit, axis=1) / total).sum())


def beta_prior(H: np.ndarray, M: np.ndarray) -> tuple[float, float]:
    """Parameters of the Beta prior that maximizes the marginal likelihood, without its gradient."""
    found = minimize(
        lambda logs: -beta_log_marginal(*np.exp(logs), H, M),
        np.zeros(2),
        method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-10, "maxiter": 2000},
    )
    return float(np.exp(found.x[0])), float(np.exp(found.x[1]))
