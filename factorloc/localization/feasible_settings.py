"""Feasible settings: how correspondences are intersected."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field

from factorloc.config import Block

__all__ = ["FeasibleSettings"]


class FeasibleSettings(Block):
    """How correspondences are intersected.

    Parameters
    ----------
    confidence : float
        Poses are left out that together have at most the rest of the odds. That is a statement on doubts: no interval
        operation can promise that a line is that of its wall. Published is the intersection of all.
    surprise : float
        Assumptions count as violated if the lightest correspondences that have to be false are so heavy that it was
        less probable than this that as heavy ones are.
    orthogonal : {"chain", "none"}
        Second strip of each: along the wall, by the whole row of walls in line with it, or not at all. The facade alone
        would be too tight: supporters are of its neighbours too.
    slice : float
        Width of a slice of headings, rad.
    cells : int
        Cells along the longer side of the positions that were possible.
    layers : tuple of float
        Greatest costs of the layers that are carried along, natural units of log odds.
    memory : float
        Part of the cost of a layer that counts at the next scan, which sees mostly the same walls.
    """

    confidence: float = Field(0.9999, gt=0, lt=1)
    surprise: float = Field(1e-4, ge=0, lt=1)
    orthogonal: Literal["chain", "none"] = "chain"
    slice: float = Field(math.radians(0.35), gt=0)
    cells: int = Field(64, ge=4, le=512)
    layers: tuple[float, ...] = (1.0, 3.0, 5.0, 8.0, 12.0, 18.0)
    memory: float = Field(0.2, ge=0, le=1)
