"""Facade hypotheses: a few beliefs of one drive, each weighed by how well all points of the scans fit the map there.

Houses of a row look alike, and where only the two sides of a street are seen, the way along it is open: a solver that
once ends at the wrong house stays there, with every wall along the street in its favour. So a drive begins at several
places of its first feasible set, and goes on to begin at others where these fit far better than all beliefs do. Which
one is believed is decided by the scans since.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.geometry import wrap
from factorloc.localization.bounded_least_squares import BoundedEstimate
from factorloc.localization.wall_belief import WallBelief

__all__ = ["Hypothesis", "HypothesisSettings", "chosen", "poses_of", "weighed", "without_twins"]

Array = npt.NDArray[np.float64]


class HypothesisSettings(Block):
    """How many beliefs are kept, when another one begins, and what scans tell of them.

    Parameters
    ----------
    most : int
        Beliefs that are kept, and places a drive begins at.
    doubtful : float
        Another one begins where a scan fits by so much better than with the best belief, natural units.
    handicap : float
        By so much less it begins than the best one, natural units: the odds are against having been wrong.
    settled : int
        Scans until that counts whole.
    novelty : float
        Part of a log likelihood that counts: neighbouring points are of one wall, and a scan sees what the last saw.
    spared : float
        Log likelihood that a belief may be worse than the best one of a scan, natural units: what is not on the map
        looks like walls elsewhere by chance.
    most_told : float
        No scan tells more against a belief, natural units.
    spread_position, spread_heading : float
        Standard deviations that a place begins with, m and rad.
    around : float
        A belief fits as well as the best of the poses so many standard deviations around it.
    contradicted : float
        A feasible set that is farther from the best belief, in standard deviations, violates the assumptions unless
        some place in it fits far better.
    most_contradictions : int
        So many scans in a row; then the sets are believed.
    twins_position, twins_heading : float
        Beliefs nearer than that are one, m and rad.
    """

    most: int = Field(4, gt=0)
    doubtful: float = Field(100.0, gt=0)
    handicap: float = Field(20.0, ge=0)
    settled: int = Field(10, gt=0)
    novelty: float = Field(0.05, gt=0, le=1)
    spared: float = Field(50.0, ge=0)
    most_told: float = Field(5.0, gt=0)
    spread_position: float = Field(0.5, gt=0)
    spread_heading: float = Field(math.radians(1.0), gt=0)
    around: float = Field(1.5, ge=0)
    contradicted: float = Field(5.0, gt=0)
    most_contradictions: int = Field(2, ge=0)
    twins_position: float = Field(0.5, ge=0)
    twins_heading: float = Field(math.radians(1.0), ge=0)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A belief, and what speaks for it.

    Parameters
    ----------
    belief : WallBelief
        Pose and errors of the map.
    score : float
        What the scans so far have told, never more than nothing; natural units.
    prior : WallBelief or None
        What it knew before the last scan; the search began at its pose.
    estimate : BoundedEstimate or None
        What the last scan gave; None if it gave nothing.
    fit : float
        Log likelihood of the last scan.
    """

    belief: WallBelief
    score: float
    prior: WallBelief | None = None
    estimate: BoundedEstimate | None = None
    fit: float = 0.0

    @classmethod
    def at_place(cls, place: Array, score: float, settings: HypothesisSettings) -> Hypothesis:
        """One that begins at a place."""
        sigmas = np.array([settings.spread_position, settings.spread_position, settings.spread_heading])
        return cls(WallBelief.of_pose(place, np.diag(sigmas**2)), score)


def poses_of(belief: WallBelief, sigmas: float) -> Array:
    """Poses of a belief: its own, and those so many standard deviations around it, shape (27, 3)."""
    values, vectors = np.linalg.eigh(belief.covariance[:3, :3])
    steps = np.stack(np.meshgrid(*3 * [np.array([0.0, -sigmas, sigmas])], indexing="ij"), -1).reshape(-1, 3)
    return np.asarray(belief.pose + (steps * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def weighed(hypotheses: Sequence[Hypothesis], settings: HypothesisSettings) -> list[Hypothesis]:
    """Hypotheses after a scan that each has its fit to: what is beyond the spared part of the best fit counts against.

    Parameters
    ----------
    hypotheses : sequence of Hypothesis
        All of them.
    settings : HypothesisSettings
        See there.
    """
    best = max(one.fit for one in hypotheses)
    told = [
        max(settings.novelty * min(one.fit - best + settings.spared, 0.0), -settings.most_told) for one in hypotheses
    ]
    return [replace(one, score=one.score + new) for one, new in zip(hypotheses, told, strict=True)]


def chosen(hypotheses: Sequence[Hypothesis]) -> Hypothesis:
    """The one that most speaks for; of equals, the first."""
    return max(hypotheses, key=lambda one: one.score)


def without_twins(hypotheses: Sequence[Hypothesis], settings: HypothesisSettings) -> list[Hypothesis]:
    """The best ones, of those near each other only the better."""
    kept = list[Hypothesis]()
    for one in sorted(hypotheses, key=lambda one: -one.score):
        away = [one.belief.pose - other.belief.pose for other in kept]
        near = any(
            math.hypot(x, y) < settings.twins_position and abs(wrap(turn)) < settings.twins_heading
            for x, y, turn in away
        )
        if not near and len(kept) < settings.most:
            kept.append(one)
    return kept
