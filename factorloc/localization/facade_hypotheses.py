"""Facade hypotheses: a few beliefs of one drive, each weighed by the lines that are where it has them.

Houses of a row look alike, and where only the two sides of a street are seen, the way along it is open: a solver that
once ends at the wrong house stays there, with every wall along the street in its favour. So where too heavy lines speak
against all beliefs, another one begins anywhere in the feasible set; which one is believed is decided by all lines of
the scans since.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from factorloc.config import Block
from factorloc.geometry import wrap
from factorloc.localization.bounded_least_squares import BoundedEstimate
from factorloc.localization.correspondence import Correspondence
from factorloc.localization.least_squares_settings import LeastSquaresSettings
from factorloc.localization.line_gate import line_residuals
from factorloc.localization.wall_belief import WallBelief
from factorloc.localization.wall_lines import WallLines

__all__ = ["Hypothesis", "HypothesisSettings", "chosen", "evidence", "without_twins"]

Array = npt.NDArray[np.float64]

_WINDOW = 10.0  # m; where a false line may be


class HypothesisSettings(Block):
    """How many beliefs are kept, and when another one begins.

    Parameters
    ----------
    most : int
        Beliefs that are kept.
    places : int
        Another one begins at the best of so many places along either side of the feasible set, the first ones at all.
    doubtful : float
        Another one begins if lines that are not where the best belief has them weigh more, natural units of log odds.
    handicap : float
        By so much less it begins than the best one, natural units: that odds are against having been wrong.
    memory : float
        Part of the evidence of earlier scans that counts at the next one.
    novelty : float
        Part of the evidence of a scan that is not that of the last one, which saw mostly the same walls.
    twins_position, twins_heading : float
        Beliefs nearer than that are one, m and rad.
    """

    most: int = Field(4, gt=0)
    places: int = Field(3, gt=0)
    doubtful: float = Field(10.0, gt=0)
    handicap: float = Field(40.0, ge=0)
    memory: float = Field(1.0, ge=0, le=1)
    novelty: float = Field(0.05, gt=0, le=1)
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
        Log likelihood ratio of the lines of the scans so far.
    prior : WallBelief or None
        What it knew before the last scan; the search began at its pose.
    estimate : BoundedEstimate or None
        What the last scan gave; None if it gave nothing.
    """

    belief: WallBelief
    score: float
    prior: WallBelief | None = None
    estimate: BoundedEstimate | None = None


def evidence(
    found: Sequence[Correspondence], walls: WallLines, belief: WallBelief, settings: LeastSquaresSettings
) -> tuple[float, float]:
    """Log likelihood ratio of the lines of a scan, and the weight of those that are not where a belief has them.

    A line that is false, with its doubt p, is anywhere in a window w: the ratio is that of the mixture
    ``(1 - p) N(r; 0, s^2) + p / w`` of its residual to ``1 / w``. A belief that is sure gains by what it foretells.

    Parameters
    ----------
    found : sequence of Correspondence
        Lines of a scan.
    walls : WallLines
        The map.
    belief : WallBelief
        Before the scan.
    settings : LeastSquaresSettings
        Standard deviations, and the gate.
    """
    if not found:
        return 0.0, 0.0
    doubts = np.array([one.doubt for one in found])
    away, variance = line_residuals(found, walls, belief, settings)
    density = np.exp(-0.5 * away**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    ratio = np.log((1.0 - doubts) * density * _WINDOW + doubts)
    outside = away**2 > settings.gate**2 * variance
    return float(ratio.sum()), float(np.log((1.0 - doubts) / doubts)[outside].sum())


def chosen(hypotheses: Sequence[Hypothesis]) -> Hypothesis:
    """The one that most speaks for."""
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
