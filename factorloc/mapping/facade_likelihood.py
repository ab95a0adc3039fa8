"""Facade likelihood: an end-point model whose occupied cells are the walls of a building map."""

from __future__ import annotations

import math

import numpy as np

from factorloc.mapping.distance_transform import DistanceField
from factorloc.mapping.end_point import EndPointModel
from factorloc.mapping.facades import Facades
from factorloc.mapping.grid import Grid, require_memory

__all__ = ["facade_field", "facade_likelihood"]


def facade_field(
    facades: Facades, resolution: float = 0.2, farthest: float = 3.0, margin: float = 30.0
) -> DistanceField:
    """Distances to the nearest facade, on a grid around all of them.

    Parameters
    ----------
    facades : Facades
        As mapped.
    resolution : float
        Edge of a cell, m.
    farthest : float
        Distances end here, m.
    margin : float
        Free space around the facades, m.

    Raises
    ------
    MapError
        If there is no facade, or the grid does not fit into memory.
    """
    grid = Grid.around(facades.segments.reshape(-1, 2), resolution, margin)
    require_memory(17 * math.prod(grid.shape), f"distance field of {grid.shape} cells")
    occupied = np.zeros(grid.shape, np.bool_)
    for start, end in facades.segments:
        count = math.ceil(2.0 * float(np.hypot(*(end - start))) / resolution) + 1
        cells = grid.index(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
        occupied[cells[:, 0], cells[:, 1]] = True
    return DistanceField.from_occupied(grid, occupied, farthest)


def facade_likelihood(
    facades: Facades,
    sigma: float = 0.5,
    *,
    hit: float = 0.9,
    random: float = 0.1,
    resolution: float = 0.2,
    farthest: float = 3.0,
    margin: float = 30.0,
) -> EndPointModel:
    """Likelihood of planar scans among facades, for particle filters: points near a facade are likely.

    Parameters
    ----------
    facades : Facades
        As mapped.
    sigma : float
        Standard deviation of a point's distance from the mapped wall, m; mostly the error of the map.
    hit, random : float
        Weights of walls and of everything else.
    resolution, farthest, margin
        Of :func:`facade_field`.

    Raises
    ------
    MapError
        If there is no facade, or a number is out of its range.
    """
    return EndPointModel(facade_field(facades, resolution, farthest, margin), sigma, hit, random)
