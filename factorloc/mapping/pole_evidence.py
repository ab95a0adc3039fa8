"""Poles by evidence: likelihood ratios of hits and misses instead of the published score.

The published score asks of every cell of a pole to be surely occupied, and breaks where no ray has been: between the
beams of a lidar. Here each cell weighs, by its hits and misses, the hypotheses shaft, free and clutter, each a
reflection probability with a Beta distribution of its own:

    log p(H, M | a, b) = log B(H + a, M + b) - log B(a, b).

A pole is the box and the run of slices with the greatest likelihood ratio against "all free" and "all clutter"; and
every column of the hull around it has to be free rather than part of a shaft. The evidence of a pole is the smaller
of the two.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.special import betaln

from factorloc import _jit
from factorloc.mapping._pole_evidence_kernels import best_runs, choose_boxes, fill_evidence, hull_evidence
from factorloc.mapping.pole_settings import EvidenceSettings, PoleSettings
from factorloc.mapping.poles import Poles
from factorloc.mapping.reflection_window import ReflectionWindow

__all__ = ["evidence_tables", "find_by_evidence"]

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]


def evidence_tables(settings: EvidenceSettings) -> tuple[Array, Array]:
    """Log-likelihood ratios of hits and misses of a cell, (N + 1, N + 1) for N rays at most: shaft and clutter to free.

    Parameters
    ----------
    settings : EvidenceSettings
        The three Beta distributions, and N.
    """
    h, m = np.indices((settings.most_rays + 1,) * 2, dtype=np.float64)
    shaft, free, clutter = (
        betaln(h + alpha, m + beta) - betaln(alpha, beta)
        for alpha, beta in (settings.shaft, settings.free, settings.clutter)
    )
    return np.ascontiguousarray(shaft - free), np.ascontiguousarray(clutter - free)


def find_by_evidence(window: ReflectionWindow, settings: PoleSettings, evidence: EvidenceSettings) -> Poles:
    """Find the poles in a local map.

    Parameters
    ----------
    window : ReflectionWindow
        Hits and misses.
    settings : PoleSettings
        Widths, heights and the hull.
    evidence : EvidenceSettings
        Likelihoods, and how much is enough.

    Returns
    -------
    Poles
        By falling evidence, nats, which is their score.
    """
    n_x, n_y, n_z = window.grid.shape
    shaft, clutter = np.empty((n_z, n_x + 1, n_y + 1)), np.empty((n_z, n_x + 1, n_y + 1))
    hits, misses, tables = window.rimmed_hits, window.rimmed_misses, evidence_tables(evidence)
    _jit.in_threads(lambda first, last: fill_evidence(hits, misses, *tables, first, last, shaft, clutter), n_z)
    hull = settings.hull_cells
    found: list[tuple[Index, Index, Array]] = []

    def search(first: int, last: int) -> None:
        current, best = np.empty((n_x, n_y)), np.empty((n_x, n_y))
        starts, bottoms, tops = (np.empty((n_x, n_y), np.int64) for _ in range(3))
        for width in range(first + 1, last + 1):
            best_runs(shaft, clutter, width, hull, settings.height_cells, current, starts, best, bottoms, tops)
            corners = np.argwhere(best > evidence.least)
            at = tuple(corners.T)
            boxes = np.column_stack([corners, np.full(len(corners), width)]).astype(np.int64)
            found.append((boxes, np.stack([bottoms[at], tops[at]], 1), best[at]))

    _jit.in_threads(search, settings.most_width)
    found.sort(key=lambda part: part[0][0, 2] if len(part[0]) else 0)
    boxes, slices, scores = (np.concatenate(parts) for parts in zip(*found, strict=True))
    around = np.empty(len(boxes))
    hull_evidence(shaft, boxes, slices[:, 0].copy(), slices[:, 1].copy(), hull, around)
    scores = np.minimum(scores, -around)
    enough = scores > evidence.least
    boxes, slices, scores = boxes[enough], slices[enough], scores[enough]
    order, chosen = np.argsort(-scores, kind="stable"), np.zeros(len(boxes), np.bool_)
    choose_boxes(boxes, order, hull, np.zeros((n_x, n_y), np.bool_), chosen)
    rows = order[chosen[order]]
    resolution, origin = window.grid.resolution, window.grid.origin
    return Poles(
        (boxes[rows, :2] + boxes[rows, 2:] / 2) * resolution + origin[:2],
        boxes[rows, 2] * resolution,
        slices[rows] * resolution + origin[2],
        scores[rows],
    )
